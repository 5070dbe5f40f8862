//! Fits that follow most lights at a pixel rather than all: the matte layer below shadows and highlights.

use crate::LeastSquares;
use relight_core::weighted_sums::Rows;

/// Rounds in which residuals count by their size, not its square, which finds the majority ..
const L1_ROUNDS: usize = 4;

/// .. and rounds in which what is far off that counts for nothing.
const TUKEY_ROUNDS: usize = 4;

/// Residuals beyond so many deviations count for nothing.
///
/// Source: Beaton, Tukey, *The fitting of power series*, 1974: 95 % efficiency under normal noise.
const TUKEY_LIMIT: f64 = 4.685;

/// From the median of absolute residuals to a normal distribution's deviation.
const DEVIATIONS_PER_MEDIAN: f64 = 1.482_6;

/// Deviations are no smaller than half a step of 8 bits: below that all lights agree.
const LEAST_DEVIATION: f64 = 0.5 / 255.0;

/// A fit by iteratively reweighted least squares, pixel by pixel.
///
/// Every pixel gets weights of its own for the lights, from how far its mean over channels is from what the functions make of
/// the others: `argmin_c |W^(1/2) (A c - y)|^2 + ridge s0^2 |c|^2` with those weights times the lights' own. The number of rounds
/// is fixed: the same pixel has the same bits everywhere.
/// Source: Holland, Welsch, *Robust regression using iteratively reweighted least-squares*, 1977.
#[derive(Clone, Debug)]
pub struct RobustFit {
    fit: LeastSquares,
    /// N x k (k + 1) / 2: the products of a light's functions, lower triangle by rows.
    pairs: Vec<f64>,
    /// Ridge times the largest singular value squared.
    damping: f64,
}

/// Working space of a thread.
#[derive(Clone, Debug, Default)]
pub(crate) struct RobustScratch {
    samples: Vec<f32>,
    coefficients: Vec<f32>,
    rounds: Rounds,
}

/// That of a pixel.
#[derive(Clone, Debug, Default)]
struct Rounds {
    grey: Vec<f64>,
    residuals: Vec<f64>,
    sorted: Vec<f64>,
    weights: Vec<f64>,
    factor: Vec<f64>,
    right: Vec<f64>,
}

impl RobustFit {
    /// Of the functions, weights and ridge of `fit`.
    pub fn new(fit: LeastSquares) -> Self {
        let decomposition = &fit.decomposition;
        let row = |functions: &[f64]| {
            let of = |(i, a): (usize, &f64)| functions[..=i].iter().map(|b| a * b).collect::<Vec<_>>();
            functions.iter().enumerate().flat_map(of).collect::<Vec<_>>()
        };
        let pairs = decomposition.design.chunks_exact(decomposition.functions).flat_map(row).collect();
        let largest = decomposition.singular_values.first().copied().unwrap_or(0.0);
        // Where lights are left out, the others may leave functions undetermined: some damping there always is.
        let damping = fit.ridge.max(1e-9) * largest * largest;
        Self { fit, pairs, damping }
    }

    /// The fit whose functions these are.
    pub fn least_squares(&self) -> &LeastSquares {
        &self.fit
    }

    /// As [`weighted_sums`](relight_core::weighted_sums) with weights of its own for each pixel: coefficients of the `width`
    /// samples of `input`, `channels` a pixel.
    pub(crate) fn solve(
        &self,
        scratch: &mut RobustScratch,
        channels: usize,
        input: Rows<&[f32]>,
        output: Rows<&mut [f32]>,
        width: usize,
    ) {
        let RobustScratch { samples, coefficients, rounds } = scratch;
        samples.resize(self.fit.decomposition.lights * channels, 0.0);
        coefficients.resize(self.fit.decomposition.functions * channels, 0.0);
        for at in (0..width).step_by(channels) {
            let rows = input.samples.chunks(input.stride);
            for (values, row) in samples.chunks_exact_mut(channels).zip(rows) {
                values.copy_from_slice(&row[at..at + channels]);
            }
            self.pixel(samples, channels, rounds, coefficients);
            let rows = output.samples.chunks_mut(output.stride);
            for (row, values) in rows.zip(coefficients.chunks_exact(channels)) {
                row[at..at + channels].copy_from_slice(values);
            }
        }
    }

    /// Coefficients of a pixel from its `samples`, N x channels: k x channels in `coefficients`.
    fn pixel(&self, samples: &[f32], channels: usize, work: &mut Rounds, coefficients: &mut [f32]) {
        let decomposition = &self.fit.decomposition;
        let (lights, functions) = (decomposition.lights, decomposition.functions);
        work.grey.clear();
        work.grey.extend(
            samples.chunks_exact(channels).map(|values| values.iter().map(|v| f64::from(*v)).sum::<f64>()),
        );
        work.grey.iter_mut().for_each(|value| *value /= channels as f64);
        work.weights.clone_from(&decomposition.weights);
        for round in 0..L1_ROUNDS + TUKEY_ROUNDS {
            self.factorize(&work.weights, &mut work.factor);
            self.right_side(&work.weights, |light| work.grey[light], &mut work.right);
            solve(&work.factor, functions, &mut work.right);
            let rows = decomposition.design.chunks_exact(functions);
            work.residuals.clear();
            work.residuals.extend(rows.zip(&work.grey).map(|(row, value)| {
                (value - row.iter().zip(&work.right).map(|(b, c)| b * c).sum::<f64>()).abs()
            }));
            work.sorted.clone_from(&work.residuals);
            let middle = work.sorted.len() / 2;
            let (_, median, _) = work.sorted.select_nth_unstable_by(middle, f64::total_cmp);
            let deviation = (DEVIATIONS_PER_MEDIAN * *median).max(LEAST_DEVIATION);
            for light in 0..lights {
                let off = work.residuals[light] / deviation;
                let trust = if round < L1_ROUNDS {
                    1.0 / off.max(0.1)
                } else {
                    let share = (off / TUKEY_LIMIT).min(1.0);
                    (1.0 - share * share) * (1.0 - share * share)
                };
                work.weights[light] = trust * decomposition.weights[light];
            }
        }
        self.factorize(&work.weights, &mut work.factor);
        for channel in 0..channels {
            let value = |light: usize| f64::from(samples[light * channels + channel]);
            self.right_side(&work.weights, value, &mut work.right);
            solve(&work.factor, functions, &mut work.right);
            for (function, value) in work.right.iter().enumerate() {
                coefficients[function * channels + channel] = *value as f32;
            }
        }
    }

    /// The lower Cholesky factor of `A^T W A + damping I`, by rows.
    fn factorize(&self, weights: &[f64], factor: &mut Vec<f64>) {
        let functions = self.fit.decomposition.functions;
        let packed = functions * (functions + 1) / 2;
        factor.clear();
        factor.resize(packed, 0.0);
        for (pairs, weight) in self.pairs.chunks_exact(packed).zip(weights) {
            factor.iter_mut().zip(pairs).for_each(|(sum, pair)| *sum += weight * pair);
        }
        let row = |i: usize| i * (i + 1) / 2;
        for i in 0..functions {
            factor[row(i) + i] += self.damping;
            for j in 0..=i {
                let (a, b) = (row(i), row(j));
                let before: f64 = (0..j).map(|t| factor[a + t] * factor[b + t]).sum();
                let rest = factor[a + j] - before;
                // Positive but for rounding, which the damping outweighs.
                factor[a + j] =
                    if i == j { rest.max(self.damping * 1e-3).sqrt() } else { rest / factor[b + j] };
            }
        }
    }

    /// `A^T W y`.
    fn right_side(&self, weights: &[f64], value: impl Fn(usize) -> f64, right: &mut Vec<f64>) {
        let decomposition = &self.fit.decomposition;
        right.clear();
        right.resize(decomposition.functions, 0.0);
        let rows = decomposition.design.chunks_exact(decomposition.functions);
        for (light, (row, weight)) in rows.zip(weights).enumerate() {
            let weighted = weight * value(light);
            right.iter_mut().zip(row).for_each(|(sum, b)| *sum += weighted * b);
        }
    }
}

/// Solves `L L^T x = b` in place.
fn solve(factor: &[f64], functions: usize, x: &mut [f64]) {
    let row = |i: usize| i * (i + 1) / 2;
    for i in 0..functions {
        let before: f64 = (0..i).map(|t| factor[row(i) + t] * x[t]).sum();
        x[i] = (x[i] - before) / factor[row(i) + i];
    }
    for i in (0..functions).rev() {
        let after: f64 = (i + 1..functions).map(|t| factor[row(t) + i] * x[t]).sum();
        x[i] = (x[i] - after) / factor[row(i) + i];
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::{LightWeights, Ridge, Sample};
    use relight_core::sphere::{Cap, fibonacci_in};
    use relight_core::{Design, Direction, Family, LightSet};

    const LIGHTS: usize = 50;

    fn least_squares(family: &str, count: usize, lights: &[Direction]) -> LeastSquares {
        let set = LightSet::from_directions(lights.to_vec());
        let basis = Family::by_name(family).unwrap().build(&Design::new(count, &set)).unwrap();
        let rows: Vec<Vec<f32>> = (0..lights.len()).map(|i| vec![i as f32 / 64.0, 0.3]).collect();
        let ridge = Ridge::Fixed(1e-9);
        LeastSquares::new(basis, lights, LightWeights::Voronoi, ridge, &Sample::from_values(&rows)).unwrap()
    }

    /// Three channels of known coefficients; every fourth light is in shadow, every seventh in a highlight.
    fn pixel(fit: &LeastSquares, truth: &[f32], spoilt: bool) -> Vec<f32> {
        let functions = fit.decomposition.functions;
        let mut samples = Vec::new();
        for (light, row) in fit.decomposition.design.chunks_exact(functions).enumerate() {
            for channel in 0..3 {
                let matte: f64 = (0..functions).map(|f| row[f] * f64::from(truth[f * 3 + channel])).sum();
                samples.push(match (spoilt, light % 4, light % 7) {
                    (true, 1, _) => 0.0,
                    (true, _, 2) => matte as f32 + 0.7 - 0.1 * channel as f32,
                    _ => matte as f32,
                });
            }
        }
        samples
    }

    #[test]
    fn shadows_and_highlights_leave_the_matte_layer_as_it_is() {
        let lights = fibonacci_in(Cap { axis: Direction::OUT, radius: 1.3 }, LIGHTS);
        for (family, count) in [("ptm", 6), ("hsh", 9)] {
            let fit = least_squares(family, count, &lights);
            let truth: Vec<f32> =
                (0..count * 3)
                    .map(|i| {
                        if i < 3 || (family == "ptm" && i >= 15) { 0.5 } else { 0.02 * (i % 5) as f32 - 0.04 }
                    })
                    .collect();
            let robust = RobustFit::new(fit.clone());
            let worst = |samples: &[f32]| {
                let mut found = vec![0.0f32; count * 3];
                robust.pixel(samples, 3, &mut Rounds::default(), &mut found);
                found.iter().zip(&truth).map(|(a, b)| (a - b).abs()).fold(0.0, f32::max)
            };
            assert!(worst(&pixel(&fit, &truth, false)) < 1e-4, "{family}");
            let samples = pixel(&fit, &truth, true);
            let plain = (0..count)
                .map(|f| {
                    let row = &fit.solution[f * LIGHTS..][..LIGHTS];
                    let sum: f64 =
                        row.iter().zip(samples.chunks_exact(3)).map(|(s, v)| s * f64::from(v[0])).sum();
                    (sum as f32 - truth[f * 3]).abs()
                })
                .fold(0.0, f32::max);
            let found = worst(&samples);
            assert!(found < 2e-3 && plain > 0.08, "{family}: robust {found}, plain {plain}");
        }
    }

    #[test]
    fn black_constant_and_undetermined_pixels_are_finite() {
        let fit = least_squares("hsh", 16, &fibonacci_in(Cap { axis: Direction::OUT, radius: 1.3 }, 12));
        let robust = RobustFit::new(fit.clone());
        for value in [0.0f32, 1.0, 1e4] {
            let mut found = vec![f32::NAN; 16];
            robust.pixel(&[value; 12], 1, &mut Rounds::default(), &mut found);
            assert!(found.iter().all(|c| c.is_finite()), "{value}: {found:?}");
        }
        let alternating: Vec<f32> = (0..12).map(|i| (i % 2) as f32).collect();
        let mut found = vec![f32::NAN; 16];
        robust.pixel(&alternating, 1, &mut Rounds::default(), &mut found);
        assert!(found.iter().all(|c| c.is_finite()), "{found:?}");
    }
}
