//! Pictures that don't fit their light: a swapped name, a lamp that failed, a moved object.

use crate::row_products::product;
use crate::{FitError, LeastSquares, LeaveOneOut, LightWeights, Ridge, Sample, largest_usable, median};
use relight_core::basis::SrbfDesign;
use relight_core::{Direction, Family, LightSet};

/// A picture that does not fit its light.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Misfit {
    /// Index of the light.
    pub light: usize,
    /// Its left-out error.
    pub rmse: f64,
    /// Median of its nearest lights' left-out errors, or of all lights' where that is larger.
    pub expected: f64,
    /// The light whose direction suits the picture best, if that is another one and it suits
    /// much better: a swapped name.
    pub better: Option<usize>,
}

/// How many of its nearest lights a light is compared with.
const NEIGHBOURS: usize = 6;

/// The most functions of the basis that judges; more follow a wrong picture instead of showing it.
const MOST_FUNCTIONS: usize = 16;

/// A picture is reported when its left-out error is this many times what is expected.
///
/// Measured: photographs of six captures stay below 2.0, swapped pairs mostly exceed 2.5.
const FACTOR: f64 = 2.2;

/// Misfits below this part of the worst one's error are not reported beside it.
const BESIDE_THE_WORST: f64 = 0.4;

/// Above this leverage a light is predicted by extrapolation, and its error says nothing.
const MOST_LEVERAGE: f64 = 0.8;

/// Exchanging two pictures must lower the fit's squared error by this part.
///
/// Measured on icon72: the best exchange of the untouched capture gains 1.8 %, right ones 5 to 75 %.
const WORTH_EXCHANGING: f64 = 0.05;

/// Exchanged pairs that are looked for.
const MOST_PAIRS: usize = 8;

/// Pictures that are tried for an exchange with every other one.
const MOST_SUSPECTS: usize = 64;

/// Another light suits a picture much better when its error is below this part of its own light's.
const MUCH_BETTER: f64 = 0.6;

/// Finds the pictures of a capture that don't fit their light.
///
/// The judge is not the basis that is to be baked but the largest usable one of up to 16 harmonics
/// (hemispherical, or spherical where lights lie below the picture plane): a coarse basis misses
/// every picture alike, and a fine one bends to a wrong picture.
///
/// # Errors
/// [`FitError::NoLights`].
///
/// # Panics
/// When `sample` is of another number of lights.
pub fn misfits(lights: &LightSet, sample: &Sample) -> Result<Vec<Misfit>, FitError> {
    let Some(fit) = coarse_fit(lights, sample)? else { return Ok(Vec::new()) };
    let directions = lights.directions();
    let hat = fit.decomposition.hat(&fit.solution);
    let expected = expectations(&directions, &fit.leave_one_out);

    let mut mended = sample.clone();
    let mut found = Vec::new();
    for (a, b) in swapped_pairs(&hat, &fit.leave_one_out, &expected, &mut mended) {
        for (light, other) in [(a, b), (b, a)] {
            let rmse = fit.leave_one_out.left_out[light];
            found.push(Misfit { light, rmse, expected: expected[light], better: Some(other) });
        }
    }
    // What stands out once those pairs are in their places: a wrong picture spoils its neighbours.
    let errors = LeaveOneOut::of(&fit.decomposition, &fit.solution, &mended);
    let expected = expectations(&directions, &errors);
    let mut single = Vec::new();
    for (light, &rmse) in errors.left_out.iter().enumerate() {
        let judged = errors.leverage[light] < MOST_LEVERAGE && found.iter().all(|pair| pair.light != light);
        if judged && rmse > FACTOR * expected[light] && rmse > 1e-6 {
            let better = better_light(&hat, &mended, light, rmse);
            single.push(Misfit { light, rmse, expected: expected[light], better });
        }
    }
    let worst = single.iter().map(|misfit| misfit.rmse).fold(0.0, f64::max);
    single.retain(|misfit| misfit.rmse > BESIDE_THE_WORST * worst);
    found.extend(single);
    found.sort_by_key(|misfit| misfit.light);
    Ok(found)
}

/// The fit by which pictures are judged; `None` for lights that carry no basis.
///
/// # Errors
/// [`FitError::NoLights`].
pub(crate) fn coarse_fit(lights: &LightSet, sample: &Sample) -> Result<Option<LeastSquares>, FitError> {
    let directions = lights.directions();
    let name = if directions.iter().any(|d| d.z() < 0.0) { "sh" } else { "hsh" };
    let usable = Family::by_name(name).and_then(|family| {
        largest_usable(family, lights, SrbfDesign::default(), MOST_FUNCTIONS).ok().flatten()
    });
    let Some(usable) = usable else { return Ok(None) };
    LeastSquares::new(usable.basis, &directions, LightWeights::Voronoi, Ridge::Auto, sample).map(Some)
}

/// For each light the left-out error that its neighbours and all lights let expect.
fn expectations(directions: &[Direction], errors: &LeaveOneOut) -> Vec<f64> {
    let middle = |mut errors: Vec<f64>| median(&mut errors, f64::total_cmp).unwrap_or(0.0);
    let overall = middle(errors.left_out.clone());
    let near = |i| nearest(directions, i).into_iter().map(|j| errors.left_out[j]).collect();
    (0..directions.len()).map(|i| middle(near(i)).max(overall)).collect()
}

/// Pairs of pictures whose exchange lowers the error of the whole fit, worst pair first; `sample` has
/// them exchanged afterwards.
///
/// With M = (I - H)^T (I - H) the fit's squared error is E = sum of `M * G`, and exchanging pictures i
/// and j changes it by 2 sum over r of (M_ir - M_jr)(G_jr - G_ir) + (M_ii - M_jj)(G_jj - G_ii), r
/// other than i and j.
fn swapped_pairs(
    hat: &[f64],
    errors: &LeaveOneOut,
    expected: &[f64],
    sample: &mut Sample,
) -> Vec<(usize, usize)> {
    let n = sample.lights;
    let metric = residual_metric(hat, n);
    // At least one of a pair stands out somewhat.
    let mut suspects: Vec<usize> = (0..n).filter(|&i| errors.left_out[i].is_finite()).collect();
    let ratio = |i: usize| errors.left_out[i] / expected[i].max(f64::MIN_POSITIVE);
    suspects.sort_by(|&a, &b| ratio(b).total_cmp(&ratio(a)));
    suspects.truncate(MOST_SUSPECTS);

    let mut pairs: Vec<(usize, usize)> = Vec::new();
    while pairs.len() < MOST_PAIRS {
        let gram = &sample.gram;
        let total: f64 = metric.iter().zip(gram).map(|(m, g)| m * g).sum();
        let change = |i: usize, j: usize| {
            let rows = |matrix: &'_ [f64]| {
                (i * n..(i + 1) * n)
                    .zip(j * n..(j + 1) * n)
                    .map(|(a, b)| matrix[a] - matrix[b])
                    .collect::<Vec<_>>()
            };
            let (m, g) = (rows(&metric), rows(gram));
            let others = (0..n).filter(|&r| r != i && r != j).map(|r| -m[r] * g[r]).sum::<f64>();
            let own = (metric[i * n + i] - metric[j * n + j]) * (gram[j * n + j] - gram[i * n + i]);
            2.0 * others + own
        };
        let free = |i: &usize| pairs.iter().all(|&(a, b)| a != *i && b != *i);
        let candidates =
            suspects.iter().filter(|i| free(i)).flat_map(|&i| (0..n).filter(free).map(move |j| (i, j)));
        let best = candidates
            .filter(|(i, j)| i != j)
            .map(|(i, j)| (change(i, j), i.min(j), i.max(j)))
            .min_by(|a, b| a.0.total_cmp(&b.0));
        match best {
            Some((change, i, j)) if change < -WORTH_EXCHANGING * total => {
                pairs.push((i, j));
                exchange(&mut sample.gram, n, i, j);
            }
            _ => break,
        }
    }
    pairs
}

/// `(I - H)^T (I - H)`, n x n.
fn residual_metric(hat: &[f64], n: usize) -> Vec<f64> {
    let residual = |i: usize, j: usize| f64::from(i == j) - hat[i * n + j];
    let rows: Vec<f64> = (0..n * n).map(|at| residual(at / n, at % n)).collect();
    let transposed: Vec<f64> = (0..n * n).map(|at| residual(at % n, at / n)).collect();
    product(&transposed, &rows, n)
}

/// Exchanges pictures i and j in a matrix of inner products.
fn exchange(gram: &mut [f64], n: usize, i: usize, j: usize) {
    for r in 0..n {
        gram.swap(i * n + r, j * n + r);
    }
    for r in 0..n {
        gram.swap(r * n + i, r * n + j);
    }
}

/// The light at which the others' pictures predict picture `light` much better than at its own.
///
/// The picture of that light is left out as well: in a swapped pair it is the wrong one.
fn better_light(hat: &[f64], sample: &Sample, light: usize, rmse: f64) -> Option<usize> {
    let error_at = |(other, row): (usize, &[f64])| {
        let freedom = 1.0 - row[other];
        let mut residual: Vec<f64> = row.iter().map(|h| -h / freedom).collect();
        residual[other] = 0.0;
        residual[light] += 1.0;
        (other, sample.rms(&residual))
    };
    let others = hat.chunks_exact(sample.lights).enumerate();
    let others = others.filter(|(other, row)| *other != light && row[*other] < MOST_LEVERAGE);
    let best = others.map(error_at).min_by(|a, b| a.1.total_cmp(&b.1));
    best.filter(|(_, error)| *error < MUCH_BETTER * rmse).map(|(other, _)| other)
}

/// The lights nearest to light `i`.
fn nearest(directions: &[Direction], i: usize) -> Vec<usize> {
    let cosines: Vec<f64> = directions.iter().map(|d| d.cosine(directions[i])).collect();
    let mut others: Vec<usize> = (0..directions.len()).filter(|&j| j != i).collect();
    others.sort_by(|&a, &b| cosines[b].total_cmp(&cosines[a]));
    others.truncate(NEIGHBOURS);
    others
}
