//! Rebinning: from rows of pictures to tiles of all lights side by side, and the product on them.
//!
//! Source: Wong et al., *Lighting Precomputation Using the Relighting Map*, figure 1. A tile of
//! all lights fits the L2 cache, is read once and multiplied once; spans are the unit of parallel
//! work and of writing. Spans and tiles depend on the pictures only, never on threads or memory.

use crate::{FitError, LeastSquares};
use rayon::prelude::*;
use relight_core::weighted_sums::{Rows, weighted_sums};
use relight_core::{CoefficientMap, CoefficientRange, CoefficientSpan, CpuLevel, Layout, Model, Stack};

/// Pixels of a span.
pub const SPAN: usize = 8192;

/// Bytes of f32 values that a tile of all lights may take: a part of every L2 cache since 2015.
const TILE_BYTES: usize = 384 << 10;

/// Pixels of a tile: what fits [`TILE_BYTES`], a multiple of 16 samples for the kernel's lanes.
fn tile_pixels(lights: usize, channels: usize) -> usize {
    let pixels = TILE_BYTES / (4 * lights.max(1) * channels);
    (pixels / 16 * 16).clamp(16, SPAN)
}

/// Bytes that a thread needs for a span of `lights` pictures and `functions` functions: the pictures'
/// rows as they are read back, the coefficients, and as much again for whoever consumes them.
pub fn span_bytes(lights: usize, functions: usize) -> u64 {
    let samples = 3 * SPAN as u64;
    4 * samples * (lights as u64 + 2 * (functions as u64 + 1)) + TILE_BYTES as u64
}

/// Fits every pixel of `stack` and hands the coefficients to `consume`, span by span, in any
/// order and from several threads at once.
///
/// # Errors
/// The first error of reading the stack or of `consume`; [`FitError::GreyHasNoColor`] for
/// [`Layout::Lrgb`] on grey pictures.
pub fn for_each_span<E: From<FitError> + Send>(
    stack: &dyn Stack,
    fit: &LeastSquares,
    layout: Layout,
    level: CpuLevel,
    consume: impl Fn(&CoefficientSpan<'_>) -> Result<(), E> + Sync,
) -> Result<(), E> {
    if layout == Layout::Lrgb && stack.channels() == 1 {
        return Err(FitError::GreyHasNoColor.into());
    }
    let solution = fit.solution_f32();
    let spans = stack.pixels().div_ceil(SPAN);
    (0..spans).into_par_iter().try_for_each_init(Scratch::default, |scratch, span| {
        let first = span * SPAN;
        let pixels = SPAN.min(stack.pixels() - first);
        match layout {
            Layout::Lrgb => scratch.fit_luminance(stack, fit, &solution, level, first, pixels)?,
            Layout::Grey | Layout::Rgb => scratch.fit_channels(stack, &solution, level, first, pixels)?,
        }
        consume(&CoefficientSpan {
            first,
            pixels,
            functions: &scratch.coefficients,
            base_color: &scratch.base_color,
        })
    })
}

/// Buffers of one thread.
#[derive(Default)]
struct Scratch {
    tile: Vec<f32>,
    luminance: Vec<f32>,
    coefficients: Vec<f32>,
    base_color: Vec<f32>,
}

impl Scratch {
    fn fit_channels(
        &mut self,
        stack: &dyn Stack,
        solution: &[f32],
        level: CpuLevel,
        first: usize,
        pixels: usize,
    ) -> Result<(), FitError> {
        let (lights, channels) = (stack.lights(), stack.channels());
        let samples = pixels * channels;
        let rows = stack.rows(first * channels..(first + pixels) * channels)?;
        let stride = tile_pixels(lights, channels) * channels;
        self.tile.resize(lights * stride, 0.0);
        self.coefficients.resize(solution.len() / lights * samples, 0.0);
        for start in (0..samples).step_by(stride) {
            let width = stride.min(samples - start);
            for (light, row) in self.tile.chunks_exact_mut(stride).enumerate() {
                rows.copy(light, start, &mut row[..width]);
            }
            let input = Rows { samples: &self.tile[..], stride };
            let output = Rows { samples: &mut self.coefficients[start..], stride: samples };
            weighted_sums(level, solution, lights, input, output, width);
        }
        Ok(())
    }

    /// Luminance coefficients and base colour: pixel = base colour x luminance, the base colour
    /// the least-squares ratio of each channel to the luminance, scaled to a largest component
    /// of 1. Black pixels get a white base and no luminance, never 0/0.
    fn fit_luminance(
        &mut self,
        stack: &dyn Stack,
        fit: &LeastSquares,
        solution: &[f32],
        level: CpuLevel,
        first: usize,
        pixels: usize,
    ) -> Result<(), FitError> {
        let lights = stack.lights();
        let rows = stack.rows(first * 3..(first + pixels) * 3)?;
        let stride = tile_pixels(lights, 4);
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
            weighted_sums(level, solution, lights, input, output, width);
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

/// Least and largest coefficient of every plane of `layout`, in the order of [`Model::roles`].
///
/// # Errors
/// As [`for_each_span`].
pub fn coefficient_ranges<E: From<FitError> + Send>(
    stack: &dyn Stack,
    fit: &LeastSquares,
    layout: Layout,
    level: CpuLevel,
    check: impl Fn() -> Result<(), E> + Sync,
) -> Result<Vec<CoefficientRange>, E> {
    let channels = layout.planes_per_function();
    let colors = if layout == Layout::Lrgb { 3 } else { 0 };
    let planes = fit.basis.count() * channels + colors;
    let total = std::sync::Mutex::new(vec![CoefficientRange::EMPTY; planes]);
    for_each_span(stack, fit, layout, level, |span| {
        check()?;
        let mut ranges = Vec::with_capacity(planes);
        for row in span.functions.chunks_exact(span.pixels * channels) {
            let [r, g, b] = channel_ranges(row);
            // All lanes of a one-channel row belong to its one plane.
            let of_row = if channels == 3 { vec![r, g, b] } else { vec![r.union(g).union(b)] };
            ranges.extend(of_row);
        }
        if colors == 3 {
            ranges.extend(channel_ranges(span.base_color));
        }
        // The union of ranges is the same in any order.
        let mut total = total.lock().unwrap_or_else(std::sync::PoisonError::into_inner);
        for (total, range) in total.iter_mut().zip(ranges) {
            *total = total.union(range);
        }
        Ok::<(), E>(())
    })?;
    Ok(total.into_inner().unwrap_or_else(std::sync::PoisonError::into_inner))
}

/// Ranges of the samples 0, 3, 6 ..; 1, 4, 7 ..; and 2, 5, 8 .. of `row`.
fn channel_ranges(row: &[f32]) -> [CoefficientRange; 3] {
    /// A multiple of three channels and of the SIMD lanes.
    const WIDTH: usize = 24;
    let (mut min, mut max) = ([f32::INFINITY; WIDTH], [f32::NEG_INFINITY; WIDTH]);
    let chunks = row.chunks_exact(WIDTH);
    for (lane, value) in chunks.remainder().iter().enumerate() {
        (min[lane], max[lane]) = (min[lane].min(*value), max[lane].max(*value));
    }
    for chunk in chunks {
        for lane in 0..WIDTH {
            // Comparisons, not f32::min: those compile to one instruction a vector.
            min[lane] = if chunk[lane] < min[lane] { chunk[lane] } else { min[lane] };
            max[lane] = if chunk[lane] > max[lane] { chunk[lane] } else { max[lane] };
        }
    }
    std::array::from_fn(|channel| {
        (channel..WIDTH).step_by(3).fold(CoefficientRange::EMPTY, |range, lane| {
            range.union(CoefficientRange { min: min[lane], max: max[lane] })
        })
    })
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
    let channels = model.layout.planes_per_function();
    let planes = std::sync::Mutex::new(vec![vec![0.0; pixels]; model.plane_count()]);
    for_each_span(stack, fit, model.layout, level, |span| {
        let mut planes = planes.lock().unwrap_or_else(std::sync::PoisonError::into_inner);
        let rows = span.functions.chunks_exact(span.pixels * channels);
        let colors = (!span.base_color.is_empty()).then_some((span.base_color, 3));
        let mut plane = 0;
        for (row, channels) in rows.map(|row| (row, channels)).chain(colors) {
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
    let planes = planes.into_inner().unwrap_or_else(std::sync::PoisonError::into_inner);
    Ok(CoefficientMap { width: stack.width(), height: stack.height(), model, planes })
}
