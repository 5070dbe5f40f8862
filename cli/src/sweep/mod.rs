//! `relight sweep`: what accuracy costs in bytes and time, over a grid of choices.

mod axes;
mod bench;
mod front;
mod gpu_time;
mod outcome;
mod render_time;
mod report;
mod search;

pub(crate) use search::{Found, search};

use crate::bake::textures::TextureOptions;
use crate::bake::{Division, FitOptions, Planned, Stages, input_files, spill_folder, split};
use crate::failure::Failure;
use crate::holdout::Holdout;
use crate::options::{MachineOptions, check_apart};
use crate::photograph_options::PhotographOptions;
use crate::say;
use crate::{notes, page, progress};
use axes::{Axes, GridPoint};
use bench::Bench;
pub(crate) use bench::Opened;
use clap::{Args, ValueEnum};
use gpu_time::GpuClock;
use outcome::Outcome;
use relight_core::Family;
use relight_fit::LIGHTS_PER_FUNCTION;
use relight_formats::{OpenCapture, open_capture};
use std::path::{Path, PathBuf};

/// What to try, and on what.
#[derive(Args, Debug)]
pub(crate) struct SweepArguments {
    /// A .lp file, or a folder that holds one
    input: PathBuf,
    /// The folder for report.html and report.json, the figures of each choice and the assets that are kept
    #[arg(short, long, value_name = "FOLDER")]
    output: PathBuf,
    /// What varies: some of basis,k,precision,block,quality, each alone or with values, such as
    /// basis=sh/pca,k=9/18,block=none/bc7 [default: basis,k,block]
    #[arg(long, value_name = "AXES")]
    axes: Option<Axes>,
    /// Assets to keep in the folder: those on a front, all or none
    #[arg(long, value_name = "WHICH", value_enum, default_value = "front")]
    keep: Keep,
    #[command(flatten)]
    fit: FitOptions,
    #[command(flatten)]
    textures: TextureOptions,
    #[command(flatten)]
    photographs: PhotographOptions,
    /// Pictures to leave out and judge by, instead of predicting each light from the others: every:N, random:N,
    /// random:N:SEED or FILE.lp
    #[arg(long, value_name = "WHICH")]
    holdout: Option<Holdout>,
    /// Print JSON lines, one a choice, instead of a table
    #[arg(long)]
    json: bool,
    #[command(flatten)]
    machine: MachineOptions,
}

#[derive(Clone, Copy, Debug, PartialEq, Eq, ValueEnum)]
enum Keep {
    Front,
    All,
    None,
}

/// A point of the grid and the options that it stands for.
struct Choice {
    point: GridPoint,
    fit: FitOptions,
    textures: TextureOptions,
}

impl Choice {
    fn new(point: GridPoint, fit: &FitOptions, textures: &TextureOptions) -> Result<Self, Failure> {
        let fit = fit.with(point.basis, point.count);
        let [precision, block, quality] =
            [&point.precision, &point.block, &point.quality].map(|value| value.as_deref());
        let textures = textures.with(precision, block, quality)?;
        Ok(Self { point, fit, textures })
    }

    /// Choices of one group share a fit.
    fn same_fit(&self, other: &Self) -> bool {
        self.point.basis == other.point.basis && self.point.count == other.point.count
    }
}

/// Runs the subcommand.
pub(crate) fn run(arguments: &SweepArguments) -> Result<(), Failure> {
    let machine = arguments.machine.machine()?;
    let folder = &arguments.output;
    if folder.is_file() {
        let message = format!("{} is a file; -o names a folder for a sweep", folder.display());
        return Err(Failure::usage(message));
    }
    let spill = spill_folder(folder);
    let mut stages = Stages::default();
    let mut all = stages.time("open", || open_capture(&arguments.input)?.by_direction())?;
    stages.time("adjust", || arguments.photographs.apply(&mut all, &machine, &spill))?;
    notes::print(&all.capture.notes);
    let (fitted, left_out) =
        split(&all, &Division::new(&all, arguments.holdout.as_ref())?, &arguments.photographs)?;
    let space = arguments.fit.space(&all);
    let opened =
        Opened { fitted: &fitted, left_out: left_out.as_ref(), space, machine, spill: &spill, beside: 0 };

    let axes = arguments.axes()?;
    let (points, skipped) = carried(axes.grid()?, &fitted);
    notes::print(&skipped);
    let choices: Vec<Choice> = points
        .into_iter()
        .map(|point| Choice::new(point, &arguments.fit, &arguments.textures))
        .collect::<Result<_, _>>()?;
    let inputs = input_files(&all, left_out.as_ref(), arguments.photographs.files());
    let key = stages.time("key", || key_of(arguments, &inputs))?;

    let check = |outputs: &[PathBuf]| check_apart(outputs, inputs.iter().copied());
    let mut results = Results::new(folder, &key, &choices);
    let missing: Vec<usize> = results.missing();
    if missing.len() < choices.len() {
        let found = choices.len() - missing.len();
        notes::print(&[format!(
            "{found} of {} choices are taken up from {}",
            choices.len(),
            folder.display()
        )]);
    }
    if arguments.json {
        results.outcomes.iter().flatten().for_each(say_json);
    }
    results.fill(&choices, &missing, &opened, &check, &mut stages, arguments.json)?;
    let outcomes = results.complete();
    let fronts = report::Fronts::of(&outcomes);
    let wanted = |index: usize| match arguments.keep {
        Keep::All => true,
        Keep::Front => fronts.has(index),
        Keep::None => false,
    };
    // What is taken up from an earlier run may lack its asset.
    let asset = |index: usize| asset_path(folder, &choices[index].point);
    let absent: Vec<usize> = (0..choices.len()).filter(|&i| wanted(i) && !asset(i).exists()).collect();
    results.fill(&choices, &absent, &opened, &check, &mut stages, false)?;
    for index in (0..choices.len()).filter(|&index| !wanted(index)) {
        relight_formats::remove_file(&asset(index))?;
    }
    let summary = report::Summary {
        input: &arguments.input,
        size: fitted.size(),
        pictures: fitted.infos.len(),
        judged: left_out.as_ref().map(|capture| capture.infos.len()),
        outcomes: &outcomes,
        fronts: &fronts,
        chosen: report::chosen(&outcomes, &arguments.fit.targets),
        stages: &stages,
        measured: missing.len(),
        skipped: &skipped,
    };
    let report = summary.json();
    relight_formats::write_whole(&folder.join("report.json"), format!("{report:#}\n").as_bytes())?;
    let captures = (&fitted, left_out.as_ref());
    page::write_sweep_page(folder, &report, captures, arguments.fit.weighting(), &machine)?;
    summary.print(folder, arguments.json);
    summary.check()
}

/// A line of JSON for a choice.
fn say_json(outcome: &Outcome) {
    say::product(format!("{}\n", serde_json::to_string(outcome).unwrap_or_default()).as_bytes());
}

impl SweepArguments {
    /// What varies: all usual axes but those that options pin, or what --axes says.
    fn axes(&self) -> Result<Axes, Failure> {
        let (basis, count) = (self.fit.asked_basis(), self.fit.asked_count()?);
        match &self.axes {
            None => Ok(Axes::free(basis, count, &self.textures)),
            Some(_) if basis.is_some() || count.is_some() => Err(Failure::usage(
                "--axes says which bases and how many functions: leave out --basis, -k, --order and --degree",
            )),
            Some(axes) => Ok(axes.clone()),
        }
    }
}

/// The points that the lights carry, and a sentence for each family of which some are left out.
fn carried(points: Vec<GridPoint>, capture: &OpenCapture) -> (Vec<GridPoint>, Vec<String>) {
    let lights = capture.infos.len();
    let channels = if capture.is_grey() { 1 } else { 3 };
    let is_learned = |point: &GridPoint| Family::by_name(point.basis).is_some_and(|family| family.learned);
    let carries = |point: &GridPoint| match is_learned(point) {
        true => point.count < lights * channels,
        false => lights as f64 >= LIGHTS_PER_FUNCTION * point.count as f64,
    };
    let (kept, left): (Vec<_>, Vec<_>) = points.into_iter().partition(carries);
    let mut sentences: Vec<String> = left
        .iter()
        .map(|point| {
            format!("{lights} lights carry no {} functions of {}: left out", point.count, point.basis)
        })
        .collect();
    sentences.dedup();
    (kept, sentences)
}

/// What a measured choice depends on beside its own options.
fn key_of(arguments: &SweepArguments, inputs: &[&PathBuf]) -> Result<String, Failure> {
    // Files count by their contents, which are among the inputs.
    let holdout = arguments.holdout.as_ref().filter(|holdout| !matches!(holdout, Holdout::File(_)));
    let settings = format!(
        "{} {:?} {:?} {:?} {holdout:?}",
        env!("CARGO_PKG_VERSION"),
        arguments.fit.with("", 0),
        arguments.textures,
        arguments.photographs.without_names(),
    );
    Ok(relight_formats::content_key(&settings, inputs.iter().map(|path| path.as_path()))?)
}

fn asset_path(folder: &Path, point: &GridPoint) -> PathBuf {
    folder.join("assets").join(format!("{}.ktx2", point.name()))
}

/// The outcomes of the choices so far.
struct Results<'a> {
    folder: &'a Path,
    key: &'a str,
    outcomes: Vec<Option<Outcome>>,
}

impl<'a> Results<'a> {
    /// Those that are kept in `folder`.
    fn new(folder: &'a Path, key: &'a str, choices: &[Choice]) -> Self {
        let kept = |choice: &Choice| outcome::kept(&Self::path(folder, &choice.point), key);
        Self { folder, key, outcomes: choices.iter().map(kept).collect() }
    }

    fn path(folder: &Path, point: &GridPoint) -> PathBuf {
        folder.join("choices").join(format!("{}.json", point.name()))
    }

    fn missing(&self) -> Vec<usize> {
        (0..self.outcomes.len()).filter(|&index| self.outcomes[index].is_none()).collect()
    }

    /// Makes and measures the choices of these indices, those of one fit together.
    fn fill(
        &mut self,
        choices: &[Choice],
        indices: &[usize],
        opened: &Opened<'_>,
        check: &dyn Fn(&[PathBuf]) -> Result<(), Failure>,
        stages: &mut Stages,
        json: bool,
    ) -> Result<(), Failure> {
        if indices.is_empty() {
            return Ok(());
        }
        for part in ["choices", "assets"] {
            relight_formats::create_folder(&self.folder.join(part))?;
        }
        let groups: Vec<&[usize]> = indices.chunk_by(|&a, &b| choices[a].same_fit(&choices[b])).collect();
        let planned: Vec<Vec<Planned<'_>>> = groups
            .iter()
            .map(|group| {
                group
                    .iter()
                    .map(|&i| opened.planned(&choices[i], &asset_path(self.folder, &choices[i].point)))
                    .collect()
            })
            .collect::<Result<_, _>>()?;
        let grouped: Vec<Vec<&Planned<'_>>> = planned.iter().map(|group| group.iter().collect()).collect();
        let decoded = opened.decode(&grouped, stages)?;
        let bench = Bench::new(opened, &decoded, Some(GpuClock::open()));
        let bar = progress::bar("choices", indices.len());
        for (group, mut planned) in groups.into_iter().zip(planned) {
            let points: Vec<&GridPoint> = group.iter().map(|&index| &choices[index].point).collect();
            for (&index, outcome) in group.iter().zip(bench.measure(&points, &mut planned, check, stages)?) {
                // The times of an earlier run stay: its fronts decided what is kept.
                let outcome = match self.outcomes[index].take() {
                    Some(before) => Outcome { times: before.times, ..outcome },
                    None => outcome,
                };
                outcome::keep(&Self::path(self.folder, &choices[index].point), self.key, &outcome)?;
                if json {
                    say_json(&outcome);
                }
                self.outcomes[index] = Some(outcome);
                bar.inc(1);
            }
        }
        bar.finish_and_clear();
        Ok(())
    }

    fn complete(&self) -> Vec<Outcome> {
        self.outcomes.iter().flatten().cloned().collect()
    }
}
