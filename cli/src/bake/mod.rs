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
pub(crate) mod textures;
mod versions;

use crate::budget::{Account, Judges};
use crate::depfile::BuildOptions;
use crate::evaluate::{Evaluation, PixelError};
use crate::failure::{Exit, Failure};
use crate::holdout::Holdout;
use crate::near::{NearOptions, surface_bytes};
use crate::options::{Machine, MachineOptions, check_apart};
use crate::photograph_options::PhotographOptions;
use crate::say::{say, write_product};
use crate::{evaluate, interrupt, page, progress, sweep};
use cache_options::CacheOptions;
use clap::Args;
pub(crate) use division::{Division, split};
pub(crate) use fit::BakeFit;
pub(crate) use fit_options::{Color, FitOptions, TargetOptions};
use job::suffix_of;
pub(crate) use job::{Job, Ready, input_files, job_pictures};
pub(crate) use kept::{CacheUse, Facts, KeepError, Keeper};
pub(crate) use keys::{fit_key_of, key_of};
pub(crate) use making::{Coefficients, Made, Planned, Samples, bytes_beside, make};
use relight_core::{Space, Stack};
use relight_fit::{LevelledStack, NearLamps};
use relight_formats::{
    AssetPositions, Cache, FitFolder, MadeFile, OpenCapture, PictureStack, ScratchFolder, StackSettings,
    TileStack, bytes_on_disk, hexadecimal, tree_hash,
};
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
    let Ready { job, fitted, left_out, lamps, space, .. } = job.prepare(&mut stages)?;
    let Job { arguments, machine, format, beside_asset, .. } = &job;
    let stored = job.stores_positions(lamps.as_ref());
    arguments.positions.precision(format, &arguments.output, stored)?;
    let files = match arguments.searches()? {
        // What the targets take is known afterwards.
        true => vec![arguments.output.clone()],
        false => {
            let Job { arguments: BakeArguments { output, fit, textures, .. }, .. } = &job;
            Planned::new(output, fit, textures, &fitted, space, machine, None)?.files(stored)?
        }
    };
    let inputs = job.inputs(left_out.as_ref());
    check_apart(files.iter().chain(beside_asset), inputs.iter().copied())?;
    arguments.build.say_files(inputs.iter().copied(), files.iter().chain(beside_asset));
    Ok(())
}

/// What becomes of coefficients on their way.
pub(crate) enum Keeping {
    /// They are kept in a cache and taken from it, where there is one.
    In(Option<Cache>),
    /// They are those of all shards.
    Merged(FitFolder),
}

/// Makes the asset of `job`.
pub(crate) fn bake(job: Job<'_>, keeping: Keeping, mut stages: Stages) -> Result<(), Failure> {
    let Ready { mut job, fitted, left_out, lamps, lamps_of_judges, map, space } = job.prepare(&mut stages)?;
    let mut scene_notes = std::mem::take(&mut job.scene_notes);
    let Job { arguments, machine, format, all, provenance, beside_asset, .. } = &job;
    let spill_folder = spill_folder(&arguments.output);
    let inputs = job.inputs(left_out.as_ref());
    let stored = job.stores_positions(lamps.as_ref());
    if !stored && job.wants_positions() {
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
            let opened = sweep::Opened { fitted: &fitted, left_out, space, machine: *machine, spill, beside };
            let (found, pictures) = search(arguments, &opened, &mut stages)?;
            (Some(found), Some(pictures))
        }
        false => (None, None),
    };
    let (fit, textures) = match &found {
        Some(found) => (&found.fit, &found.textures),
        None => (&arguments.fit, &arguments.textures),
    };
    let mut keeper = match &keeping {
        // What a search finds, it has measured on the way.
        Keeping::In(_) if found.is_some() => None,
        Keeping::In(cache) => cache.as_ref().map(|cache| cache.fit(fit_key_of(provenance))),
        Keeping::Merged(folder) => Some(folder.clone()),
    }
    .map(|folder| Keeper::new(folder, fitted.size()));
    let plan = |known| -> Result<_, Failure> {
        let mut planned = Planned::new(&arguments.output, fit, textures, &fitted, space, machine, known)?;
        planned.model.provenance = Some(Box::new(provenance.clone()));
        Ok(planned)
    };
    let facts = keeper.as_mut().and_then(Keeper::facts);
    let basis = facts.as_ref().and_then(Facts::basis);
    let is_known = basis.is_some();
    let mut planned = plan(basis)?;
    if let Keeping::In(Some(cache)) = &keeping
        && keeper.is_some()
        && !cache.has_room_for(planned.float_bytes())
    {
        keeper = None;
        scene_notes.push("the coefficients are more than --cache-size allows and are not kept".to_owned());
    }
    let taken = stages.time("cache", || match (&mut keeper, facts) {
        (Some(keeper), Some(facts)) if is_known => keeper.take_up(facts, &planned.model),
        _ => None,
    });
    if taken.is_none() && is_known {
        planned = plan(None)?;
    }
    let scratch_fit = match keeper.is_none() && planned.fits_slowly_and_twice() {
        // Where there is no room the fit is done twice.
        true => ScratchFolder::beside(&arguments.output).ok(),
        false => None,
    };
    let (pictures, levelled, tiles);
    let mut spilled = 0;
    let (mut fit, stack): (BakeFit<'_>, &dyn Stack) = match taken {
        Some((fit, found)) => {
            tiles = found;
            (fit, &tiles)
        }
        None if matches!(keeping, Keeping::Merged(_)) => {
            let message = format!("{}: what the shards computed is not whole", arguments.output.display());
            return Err(Failure::new(Exit::BadInput, message));
        }
        None => {
            pictures = match decoded {
                Some(pictures) => pictures,
                None => {
                    let place = (position_bytes, arguments.output.as_path());
                    job_pictures(&planned, &fitted, lamps.as_ref(), place, machine, &mut stages)?
                }
            };
            job.stamps.check()?;
            spilled = pictures.spilled_bytes();
            levelled = lamps.as_ref().map(|lamps| LevelledStack {
                stack: &pictures,
                lamps,
                space,
                level: machine.level,
            });
            let stack: &dyn Stack = levelled.as_ref().map_or(&pictures, |levelled| levelled);
            let fit =
                stages.time("solve", || planned.solve(&fitted, &Samples::new(stack), lamps.as_ref()))?;
            let mut scratch = scratch_fit.as_ref().map(|folder| {
                Keeper::new(FitFolder::new(folder.path().to_owned(), fit_key_of(provenance)), fitted.size())
            });
            let (keeper, notes) = match keeper.as_mut() {
                Some(keeper) => (Some(keeper), &mut scene_notes),
                None => (scratch.as_mut(), &mut Vec::new()),
            };
            match keep(keeper, &planned, &fit, stack, machine, notes, &mut stages)? {
                Some((fit, found)) => {
                    tiles = found;
                    (fit, &tiles)
                }
                None => (fit, stack),
            }
        }
    };
    let position_facts = positions.as_ref().map(positions::PositionFacts::of);
    let check = |outputs: &[PathBuf]| check_apart(outputs.iter().chain(beside_asset), inputs.iter().copied());
    let scratch = match &arguments.report {
        Some(_) => versions_folder(&planned, lamps.as_ref(), machine, &mut scene_notes)?,
        None => None,
    };
    planned.keep_versions_in = scratch.as_ref().map(|folder| folder.path().to_owned());
    let distributions = keeper.as_mut().map(Keeper::distributions).unwrap_or_default();
    let kept = distributions.len();
    let mut coefficients = Coefficients { fit: &fit, stack, distributions };
    let mut made = make(&mut [&mut planned], &mut coefficients, positions, machine, &mut stages, &check)?;
    if let (Keeping::In(_), Some(keeper)) = (&keeping, &keeper)
        && coefficients.distributions.len() != kept
    {
        // Where they can't be kept, the next bake finds them again.
        drop(keeper.folder.keep_distributions(&coefficients.distributions));
    }
    let Made { plan, packed, versions, files, .. } = made.swap_remove(0);
    fit.notes.extend(fit.misfit_notes(&fitted));
    fit.notes.extend(found.as_ref().map(|found| found.why.clone()));
    fit.notes.append(&mut scene_notes);
    fit.notes.extend(textures::size_note(&plan.packing, fitted.size().0, fitted.size().1));
    fit.notes.extend(position_facts.as_ref().and_then(|facts| facts.note.clone()));
    // Of a cache that could not be used there is nothing to say.
    let cache_use = keeper.as_ref().map(|keeper| keeper.counts).filter(|used| *used != CacheUse::default());
    fit.notes.extend(cache_use.and_then(CacheUse::note));

    let left_out = left_out.as_ref().map(|capture| Judges { capture, lamps: lamps_of_judges.as_ref() });
    let (budget, judged) = match &versions {
        Some(versions) => {
            let seen = Judges { capture: &fitted, lamps: lamps.as_ref() };
            let account = Account { asset: &arguments.output, versions, seen, left_out, machine };
            let (budget, judged) = stages.time("error budget", || account.settle())?;
            (Some(budget), left_out.map(|_| judged))
        }
        None => (None, judged_by(&arguments.output, left_out, machine, &mut stages)?),
    };
    drop(scratch);
    let key = hexadecimal(&key_of(provenance));
    let summary = report::Summary {
        fit: &fit,
        fitted: &fitted,
        key: (&key, provenance),
        cache: cache_use,
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
    if let Some((json, page)) = &job.report_files {
        let report = summary.json(&arguments.output);
        write_product(json, format!("{report:#}\n").as_bytes())?;
        if let Some(page) = page {
            let listed = fitted.select(&fitted.as_listed());
            let captures = (&listed, left_out.map(|judges| judges.capture));
            page::write_bake_page(page, &report, &arguments.output, captures, budget.as_ref(), machine)?;
        }
    }
    if let (Some(folder), Some(budget)) = (&arguments.heatmaps, &budget) {
        budget.write_heat_maps(folder)?;
    }
    if let Keeping::In(Some(cache)) = &keeping {
        remember(cache, &job, &files);
        if let Some(keeper) = keeper.as_ref().filter(|keeper| keeper.counts.fitted > 0) {
            cache.grown_by(bytes_on_disk(keeper.folder.path()));
        }
    }
    Ok(())
}

/// Keeps the coefficients of `fit` where there is a folder for them, and opens them; a note instead where it can't take them.
fn keep(
    keeper: Option<&mut Keeper>,
    planned: &Planned<'_>,
    fit: &BakeFit<'_>,
    stack: &dyn Stack,
    machine: &Machine,
    notes: &mut Vec<String>,
    stages: &mut Stages,
) -> Result<Option<(BakeFit<'static>, TileStack)>, Failure> {
    let Some(keeper) = keeper else { return Ok(None) };
    let model = planned.model_of(fit);
    let wanted: Vec<usize> = (0..keeper.grid.count()).collect();
    match stages.time("fit", || keeper.fill(fit, &model, stack, machine.level, &wanted)) {
        Ok(tiles) => Ok(keeper.reopen(fit, &model, tiles)),
        Err(KeepError::Folder(error)) => {
            notes.push(format!("the cache is not used: {}", Failure::from(error).words()));
            keeper.counts = CacheUse::default();
            Ok(None)
        }
        Err(KeepError::Work(failure)) => Err(failure),
    }
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
