//! A bounded sample of pixels, by which a fit is judged in closed form.

use crate::row_products::quadratic_form;
use rayon::prelude::*;
use relight_core::{Stack, StackError};

/// Pixels side by side in a run: a spilled picture is read a run at a time.
const RUN: usize = 16;

/// Runs of a sample; 8,192 pixels decide a ridge as well as a million do.
const RUNS: usize = 512;

/// The inner products of all pictures over a sample of pixels.
#[derive(Clone, Debug)]
pub struct Sample {
    /// Number of pictures N.
    pub lights: usize,
    /// Samples (pixels x channels) that were taken.
    pub count: usize,
    /// N x N, row-major: `gram[i][j] = mean over samples of value_i * value_j`.
    pub gram: Vec<f64>,
}

/// Lights up to which all runs are taken: the inner products of N pictures cost N^2 a sample.
const LIGHTS_FOR_ALL_RUNS: usize = 500;

/// `count` pixels of a picture of `pixels`, or all of them, as [`Sample::of`] spreads its runs.
pub(crate) fn spread_pixels(pixels: usize, count: usize) -> Vec<usize> {
    if pixels <= RUN * count {
        let count = count.min(pixels);
        return (0..count).map(|i| (2 * i + 1) * pixels / (2 * count)).collect();
    }
    run_starts(pixels, count).into_iter().map(|start| start + RUN / 2).collect()
}

/// Runs taken from `lights` pictures.
fn runs_for(lights: usize) -> usize {
    let square = |n: usize| n * n;
    (RUNS * square(LIGHTS_FOR_ALL_RUNS) / square(lights.max(1))).clamp(RUNS / 8, RUNS)
}

/// First pixel of each run: one at a place of its own in each of `runs` equal parts of the picture.
fn run_starts(pixels: usize, runs: usize) -> Vec<usize> {
    if pixels <= RUN * runs {
        return (0..pixels).step_by(RUN).collect();
    }
    let part = pixels as f64 / runs as f64;
    // The golden ratio's multiples keep the places from lining up with the picture's rows.
    let place = |i: usize| (i as f64 * 0.618_033_988_749_894_9).fract() * (part - RUN as f64);
    (0..runs).map(|i| (i as f64 * part + place(i)) as usize).collect()
}

/// The moments of all pictures over a sample of pixels, channel by channel.
#[derive(Clone, Debug)]
pub struct ChannelSample {
    /// Samples a pixel: 1 or 3.
    pub channels: usize,
    /// The mean of channel c of picture i, at `i * channels + c`.
    pub means: Vec<f64>,
    /// Mean products of these rows, (N x channels)^2, row-major.
    pub gram: Vec<f64>,
    /// The same over channels.
    pub of_pictures: Sample,
}

impl ChannelSample {
    /// As of [`Sample::of`].
    ///
    /// # Errors
    /// [`StackError`] when a picture can't be read back.
    pub fn of(stack: &dyn Stack) -> Result<Self, StackError> {
        Ok(Self::from_values(&interleaved(stack)?, stack.channels()))
    }

    /// Bytes of the values of which [`Self::of`] takes moments, as read and channel by channel.
    pub(crate) fn values_bytes(lights: usize, channels: usize, pixels: usize) -> u64 {
        2 * 4 * (lights * channels * pixels.min(RUN * runs_for(lights))) as u64
    }

    /// The moments of pictures given as equally long rows of values, `channels` interleaved in each.
    ///
    /// # Panics
    /// When the rows differ in length or are not whole pixels.
    pub fn from_values(values: &[Vec<f32>], channels: usize) -> Self {
        let rows: Vec<Vec<f32>> = values
            .iter()
            .flat_map(|row| {
                assert!(row.len().is_multiple_of(channels), "whole pixels");
                (0..channels).map(|c| row[c..].iter().step_by(channels).copied().collect())
            })
            .collect();
        let Sample { gram, count, .. } = Sample::from_values(&rows);
        let mean = |row: &Vec<f32>| row.iter().map(|v| f64::from(*v)).sum::<f64>() / row.len().max(1) as f64;
        let (lights, width) = (values.len(), rows.len());
        let product = |i: usize, j: usize| {
            let of = |c: usize| gram[(i * channels + c) * width + j * channels + c];
            (0..channels).map(of).sum::<f64>() / channels as f64
        };
        let of_lights = (0..lights * lights).map(|at| product(at / lights, at % lights)).collect();
        let of_pictures = Sample { lights, count: count * channels, gram: of_lights };
        Self { channels, means: rows.iter().map(mean).collect(), gram, of_pictures }
    }
}

/// The sampled pixels of every picture.
pub(crate) fn interleaved(stack: &dyn Stack) -> Result<Vec<Vec<f32>>, StackError> {
    let (lights, channels) = (stack.lights(), stack.channels());
    let starts = run_starts(stack.pixels(), runs_for(lights));
    let mut values = vec![Vec::new(); lights];
    for start in starts {
        let pixels = RUN.min(stack.pixels() - start);
        let rows = stack.rows(start * channels..(start + pixels) * channels)?;
        for (light, values) in values.iter_mut().enumerate() {
            let before = values.len();
            values.resize(before + pixels * channels, 0.0f32);
            rows.copy(light, 0, &mut values[before..]);
        }
    }
    Ok(values)
}

impl Sample {
    /// Takes up to 8,192 pixels of `stack` in runs spread over the picture, the same for every
    /// stack of that size; fewer, down to 1,024, of more than 500 pictures.
    ///
    /// # Errors
    /// [`StackError`] when a picture can't be read back.
    pub fn of(stack: &dyn Stack) -> Result<Self, StackError> {
        Ok(Self::from_values(&interleaved(stack)?))
    }

    /// The sample of pictures given as equally long rows of values.
    ///
    /// # Panics
    /// When the rows differ in length.
    pub fn from_values(values: &[Vec<f32>]) -> Self {
        let lights = values.len();
        let count = values.first().map_or(0, Vec::len);
        assert!(values.iter().all(|row| row.len() == count), "rows of different lengths");
        let mut gram = vec![0.0; lights * lights];
        gram.par_chunks_mut(lights.max(1)).enumerate().for_each(|(i, row)| {
            for (j, product) in row.iter_mut().enumerate().skip(i) {
                *product = inner_product(&values[i], &values[j]) / count.max(1) as f64;
            }
        });
        for i in 0..lights {
            for j in 0..i {
                gram[i * lights + j] = gram[j * lights + i];
            }
        }
        Self { lights, count, gram }
    }

    /// Root mean square over the sample of `sum over i of combination[i] * picture i`.
    pub fn rms(&self, combination: &[f64]) -> f64 {
        // Rounding may leave -1e-18 where the true value is 0.
        quadratic_form(&self.gram, combination).max(0.0).sqrt()
    }
}

/// Sum of products in f64, in eight interleaved sums of fixed order.
fn inner_product(a: &[f32], b: &[f32]) -> f64 {
    let mut sums = [0.0f64; 8];
    let (chunks_a, chunks_b) = (a.chunks_exact(8), b.chunks_exact(8));
    let tail: f64 = chunks_a
        .remainder()
        .iter()
        .zip(chunks_b.remainder())
        .map(|(x, y)| f64::from(*x) * f64::from(*y))
        .sum();
    for (x, y) in chunks_a.zip(chunks_b) {
        for lane in 0..8 {
            sums[lane] += f64::from(x[lane]) * f64::from(y[lane]);
        }
    }
    sums.iter().sum::<f64>() + tail
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn runs_stay_apart_and_inside() {
        for pixels in [1, 15, 16, 17, 8192, 8193, 1_000_003] {
            let starts = run_starts(pixels, RUNS);
            assert!(starts.windows(2).all(|w| w[1] >= w[0] + RUN), "{pixels}");
            let last = *starts.last().unwrap();
            assert!(last < pixels && (pixels <= RUN * RUNS || last + RUN <= pixels), "{pixels}");
        }
    }

    #[test]
    fn the_gram_matrix_gives_the_rms_of_any_combination() {
        let rows: Vec<Vec<f32>> =
            (0..3).map(|i| (0..101).map(|x| ((x * (i + 2)) % 17) as f32 * 0.1 - 0.3).collect()).collect();
        let sample = Sample::from_values(&rows);
        let combination = [0.5, -1.25, 2.0];
        let direct: f64 = (0..101)
            .map(|x| (0..3).map(|i| combination[i] * f64::from(rows[i][x])).sum::<f64>().powi(2))
            .sum::<f64>()
            / 101.0;
        assert!((sample.rms(&combination) - direct.sqrt()).abs() < 1e-12);
    }
}
