//! The steps from options to assets, each for one asset or for several that share it.

use super::Stages;
use super::fit::{self, BakeFit, Choice};
use super::fit_options::FitOptions;
use super::textures::{self, Plan, TextureOptions, Trial};
use super::versions::Versions;
use crate::failure::Failure;
use crate::options::Machine;
use crate::{interrupt, progress};
use relight_core::{Basis, CoefficientDistribution, Model, Space, Stack};
use relight_fit::{ChannelSample, FitError, Misfit, NearLamps, Sample, for_each_span, misfits, span_bytes};
use relight_formats::{
    AssetFormat, AssetHeader, AssetPlan, AssetPositions, OpenCapture, Parts, WriteSettings,
};
use relight_texture::{PackReport, TexelFormat, needs_rows, planes_of_layers, span_pixels, working_bytes};
use std::cell::OnceCell;
use std::path::{Path, PathBuf};
use std::sync::atomic::{AtomicU64, Ordering};
use std::time::Instant;

/// An asset that is to be made of pictures: what is known before they are decoded.
pub(crate) struct Planned<'a> {
    pub(crate) output: PathBuf,
    pub(crate) model: Model,
    /// The folder that gets its [`Versions`], where they are wanted.
    pub(crate) keep_versions_in: Option<PathBuf>,
    format: &'static AssetFormat,
    settings: WriteSettings,
    fit: &'a FitOptions,
    textures: &'a TextureOptions,
    size: (usize, usize),
    formats: Vec<TexelFormat>,
    levels: usize,
    choice: Choice,
}

/// What coefficients come from, and what is known of them.
pub(crate) struct Coefficients<'a> {
    pub(crate) fit: &'a BakeFit<'a>,
    pub(crate) stack: &'a dyn Stack,
    /// Of each plane; where there are none they are found when they are needed.
    pub(crate) distributions: Vec<CoefficientDistribution>,
}

/// An asset that was made.
pub(crate) struct Made {
    pub(crate) plan: Plan,
    pub(crate) packed: PackReport,
    /// What it was before, where that was to be kept.
    pub(crate) versions: Option<Versions>,
    /// Its files.
    pub(crate) files: Vec<PathBuf>,
    /// Seconds of all threads together in which it was written.
    pub(crate) write_seconds: f64,
}

/// What of the pictures decides a fit, taken once for all fits.
pub(crate) struct Samples<'a> {
    stack: &'a dyn Stack,
    pictures: OnceCell<Sample>,
    channels: OnceCell<ChannelSample>,
    misfits: OnceCell<Vec<Misfit>>,
}

impl<'a> Samples<'a> {
    pub(crate) fn new(stack: &'a dyn Stack) -> Self {
        Self { stack, pictures: OnceCell::new(), channels: OnceCell::new(), misfits: OnceCell::new() }
    }

    /// The pictures.
    pub(super) fn stack(&self) -> &dyn Stack {
        self.stack
    }

    pub(super) fn pictures(&self) -> Result<&Sample, Failure> {
        taken(&self.pictures, || Ok(Sample::of(self.stack).map_err(FitError::from)?))
    }

    pub(super) fn channels(&self) -> Result<&ChannelSample, Failure> {
        taken(&self.channels, || Ok(ChannelSample::of(self.stack).map_err(FitError::from)?))
    }

    /// The pictures that don't fit their light, by the first sample that is asked about.
    pub(super) fn misfits(&self, capture: &OpenCapture, sample: &Sample) -> Result<&[Misfit], Failure> {
        taken(&self.misfits, || Ok(misfits(&capture.capture.lights, sample)?)).map(Vec::as_slice)
    }
}

fn taken<T>(cell: &OnceCell<T>, take: impl FnOnce() -> Result<T, Failure>) -> Result<&T, Failure> {
    if let Some(value) = cell.get() {
        return Ok(value);
    }
    let value = take()?;
    interrupt::check()?;
    Ok(cell.get_or_init(|| value))
}

impl<'a> Planned<'a> {
    /// Everything about the asset at `output` that options and lights decide; of a fit that came out with the functions `known`,
    /// these are not chosen again.
    ///
    /// # Errors
    /// Exit code 2 for options that exclude each other, 5 where --budget-bytes holds nothing.
    pub(crate) fn new(
        output: &Path,
        fit: &'a FitOptions,
        textures: &'a TextureOptions,
        capture: &OpenCapture,
        space: Space,
        machine: &Machine,
        known: Option<Basis>,
    ) -> Result<Self, Failure> {
        let format = AssetFormat::by_path(output).map_err(Failure::of_output)?;
        let settings = textures.settings(machine.memory)?;
        let layout = fit.layout(capture)?;
        let size = capture.size();
        let formats = textures.formats(format.precisions[0], format, layout)?;
        let levels = textures.levels(size.0, size.1);
        let choice = match known {
            Some(basis) => Choice::of(basis),
            None => {
                let mut choice = fit::choose_basis(fit, capture)?;
                if let Some(budget) = fit.budget_bytes() {
                    choice.keep_within(budget, &formats, size, levels)?;
                }
                choice
            }
        };
        let lights = capture.capture.lights.directions();
        let model = Model { basis: choice.stored()?, layout, space, lights, figures: None, provenance: None };
        let planned = Self {
            output: output.to_owned(),
            model,
            keep_versions_in: None,
            format,
            settings,
            fit,
            textures,
            size,
            formats,
            levels,
            choice,
        };
        format.check(&planned.output, &planned.asset_plan(), &settings).map_err(Failure::of_output)?;
        Ok(planned)
    }

    fn asset_plan(&self) -> AssetPlan<'_> {
        let (width, height) = self.size;
        AssetPlan { width, height, model: &self.model, formats: &self.formats, levels: self.levels }
    }

    /// The formats that it may have.
    pub(crate) fn formats(&self) -> &[TexelFormat] {
        &self.formats
    }

    /// Whether every pixel's fit takes long and all are needed twice, for ranges and for texels.
    pub(crate) fn fits_slowly_and_twice(&self) -> bool {
        self.fit.is_robust() && self.needs_ranges()
    }

    /// Whether planes are spread over codes.
    fn needs_ranges(&self) -> bool {
        self.formats.iter().any(|&format| self.format.needs_ranges(format))
    }

    /// Layers of texels of `format`.
    pub(crate) fn layers(&self, format: TexelFormat) -> usize {
        planes_of_layers(&self.model, format).len()
    }

    /// The files that it will have, as far as that is known before pictures are decoded: where formats are chosen by trial,
    /// there may be more textures, and of learned planes there may be fewer.
    ///
    /// # Errors
    /// Exit code 2 where a file of something else is in the way.
    pub(crate) fn files(&self, positions: bool) -> Result<Vec<PathBuf>, Failure> {
        let plan = self.textures.plan(&self.model, self.size, &self.formats[..1], &[], None)?;
        let parts = Parts { split: self.settings.split, positions };
        self.format.outputs(&self.output, &plan.packing, parts).map_err(Failure::of_output)
    }

    /// Bytes of its texels in all levels, of the first of the formats that it may have.
    pub(crate) fn texel_bytes(&self) -> u64 {
        let Some(&format) = self.formats.first() else { return 0 };
        let layers = planes_of_layers(&self.model, format).len() as u64;
        layers * format.levels_bytes(self.size.0, self.size.1, self.levels)
    }

    /// Bytes of its coefficients as floats, at most: learned planes may turn out to be fewer.
    pub(crate) fn float_bytes(&self) -> u64 {
        let (width, height) = self.size;
        (self.model.plane_count() as u64 * 4).saturating_mul((width * height) as u64)
    }

    /// Pixels of a span that suits its writer.
    fn span_pixels(&self) -> usize {
        span_pixels(self.size.0, needs_rows(self.formats.iter().copied(), self.levels))
    }

    /// Its model with what `fit` found.
    pub(crate) fn model_of(&self, fit: &BakeFit<'_>) -> Model {
        Model { basis: fit.solved.basis(), figures: Some(fit.solved.figures()), ..self.model.clone() }
    }

    /// Solves its fit and examines it.
    pub(crate) fn solve<'l>(
        &self,
        capture: &OpenCapture,
        samples: &Samples<'_>,
        lamps: Option<&'l NearLamps>,
    ) -> Result<BakeFit<'l>, Failure> {
        fit::solve(self.fit, &self.choice, capture, self.model.layout, samples, lamps)
    }

    /// Bytes that solutions under near lamps take.
    pub(crate) fn near_bytes(&self, capture: &OpenCapture, threads: usize) -> u64 {
        self.choice.near_bytes(capture, threads)
    }
}

/// Bytes that assets which share a fit take beside the pictures of `capture` while they are made.
pub(crate) fn bytes_beside(assets: &[&Planned<'_>], capture: &OpenCapture, machine: &Machine) -> u64 {
    let span = common_span(assets);
    let held = assets.iter().map(|asset| asset.format.held_bytes(&asset.asset_plan(), &asset.settings));
    let working = assets
        .iter()
        .map(|asset| working_bytes(asset.formats.iter().copied(), asset.model.plane_count(), span));
    let maps = assets.iter().map(|asset| asset.model.maps()).max().unwrap_or(0);
    let spans =
        machine.threads as u64 * (span_bytes(capture.infos.len(), maps, span) + working.max().unwrap_or(0));
    let solving = assets.iter().map(|asset| asset.choice.solving_bytes(capture)).max().unwrap_or(0);
    // Fitting begins when what it takes to solve is gone.
    held.fold(0, u64::saturating_add).saturating_add(spans.max(solving))
}

/// A span that suits all writers: whole rows of blocks suit those that take any run.
fn common_span(assets: &[&Planned<'_>]) -> usize {
    let with_rows = assets.iter().find(|asset| needs_rows(asset.formats.iter().copied(), asset.levels));
    with_rows.or(assets.first()).map_or(1, |asset| asset.span_pixels())
}

/// Makes assets of one fit: its coefficients are computed once for all of them.
///
/// The first gets `positions`; `check` is asked about the files of each before the first is begun.
pub(crate) fn make(
    assets: &mut [&mut Planned<'_>],
    coefficients: &mut Coefficients<'_>,
    mut positions: Option<AssetPositions>,
    machine: &Machine,
    stages: &mut Stages,
    check: &dyn Fn(&[PathBuf]) -> Result<(), Failure>,
) -> Result<Vec<Made>, Failure> {
    let Coefficients { fit, stack, distributions } = coefficients;
    for asset in assets.iter_mut() {
        asset.model = asset.model_of(fit);
    }
    let assets: Vec<&Planned<'_>> = assets.iter().map(|asset| &**asset).collect();
    let (pixel_fit, level) = (fit.solved.pixel_fit(), machine.level);
    let known = assets.first().is_some_and(|asset| asset.model.plane_count() == distributions.len());
    if !known && assets.iter().any(|asset| asset.needs_ranges()) {
        *distributions = stages.time("ranges", || textures::distributions(*stack, pixel_fit, level))?;
    }
    let plans = stages.time("formats", || -> Result<Vec<_>, Failure> {
        let trial = match assets.iter().any(|asset| asset.textures.tries()) {
            true => {
                let left_out = fit.solved.leave_one_out().left_out.clone();
                Some(Trial::of(*stack, pixel_fit, level, left_out)?)
            }
            false => None,
        };
        let plan = |asset: &&Planned<'_>| {
            let distributions = if asset.needs_ranges() { &distributions[..] } else { &[] };
            let trial = trial.as_ref().filter(|_| asset.textures.tries());
            asset.textures.plan(&asset.model, asset.size, &asset.formats, distributions, trial)
        };
        assets.iter().map(plan).collect()
    })?;
    let mut files = Vec::new();
    for (asset, plan) in assets.iter().zip(&plans) {
        let parts = Parts { split: asset.settings.split, positions: positions.is_some() && files.is_empty() };
        let outputs =
            asset.format.outputs(&asset.output, &plan.packing, parts).map_err(Failure::of_output)?;
        check(&outputs)?;
        files.push(outputs);
    }
    let (mut writers, mut versions, mut version_writers) = (Vec::new(), Vec::new(), Vec::new());
    for (asset, plan) in assets.iter().zip(&plans) {
        let (width, height) = asset.size;
        let header = AssetHeader { width, height, model: asset.model.clone(), packing: plan.packing.clone() };
        let kept = match &asset.keep_versions_in {
            Some(folder) => {
                Some(Versions::create(folder, &asset.output, asset.format, &header, &asset.settings)?)
            }
            None => None,
        };
        versions.push(kept.map(|(versions, writers)| {
            version_writers.extend(writers);
            versions
        }));
        let positions = positions.take();
        writers.push((
            asset.format.create_with_positions(&asset.output, header, &asset.settings, positions)?,
            AtomicU64::new(0),
        ));
    }
    let bar = progress::bar("fitting", stack.pixels());
    let packed = stages.time("fit and write", || -> Result<Vec<_>, Failure> {
        let span = common_span(&assets);
        for_each_span::<Failure>(*stack, pixel_fit, level, span, |span| {
            for (writer, nanoseconds) in &writers {
                interrupt::check()?;
                let start = Instant::now();
                writer.write(span)?;
                nanoseconds.fetch_add(start.elapsed().as_nanos() as u64, Ordering::Relaxed);
            }
            version_writers.iter().try_for_each(|writer| writer.write(span))?;
            bar.inc(span.pixels as u64);
            Ok(())
        })?;
        for writer in version_writers {
            writer.finish()?;
        }
        let finish = |(writer, nanoseconds): (Box<dyn relight_formats::AssetWriter>, AtomicU64)| {
            let start = Instant::now();
            let packed = writer.finish()?;
            Ok((packed, nanoseconds.into_inner() as f64 * 1e-9 + start.elapsed().as_secs_f64()))
        };
        writers.into_iter().map(finish).collect()
    })?;
    bar.finish_and_clear();
    let made = plans.into_iter().zip(packed).zip(versions).zip(files);
    Ok(made
        .map(|(((plan, (packed, write_seconds)), versions), files)| Made {
            plan,
            packed,
            versions,
            files,
            write_seconds,
        })
        .collect())
}
