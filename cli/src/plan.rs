//! `relight plan`: how a bake is spread over processes, and what each will take.

mod estimate;
mod file;
mod submit;

use crate::bake::{BakeArguments, Job, Planned, Ready, Stages, fit_key_of, key_of};
use crate::failure::Failure;
use crate::options::check_apart;
use crate::say::say;
use clap::error::ErrorKind;
use clap::parser::ValueSource;
use clap::{Arg, ArgAction, ArgMatches, Args, Command, FromArgMatches};
use estimate::Estimate;
use file::Shard;
pub(crate) use file::{PlanFile, tiles_of};
use relight_fit::SPAN;
use relight_formats::{TileGrid, hexadecimal, write_whole};
use std::any::TypeId;
use std::path::{Path, PathBuf};
use submit::Engine;
pub(crate) use submit::quoted;

/// Version of the plan's form.
const VERSION: u32 = 1;

/// A bake to plan: the command line of `relight bake`, but that the asset is named by --asset.
#[derive(Debug)]
pub(crate) struct PlanArguments {
    bake: BakeArguments,
    /// What the command line says of the bake, by keys of job files.
    job: Vec<(String, String)>,
    options: PlanOptions,
}

#[derive(Args, Debug)]
struct PlanOptions {
    /// The plan to write
    #[arg(short = 'o', long = "output", id = "plan_output", value_name = "FILE.json")]
    plan_output: PathBuf,
    /// Over how many processes the bake is spread
    #[arg(long, value_name = "N", default_value_t = 1, value_parser = clap::value_parser!(u32).range(1..=10_000))]
    shards: u32,
    /// Also write the file that submits the plan to an engine: hq, slurm, openjd, k8s, ninja or bazel, or lines of a shell;
    /// beside the plan, as FILE.hq.toml and the like
    #[arg(long, value_name = "ENGINE", value_enum)]
    format: Option<Engine>,
    /// With --format: another name for that file
    #[arg(long, value_name = "FILE", requires = "format")]
    submit: Option<PathBuf>,
    /// With --format: the program that the engine's machines run
    #[arg(long, value_name = "PATH", requires = "format", default_value = "relight")]
    program: String,
}

impl Args for PlanArguments {
    fn augment_args(command: Command) -> Command {
        let bake = BakeArguments::augment_args(command);
        let bake = bake.mut_arg("output", |output| output.long("asset").short(None));
        PlanOptions::augment_args(bake)
    }

    fn augment_args_for_update(command: Command) -> Command {
        Self::augment_args(command)
    }
}

impl FromArgMatches for PlanArguments {
    fn from_arg_matches(matches: &ArgMatches) -> Result<Self, clap::Error> {
        let bake = BakeArguments::from_arg_matches(matches)?;
        Ok(Self { bake, job: job_of(matches)?, options: PlanOptions::from_arg_matches(matches)? })
    }

    fn update_from_arg_matches(&mut self, matches: &ArgMatches) -> Result<(), clap::Error> {
        *self = Self::from_arg_matches(matches)?;
        Ok(())
    }
}

/// What was said of the bake, as a job file would say it; paths are absolute.
///
/// Fails for what is no UTF-8, which a plan can't hold.
fn job_of(matches: &ArgMatches) -> Result<Vec<(String, String)>, clap::Error> {
    // Of the machine that plans, not of those that bake.
    let ours = ["jobs", "cpu", "cache", "cache_size", "depfile", "depfile_format", "dry_run", "job_file"];
    let command = BakeArguments::augment_args(Command::new("bake"));
    let said = |arg: &&Arg| {
        let id = arg.get_id().as_str();
        !ours.contains(&id) && matches.value_source(id) == Some(ValueSource::CommandLine)
    };
    let pair = |arg: &Arg| {
        let id = arg.get_id().as_str();
        if matches!(arg.get_action(), ArgAction::SetTrue) {
            return Ok((id.to_owned(), "true".to_owned()));
        }
        let given = matches.get_raw(id).and_then(|mut values| values.next()).unwrap_or_default();
        let is_file = is_path(arg)
            || (id == "holdout" && given.to_string_lossy().to_ascii_lowercase().ends_with(".lp"));
        let value = if is_file { std::path::absolute(given)?.into_os_string() } else { given.to_owned() };
        let value = value.into_string().map_err(|value| {
            let name = arg.get_long().map_or_else(|| id.to_uppercase(), |long| format!("--{long}"));
            let value = value.to_string_lossy();
            let words = format!("{name}: {value} is no UTF-8, which a plan can't hold; rename it\n");
            clap::Error::raw(ErrorKind::InvalidUtf8, words)
        })?;
        Ok((id.to_owned(), value))
    };
    command.get_arguments().filter(said).map(pair).collect()
}

/// Whether the argument names a file or folder.
pub(crate) fn is_path(arg: &Arg) -> bool {
    arg.get_value_parser().type_id() == TypeId::of::<PathBuf>()
}

/// Runs the subcommand.
pub(crate) fn run(arguments: &PlanArguments) -> Result<(), Failure> {
    let PlanArguments { bake, job, options } = arguments;
    bake.build.refuse("plan")?;
    if bake.searches()? {
        return Err(Failure::usage(
            "targets choose among fits, which shards can't share: find the choice with relight bake, then plan it",
        ));
    }
    let mut stages = Stages::default();
    let Ready { job: opened, fitted, lamps, map, space, .. } =
        Job::open(bake, &mut stages)?.prepare(&mut stages)?;
    let planned =
        Planned::new(&bake.output, &bake.fit, &bake.textures, &fitted, space, &opened.machine, None)?;
    let (width, height) = fitted.size();
    let grid = TileGrid::new(width * height, SPAN);
    let estimate = Estimate::new(&planned, &fitted, lamps.as_ref(), map.as_ref(), &opened.machine)?;
    let shard = |index: u32| {
        let tiles = file::tiles_of(index, options.shards, grid.count());
        let pixels = tiles.clone().map(|tile| grid.pixels(tile).len()).sum();
        Shard {
            shard: index + 1,
            tiles: [tiles.start, tiles.end],
            pixels,
            bytes: (pixels * planned.model.plane_count()) as u64 * 4,
            memory: estimate.memory(),
            seconds: estimate.shard_seconds(pixels),
        }
    };
    let plan = PlanFile {
        relight_plan: VERSION,
        relight: env!("CARGO_PKG_VERSION").to_owned(),
        key: hexadecimal(&key_of(&opened.provenance)),
        fit_key: hexadecimal(&fit_key_of(&opened.provenance)),
        job: job.iter().cloned().collect(),
        width,
        height,
        pictures: fitted.infos.len(),
        tile_pixels: grid.tile_pixels(),
        tiles: grid.count(),
        input_bytes: estimate.input_bytes,
        texel_bytes: planned.texel_bytes(),
        shards: (0..options.shards).map(shard).collect(),
        merge: estimate.merge(),
        provenance: opened.provenance,
    };
    plan.write(&options.plan_output)?;
    if let Some(engine) = options.format {
        let usual = || options.plan_output.with_extension(engine.extension());
        let path = options.submit.clone().unwrap_or_else(usual);
        check_apart([&options.plan_output, &path], [])?;
        let text = engine.submission(&plan, &options.plan_output, &options.program)?;
        write_whole(&path, text.as_bytes()).map_err(Failure::of_output)?;
        say!("{}: {}", path.display(), engine.about());
    }
    say!(
        "{}: {} tiles of {} pixels in {} shards of {:.0} MiB and {:.1} s each; merging takes {:.0} MiB and {:.1} s",
        options.plan_output.display(),
        plan.tiles,
        plan.tile_pixels,
        options.shards,
        plan.shards[0].memory as f64 / f64::from(1 << 20),
        plan.shards[0].seconds,
        plan.merge.memory as f64 / f64::from(1 << 20),
        plan.merge.seconds,
    );
    Ok(())
}

/// The bake of a plan that asks for it, on this machine: `machine` are words after `relight bake`.
///
/// # Errors
/// What is wrong with the plan's job.
pub(crate) fn bake_of(plan: &PlanFile, path: &Path, machine: &[String]) -> Result<BakeArguments, Failure> {
    let command = BakeArguments::augment_args(Command::new("bake"));
    let mut words = Vec::new();
    for arg in command.get_arguments() {
        let Some(value) = plan.job.get(arg.get_id().as_str()) else { continue };
        words.push(match (arg.get_long(), arg.get_action()) {
            (Some(long), ArgAction::SetTrue) => format!("--{long}"),
            (Some(long), _) => format!("--{long}={value}"),
            (None, _) => value.clone(),
        });
    }
    let words = words.into_iter().chain(machine.iter().cloned()).map(Into::into);
    crate::job::bake_arguments(words)
        .map_err(|failure| Failure::usage(format!("{}: its job: {}", path.display(), failure.words())))
}
