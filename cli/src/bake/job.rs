//! A bake whose files are known and checked, before any picture is decoded.

use super::keys::{key_of, provenance};
use super::making::{Planned, bytes_beside};
use super::{BakeArguments, Division, Stages, load, spill_folder, split};
use crate::budget::{HELD_OUT, heat_map_files};
use crate::failure::Failure;
use crate::near::surface_bytes;
use crate::options::{Machine, check_apart, check_writable};
use crate::{notes, page};
use relight_core::{PositionMap, Provenance, Space};
use relight_fit::NearLamps;
use relight_formats::{
    AssetFormat, Cache, OpenCapture, PictureStack, Stamps, hexadecimal, open_capture, tree_hash,
};
use std::path::{Path, PathBuf};

/// What is to be made of which pictures.
pub(crate) struct Job<'a> {
    pub(crate) arguments: &'a BakeArguments,
    pub(crate) machine: Machine,
    pub(crate) format: &'static AssetFormat,
    /// All pictures, in the order of their lights' directions.
    pub(crate) all: OpenCapture,
    division: Division,
    pub(crate) provenance: Provenance,
    /// The key of the pictures that judge.
    pub(crate) judges_key: [u8; 32],
    /// Those of the pictures before the provenance was taken: what is decoded must be of it.
    pub(crate) stamps: Stamps,
    pub(crate) scene_notes: Vec<String>,
    /// What the scene reads.
    scene_files: Vec<PathBuf>,
    /// The report as .json, and as .html where that is asked for.
    pub(crate) report_files: Option<(PathBuf, Option<PathBuf>)>,
    /// Reports and heat maps.
    pub(crate) beside_asset: Vec<PathBuf>,
}

/// A job whose pictures may be decoded.
pub(crate) struct Ready<'a> {
    pub(crate) job: Job<'a>,
    pub(crate) fitted: OpenCapture,
    pub(crate) left_out: Option<OpenCapture>,
    pub(crate) lamps: Option<NearLamps>,
    pub(crate) lamps_of_judges: Option<NearLamps>,
    pub(crate) map: Option<PositionMap>,
    pub(crate) space: Space,
}

impl<'a> Job<'a> {
    /// Opens all files of `arguments` and finds what the asset will be made of.
    ///
    /// # Errors
    /// What is wrong with the options, the outputs or the files.
    pub(crate) fn open(arguments: &'a BakeArguments, stages: &mut Stages) -> Result<Self, Failure> {
        let format = AssetFormat::by_path(&arguments.output).map_err(Failure::of_output)?;
        format.check_writable(&arguments.output).map_err(Failure::of_output)?;
        Self::open_for_others(arguments, stages)
    }

    /// [`Self::open`] where the asset is not written here.
    ///
    /// # Errors
    /// As there.
    pub(crate) fn open_for_others(
        arguments: &'a BakeArguments,
        stages: &mut Stages,
    ) -> Result<Self, Failure> {
        let machine = arguments.machine.machine()?;
        let format = AssetFormat::by_path(&arguments.output).map_err(Failure::of_output)?;
        let report_files = arguments.report.as_deref().map(page::report_files).transpose()?;
        let reports: Vec<PathBuf> =
            report_files.iter().flat_map(|(json, page)| [json].into_iter().chain(page).cloned()).collect();
        for path in &reports {
            check_writable(path)?;
        }
        if let Some(folder) = &arguments.heatmaps {
            check_heat_maps(folder, arguments.report.is_some())?;
        }
        let is_stage = |name: &str| match name {
            HELD_OUT => arguments.holdout.is_some(),
            _ => arguments.textures.may_have_stage(name, format),
        };
        let heat_maps = arguments.heatmaps.iter().flat_map(|folder| heat_map_files(folder, is_stage));
        let depfile = arguments.build.file().cloned();
        let beside_asset: Vec<PathBuf> = reports.into_iter().chain(heat_maps).chain(depfile).collect();
        let all = stages.time("open", || open_capture(&arguments.input)?.by_direction())?;
        let division = Division::new(&all, arguments.holdout.as_ref())?;
        let (mut scene_notes, mut scene_files) = (Vec::new(), Vec::new());
        let wanted = arguments.positions.wanted(&machine, &mut scene_notes, &mut scene_files)?;
        let stamps = Stamps::of(&all.capture.pictures);
        let (provenance, judges_key) =
            stages.time("key", || provenance(arguments, format, &all, &division, wanted))?;
        Ok(Self {
            arguments,
            machine,
            format,
            all,
            division,
            provenance,
            judges_key,
            stamps,
            scene_notes,
            scene_files,
            report_files,
            beside_asset,
        })
    }

    /// Whether all that it is to write is there, as `cache` remembers that it was made of the same.
    pub(crate) fn is_up_to_date(&self, cache: &Cache) -> bool {
        let key = key_of(&self.provenance);
        let Some(made) = cache.made(&key) else { return false };
        let output = &self.arguments.output;
        if made.judges != self.judges_key {
            return false;
        }
        let whole = made.files.iter().all(|file| {
            beside(output, &file.suffix)
                .is_some_and(|path| tree_hash(&path).is_ok_and(|hash| hash == file.hash))
        });
        let report: serde_json::Value =
            self.report_files.as_ref().map_or_else(Default::default, |(json, _)| {
                let text = relight_formats::read_text(json).unwrap_or_default();
                serde_json::from_str(&text).unwrap_or_default()
            });
        let reported = self.report_files.is_none() || report["key"] == hexadecimal(&key);
        // Heat maps are of the stages that the report has.
        let stages = report["error_budget"]["stages"].as_array();
        let is_stage =
            |name: &str| stages.is_some_and(|stages| stages.iter().any(|stage| stage["name"] == name));
        let maps_of = |is_stage: &dyn Fn(&str) -> bool| -> Vec<PathBuf> {
            self.arguments.heatmaps.iter().flat_map(|folder| heat_map_files(folder, is_stage)).collect()
        };
        let (possible, drawn) = (maps_of(&|_| true), maps_of(&is_stage));
        let depfile = self.arguments.build.file();
        let is_other = |path: &&PathBuf| Some(*path) != depfile && !possible.contains(path);
        whole
            && reported
            && self.beside_asset.iter().filter(is_other).chain(&drawn).all(|path| path.is_file())
    }

    /// All files that it reads, each once; `left_out` are the pictures that judge.
    pub(crate) fn inputs<'b>(&'b self, left_out: Option<&'b OpenCapture>) -> Vec<&'b PathBuf> {
        let Self { arguments, .. } = self;
        let others =
            arguments.positions.files().chain(arguments.photographs.files()).chain(arguments.near.files());
        input_files(&self.all, left_out, others.chain(&self.scene_files))
    }

    /// Whether positions are asked for.
    pub(crate) fn wants_positions(&self) -> bool {
        self.provenance.storing.get("positions").is_some_and(|stored| stored == "true")
    }

    /// Whether the asset holds positions; those that serve near lamps alone need not be.
    pub(crate) fn stores_positions(&self, lamps: Option<&NearLamps>) -> bool {
        self.wants_positions() && !(lamps.is_some() && self.format.positions.is_empty())
    }

    /// The pictures that judge, as they are opened.
    pub(crate) fn judges(&self) -> Option<OpenCapture> {
        self.division.judges_of(&self.all)
    }

    /// Does what photographs, positions and lamps call for.
    ///
    /// # Errors
    /// What is wrong with them, and options that exclude each other.
    pub(crate) fn prepare(mut self, stages: &mut Stages) -> Result<Ready<'a>, Failure> {
        let Self { arguments, machine, .. } = self;
        let whole = self.all.size();
        let spill = spill_folder(&arguments.output);
        let photographs = match arguments.build.is_dry_run() {
            true => arguments.photographs.without_estimates(),
            false => arguments.photographs.clone(),
        };
        stages.time("adjust", || photographs.apply(&mut self.all, &machine, &spill))?;
        let (mut fitted, mut left_out) = split(&self.all, &self.division, &photographs)?;
        let map = match self.wants_positions() || arguments.near.is_given() {
            true => stages.time("positions", || {
                arguments.positions.read(whole, arguments.photographs.crop(), machine.memory)
            })?,
            false => None,
        };
        if arguments.near.is_given() {
            check_near(arguments)?;
        }
        let notes = &mut self.all.capture.notes;
        let lamps = arguments.near.apply(&mut fitted, whole, map.as_ref(), notes)?;
        let lamps_of_judges = match &mut left_out {
            Some(judges) => arguments.near.apply(judges, whole, map.as_ref(), &mut Vec::new())?,
            None => None,
        };
        notes::print(&self.all.capture.notes);
        let space = arguments.fit.space(&self.all);
        let ready = Ready { job: self, fitted, left_out, lamps, lamps_of_judges, map, space };
        ready.check_apart(std::slice::from_ref(&arguments.output))?;
        Ok(ready)
    }
}

impl Ready<'_> {
    /// Fails where one of `outputs`, or of what is written beside the asset, is an input or another output.
    pub(super) fn check_apart(&self, outputs: &[PathBuf]) -> Result<(), Failure> {
        check_apart(outputs.iter().chain(&self.job.beside_asset), self.job.inputs(self.left_out.as_ref()))
    }
}

/// Fails where an option excludes --near.
fn check_near(arguments: &BakeArguments) -> Result<(), Failure> {
    if arguments.fit.learns()? {
        return Err(Failure::usage(
            "--near fits functions of light; bake those of sh, hsh, srbf or ptm, and make planes of them with relight convert",
        ));
    }
    if arguments.fit.searches()? {
        return Err(Failure::usage("--near fits one choice: leave targets out and give --basis and -k"));
    }
    if arguments.fit.is_robust() {
        return Err(Failure::usage("--near and --robust exclude each other; leave one of them out"));
    }
    Ok(())
}

/// Fails where heat maps can't stand in `folder`, or nothing is known that they could show.
fn check_heat_maps(folder: &Path, reported: bool) -> Result<(), Failure> {
    let refused = |problem: &str| Err(Failure::usage(format!("--heatmaps {}: {problem}", folder.display())));
    if !reported {
        return refused("heat maps belong to the error budget of --report; give that too");
    }
    if folder.is_file() {
        return refused("is a file; name a folder");
    }
    Ok(())
}

/// What the name `file` has beyond that of `output` without its extension.
pub(super) fn suffix_of(file: &Path, output: &Path) -> Option<String> {
    let (name, stem) = (file.file_name()?.to_str()?, output.file_stem()?.to_str()?);
    name.strip_prefix(stem).map(str::to_owned)
}

/// The file beside `output` with such a name.
fn beside(output: &Path, suffix: &str) -> Option<PathBuf> {
    let stem = output.file_stem()?.to_str()?;
    Some(output.with_file_name(format!("{stem}{suffix}")))
}

/// Decodes the pictures that are fitted, within the memory that the rest leaves; what doesn't fit goes beside `output`.
pub(super) fn job_pictures(
    planned: &Planned<'_>,
    fitted: &OpenCapture,
    lamps: Option<&NearLamps>,
    (position_bytes, output): (u64, &Path),
    machine: &Machine,
    stages: &mut Stages,
) -> Result<PictureStack, Failure> {
    let near = lamps.map_or(0, |_| planned.near_bytes(fitted, machine.threads));
    let beside = [position_bytes, surface_bytes(lamps), near]
        .into_iter()
        .fold(bytes_beside(&[planned], fitted, machine), u64::saturating_add);
    let spill = spill_folder(output);
    stages.time("decode", || load(fitted, planned.model.space, machine, beside, &spill))
}

/// The files that are read, each once: of the capture, of the pictures that judge, and `others`.
pub(crate) fn input_files<'a>(
    all: &'a OpenCapture,
    left_out: Option<&'a OpenCapture>,
    others: impl Iterator<Item = &'a PathBuf>,
) -> Vec<&'a PathBuf> {
    let captures = [all].into_iter().chain(left_out);
    let files = captures.flat_map(|open| {
        let pictures = open.as_listed().into_iter().map(|i| &open.capture.pictures[i]);
        pictures.chain([&open.capture.light_file])
    });
    let mut files: Vec<&PathBuf> = files.chain(others).collect();
    let mut seen = std::collections::HashSet::new();
    files.retain(|file| seen.insert(*file));
    files
}
