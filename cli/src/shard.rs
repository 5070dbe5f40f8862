//! `relight bake --plan`: fits the tiles of one shard of a plan.

use crate::bake::{Job, Keeper, Planned, Ready, Source, Stages, fit_key_of};
use crate::failure::Failure;
use crate::options::MachineOptions;
use crate::plan::{PlanFile, bake_of, tiles_of};
use crate::say::say;
use crate::{interrupt, notes};
use clap::Args;
use relight_formats::FitFolder;
use std::path::PathBuf;
use std::str::FromStr;

/// A shard of a plan that is to be fitted. What was fitted before is taken up.
#[derive(Args, Debug)]
pub(crate) struct ShardArguments {
    /// A plan that relight plan wrote
    #[arg(long, value_name = "FILE.json")]
    plan: PathBuf,
    /// Which part of the work, from 1; or auto: the number that HyperQueue, Slurm, Kubernetes, AWS Batch, PBS or Grid Engine
    /// gives, of as many shards as the plan has
    #[arg(long, value_name = "K/N|auto")]
    shard: ShardChoice,
    /// The folder of the parts, one for all shards
    #[arg(short, long, value_name = "FOLDER")]
    output: PathBuf,
    #[command(flatten)]
    machine: MachineOptions,
}

/// Which shard.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum ShardChoice {
    /// Index from 0, and how many there are.
    Of(u32, u32),
    Auto,
}

impl FromStr for ShardChoice {
    type Err = String;

    fn from_str(text: &str) -> Result<Self, String> {
        let refused = || "write K/N, such as 1/4 to 4/4, or auto".to_owned();
        if text == "auto" {
            return Ok(Self::Auto);
        }
        let (shard, shards) = text.split_once('/').ok_or_else(refused)?;
        let number = |text: &str| text.parse::<u32>().ok().filter(|number| (1..=10_000).contains(number));
        match (number(shard), number(shards)) {
            (Some(shard), Some(shards)) if shard <= shards => Ok(Self::Of(shard - 1, shards)),
            _ => Err(refused()),
        }
    }
}

/// Variables in which engines number the tasks of an array, and the number of the first. The files that relight plan writes number
/// HyperQueue's, Slurm's and PBS's from 1; Grid Engine knows no other. What these say is the least of an array is no origin: who sends
/// the third task once more (`sbatch --array=3`) has an array that begins at 3 and means the third shard. Only an array from 0 can't
/// have been numbered from 1.
const NUMBERS: [(&str, Origin); 6] = [
    ("HQ_TASK_ID", Origin::Fixed(1)),
    ("SLURM_ARRAY_TASK_ID", Origin::OneUnlessZero("SLURM_ARRAY_TASK_MIN")),
    ("JOB_COMPLETION_INDEX", Origin::Fixed(0)),
    ("AWS_BATCH_JOB_ARRAY_INDEX", Origin::Fixed(0)),
    ("PBS_ARRAY_INDEX", Origin::Fixed(1)),
    ("SGE_TASK_ID", Origin::Fixed(1)),
];

/// The number of an array's first task.
#[derive(Clone, Copy)]
enum Origin {
    Fixed(u32),
    /// 1, or 0 where this variable says that the array begins there.
    OneUnlessZero(&'static str),
}

/// The shard, from 0 of `shards`, that the engine's variables name.
fn numbered(shards: u32, variable: impl Fn(&str) -> Option<String>) -> Result<u32, Failure> {
    let number = |name: &str| variable(name)?.parse::<u32>().ok();
    // Grid Engine says "undefined" outside arrays.
    let found = NUMBERS.iter().find_map(|(name, origin)| Some((name, number(name)?, origin)));
    let Some((name, task, origin)) = found else {
        let names: Vec<&str> = NUMBERS.iter().map(|(name, _)| *name).collect();
        let message = format!("--shard auto: none of {} is a number; give --shard K/N", names.join(", "));
        return Err(Failure::usage(message));
    };
    let first = match *origin {
        Origin::Fixed(first) => first,
        Origin::OneUnlessZero(least) => number(least).map_or(1, |least| least.min(1)),
    };
    task.checked_sub(first).filter(|&shard| shard < shards).ok_or_else(|| {
        Failure::usage(format!(
            "--shard auto: {name} is {task}, but the plan has {shards} shards, numbered {first} to {}; give --shard K/N",
            first + shards - 1
        ))
    })
}

/// Runs the subcommand.
pub(crate) fn run(arguments: &ShardArguments) -> Result<(), Failure> {
    let plan = PlanFile::read(&arguments.plan)?;
    let (index, shards) = match arguments.shard {
        ShardChoice::Of(index, shards) => (index, shards),
        ShardChoice::Auto => {
            let shards = plan.shards.len() as u32;
            (numbered(shards, |name| std::env::var(name).ok())?, shards)
        }
    };
    let wanted: Vec<usize> = tiles_of(index, shards, plan.tiles).collect();
    let name = format!("shard {}/{shards}", index + 1);
    let bake = bake_of(&plan, &arguments.plan, &arguments.machine.words())?;
    let mut stages = Stages::default();
    let job = Job::open_for_others(&bake, &mut stages)?;
    plan.check(&arguments.plan, &job)?;
    let folder = FitFolder::new(arguments.output.clone(), fit_key_of(&job.provenance));
    folder.create()?;
    let mut keeper = Keeper::new(folder, (plan.width, plan.height));
    if keeper.holds(&wanted) {
        say!("{name}: its {} tiles are there already", wanted.len());
        return Ok(());
    }
    let mut ready = job.prepare(&mut stages)?;
    let surface = ready.map.take().map_or(0, |map| size_of_val(&map.points[..])) as u64;
    let Ready { job, fitted, space, .. } = &ready;
    let planned = Planned::new(&bake.output, &bake.fit, &bake.textures, fitted, *space, &job.machine, None)?;
    let place = (surface, arguments.output.as_path());
    let Source { fit, stack, .. } = Source::of_pictures(&ready, &planned, None, place, &mut stages)?;
    interrupt::check()?;
    let model = planned.model_of(&fit);
    stages.time("fit", || keeper.fill(&fit, &model, &*stack, job.machine.level, &wanted))?;
    notes::print(&keeper.counts.note().into_iter().collect::<Vec<_>>());
    let counts = keeper.counts;
    say!("{name}: {} tiles fitted, {} taken up from an earlier run", counts.fitted, counts.taken);
    Ok(())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn shards_are_counted_from_one() {
        assert_eq!("1/1".parse(), Ok(ShardChoice::Of(0, 1)));
        assert_eq!("7/16".parse(), Ok(ShardChoice::Of(6, 16)));
        assert_eq!("auto".parse(), Ok(ShardChoice::Auto));
        for text in ["", "0/4", "5/4", "1", "1/0", "a/b", "1/2/3", "-1/4", "1/99999"] {
            assert!(text.parse::<ShardChoice>().is_err(), "{text}");
        }
    }

    #[test]
    fn engines_number_from_zero_or_one() {
        let told = |variables: &[(&str, &str)], shards: u32| {
            numbered(shards, |name| variables.iter().find(|(n, _)| *n == name).map(|(_, v)| (*v).to_owned()))
        };
        for (variables, expected) in [
            (&[("HQ_TASK_ID", "1")][..], 0),
            (&[("SLURM_ARRAY_TASK_ID", "1")], 0),
            (&[("SLURM_ARRAY_TASK_ID", "3"), ("SLURM_ARRAY_TASK_MIN", "0")], 3),
            (&[("SLURM_ARRAY_TASK_ID", "3"), ("SLURM_ARRAY_TASK_MIN", "3")], 2),
            (&[("JOB_COMPLETION_INDEX", "0")], 0),
            (&[("AWS_BATCH_JOB_ARRAY_INDEX", "2")], 2),
            (&[("PBS_ARRAY_INDEX", "4")], 3),
            (&[("SGE_TASK_ID", "4"), ("SGE_TASK_FIRST", "4")], 3),
            (&[("SGE_TASK_ID", "undefined"), ("JOB_COMPLETION_INDEX", "1")], 1),
        ] {
            assert_eq!(told(variables, 4).unwrap(), expected, "{variables:?}");
        }
        for variables in
            [&[][..], &[("HQ_TASK_ID", "0")], &[("JOB_COMPLETION_INDEX", "4")], &[("SGE_TASK_ID", "x")]]
        {
            assert!(told(variables, 4).is_err(), "{variables:?}");
        }
    }
}
