//! `relight bake`: pictures in, asset out.

mod cache_options;
mod division;
mod fit;
mod fit_options;
mod job;
mod kept;
mod keys;
mod making;
mod positions;
mod report;
mod source;
pub(crate) mod textures;
mod versions;

use crate::budget::{Account, Budget, Judges};
use crate::depfile::BuildOptions;
use crate::evaluate::{Evaluation, PixelError};
use crate::failure::Failure;
use crate::holdout::Holdout;
use crate::near::{NearOptions, surface_bytes};
use crate::options::{Machine, MachineOptions};
use crate::photograph_options::PhotographOptions;
use crate::say::say;
use crate::{evaluate, interrupt, progress, sweep};
use cache_options::CacheOptions;
use clap::Args;
pub(crate) use division::{Division, split};
pub(crate) use fit::BakeFit;
pub(crate) use fit_options::{Color, FitOptions, TargetOptions};
use job::suffix_of;
pub(crate) use job::{Job, Ready, input_files};
use kept::CacheUse;
pub(crate) use kept::Keeper;
pub(crate) use keys::{fit_key_of, key_of};
pub(crate) use making::{Coefficients, Made, Planned, Samples, bytes_beside, make};
use relight_core::Space;
use relight_fit::NearLamps;
use relight_formats::{
    AssetPositions, Cache, MadeFile, OpenCapture, PictureStack, ScratchFolder, StackSettings, bytes_on_disk,
    tree_hash,
};
pub(crate) use source::{Keeping, Source};
use std::path::{Path, PathBuf};
use std::time::Instant;
pub(crate) use versions::Versions;

/// What to fit and how. Every option is also a key of a TOML job file given as INPUT.
#[derive(Args, Debug)]
pub(crate) struct BakeArguments {
    /// A .lp file, a folder that holds one, or a .toml job file (- for one on standard input); several job files are baked one
    /// after another
    input: PathBuf,
    /// The asset to write: .ktx2, .dds, .exr, .ptm, .rti, or .web for a folder
    #[arg(short, long, value_name = "FILE")]
    pub(crate) output: PathBuf,
    #[command(flatten)]
    pub(crate) fit: FitOptions,
    #[command(flatten)]
    photographs: PhotographOptions,
    #[command(flatten)]
    near: NearOptions,
    #[command(flatten)]
    pub(crate) textures: textures::TextureOptions,
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
    cache: CacheOptions,
    #[command(flatten)]
    pub(crate) build: BuildOptions,
    #[command(flatten)]
    machine: MachineOptions,
}

impl BakeArguments {
    /// Notes the job file that they come from.
    pub(crate) fn set_job_file(&mut self, path: PathBuf) {
        self.build.set_job_file(path);
    }
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

impl BakeArguments {
    /// Whether targets choose what is fitted.
    ///
    /// # Errors
    /// Exit code 2 for options that exclude each other.
    pub(crate) fn searches(&self) -> Result<bool, Failure> {
        self.fit.searches()
    }
}

/// Runs the subcommand.
pub(crate) fn run(arguments: &BakeArguments) -> Result<(), Failure> {
    let mut stages = Stages::default();
    let job = Job::open(arguments, &mut stages)?;
    let judges = job.judges();
    let depfile = arguments.build.depfile(&arguments.output, job.inputs(judges.as_ref()))?;
    if arguments.build.is_dry_run() {
        return dry_run(job, stages);
    }
    let cache = arguments.cache.open();
    match cache.as_ref().is_some_and(|cache| job.is_up_to_date(cache)) {
        true => say!("{}: up to date", arguments.output.display()),
        false => bake(job, Keeping::In(cache), stages)?,
    }
    depfile.map_or(Ok(()), |depfile| depfile.write())
}

/// Says what [`bake`] would read and write, and checks what can be checked without decoding.
fn dry_run(job: Job<'_>, mut stages: Stages) -> Result<(), Failure> {
    let ready = job.prepare(&mut stages)?;
    let Ready { job, fitted, left_out, lamps, space, .. } = &ready;
    let Job { arguments, machine, format, beside_asset, .. } = job;
    let stored = job.stores_positions(lamps.as_ref());
    arguments.positions.precision(format, &arguments.output, stored)?;
    let files = match arguments.searches()? {
        // What the targets take is known afterwards.
        true => vec![arguments.output.clone()],
        false => {
            let BakeArguments { output, fit, textures, .. } = arguments;
            Planned::new(output, fit, textures, fitted, *space, machine, None)?.files(stored)?
        }
    };
    ready.check_apart(&files)?;
    let inputs = job.inputs(left_out.as_ref());
    arguments.build.say_files(inputs.iter().copied(), files.iter().chain(beside_asset));
    Ok(())
}

/// Makes the asset of `job`.
pub(crate) fn bake(job: Job<'_>, keeping: Keeping, mut stages: Stages) -> Result<(), Failure> {
    let mut ready = job.prepare(&mut stages)?;
    let mut notes = std::mem::take(&mut ready.job.scene_notes);
    let positions = positions_of(&mut ready, &mut notes)?;
    let surface_bytes =
        positions.as_ref().map_or(0, |positions| size_of_val(&positions.map.points[..])) as u64;
    let Ready { job, fitted, lamps, space, .. } = &ready;
    let Job { arguments, machine, provenance, .. } = job;
    let (found, decoded) = search(&ready, surface_bytes, &mut stages)?.unzip();
    let (fit, textures) = match &found {
        Some(found) => (&found.fit, &found.textures),
        None => (&arguments.fit, &arguments.textures),
    };
    let mut keeper = match (&keeping, &found) {
        // What a search finds, it has measured on the way.
        (Keeping::In(_), Some(_)) => None,
        _ => keeping.keeper(&ready),
    };
    let plan = |known| -> Result<_, Failure> {
        let mut planned = Planned::new(&arguments.output, fit, textures, fitted, *space, machine, known)?;
        planned.model.provenance = Some(Box::new(provenance.clone()));
        Ok(planned)
    };
    let (place, pictures) = ((&keeping, &mut keeper), (decoded, surface_bytes));
    let (mut planned, mut source) = Source::find(&ready, &plan, place, pictures, &mut notes, &mut stages)?;
    let scratch = match &arguments.report {
        Some(_) => versions_folder(&planned, lamps.as_ref(), machine, &mut notes)?,
        None => None,
    };
    planned.keep_versions_in = scratch.as_ref().map(|folder| folder.path().to_owned());
    let position_facts = positions.as_ref().map(positions::PositionFacts::of);
    let distributions = keeper.as_mut().map(Keeper::distributions).unwrap_or_default();
    let kept = distributions.len();
    let mut coefficients = Coefficients { fit: &source.fit, stack: &*source.stack, distributions };
    let check = |outputs: &[PathBuf]| ready.check_apart(outputs);
    let mut made = make(&mut [&mut planned], &mut coefficients, positions, machine, &mut stages, &check)?;
    if let (Keeping::In(_), Some(keeper)) = (&keeping, &keeper)
        && coefficients.distributions.len() != kept
    {
        // Where they can't be kept, the next bake finds them again.
        drop(keeper.folder.keep_distributions(&coefficients.distributions));
    }
    let Made { plan, packed, versions, files, .. } = made.swap_remove(0);
    let fit = &mut source.fit;
    fit.notes.extend(fit.misfit_notes(fitted));
    fit.notes.extend(found.as_ref().map(|found| found.why.clone()));
    fit.notes.append(&mut notes);
    fit.notes.extend(textures::size_note(&plan.packing, fitted.size().0, fitted.size().1));
    fit.notes.extend(position_facts.as_ref().and_then(|facts| facts.note.clone()));
    // Of a cache that could not be used there is nothing to say.
    let cache_use = keeper.as_ref().map(|keeper| keeper.counts).filter(|used| *used != CacheUse::default());
    fit.notes.extend(cache_use.and_then(CacheUse::note));

    let (budget, judged) = judge(&ready, versions.as_ref(), &mut stages)?;
    drop(scratch);
    report::Summary {
        ready: &ready,
        fit,
        cache: cache_use,
        judged: judged.as_ref(),
        budget: budget.as_ref(),
        stages: &stages,
        spilled: source.spilled,
        model: &planned.model,
        plan: &plan,
        packed: &packed,
        positions: position_facts.as_ref(),
    }
    .tell()?;
    if let Keeping::In(Some(cache)) = &keeping {
        remember(cache, job, &files);
        if let Some(keeper) = keeper.as_ref().filter(|keeper| keeper.counts.fitted > 0) {
            cache.grown_by(bytes_on_disk(keeper.folder.path()));
        }
    }
    Ok(())
}

/// The positions that the asset gets; a note where it gets none though they are given.
fn positions_of(ready: &mut Ready<'_>, notes: &mut Vec<String>) -> Result<Option<AssetPositions>, Failure> {
    let Job { arguments: BakeArguments { output, positions, .. }, format, .. } = &ready.job;
    let stored = ready.job.stores_positions(ready.lamps.as_ref());
    if !stored && ready.job.wants_positions() {
        notes.push(format!("{}: holds no positions; they serve --near alone", output.display()));
    }
    let precision = positions.precision(format, output, stored)?;
    Ok(precision.zip(ready.map.take()).map(|(precision, map)| AssetPositions { map, precision }))
}

/// Notes in the cache what was made; where it can't be, the next bake makes it again.
fn remember(cache: &Cache, job: &Job<'_>, files: &[PathBuf]) {
    let Job { arguments, provenance, judges_key, .. } = job;
    let output = &arguments.output;
    let hashed =
        |file: &PathBuf| Some(MadeFile { suffix: suffix_of(file, output)?, hash: tree_hash(file).ok()? });
    if let Some(files) = files.iter().map(hashed).collect::<Option<Vec<_>>>()
        && let Ok(text) = serde_json::to_string(provenance)
    {
        drop(cache.keep_made(
            &key_of(provenance),
            &relight_formats::Made { provenance: text, judges: *judges_key, files },
        ));
    }
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

/// What each stage of making the asset cost, where its `versions` were kept, and what pictures that were left out say of it.
fn judge(
    ready: &Ready<'_>,
    versions: Option<&Versions>,
    stages: &mut Stages,
) -> Result<(Option<Budget>, Option<Evaluation>), Failure> {
    let Ready { job, fitted, lamps, left_out, lamps_of_judges, .. } = ready;
    let (asset, machine) = (job.arguments.output.as_path(), &job.machine);
    let left_out = left_out.as_ref().map(|capture| Judges { capture, lamps: lamps_of_judges.as_ref() });
    if let Some(versions) = versions {
        let seen = Judges { capture: fitted, lamps: lamps.as_ref() };
        let account = Account { asset, versions, seen, left_out, machine };
        let (budget, judged) = stages.time("error budget", || account.settle())?;
        return Ok((Some(budget), left_out.map(|_| judged)));
    }
    let Some(Judges { capture, lamps }) = left_out else { return Ok((None, None)) };
    let judge = || evaluate::evaluate(asset, capture, lamps, machine, PixelError::None);
    Ok((None, Some(stages.time("hold-out", judge)?)))
}

/// The choice that targets take, where there are some, and the decoded pictures. What it measures is written to a folder that is
/// gone afterwards.
fn search(
    ready: &Ready<'_>,
    surface_bytes: u64,
    stages: &mut Stages,
) -> Result<Option<(sweep::Found, PictureStack)>, Failure> {
    let Ready { job: Job { arguments, machine, .. }, fitted, left_out, space, .. } = ready;
    if !arguments.searches()? {
        return Ok(None);
    }
    let output = &arguments.output;
    let opened = sweep::Opened {
        fitted,
        left_out: left_out.as_ref(),
        space: *space,
        machine: *machine,
        spill: &spill_folder(output),
        beside: surface_bytes,
    };
    let folder = ScratchFolder::beside(output)?;
    let scratch = folder.path().join("asset").with_extension(output.extension().unwrap_or_default());
    sweep::search(&opened, &arguments.fit, &arguments.textures, &scratch, stages).map(Some)
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
