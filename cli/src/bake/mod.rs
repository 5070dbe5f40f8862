//! `relight bake`: pictures in, asset out.

mod fit;
mod fit_options;
mod making;
mod positions;
mod report;
pub(crate) mod textures;
mod versions;

use crate::budget::{Account, Judges, heat_map_files};
use crate::evaluate::{Evaluation, PixelError};
use crate::failure::Failure;
use crate::holdout::Holdout;
use crate::near::{NearOptions, surface_bytes};
use crate::options::{Machine, MachineOptions, check_apart, check_writable};
use crate::photograph_options::PhotographOptions;
use crate::{evaluate, interrupt, notes, page, progress, sweep};
use clap::Args;
pub(crate) use fit::BakeFit;
pub(crate) use fit_options::{Color, FitOptions, TargetOptions};
pub(crate) use making::{Made, Planned, Samples, bytes_beside, make};
use relight_core::{Space, Stack};
use relight_fit::{LevelledStack, NearLamps};
use relight_formats::{
    AssetFormat, AssetPositions, OpenCapture, PictureStack, ScratchFolder, StackSettings, open_capture,
    place_of,
};
use std::path::{Path, PathBuf};
use std::time::Instant;
pub(crate) use versions::Versions;

/// What to fit and how. Every option is also a key of a TOML job file given as INPUT.
#[derive(Args, Debug)]
pub(crate) struct BakeArguments {
    /// A .lp file, a folder that holds one, or a .toml job file
    input: PathBuf,
    /// The asset to write: .ktx2, .dds, .exr, .ptm, .rti, or .web for a folder
    #[arg(short, long, value_name = "FILE")]
    output: PathBuf,
    #[command(flatten)]
    fit: FitOptions,
    #[command(flatten)]
    photographs: PhotographOptions,
    #[command(flatten)]
    near: NearOptions,
    #[command(flatten)]
    textures: textures::TextureOptions,
    #[command(flatten)]
    positions: positions::PositionOptions,
    /// Pictures to leave out and judge by: every:N, random:N, random:N:SEED or FILE.lp
    #[arg(long, value_name = "WHICH")]
    holdout: Option<Holdout>,
    /// Write figures of the fit, each light's errors, what error each stage adds and times as .json, or as a .html page that
    /// shows and relights the asset, with the .json beside it; until that is known, coefficients take 4 bytes each in a folder
    /// beside the output, and a fifth where there are blocks or JPEG
    #[arg(long, value_name = "FILE")]
    report: Option<PathBuf>,
    /// With --report: write the error of each pixel after each stage as heatmap-STAGE.png; black is 0, white 0.25 and more
    #[arg(long, value_name = "FOLDER")]
    heatmaps: Option<PathBuf>,
    #[command(flatten)]
    machine: MachineOptions,
}

/// Seconds that each stage took, in order.
#[derive(Clone, Default)]
pub(crate) struct Stages(pub(crate) Vec<(&'static str, f64)>);

impl Stages {
    /// Adds those of a part of the work.
    pub(crate) fn add(&mut self, part: &Self) {
        self.0.extend_from_slice(&part.0);
    }

    /// The seconds of each stage, those that came several times added up, in order of the first.
    pub(crate) fn summed(&self) -> Vec<(&'static str, f64)> {
        let mut summed: Vec<(&'static str, f64)> = Vec::new();
        for &(stage, seconds) in &self.0 {
            match summed.iter_mut().find(|(other, _)| *other == stage) {
                Some((_, sum)) => *sum += seconds,
                None => summed.push((stage, seconds)),
            }
        }
        summed
    }

    pub(crate) fn time<T>(&mut self, stage: &'static str, work: impl FnOnce() -> T) -> T {
        let start = Instant::now();
        let result = work();
        self.0.push((stage, start.elapsed().as_secs_f64()));
        result
    }
}

/// Runs the subcommand.
pub(crate) fn run(arguments: &BakeArguments) -> Result<(), Failure> {
    let machine = arguments.machine.machine()?;
    let format = AssetFormat::by_path(&arguments.output).map_err(Failure::of_output)?;
    format.check_writable(&arguments.output).map_err(Failure::of_output)?;
    let report_files = arguments.report.as_deref().map(page::report_files).transpose()?;
    let reports: Vec<PathBuf> =
        report_files.iter().flat_map(|(json, page)| [json].into_iter().chain(page).cloned()).collect();
    for path in &reports {
        check_writable(path)?;
    }
    if let Some(folder) = &arguments.heatmaps {
        check_heat_maps(folder, arguments.report.is_some())?;
    }
    let spill_folder = spill_folder(&arguments.output);
    let mut stages = Stages::default();

    let mut all = stages.time("open", || open_capture(&arguments.input))?;
    let whole = all.size();
    stages.time("adjust", || arguments.photographs.apply(&mut all, &machine, &spill_folder))?;
    let (mut fitted, mut left_out) = split(&all, arguments.holdout.as_ref(), &arguments.photographs)?;
    let mut scene_notes = Vec::new();
    let wanted = arguments.positions.wanted(&machine, &mut scene_notes)?;
    let map = match wanted || arguments.near.is_given() {
        true => stages.time("positions", || {
            arguments.positions.read(whole, arguments.photographs.crop(), machine.memory)
        })?,
        false => None,
    };
    if arguments.near.is_given() && arguments.fit.learns()? {
        return Err(Failure::usage(
            "--near fits functions of light; bake those of sh, hsh, srbf or ptm, and make planes of them with relight convert",
        ));
    }
    if arguments.near.is_given() && arguments.fit.searches()? {
        return Err(Failure::usage("--near fits one choice: leave targets out and give --basis and -k"));
    }
    if arguments.near.is_given() && arguments.fit.is_robust() {
        return Err(Failure::usage("--near and --robust exclude each other; leave one of them out"));
    }
    let lamps = arguments.near.apply(&mut fitted, whole, map.as_ref(), &mut all.capture.notes)?;
    let lamps_of_judges = match &mut left_out {
        Some(judges) => arguments.near.apply(judges, whole, map.as_ref(), &mut Vec::new())?,
        None => None,
    };
    notes::print(&all.capture.notes);
    let others =
        arguments.positions.files().chain(arguments.photographs.files()).chain(arguments.near.files());
    let inputs = input_files(&all, left_out.as_ref(), others);
    let beside_asset: Vec<PathBuf> =
        reports.iter().cloned().chain(arguments.heatmaps.iter().flat_map(|f| heat_map_files(f))).collect();
    check_apart(std::iter::once(&arguments.output).chain(&beside_asset), inputs.iter().copied())?;
    let space = arguments.fit.space(&all);
    let stored = wanted && !(lamps.is_some() && format.positions.is_empty());
    if wanted && !stored {
        scene_notes
            .push(format!("{}: holds no positions; they serve --near alone", arguments.output.display()));
    }
    let precision = arguments.positions.precision(format, &arguments.output, stored)?;
    let positions = precision.zip(map).map(|(precision, map)| AssetPositions { map, precision });
    let position_bytes =
        positions.as_ref().map_or(0, |positions| size_of_val(&positions.map.points[..])) as u64;
    let (found, decoded) = match arguments.fit.searches()? {
        true => {
            let (left_out, spill, beside) = (left_out.as_ref(), spill_folder.as_path(), position_bytes);
            let opened = sweep::Opened { fitted: &fitted, left_out, space, machine, spill, beside };
            let (found, pictures) = search(arguments, &opened, &mut stages)?;
            (Some(found), Some(pictures))
        }
        false => (None, None),
    };
    let (fit, textures) = match &found {
        Some(found) => (&found.fit, &found.textures),
        None => (&arguments.fit, &arguments.textures),
    };
    let mut planned = Planned::new(&arguments.output, fit, textures, &fitted, space, &machine)?;

    let near = lamps.as_ref().map_or(0, |_| planned.near_bytes(&fitted, machine.threads));
    let beside = [position_bytes, surface_bytes(lamps.as_ref()), near]
        .into_iter()
        .fold(bytes_beside(&[&planned], &fitted, &machine), u64::saturating_add);
    let pictures = match decoded {
        Some(pictures) => pictures,
        None => stages.time("decode", || load(&fitted, space, &machine, beside, &spill_folder))?,
    };
    let levelled =
        lamps.as_ref().map(|lamps| LevelledStack { stack: &pictures, lamps, space, level: machine.level });
    let stack: &dyn Stack = levelled.as_ref().map_or(&pictures, |levelled| levelled);
    let mut fit = stages.time("solve", || planned.solve(&fitted, &Samples::new(stack), lamps.as_ref()))?;
    let position_facts = positions.as_ref().map(positions::PositionFacts::of);
    let check =
        |outputs: &[PathBuf]| check_apart(outputs.iter().chain(&beside_asset), inputs.iter().copied());
    let scratch = match &arguments.report {
        Some(_) => versions_folder(&planned, lamps.as_ref(), &machine, &mut scene_notes)?,
        None => None,
    };
    planned.keep_versions_in = scratch.as_ref().map(|folder| folder.path().to_owned());
    let mut made = make(&mut [&mut planned], &fit, stack, positions, &machine, &mut stages, &check)?;
    let Made { plan, packed, versions, .. } = made.swap_remove(0);
    fit.notes.extend(found.as_ref().map(|found| found.why.clone()));
    fit.notes.append(&mut scene_notes);
    fit.notes.extend(textures::size_note(&plan.packing, fitted.size().0, fitted.size().1));
    fit.notes.extend(position_facts.as_ref().and_then(|facts| facts.note.clone()));
    let spilled = pictures.spilled_bytes();
    drop(pictures);

    let left_out = left_out.as_ref().map(|capture| Judges { capture, lamps: lamps_of_judges.as_ref() });
    let (budget, judged) = match &versions {
        Some(versions) => {
            let seen = Judges { capture: &fitted, lamps: lamps.as_ref() };
            let account = Account { asset: &arguments.output, versions, seen, left_out, machine: &machine };
            let (budget, judged) = stages.time("error budget", || account.settle())?;
            (Some(budget), left_out.map(|_| judged))
        }
        None => (None, judged_by(&arguments.output, left_out, &machine, &mut stages)?),
    };
    drop(scratch);
    let summary = report::Summary {
        fit: &fit,
        fitted: &fitted,
        notes: &all.capture.notes,
        judged: judged.as_ref(),
        budget: budget.as_ref(),
        stages: &stages,
        spilled,
        model: &planned.model,
        plan: &plan,
        packed: &packed,
        positions: position_facts.as_ref(),
    };
    summary.print(&arguments.output);
    if let Some((json, page)) = &report_files {
        let report = summary.json(&arguments.output);
        relight_formats::write_whole(json, format!("{report:#}\n").as_bytes())?;
        if let Some(page) = page {
            let captures = (&fitted, left_out.map(|judges| judges.capture));
            page::write_bake_page(page, &report, &arguments.output, captures, budget.as_ref(), &machine)?;
        }
    }
    if let (Some(folder), Some(budget)) = (&arguments.heatmaps, &budget) {
        budget.write_heat_maps(folder)?;
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

/// A folder for the versions of an asset, gone when it is dropped; a note instead where they could not be read back.
fn versions_folder(
    planned: &Planned<'_>,
    lamps: Option<&NearLamps>,
    machine: &Machine,
    notes: &mut Vec<String>,
) -> Result<Option<ScratchFolder>, Failure> {
    let needed = planned.float_bytes().saturating_add(surface_bytes(lamps));
    if needed > machine.memory {
        let mib = |bytes: u64| bytes.div_ceil(1 << 20);
        notes.push(format!(
            "no error budget: the coefficients as floats take {} MiB, --memory allows {}",
            mib(needed),
            mib(machine.memory)
        ));
        return Ok(None);
    }
    Ok(Some(ScratchFolder::beside(&planned.output)?))
}

/// What pictures that were left out say of the asset at `output`.
fn judged_by(
    output: &Path,
    left_out: Option<Judges<'_>>,
    machine: &Machine,
    stages: &mut Stages,
) -> Result<Option<Evaluation>, Failure> {
    let Some(Judges { capture, lamps }) = left_out else { return Ok(None) };
    let judge = || evaluate::evaluate(output, capture, lamps, machine, PixelError::None);
    Ok(Some(stages.time("hold-out", judge)?))
}

/// The choice that the targets take, and the decoded pictures. What it measures is written to a folder that is gone afterwards.
fn search(
    arguments: &BakeArguments,
    opened: &sweep::Opened<'_>,
    stages: &mut Stages,
) -> Result<(sweep::Found, PictureStack), Failure> {
    let folder = ScratchFolder::beside(&arguments.output)?;
    let scratch =
        folder.path().join("asset").with_extension(arguments.output.extension().unwrap_or_default());
    sweep::search(opened, &arguments.fit, &arguments.textures, &scratch, stages)
}

/// The files that are read, each once: of the capture, of the pictures that judge, and `others`.
pub(crate) fn input_files<'a>(
    all: &'a OpenCapture,
    left_out: Option<&'a OpenCapture>,
    others: impl Iterator<Item = &'a PathBuf>,
) -> Vec<&'a PathBuf> {
    let captures = [all].into_iter().chain(left_out);
    let files = captures.flat_map(|open| open.capture.pictures.iter().chain([&open.capture.light_file]));
    let mut files: Vec<&PathBuf> = files.chain(others).collect();
    let mut seen = std::collections::HashSet::new();
    files.retain(|file| seen.insert(*file));
    files
}

/// The pictures to fit, and those to judge the fit by.
pub(crate) fn split(
    all: &OpenCapture,
    holdout: Option<&Holdout>,
    photographs: &PhotographOptions,
) -> Result<(OpenCapture, Option<OpenCapture>), Failure> {
    let (kept, judge) = match holdout {
        None => return Ok((all.clone(), None)),
        Some(Holdout::File(path)) => {
            let mut judge = open_capture(path)?;
            notes::print(&judge.capture.notes);
            evaluate::check_size((all.infos[0].width, all.infos[0].height), &all.capture.light_file, &judge)?;
            photographs.apply_to_judges(&mut judge, all)?;
            let places: Vec<_> = judge.capture.pictures.iter().filter_map(|path| place_of(path)).collect();
            let is_judge = |path: &Path| place_of(path).is_some_and(|place| places.contains(&place));
            let kept: Vec<usize> =
                (0..all.infos.len()).filter(|&i| !is_judge(&all.capture.pictures[i])).collect();
            (kept, judge)
        }
        Some(rule) => {
            let out = rule.indices(all.infos.len());
            let kept: Vec<usize> = (0..all.infos.len()).filter(|i| !out.contains(i)).collect();
            (kept, all.select(&out))
        }
    };
    if kept.is_empty() || judge.infos.is_empty() {
        let message = format!(
            "--holdout leaves {} of {} pictures to fit and {} to judge by; both must be at least 1",
            kept.len(),
            all.infos.len(),
            judge.infos.len()
        );
        return Err(Failure::usage(message));
    }
    Ok((all.select(&kept), Some(judge)))
}

/// Where pictures that exceed the memory go when `output` is written: TMPDIR, where that is set, or else beside it.
pub(crate) fn spill_folder(output: &Path) -> PathBuf {
    match std::env::var_os("TMPDIR") {
        Some(folder) => PathBuf::from(folder),
        None => output.parent().filter(|p| !p.as_os_str().is_empty()).unwrap_or(Path::new(".")).to_owned(),
    }
}

/// Decodes the pictures of `capture` within the machine's memory less `kept_back`; what doesn't fit goes to a temporary file
/// in `spill_folder`.
pub(crate) fn load(
    capture: &OpenCapture,
    space: Space,
    machine: &Machine,
    kept_back: u64,
    spill_folder: &Path,
) -> Result<PictureStack, Failure> {
    let bar = progress::bar("decoding", capture.infos.len());
    let settings = StackSettings {
        space,
        memory: machine.memory,
        kept_back,
        threads: machine.threads,
        spill_folder,
        level: machine.level,
        cancel: interrupt::flag(),
        progress: &|done| bar.set_position(done as u64),
    };
    let stack = PictureStack::load(capture, &settings)?;
    bar.finish_and_clear();
    Ok(stack)
}
