//! `relight bake`: pictures in, asset out.

mod fit;
mod positions;
mod report;
pub(crate) mod textures;

use crate::failure::Failure;
use crate::function_options::{FunctionOptions, family_of_name, size_of};
use crate::holdout::Holdout;
use crate::near::{NearOptions, surface_bytes};
use crate::options::{ByteCount, Machine, MachineOptions, check_apart, check_writable};
use crate::photograph_options::PhotographOptions;
use crate::{evaluate, interrupt, notes, progress};
use clap::{Args, ValueEnum};
use relight_core::basis::SrbfDesign;
use relight_core::{Family, Layout, Model, Space, Stack};
use relight_fit::{
    LearnedDesign, LevelledStack, LightWeights, Ridge, coefficient_distributions, coefficient_sample,
    for_each_span, span_bytes,
};
use relight_formats::{
    AssetFormat, AssetHeader, AssetPlan, AssetPositions, OpenCapture, Parts, PictureStack, StackSettings,
    open_capture, place_of,
};
use relight_texture::{needs_rows, span_pixels, working_bytes};
use std::path::{Path, PathBuf};
use std::time::Instant;

/// What to fit and how. Every option is also a key of a TOML job file given as INPUT.
#[derive(Args, Debug)]
pub(crate) struct BakeArguments {
    /// A .lp file, a folder that holds one, or a .toml job file
    input: PathBuf,
    /// The asset to write: .ktx2, .dds, .exr, .ptm, .rti, or .web for a folder
    #[arg(short, long, value_name = "FILE")]
    output: PathBuf,
    /// Family of functions: ptm, sh, hsh, srbf, or pca for planes learned from the pictures
    #[arg(long, value_name = "NAME", default_value = "ptm")]
    basis: String,
    #[command(flatten)]
    functions: FunctionOptions,
    /// Three planes a function, or luminance planes and a base colour; of pca: planes of any colour, or of
    /// luminance or chrominance each
    #[arg(long, value_name = "COLOR", value_enum, default_value = "rgb")]
    color: Color,
    /// Store so many planes instead of all coefficients of ptm, sh, hsh or srbf: those that carry most of them
    #[arg(long, value_name = "N", value_parser = size_of, allow_negative_numbers = true)]
    planes: Option<usize>,
    /// Of pca and --planes: take the fewest planes whose mean PSNR on lights predicted from the others reaches
    /// this (dB)
    #[arg(long, value_name = "DB", value_parser = decibels_of, allow_negative_numbers = true)]
    target_psnr: Option<f64>,
    /// Of pca and --planes: take no more planes than texels of so many bytes hold, mip levels included; 8M, 512K
    #[arg(long, value_name = "BYTES")]
    budget_bytes: Option<ByteCount>,
    /// Values to fit: auto takes 8/16-bit pictures encoded and float pictures linear
    #[arg(long, value_name = "SPACE", value_enum, default_value = "auto")]
    space: SpaceChoice,
    /// How strongly coefficients are held small: auto, or 0 to 1
    #[arg(long, value_name = "RIDGE", default_value = "auto", value_parser = ridge_of, allow_negative_numbers = true)]
    ridge: Ridge,
    /// Weight of each light: by the area of its cell on the sphere, or all alike
    #[arg(long, value_name = "WEIGHTS", value_enum, default_value = "voronoi")]
    weights: Weights,
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
    /// Write figures of the fit, each light's errors and times as JSON
    #[arg(long, value_name = "FILE")]
    report: Option<PathBuf>,
    #[command(flatten)]
    machine: MachineOptions,
}

/// How channels share planes.
#[derive(Clone, Copy, Debug, PartialEq, Eq, ValueEnum)]
pub(crate) enum Color {
    Rgb,
    Lrgb,
    Ycc,
}

#[derive(Clone, Copy, Debug, PartialEq, Eq, ValueEnum)]
enum SpaceChoice {
    Auto,
    Encoded,
    Linear,
}

#[derive(Clone, Copy, Debug, PartialEq, Eq, ValueEnum)]
enum Weights {
    Voronoi,
    Uniform,
}

fn decibels_of(text: &str) -> Result<f64, String> {
    match text.parse::<f64>() {
        Ok(decibels) if (0.0..=120.0).contains(&decibels) => Ok(decibels),
        _ => Err("write decibels from 0 to 120".to_owned()),
    }
}

fn ridge_of(text: &str) -> Result<Ridge, String> {
    match text.parse::<f64>() {
        _ if text == "auto" => Ok(Ridge::Auto),
        Ok(ridge) if (0.0..=1.0).contains(&ridge) => Ok(Ridge::Fixed(ridge)),
        _ => Err("write auto or a number from 0 to 1".to_owned()),
    }
}

/// Seconds that each stage took, in order.
pub(crate) struct Stages(Vec<(&'static str, f64)>);

impl Stages {
    fn time<T>(&mut self, stage: &'static str, work: impl FnOnce() -> T) -> T {
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
    if let Some(path) = &arguments.report {
        check_writable(path)?;
    }
    let settings = arguments.textures.settings(machine.memory)?;
    let spill_folder = spill_folder(&arguments.output);
    let mut stages = Stages(Vec::new());

    let mut all = stages.time("open", || open_capture(&arguments.input))?;
    let whole = all.size();
    stages.time("adjust", || arguments.photographs.apply(&mut all, &machine, &spill_folder))?;
    let (mut fitted, mut left_out) = split(&all, arguments)?;
    let mut scene_notes = Vec::new();
    let wanted = arguments.positions.wanted(&machine, &mut scene_notes)?;
    let map = match wanted || arguments.near.is_given() {
        true => stages.time("positions", || {
            arguments.positions.read(whole, arguments.photographs.crop(), machine.memory)
        })?,
        false => None,
    };
    if arguments.near.is_given() && arguments.learns()? {
        return Err(Failure::usage(
            "--near fits functions of light; bake those of sh, hsh, srbf or ptm, and make planes of them with relight convert",
        ));
    }
    let lamps = arguments.near.apply(&mut fitted, whole, map.as_ref(), &mut all.capture.notes)?;
    let lamps_of_judges = match &mut left_out {
        Some(judges) => arguments.near.apply(judges, whole, map.as_ref(), &mut Vec::new())?,
        None => None,
    };
    notes::print(&all.capture.notes);
    let judges =
        left_out.iter().flat_map(|judge| judge.capture.pictures.iter().chain([&judge.capture.light_file]));
    let positions =
        arguments.positions.files().chain(arguments.photographs.files()).chain(arguments.near.files());
    let inputs: Vec<&PathBuf> =
        all.capture.pictures.iter().chain([&all.capture.light_file]).chain(judges).chain(positions).collect();
    check_apart(std::iter::once(&arguments.output).chain(&arguments.report), inputs.iter().copied())?;
    let space = arguments.space(&all);
    let layout = arguments.layout(&fitted)?;
    let (width, height) = fitted.size();
    let formats = arguments.textures.formats(format.precisions[0], format, layout)?;
    let levels = arguments.textures.levels(width, height);
    let mut choice = fit::choose_basis(arguments, &fitted)?;
    if let Some(budget) = arguments.budget_bytes {
        choice.keep_within(budget.0, &formats, (width, height), levels)?;
    }
    let mut model = Model {
        basis: choice.stored()?,
        layout,
        space,
        lights: fitted.capture.lights.directions(),
        figures: None,
    };
    let plan = AssetPlan { width, height, model: &model, formats: &formats, levels };
    format.check(&arguments.output, &plan, &settings).map_err(Failure::of_output)?;

    let stored = wanted && !(lamps.is_some() && format.positions.is_empty());
    if wanted && !stored {
        scene_notes
            .push(format!("{}: holds no positions; they serve --near alone", arguments.output.display()));
    }
    let precision = arguments.positions.precision(format, &arguments.output, stored)?;
    let positions = precision.zip(map).map(|(precision, map)| AssetPositions { map, precision });
    let position_bytes = positions.as_ref().map_or(0, |positions| size_of_val(&positions.map.points[..]));

    let span = span_pixels(width, needs_rows(formats.iter().copied(), levels));
    let working = working_bytes(formats.iter().copied(), model.plane_count(), span);
    let spans = machine.threads as u64 * (span_bytes(fitted.infos.len(), model.maps(), span) + working);
    // Fitting begins when what it takes to solve is gone.
    let needed = spans.max(choice.solving_bytes(&fitted));
    let near = lamps.as_ref().map_or(0, |_| choice.near_bytes(&fitted, machine.threads));
    let kept_back = [position_bytes as u64, surface_bytes(lamps.as_ref()), near, needed]
        .into_iter()
        .fold(format.held_bytes(&plan, &settings), u64::saturating_add);
    let pictures = stages.time("decode", || load(&fitted, space, &machine, kept_back, &spill_folder))?;
    let levelled =
        lamps.as_ref().map(|lamps| LevelledStack { stack: &pictures, lamps, space, level: machine.level });
    let stack: &dyn Stack = levelled.as_ref().map_or(&pictures, |levelled| levelled);
    let mut fit =
        stages.time("solve", || fit::solve(arguments, choice, &fitted, layout, stack, lamps.as_ref()))?;
    model.basis = fit.solved.basis();
    model.figures = Some(fit.solved.figures());

    let distributions =
        stages.time("ranges", || match formats.iter().any(|&texels| format.needs_ranges(texels)) {
            true => {
                coefficient_distributions::<Failure>(stack, fit.solved.pixel_fit(), machine.level, || {
                    Ok(interrupt::check()?)
                })
            }
            false => Ok(Vec::new()),
        })?;
    let plan = stages.time("formats", || -> Result<_, Failure> {
        let trial = match arguments.textures.tries() {
            true => Some(textures::Trial {
                sample: coefficient_sample(
                    stack,
                    fit.solved.pixel_fit(),
                    machine.level,
                    textures::TRIAL_BLOCKS,
                )?,
                left_out: fit.solved.leave_one_out().left_out.clone(),
            }),
            false => None,
        };
        arguments.textures.plan(&model, (width, height), &formats, &distributions, trial.as_ref())
    })?;
    fit.notes.append(&mut scene_notes);
    fit.notes.extend(textures::size_note(&plan.packing, width, height));
    let header = AssetHeader { width, height, model: model.clone(), packing: plan.packing.clone() };
    let position_facts = positions.as_ref().map(positions::PositionFacts::of);
    fit.notes.extend(position_facts.as_ref().and_then(|facts| facts.note.clone()));
    let parts = Parts { split: settings.split, positions: positions.is_some() };
    let outputs = format.outputs(&arguments.output, &plan.packing, parts).map_err(Failure::of_output)?;
    check_apart(outputs.iter().chain(&arguments.report), inputs.iter().copied())?;
    let writer = format.create_with_positions(&arguments.output, header, &settings, positions)?;
    let bar = progress::bar("fitting", stack.pixels());
    let packed = stages.time("fit and write", || -> Result<_, Failure> {
        for_each_span::<Failure>(stack, fit.solved.pixel_fit(), machine.level, span, |span| {
            interrupt::check()?;
            writer.write(span)?;
            bar.inc(span.pixels as u64);
            Ok(())
        })?;
        Ok(writer.finish()?)
    })?;
    bar.finish_and_clear();
    let spilled = pictures.spilled_bytes();
    drop(pictures);

    let judged = match &left_out {
        Some(capture) => {
            let lamps = lamps_of_judges.as_ref();
            Some(
                stages
                    .time("hold-out", || evaluate::evaluate(&arguments.output, capture, lamps, &machine))?,
            )
        }
        None => None,
    };
    let summary = report::Summary {
        fit: &fit,
        fitted: &fitted,
        notes: &all.capture.notes,
        judged: judged.as_ref(),
        stages: &stages,
        spilled,
        model: &model,
        plan: &plan,
        packed: &packed,
        positions: position_facts.as_ref(),
    };
    summary.print(&arguments.output);
    if let Some(path) = &arguments.report {
        relight_formats::write_whole(path, summary.json(&arguments.output).as_bytes())?;
    }
    Ok(())
}

/// The pictures to fit, and those to judge the fit by.
fn split(
    all: &OpenCapture,
    arguments: &BakeArguments,
) -> Result<(OpenCapture, Option<OpenCapture>), Failure> {
    let (kept, judge) = match &arguments.holdout {
        None => return Ok((all.clone(), None)),
        Some(Holdout::File(path)) => {
            let mut judge = open_capture(path)?;
            notes::print(&judge.capture.notes);
            evaluate::check_size((all.infos[0].width, all.infos[0].height), &all.capture.light_file, &judge)?;
            arguments.photographs.apply_to_judges(&mut judge, all)?;
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

impl BakeArguments {
    fn space(&self, capture: &OpenCapture) -> Space {
        match self.space {
            SpaceChoice::Encoded => Space::Encoded,
            SpaceChoice::Linear => Space::Linear,
            SpaceChoice::Auto if capture.is_float() => Space::Linear,
            SpaceChoice::Auto => Space::Encoded,
        }
    }

    fn layout(&self, capture: &OpenCapture) -> Result<Layout, Failure> {
        let learned = self.learns()?;
        Ok(match self.color {
            Color::Rgb | Color::Ycc if learned => Layout::Shared,
            Color::Lrgb if learned => {
                return Err(Failure::usage(
                    "--color lrgb is not for --basis pca and --planes; use rgb or ycc",
                ));
            }
            Color::Ycc => {
                let message = format!(
                    "--color ycc belongs to --basis pca and --planes; {} alone has rgb and lrgb",
                    self.basis
                );
                return Err(Failure::usage(message));
            }
            Color::Lrgb => Layout::Lrgb,
            Color::Rgb if capture.is_grey() => Layout::Grey,
            Color::Rgb => Layout::Rgb,
        })
    }

    /// Whether planes are learned.
    fn learns(&self) -> Result<bool, Failure> {
        let learned = self.family()?.learned;
        if learned && self.planes.is_some() {
            return Err(Failure::usage("--planes is for ptm, sh, hsh and srbf; pca has -k"));
        }
        let chooses =
            [("target-psnr", self.target_psnr.is_some()), ("budget-bytes", self.budget_bytes.is_some())];
        let chooses = chooses.into_iter().find(|(_, given)| *given && !learned && self.planes.is_none());
        if let Some((flag, _)) = chooses {
            let message = format!("--{flag} chooses planes: give --basis pca, or --planes and the most");
            return Err(Failure::usage(message));
        }
        Ok(learned || self.planes.is_some())
    }

    /// How `planes` planes at most are learned.
    fn learned_design(&self, planes: usize) -> LearnedDesign {
        LearnedDesign { planes, opponent: self.color == Color::Ycc, target_psnr: self.target_psnr }
    }

    /// The number of functions asked for by -k, --order or --degree; `None` for the default.
    fn asked_count(&self) -> Result<Option<usize>, Failure> {
        self.functions.asked_count(self.family()?)
    }

    fn family(&self) -> Result<&'static Family, Failure> {
        family_of_name(&self.basis)
    }

    /// The choices of the SRBF family; an error when they are given for another one.
    fn srbf(&self) -> Result<SrbfDesign, Failure> {
        self.functions.srbf(&self.basis)
    }

    fn weighting(&self) -> LightWeights {
        match self.weights {
            Weights::Voronoi => LightWeights::Voronoi,
            Weights::Uniform => LightWeights::Uniform,
        }
    }
}
