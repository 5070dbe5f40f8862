//! Planes learned from the pictures: principal components over lights and channels, and a function of light
//! for each of them in each channel.
//!
//! Pictures at hand are a few of those that could have been taken. What is wanted are the planes that explain
//! most of all pictures between the lights, so components are sought not of the pictures as they lie (which
//! would serve crowded lights best) but of what interpolation makes of them, evenly over the sphere's part that
//! the lights cover: with y(l) = sum of h_i(l) y_i, the energy over directions is y^T M y, M the mean of h h^T.
//!
//! Source: MATH.md sections 4 and 5 (principal components, interpolated directions); docs/accuracy.md,
//! "Learned planes", for what M gains.

use crate::continuation::Continuation;
use crate::interpolation::Interpolation;
use crate::principal::principal;
use crate::row_products::{combination, dot, product, product_with_transposed, quadratic_form};
use crate::{ChannelSample, FitError, LeastSquares, LeaveOneOut};
use nalgebra::DMatrix;
use rayon::prelude::*;
use relight_core::basis::Learned;
use relight_core::sphere::{Octahedral, fibonacci_in};
use relight_core::{Direction, FitFigures};

/// Directions over which energy is a mean, and by which tables are judged.
const DIRECTIONS: usize = 1024;

/// Edges of tables that are tried.
const NODES: [usize; 10] = [8, 10, 12, 16, 20, 24, 32, 40, 48, 64];

/// A table may err by this part of the error of predicting a light from the others: 0.02 dB.
const TABLE_ERROR: f64 = 0.07;

/// Or by this where pictures are predicted better: a tenth of a step of 8 bits.
const SMALLEST_ERROR: f64 = 0.1 / 255.0;

/// Components of less than this part of the first's energy are none.
const NO_ENERGY: f64 = 1e-12;

/// Red, green and blue as luminance and two chrominances, orthonormal.
const OPPONENT: [[f64; 3]; 3] = [
    [0.577_350_269_189_625_8, 0.577_350_269_189_625_8, 0.577_350_269_189_625_8],
    [0.707_106_781_186_547_5, 0.0, -0.707_106_781_186_547_5],
    [-0.408_248_290_463_863, 0.816_496_580_927_726, -0.408_248_290_463_863],
];

/// How planes are learned.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct LearnedDesign {
    /// How many at most.
    pub planes: usize,
    /// Whether each is luminance or chrominance alone, rather than whatever carries most energy.
    pub opponent: bool,
    /// The mean PSNR (dB) over lights predicted from the others that the fewest planes are to reach; all are
    /// taken where none is given.
    pub target_psnr: Option<f64>,
}

/// Learned planes of a capture.
#[derive(Clone, Debug)]
pub struct LearnedFit {
    /// Their functions of light, and how many there are.
    pub basis: Learned,
    /// planes x (N x channels), row-major: planes = projection x values, channel c of picture i at
    /// `i * channels + c`.
    pub projection: Vec<f64>,
    /// By plane, the part of the pictures' energy that it explains, falling.
    pub energy: Vec<f64>,
    /// The smoothing of directions that was taken, a part of the kernel's mean eigenvalue; `None` where
    /// functions of another family continue the pictures.
    pub smoothing: Option<f64>,
    /// Errors of each light on the sample.
    pub leave_one_out: LeaveOneOut,
    /// The same over all lights.
    pub figures: FitFigures,
}

impl LearnedFit {
    /// Learns planes from the moments of a sample.
    ///
    /// Deterministic: the same for the same sample, whatever the threads. Fewer planes than asked for come back
    /// where the pictures have no more.
    ///
    /// # Errors
    /// [`FitError::NoLights`]; [`FitError::Basis`] for a number of planes outside 1 to 128;
    /// [`FitError::OutOfReach`] for a target that no number of planes up to the design's reaches.
    ///
    /// # Panics
    /// When the sample is of another number of lights.
    pub fn new(
        lights: &[Direction],
        design: LearnedDesign,
        sample: &ChannelSample,
    ) -> Result<Self, FitError> {
        assert_eq!(sample.means.len(), lights.len() * sample.channels, "sample of another light set");
        let spline =
            Interpolation::of_pictures(lights, &sample.of_pictures.gram).ok_or(FitError::NoLights)?;
        let smoothing = spline.smoothing;
        Self::with(&Continuation::Spline(spline), "pca".to_owned(), Some(smoothing), design, sample)
    }

    /// The planes that carry most of what a fit's functions make of the pictures, over all directions that the
    /// lights cover: a truncated singular value decomposition of its coefficient maps in the metric of their
    /// functions. Planes are shared by functions and channels.
    ///
    /// # Errors
    /// As of [`LearnedFit::new`].
    ///
    /// # Panics
    /// As there.
    pub fn factored(
        fit: &LeastSquares,
        lights: &[Direction],
        design: LearnedDesign,
        sample: &ChannelSample,
    ) -> Result<Self, FitError> {
        assert_eq!(sample.means.len(), lights.len() * sample.channels, "sample of another light set");
        let origin = format!("{} {}", fit.basis.family().name, fit.basis.count());
        let functions = Continuation::of_functions(fit, lights).ok_or(FitError::NoLights)?;
        Self::with(&functions, origin, None, design, sample)
    }

    fn with(
        continuation: &Continuation<'_>,
        origin: String,
        smoothing: Option<f64>,
        design: LearnedDesign,
        sample: &ChannelSample,
    ) -> Result<Self, FitError> {
        let (channels, width) = (sample.channels, sample.means.len());
        let lights = width / channels;
        let covariance = covariance_of(sample);
        let root = energy_root(lights, continuation);
        let weighted = weighted_covariance(&covariance, &root, channels);
        let weighted = if design.opponent && channels == 3 { split(weighted) } else { weighted };
        let found = principal(&weighted, width, design.planes.max(1));
        let total = weighted.iter().step_by(width + 1).sum::<f64>();
        let largest = found.values.first().copied().unwrap_or(0.0);
        let worth = found.values.iter().filter(|&&value| value > NO_ENERGY * largest).count();
        let most = worth.min(continuation.freedoms() * channels).clamp(1, design.planes.max(1));

        let of_planes = |planes: usize| {
            let components = Components::new(&found.vectors[..planes * width], &root, sample);
            let at_lights = functions_at_lights(sample, &components);
            let judged = judge(continuation, sample, &covariance, &components, &at_lights);
            (components, at_lights, judged)
        };
        let planes = match design.target_psnr {
            None => most,
            Some(target) => fewest(most, target, |planes| of_planes(planes).2.errors.left_out_psnr())?,
        };
        let (components, at_lights, judged) = of_planes(planes);
        let energy = found.values[..planes]
            .iter()
            .map(|value| if total > 0.0 { value / total } else { 0.0 })
            .collect();
        let weights = vec![1.0; lights];
        let figures = FitFigures {
            fit_rmse: LeaveOneOut::mean(&judged.errors.fit, &weights),
            leave_one_out_rmse: LeaveOneOut::mean(&judged.errors.left_out, &weights),
        };
        let allowed = (TABLE_ERROR * figures.leave_one_out_rmse).max(SMALLEST_ERROR);
        let (square, table) = table_of(continuation, &at_lights, &judged.plane_covariance, channels, allowed);
        let basis = Learned::new(origin, planes, channels, square, table).map_err(FitError::Basis)?;
        Ok(Self {
            basis,
            projection: components.projection,
            energy,
            smoothing,
            leave_one_out: judged.errors,
            figures,
        })
    }

    /// The projection in f32, as the kernel takes it.
    pub fn projection_f32(&self) -> Vec<f32> {
        self.projection.iter().map(|&value| value as f32).collect()
    }
}

/// Bytes that finding up to `planes` learned planes of `lights` pictures of `pixels` pixels takes, the sample that they
/// are found in included.
pub fn learned_bytes(lights: usize, channels: usize, pixels: usize, planes: usize) -> u64 {
    let (n, width) = (lights as u64, (lights * channels) as u64);
    let moments = 8 * (width * width + n * n);
    let sampling = moments + ChannelSample::values_bytes(lights, channels, pixels);
    let splines = moments + Interpolation::bytes(n);
    // The covariance, weighted from the left, turned and weighted from the right; the energy on its way to its root.
    let components = moments + 8 * (4 * width * width + 3 * n * n + DIRECTIONS as u64 * n);
    // The covariance with and without its weights; by plane, what leads to it and back, and its functions in tables
    // of which two are in memory at once, and in the judges' directions.
    let nodes = NODES.into_iter().max().unwrap_or(0) as u64;
    let of_plane = 5 * width + channels as u64 * (2 * nodes * nodes + DIRECTIONS as u64);
    let functions = moments + 8 * (2 * width * width + n * n + (planes as u64 + 1) * of_plane);
    sampling.max(splines).max(components).max(functions)
}

/// The fewest planes up to `most` whose figure reaches `target`.
fn fewest(most: usize, target: f64, figure: impl Fn(usize) -> f64) -> Result<usize, FitError> {
    let best = figure(most);
    if best < target {
        return Err(FitError::OutOfReach { target, planes: most, best });
    }
    let (mut below, mut enough) = (0, most);
    while enough - below > 1 {
        let middle = below + (enough - below) / 2;
        *if figure(middle) >= target { &mut enough } else { &mut below } = middle;
    }
    Ok(enough)
}

/// Means over the sample of products of what is left of rows without their means.
fn covariance_of(sample: &ChannelSample) -> Vec<f64> {
    let width = sample.means.len();
    (0..width * width)
        .map(|at| sample.gram[at] - sample.means[at / width] * sample.means[at % width])
        .collect()
}

/// L of M = L L^T, N x N: M the mean of h h^T over directions, and a part of the lights themselves.
fn energy_root(n: usize, continuation: &Continuation<'_>) -> DMatrix<f64> {
    let rows: Vec<Vec<f64>> = fibonacci_in(continuation.covered(), DIRECTIONS)
        .into_par_iter()
        .map(|direction| continuation.row(direction))
        .collect();
    let measured = continuation.measured_share();
    let share = (1.0 - measured) * n as f64 / rows.len() as f64;
    let columns: Vec<Vec<f64>> = (0..n)
        .into_par_iter()
        .map(|i| {
            let mut column = vec![0.0; n];
            for row in &rows {
                for (sum, h) in column.iter_mut().zip(row) {
                    *sum += row[i] * h * share;
                }
            }
            column[i] += measured;
            column
        })
        .collect();
    let energy = DMatrix::from_fn(n, n, |i, j| columns[j][i]);
    // The measured share keeps it positive.
    energy.cholesky().map_or_else(|| DMatrix::identity(n, n), |root| root.unpack())
}

/// (L^T x I) C (L x I).
fn weighted_covariance(covariance: &[f64], root: &DMatrix<f64>, channels: usize) -> Vec<f64> {
    let width = root.nrows() * channels;
    let half = times_root(covariance, root, channels);
    let turned = transposed(&half, width);
    times_root(&turned, root, channels)
}

/// Rows times L x I: entry (j, c) is the sum over a >= j of row (a, c) x L (a, j).
fn times_root(rows: &[f64], root: &DMatrix<f64>, channels: usize) -> Vec<f64> {
    let (n, width) = (root.nrows(), root.nrows() * channels);
    let mut out = vec![0.0; rows.len()];
    out.par_chunks_mut(width).zip(rows.par_chunks(width)).for_each(|(out, row)| {
        for a in 0..n {
            for j in 0..=a {
                let factor = root[(a, j)];
                for c in 0..channels {
                    out[j * channels + c] += factor * row[a * channels + c];
                }
            }
        }
    });
    out
}

fn transposed(matrix: &[f64], width: usize) -> Vec<f64> {
    (0..matrix.len()).map(|at| matrix[at % width * width + at / width]).collect()
}

/// Without what luminance and chrominance have in common.
fn split(mut matrix: Vec<f64>) -> Vec<f64> {
    let width = matrix.len().isqrt();
    let blocks = width / 3;
    for i in 0..blocks {
        for j in 0..blocks {
            let at = |r: usize, c: usize| (3 * i + r) * width + 3 * j + c;
            let block = [0, 1, 2].map(|r| [0, 1, 2].map(|c| matrix[at(r, c)]));
            // O B O^T, the cross terms of its first row and column left out, and back.
            let turned = product3(product3(OPPONENT, block), transposed3(OPPONENT));
            let kept =
                [0, 1, 2].map(|r| [0, 1, 2].map(|c| if (r == 0) == (c == 0) { turned[r][c] } else { 0.0 }));
            let back = product3(product3(transposed3(OPPONENT), kept), OPPONENT);
            for r in 0..3 {
                for c in 0..3 {
                    matrix[at(r, c)] = back[r][c];
                }
            }
        }
    }
    matrix
}

type Matrix3 = [[f64; 3]; 3];

fn product3(a: Matrix3, b: Matrix3) -> Matrix3 {
    [0, 1, 2].map(|i| [0, 1, 2].map(|j| (0..3).map(|l| a[i][l] * b[l][j]).sum()))
}

fn transposed3(a: Matrix3) -> Matrix3 {
    [0, 1, 2].map(|i| [0, 1, 2].map(|j| a[j][i]))
}

/// From values to planes and back.
struct Components {
    planes: usize,
    /// planes x (N x channels).
    projection: Vec<f64>,
    /// planes x (N x channels): values are means + sum of plane x row.
    weights: Vec<f64>,
    /// The mean of each plane over the sample.
    plane_means: Vec<f64>,
}

impl Components {
    /// From orthonormal rows u of the weighted problem: projection u (L^T x I), weights u (L^-1 x I), scaled
    /// so that weights have a mean square of 1, their largest positive.
    fn new(vectors: &[f64], root: &DMatrix<f64>, sample: &ChannelSample) -> Self {
        let (n, channels, width) = (root.nrows(), sample.channels, sample.means.len());
        let (mut projection, mut weights) = (Vec::new(), Vec::new());
        for u in vectors.chunks_exact(width) {
            let mut p = vec![0.0; width];
            let mut w = u.to_vec();
            for a in 0..n {
                for j in 0..=a {
                    for c in 0..channels {
                        p[a * channels + c] += root[(a, j)] * u[j * channels + c];
                    }
                }
            }
            // L^T w = u, from the last row up.
            for i in (0..n).rev() {
                for c in 0..channels {
                    let known: f64 = (i + 1..n).map(|a| root[(a, i)] * w[a * channels + c]).sum();
                    w[i * channels + c] = (w[i * channels + c] - known) / root[(i, i)];
                }
            }
            let square = w.iter().map(|value| value * value).sum::<f64>() / width as f64;
            let largest = w.iter().fold(0.0f64, |a, b| if b.abs() > a.abs() { *b } else { a });
            let scale = square.sqrt().max(f64::MIN_POSITIVE) * if largest < 0.0 { -1.0 } else { 1.0 };
            projection.extend(p.into_iter().map(|value| value * scale));
            weights.extend(w.into_iter().map(|value| value / scale));
        }
        let plane_means = product_with_transposed(&projection, &sample.means, width);
        Self { planes: vectors.len() / width, projection, weights, plane_means }
    }
}

/// N x ((planes + 1) x channels): the functions at the lights, the mean less what planes with means of their own
/// bring.
fn functions_at_lights(sample: &ChannelSample, components: &Components) -> Vec<f64> {
    let (channels, width) = (sample.channels, sample.means.len());
    let mut at_lights = Vec::with_capacity((components.planes + 1) * width);
    for first in (0..width).step_by(channels) {
        let weights = || components.weights.chunks_exact(width).map(|row| &row[first..first + channels]);
        at_lights.extend((0..channels).map(|c| {
            let of_planes = weights().zip(&components.plane_means);
            sample.means[first + c] - of_planes.map(|(weight, mean)| weight[c] * mean).sum::<f64>()
        }));
        at_lights.extend(weights().flatten());
    }
    at_lights
}

struct Judged {
    errors: LeaveOneOut,
    /// planes x planes: means of products of planes less their means'.
    plane_covariance: Vec<f64>,
}

/// The errors of each light, in the fit and predicted from the other lights' functions: what the planes don't
/// explain of its picture, and what the interpolation gets wrong of its functions.
fn judge(
    continuation: &Continuation<'_>,
    sample: &ChannelSample,
    covariance: &[f64],
    components: &Components,
    at_lights: &[f64],
) -> Judged {
    let (channels, width, planes) = (sample.channels, sample.means.len(), components.planes);
    let lights = width / channels;
    let functions = (planes + 1) * channels;
    // P C and P C P^T.
    let mixed = product(&components.projection, covariance, width);
    let plane_covariance = product_with_transposed(&mixed, &components.projection, width);
    let mean_error = |delta: &[f64], channel: usize| -> f64 {
        // Centred planes, whose means count towards the mean's function again.
        let of_planes: Vec<f64> = (1..=planes).map(|plane| delta[plane * channels + channel]).collect();
        let mean = delta[channel] + dot(&components.plane_means, &of_planes);
        mean * mean + quadratic_form(&plane_covariance, &of_planes)
    };
    let unexplained = |at: usize| -> f64 {
        let w: Vec<f64> = components.weights.chunks_exact(width).map(|row| row[at]).collect();
        let crossed: f64 = mixed.chunks_exact(width).zip(&w).map(|(row, w)| w * row[at]).sum();
        (covariance[at * width + at] - 2.0 * crossed + quadratic_form(&plane_covariance, &w)).max(0.0)
    };
    let of_light = |light: usize| {
        let rest: f64 = (0..channels).map(|c| unexplained(light * channels + c)).sum();
        let freedom = continuation.freedom(light);
        let left_out = combination(&continuation.left_out(light), at_lights, functions);
        let error = |delta: &[f64]| (0..channels).map(|c| mean_error(delta, c)).sum::<f64>();
        let of_left_out = error(&left_out);
        let root = |square: f64| (square / channels as f64).sqrt();
        (root(rest + freedom * freedom * of_left_out), root(rest + of_left_out), 1.0 - freedom)
    };
    let judged: Vec<(f64, f64, f64)> = (0..lights).into_par_iter().map(of_light).collect();
    let errors = LeaveOneOut {
        fit: judged.iter().map(|(fit, _, _)| *fit).collect(),
        left_out: judged.iter().map(|(_, left_out, _)| *left_out).collect(),
        leverage: judged.iter().map(|(_, _, leverage)| *leverage).collect(),
    };
    Judged { errors, plane_covariance }
}

/// The smallest table that errs by no more than `allowed` (root mean square of relit samples), or the largest.
fn table_of(
    continuation: &Continuation<'_>,
    at_lights: &[f64],
    plane_covariance: &[f64],
    channels: usize,
    allowed: f64,
) -> (Octahedral, Vec<f32>) {
    let functions = at_lights.len() / continuation.lights().len();
    let planes = functions / channels - 1;
    let at = |direction: Direction| combination(&continuation.row(direction), at_lights, functions);
    let judges: Vec<(Direction, Vec<f64>)> = fibonacci_in(continuation.covered(), DIRECTIONS)
        .into_par_iter()
        .map(|direction| (direction, at(direction)))
        .collect();
    let hemisphere = continuation.above_horizon();
    let mut made = None;
    for nodes in NODES {
        let square = Octahedral { nodes, hemisphere };
        let table: Vec<f64> =
            (0..square.count()).into_par_iter().flat_map_iter(|node| at(square.direction(node))).collect();
        let squares: Vec<f64> = judges
            .par_iter()
            .map(|(direction, exact)| {
                let taps = square.taps(*direction);
                let mut delta: Vec<f64> = exact.iter().map(|value| -value).collect();
                for (node, weight) in taps.nodes.into_iter().zip(taps.weights) {
                    let of_node = &table[node * functions..][..functions];
                    delta.iter_mut().zip(of_node).for_each(|(sum, value)| *sum += weight * value);
                }
                let of_channel = |c: usize| {
                    let squares = (0..planes)
                        .map(|p| plane_covariance[p * planes + p] * delta[(p + 1) * channels + c].powi(2));
                    delta[c] * delta[c] + squares.sum::<f64>()
                };
                (0..channels).map(of_channel).sum::<f64>() / channels as f64
            })
            .collect();
        let error = (squares.iter().sum::<f64>() / squares.len() as f64).sqrt();
        made = Some((square, table.into_iter().map(|value| value as f32).collect()));
        if error <= allowed {
            break;
        }
    }
    made.unwrap_or((Octahedral { nodes: 2, hemisphere }, vec![0.0; 4 * functions]))
}
