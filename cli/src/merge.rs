//! `relight merge`: an asset of the tiles that shards fitted.

use crate::bake::{Job, Keeper, Keeping, Stages, bake, fit_key_of};
use crate::failure::{Exit, Failure};
use crate::options::MachineOptions;
use crate::plan::{PlanFile, bake_of, quoted, tiles_of};
use clap::Args;
use relight_formats::FitFolder;
use std::path::{Path, PathBuf};

/// Parts that are to be one asset.
#[derive(Args, Debug)]
pub(crate) struct MergeArguments {
    /// The plan whose shards made them
    #[arg(long, value_name = "FILE.json")]
    plan: PathBuf,
    /// The folder of the parts
    #[arg(value_name = "PARTS")]
    parts: PathBuf,
    /// The asset to write, of the format that was planned
    #[arg(short, long, value_name = "FILE")]
    output: PathBuf,
    #[command(flatten)]
    machine: MachineOptions,
}

/// Names that are listed one by one.
const LISTED: usize = 8;

/// Runs the subcommand.
pub(crate) fn run(arguments: &MergeArguments) -> Result<(), Failure> {
    let plan = PlanFile::read(&arguments.plan)?;
    let mut merged = bake_of(&plan, &arguments.plan, &arguments.machine.words())?;
    merged.output.clone_from(&arguments.output);
    let mut stages = Stages::default();
    let job = Job::open(&merged, &mut stages)?;
    plan.check(&arguments.plan, &job)?;
    let folder = FitFolder::new(arguments.parts.clone(), fit_key_of(&job.provenance));
    let foreign = folder.foreign()?;
    if !foreign.is_empty() {
        let message = format!(
            "{}: {} are no parts of this plan; remove them, or give the folder of its parts",
            arguments.parts.display(),
            listed(&foreign)
        );
        return Err(Failure::new(Exit::BadInput, message));
    }
    // A shard that was killed after the others had begun has nobody after it but this.
    folder.remove_strays();
    let missing = || {
        let keeper = Keeper::new(folder.clone(), (plan.width, plan.height));
        missing(&keeper, &plan, arguments)
    };
    if let Some(failure) = missing() {
        return Err(failure);
    }
    // A part that looked whole may turn out damaged, and is removed then.
    bake(job, Keeping::Merged(folder.clone()), stages).map_err(|failure| missing().unwrap_or(failure))
}

/// Which tiles are missing, and what makes them.
fn missing(keeper: &Keeper, plan: &PlanFile, arguments: &MergeArguments) -> Option<Failure> {
    let shards = plan.shards.len() as u32;
    let command = |index: &u32| {
        let shard = format!("{}/{shards}", index + 1);
        let [plan, parts] = [&arguments.plan, &arguments.parts].map(|path: &PathBuf| word(path));
        format!("relight bake --plan {plan} --shard {shard} -o {parts}")
    };
    if keeper.has_tiles_without_facts() {
        let message = format!(
            "{}: the file 'facts', which all shards share, is missing or damaged; one of them makes it again\n{}",
            arguments.parts.display(),
            command(&0)
        );
        return Some(Failure::new(Exit::BadInput, message));
    }
    let lacking = |index: &u32| {
        let tiles: Vec<usize> = tiles_of(*index, shards, plan.tiles).collect();
        !tiles.is_empty() && !keeper.holds(&tiles)
    };
    let shards_missing: Vec<u32> = (0..shards).filter(lacking).collect();
    if shards_missing.is_empty() {
        return None;
    }
    let commands: Vec<String> = shards_missing.iter().map(command).collect();
    let message = format!(
        "{}: tiles of {} of {shards} shards are missing or damaged; make them by\n{}",
        arguments.parts.display(),
        commands.len(),
        commands.join("\n")
    );
    Some(Failure::new(Exit::BadInput, message))
}

fn word(path: &Path) -> String {
    quoted(&path.to_string_lossy())
}

fn listed(names: &[String]) -> String {
    match names.len().checked_sub(LISTED) {
        Some(more @ 1..) => format!("{} and {more} more", names[..LISTED].join(", ")),
        _ => names.join(", "),
    }
}
