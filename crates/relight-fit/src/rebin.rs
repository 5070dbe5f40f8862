//! Rebinning: from rows of pictures to tiles of all lights side by side, and the product on them.
//!
//! Source: Wong et al., *Lighting Precomputation Using the Relighting Map*, figure 1. A tile of
//! all lights fits the L2 cache, is read once and multiplied once; spans are the unit of parallel
//! work and of writing. Spans and tiles depend on the pictures only, never on threads or memory.

use crate::near::NearScratch;
use crate::refit::{ChannelRefit, Refit};
use crate::robust::RobustScratch;
use crate::{FitError, LearnedFit, LeastSquares, NearSolutions, RobustFit};
use rayon::prelude::*;
use relight_core::weighted_sums::{Rows, weighted_sums};
use relight_core::{
    CoefficientCounter, CoefficientDistribution, CoefficientMap, CoefficientSample, CoefficientSpan,
};
use relight_core::{CpuLevel, Layout, Model, Spare, Stack, Vectorized};
use std::ops::Range;
use std::sync::{Mutex, PoisonError};

/// Pixels of a span for whoever doesn't need whole rows.
pub const SPAN: usize = 8192;

/// Bytes of f32 values that a tile of all lights may take: a part of every L2 cache since 2015.
const TILE_BYTES: usize = 384 << 10;

/// Bytes of a tile under near lamps, whose pixels are put in the order of their cells: some rows of these, so that there are
/// many pixels to a cell. It fits no L2 cache, but what is multiplied at a time, the pixels of one cell, does.
pub(crate) const NEAR_TILE_BYTES: usize = 4 << 20;

/// Pixels of a tile: what fits [`TILE_BYTES`], a multiple of 16 samples for the kernel's lanes.
pub(crate) fn tile_pixels(lights: usize, channels: usize) -> usize {
    pixels_within(TILE_BYTES, lights, channels)
}

fn pixels_within(bytes: usize, lights: usize, channels: usize) -> usize {
    let pixels = bytes / (4 * lights.max(1) * channels);
    (pixels / 16 * 16).clamp(16, SPAN)
}

/// Bytes that a thread needs for a span of `span_pixels` pixels of `lights` pictures and `functions`
/// functions: the pictures' rows as they are read back, the coefficients, and as much again for
/// whoever consumes them.
pub fn span_bytes(lights: usize, functions: usize, span_pixels: usize) -> u64 {
    let samples = 3 * span_pixels as u64;
    4 * samples * (lights as u64 + 2 * (functions as u64 + 1)) + TILE_BYTES as u64
}

/// What makes coefficients of a pixel's values.
#[derive(Clone, Copy, Debug)]
pub enum PixelFit<'a> {
    /// Coefficients of functions, in a layout other than shared.
    Functions(&'a LeastSquares, Layout),
    /// The same under lamps that each pixel sees from elsewhere; the pictures are those of a
    /// [`LevelledStack`](crate::LevelledStack).
    Near(&'a LeastSquares, &'a NearSolutions<'a>, Layout),
    /// Coefficients of functions that follow most lights at each pixel, three planes a function or one.
    Robust(&'a RobustFit, Layout),
    /// Learned planes.
    Planes(&'a LearnedFit),
    /// Planes of another basis; the pictures are those of a [`PlaneStack`](crate::PlaneStack).
    Refit(&'a Refit),
}

impl<'a> From<(&'a LeastSquares, Layout)> for PixelFit<'a> {
    fn from((fit, layout): (&'a LeastSquares, Layout)) -> Self {
        Self::Functions(fit, layout)
    }
}

impl<'a> From<&'a LearnedFit> for PixelFit<'a> {
    fn from(fit: &'a LearnedFit) -> Self {
        Self::Planes(fit)
    }
}

impl<'a> From<&'a Refit> for PixelFit<'a> {
    fn from(refit: &'a Refit) -> Self {
        Self::Refit(refit)
    }
}

impl PixelFit<'_> {
    fn layout(self) -> Layout {
        match self {
            Self::Functions(_, layout) | Self::Near(_, _, layout) | Self::Robust(_, layout) => layout,
            Self::Planes(_) => Layout::Shared,
            Self::Refit(refit) => refit.layout,
        }
    }

    /// Rows of coefficients.
    fn maps(self) -> usize {
        match self {
            Self::Functions(fit, _) | Self::Near(fit, ..) => fit.basis.count(),
            Self::Robust(fit, _) => fit.least_squares().basis.count(),
            Self::Planes(fit) => fit.basis.planes(),
            Self::Refit(refit) => refit.maps(),
        }
    }

    /// The matrix as the kernel takes it, that of the middle under near lamps; a refit has one for each channel of its own.
    fn matrix(self) -> Vec<f32> {
        match self {
            Self::Functions(fit, _) | Self::Near(fit, ..) => fit.solution_f32(),
            Self::Robust(fit, _) => fit.least_squares().solution_f32(),
            Self::Planes(fit) => fit.projection_f32(),
            Self::Refit(_) => Vec::new(),
        }
    }
}

/// Fits every pixel of `stack` and hands the coefficients to `consume`, span by span, in any
/// order and from several threads at once.
///
/// Every span but the last has `span_pixels` pixels, [`SPAN`] or for instance some whole rows; a
/// pixel's coefficients have the same bits whatever that is.
///
/// # Errors
/// The first error of reading the stack or of `consume`; [`FitError::GreyHasNoColor`] for
/// [`Layout::Lrgb`] on grey pictures.
///
/// # Panics
/// When `span_pixels` is 0.
pub fn for_each_span<'a, E: From<FitError> + Send>(
    stack: &dyn Stack,
    fit: impl Into<PixelFit<'a>>,
    level: CpuLevel,
    span_pixels: usize,
    consume: impl Fn(&CoefficientSpan<'_>) -> Result<(), E> + Sync,
) -> Result<(), E> {
    for_each_span_within(stack, fit, level, 0..stack.pixels(), span_pixels, consume)
}

/// [`for_each_span`] of some pixels of the picture alone; spans are counted from the first of them.
///
/// # Errors
/// As there.
///
/// # Panics
/// When `span_pixels` is 0 or `within` leaves the picture.
pub fn for_each_span_within<'a, E: From<FitError> + Send>(
    stack: &dyn Stack,
    fit: impl Into<PixelFit<'a>>,
    level: CpuLevel,
    within: Range<usize>,
    span_pixels: usize,
    consume: impl Fn(&CoefficientSpan<'_>) -> Result<(), E> + Sync,
) -> Result<(), E> {
    assert!(within.end <= stack.pixels(), "the pixels leave the picture");
    let fitting = Fitting::new(stack, fit.into(), level)?;
    let spans = within.len().div_ceil(span_pixels);
    let spare = Spare::<Scratch>::default();
    (0..spans).into_par_iter().try_for_each(|span| {
        let mut scratch = spare.take();
        let first = within.start + span * span_pixels;
        consume(&scratch.fit(&fitting, first, span_pixels.min(within.end - first))?)?;
        spare.give(scratch);
        Ok(())
    })
}

/// What is fitted to which pictures, and how.
struct Fitting<'a> {
    stack: &'a dyn Stack,
    fit: PixelFit<'a>,
    matrix: Vec<f32>,
    level: CpuLevel,
}

impl<'a> Fitting<'a> {
    fn new(stack: &'a dyn Stack, fit: PixelFit<'a>, level: CpuLevel) -> Result<Self, FitError> {
        let of_pictures = !matches!(fit, PixelFit::Refit(_));
        if of_pictures && fit.layout() == Layout::Lrgb && stack.channels() == 1 {
            return Err(FitError::GreyHasNoColor);
        }
        Ok(Self { stack, fit, matrix: fit.matrix(), level })
    }

    /// Pixels of a tile of pictures.
    fn tile_pixels(&self, channels: usize) -> usize {
        let bytes = if matches!(self.fit, PixelFit::Near(..)) { NEAR_TILE_BYTES } else { TILE_BYTES };
        pixels_within(bytes, self.stack.lights(), channels)
    }

    /// Coefficients of functions from all lights' samples, `channels` a pixel, from pixel `first` on.
    fn solve(
        &self,
        scratch: &mut SolveScratch,
        (first, channels): (usize, usize),
        input: Rows<&[f32]>,
        output: Rows<&mut [f32]>,
        width: usize,
    ) {
        match self.fit {
            PixelFit::Near(_, solutions, _) => {
                solutions.sums(&mut scratch.near, self.level, (first, channels), input, output, width);
            }
            PixelFit::Robust(fit, _) => fit.solve(&mut scratch.robust, channels, input, output, width),
            _ => weighted_sums(self.level, &self.matrix, self.stack.lights(), input, output, width),
        }
    }
}

/// Buffers of one thread.
#[derive(Default)]
struct Scratch {
    tile: Vec<f32>,
    interleaved: Vec<f32>,
    luminance: Vec<f32>,
    coefficients: Vec<f32>,
    base_color: Vec<f32>,
    solve: SolveScratch,
}

/// What ways of solving need beside a tile.
#[derive(Default)]
struct SolveScratch {
    near: NearScratch,
    robust: RobustScratch,
}

impl Scratch {
    fn fit(
        &mut self,
        fitting: &Fitting<'_>,
        first: usize,
        pixels: usize,
    ) -> Result<CoefficientSpan<'_>, FitError> {
        match fitting.fit {
            PixelFit::Functions(fit, Layout::Lrgb) | PixelFit::Near(fit, _, Layout::Lrgb) => {
                self.fit_luminance(fitting, fit, first, pixels)?;
            }
            PixelFit::Functions(..) | PixelFit::Near(..) | PixelFit::Robust(..) => {
                self.fit_channels(fitting, first, pixels)?;
            }
            PixelFit::Planes(_) => self.fit_planes(fitting, first, pixels)?,
            PixelFit::Refit(refit) => self.refit(fitting, refit, first, pixels)?,
        }
        Ok(CoefficientSpan { first, pixels, maps: &self.coefficients, base_color: &self.base_color })
    }

    fn fit_channels(&mut self, fitting: &Fitting<'_>, first: usize, pixels: usize) -> Result<(), FitError> {
        let Fitting { stack, matrix: solution, .. } = fitting;
        let (lights, channels) = (stack.lights(), stack.channels());
        let samples = pixels * channels;
        let rows = stack.rows(first * channels..(first + pixels) * channels)?;
        let stride = fitting.tile_pixels(channels) * channels;
        self.tile.resize(lights * stride, 0.0);
        self.coefficients.resize(solution.len() / lights * samples, 0.0);
        for start in (0..samples).step_by(stride) {
            let width = stride.min(samples - start);
            for (light, row) in self.tile.chunks_exact_mut(stride).enumerate() {
                rows.copy(light, start, &mut row[..width]);
            }
            let input = Rows { samples: &self.tile[..], stride };
            let output = Rows { samples: &mut self.coefficients[start..], stride: samples };
            let place = (first + start / channels, channels);
            fitting.solve(&mut self.solve, place, input, output, width);
        }
        Ok(())
    }

    /// Planes from all channels of all pictures at once.
    fn fit_planes(&mut self, fitting: &Fitting<'_>, first: usize, pixels: usize) -> Result<(), FitError> {
        let Fitting { stack, matrix, level, .. } = fitting;
        let (lights, channels) = (stack.lights(), stack.channels());
        let inputs = lights * channels;
        let rows = stack.rows(first * channels..(first + pixels) * channels)?;
        let stride = tile_pixels(lights, channels);
        self.tile.resize(inputs * stride, 0.0);
        self.interleaved.resize(channels * stride, 0.0);
        self.coefficients.resize(matrix.len() / inputs * pixels, 0.0);
        for start in (0..pixels).step_by(stride) {
            let width = stride.min(pixels - start);
            for (light, tile) in self.tile.chunks_exact_mut(channels * stride).enumerate() {
                let row = &mut self.interleaved[..width * channels];
                rows.copy(light, start * channels, row);
                level.run(Apart { row, channels, stride, tile });
            }
            let input = Rows { samples: &self.tile[..], stride };
            let output = Rows { samples: &mut self.coefficients[start..], stride: pixels };
            weighted_sums(*level, matrix, inputs, input, output, width);
        }
        Ok(())
    }

    /// Planes of another basis from planes.
    fn refit(
        &mut self,
        fitting: &Fitting<'_>,
        refit: &Refit,
        first: usize,
        pixels: usize,
    ) -> Result<(), FitError> {
        let rows = fitting.stack.rows(first..first + pixels)?;
        let (maps, stride) = (refit.maps(), refit.channels.len());
        self.coefficients.resize(maps * pixels * stride, 0.0);
        for (c, ChannelRefit { planes, weights, mean, factor }) in refit.channels.iter().enumerate() {
            let piece = tile_pixels(planes.len(), 1);
            self.tile.resize(planes.len() * piece, 0.0);
            self.interleaved.resize(maps * piece, 0.0);
            self.luminance.resize(piece, 0.0);
            for start in (0..pixels).step_by(piece) {
                let width = piece.min(pixels - start);
                for (&plane, row) in planes.iter().zip(self.tile.chunks_exact_mut(piece)) {
                    rows.copy(plane, start, &mut row[..width]);
                }
                let made = match weights {
                    None => &self.tile,
                    Some(weights) => {
                        let input = Rows { samples: &self.tile[..], stride: piece };
                        let output = Rows { samples: &mut self.interleaved[..], stride: piece };
                        weighted_sums(fitting.level, weights, planes.len(), input, output, width);
                        for (row, mean) in self.interleaved.chunks_exact_mut(piece).zip(mean) {
                            row[..width].iter_mut().for_each(|value| *value += mean);
                        }
                        &self.interleaved
                    }
                };
                let factors = &mut self.luminance[..width];
                if let Some(plane) = factor {
                    rows.copy(*plane, start, factors);
                }
                for (map, row) in made.chunks_exact(piece).enumerate() {
                    let out = &mut self.coefficients[(map * pixels + start) * stride..][..width * stride];
                    let out = out[c..].iter_mut().step_by(stride).zip(row);
                    if factor.is_some() {
                        out.zip(&*factors).for_each(|((out, value), factor)| *out = value * factor);
                    } else {
                        out.for_each(|(out, value)| *out = *value);
                    }
                }
            }
        }
        self.base_color.resize(pixels * refit.base_color.len(), 0.0);
        self.luminance.resize(pixels, 0.0);
        for (c, &plane) in refit.base_color.iter().enumerate() {
            rows.copy(plane, 0, &mut self.luminance[..pixels]);
            let out = self.base_color[c..].iter_mut().step_by(3);
            out.zip(&self.luminance).for_each(|(out, value)| *out = *value);
        }
        Ok(())
    }

    /// Luminance coefficients and base colour: pixel = base colour x luminance, the base colour
    /// the least-squares ratio of each channel to the luminance, scaled to a largest component
    /// of 1. Black pixels get a white base and no luminance, never 0/0.
    fn fit_luminance(
        &mut self,
        fitting: &Fitting<'_>,
        fit: &LeastSquares,
        first: usize,
        pixels: usize,
    ) -> Result<(), FitError> {
        let Fitting { stack, matrix: solution, .. } = fitting;
        let lights = stack.lights();
        let rows = stack.rows(first * 3..(first + pixels) * 3)?;
        let stride = fitting.tile_pixels(4);
        self.tile.resize(stride * 3, 0.0);
        self.luminance.resize(lights * stride, 0.0);
        self.coefficients.resize(solution.len() / lights * pixels, 0.0);
        self.base_color.resize(pixels * 3, 0.0);
        for start in (0..pixels).step_by(stride) {
            let width = stride.min(pixels - start);
            let mut products = vec![[0.0f32; 4]; width];
            for (light, luminance) in self.luminance.chunks_exact_mut(stride).enumerate() {
                rows.copy(light, start * 3, &mut self.tile[..width * 3]);
                let weight = fit.decomposition.weights[light] as f32;
                let pixels = self.tile.chunks_exact(3).zip(luminance.iter_mut()).zip(&mut products);
                for ((rgb, luminance), products) in pixels {
                    *luminance = relight_core::luminance([rgb[0], rgb[1], rgb[2]]);
                    for (channel, value) in rgb.iter().enumerate() {
                        products[channel] += weight * value * *luminance;
                    }
                    products[3] += weight * *luminance * *luminance;
                }
            }
            let input = Rows { samples: &self.luminance[..], stride };
            let output = Rows { samples: &mut self.coefficients[start..], stride: pixels };
            fitting.solve(&mut self.solve, (first + start, 1), input, output, width);
            for (x, [r, g, b, square]) in products.into_iter().enumerate() {
                let largest = r.max(g).max(b);
                let lit = largest > 0.0 && square > 0.0 && largest.is_finite() && square.is_finite();
                let factor = if lit { largest / square } else { 0.0 };
                let color = if lit { [r, g, b].map(|c| (c / largest).max(0.0)) } else { [1.0; 3] };
                self.base_color[(start + x) * 3..][..3].copy_from_slice(&color);
                for row in self.coefficients.chunks_exact_mut(pixels) {
                    row[start + x] *= factor;
                }
            }
        }
        Ok(())
    }
}

/// Channels side by side to rows of their own.
struct Apart<'a> {
    row: &'a [f32],
    channels: usize,
    stride: usize,
    tile: &'a mut [f32],
}

impl Vectorized for Apart<'_> {
    type Output = ();

    #[inline(always)]
    fn run(self) {
        let Self { row, channels, stride, tile } = self;
        if channels == 1 {
            tile[..row.len()].copy_from_slice(row);
            return;
        }
        let (r, rest) = tile.split_at_mut(stride);
        let (g, b) = rest.split_at_mut(stride);
        for (((pixel, r), g), b) in row.chunks_exact(3).zip(r).zip(g).zip(b) {
            (*r, *g, *b) = (pixel[0], pixel[1], pixel[2]);
        }
    }
}

/// The rows of `span`, each with the number of interleaved channels in it; their planes follow one
/// another in the order of [`Model::roles`].
fn rows_of<'a>(span: &CoefficientSpan<'a>, layout: Layout) -> impl Iterator<Item = (&'a [f32], usize)> {
    let channels = layout.planes_per_map();
    let base_color = (!span.base_color.is_empty()).then_some((span.base_color, 3));
    span.maps.chunks_exact(span.pixels * channels).map(move |row| (row, channels)).chain(base_color)
}

/// The distribution of every plane's coefficients, in the order of [`Model::roles`]; the same with
/// any number of threads.
///
/// `check` is called once a span. Takes 128 KiB a plane on the way.
///
/// # Errors
/// As [`for_each_span`], and those of `check`.
pub fn coefficient_distributions<'a, E: From<FitError> + Send>(
    stack: &dyn Stack,
    fit: impl Into<PixelFit<'a>>,
    level: CpuLevel,
    check: impl Fn() -> Result<(), E> + Sync,
) -> Result<Vec<CoefficientDistribution>, E> {
    let fit = fit.into();
    let layout = fit.layout();
    let planes_of_rows =
        std::iter::repeat_n(layout.planes_per_map(), fit.maps()).chain((layout == Layout::Lrgb).then_some(3));
    // A lock a row: threads follow one another through the planes.
    let of_rows: Vec<_> =
        planes_of_rows.map(|planes| Mutex::new(vec![CoefficientCounter::new(); planes])).collect();
    for_each_span(stack, fit, level, SPAN, |span| {
        check()?;
        for ((row, _), counters) in rows_of(span, layout).zip(&of_rows) {
            let mut counters = counters.lock().unwrap_or_else(PoisonError::into_inner);
            CoefficientCounter::add_interleaved(&mut counters, row, span.first);
        }
        Ok::<(), E>(())
    })?;
    let counters =
        of_rows.into_iter().flat_map(|row| row.into_inner().unwrap_or_else(PoisonError::into_inner));
    Ok(counters.map(|counter| counter.distribution()).collect())
}

/// Coefficients of up to `blocks` blocks of 4 x 4 pixels spread evenly over the picture, all of them
/// where there are no more; the same for every stack of that size.
///
/// # Errors
/// As [`for_each_span`].
///
/// # Panics
/// When `blocks` is 0.
pub fn coefficient_sample<'a>(
    stack: &dyn Stack,
    fit: impl Into<PixelFit<'a>>,
    level: CpuLevel,
    blocks: usize,
) -> Result<CoefficientSample, FitError> {
    let fit = fit.into();
    let layout = fit.layout();
    let fitting = Fitting::new(stack, fit, level)?;
    let (width, height) = (stack.width(), stack.height());
    let corners = block_corners(width, height, blocks);
    // By block: planes x 16.
    let of_blocks = corners
        .par_iter()
        .map_init(Scratch::default, |scratch, &(x, y)| {
            let columns = 4.min(width - x);
            let mut block: Vec<[f32; 16]> = Vec::new();
            for row in 0..4 {
                let first = (y + row).min(height - 1) * width + x;
                let span = scratch.fit(&fitting, first, columns)?;
                let mut plane = 0;
                for (samples, channels) in rows_of(&span, layout) {
                    block.resize((plane + channels).max(block.len()), [0.0; 16]);
                    for channel in 0..channels {
                        for column in 0..4 {
                            block[plane][4 * row + column] =
                                samples[column.min(columns - 1) * channels + channel];
                        }
                        plane += 1;
                    }
                }
            }
            Ok(block)
        })
        .collect::<Result<Vec<_>, FitError>>()?;
    let planes =
        (0..of_blocks[0].len()).map(|plane| of_blocks.iter().flat_map(|block| block[plane]).collect());
    Ok(CoefficientSample { blocks: corners.len(), planes: planes.collect() })
}

/// The upper left pixels of up to `most` blocks: one at a place of its own in each of as many equal
/// parts of the picture's grid of blocks.
fn block_corners(width: usize, height: usize, most: usize) -> Vec<(usize, usize)> {
    let (columns, rows) = (width.div_ceil(4), height.div_ceil(4));
    let grid = (columns * rows) as u64;
    let parts = grid.min(most as u64);
    (0..parts)
        .map(|part| {
            let (start, end) = (part * grid / parts, (part + 1) * grid / parts);
            // 2^32 times the golden ratio: its multiples keep blocks from lining up in columns.
            let place = (part * 0x9e37_79b9) & 0xffff_ffff;
            let block = (start + ((place * (end - start)) >> 32)) as usize;
            (block % columns * 4, block / columns * 4)
        })
        .collect()
}

/// All coefficients at once, in f32 planes.
///
/// # Errors
/// As [`for_each_span`].
pub fn fit_map(
    stack: &dyn Stack,
    fit: &LeastSquares,
    model: Model,
    level: CpuLevel,
) -> Result<CoefficientMap, FitError> {
    let pixels = stack.pixels();
    let planes = Mutex::new(vec![vec![0.0; pixels]; model.plane_count()]);
    for_each_span(stack, (fit, model.layout), level, SPAN, |span| {
        let mut planes = planes.lock().unwrap_or_else(PoisonError::into_inner);
        let mut plane = 0;
        for (row, channels) in rows_of(span, model.layout) {
            for channel in 0..channels {
                let values = row[channel..].iter().step_by(channels);
                for (out, value) in planes[plane][span.first..].iter_mut().zip(values) {
                    *out = *value;
                }
                plane += 1;
            }
        }
        Ok::<(), FitError>(())
    })?;
    let planes = planes.into_inner().unwrap_or_else(PoisonError::into_inner);
    Ok(CoefficientMap { width: stack.width(), height: stack.height(), model, planes })
}
