//! Pictures that don't fit their light: a swapped name, a lamp that failed, a moved object.

use crate::{FitError, LeastSquares, LightWeights, Ridge, Sample, largest_usable};
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
    let directions = lights.directions();
    let name = if directions.iter().any(|d| d.z() < 0.0) { "sh" } else { "hsh" };
    let usable = Family::by_name(name).and_then(|family| {
        largest_usable(family, lights, SrbfDesign::default(), MOST_FUNCTIONS).ok().flatten()
    });
    let Some(usable) = usable else { return Ok(Vec::new()) };
    let fit = LeastSquares::new(usable.basis, &directions, LightWeights::Voronoi, Ridge::Auto, sample)?;
    let errors = &fit.leave_one_out;
    let hat = fit.decomposition.hat(&fit.solution);
    let overall = median(errors.left_out.clone());
    let mut found = Vec::new();
    for (light, &rmse) in errors.left_out.iter().enumerate() {
        let near = nearest(&directions, light).into_iter().map(|j| errors.left_out[j]).collect();
        let expected = median(near).max(overall);
        if errors.leverage[light] < MOST_LEVERAGE && rmse > FACTOR * expected && rmse > 1e-6 {
            let better = better_light(&hat, sample, light, rmse);
            found.push(Misfit { light, rmse, expected, better });
        }
    }
    // A badly wrong picture spoils the prediction of its neighbours: what stands out little beside
    // the worst is told when that is mended.
    let worst = found.iter().map(|misfit| misfit.rmse).fold(0.0, f64::max);
    found.retain(|misfit| misfit.rmse > BESIDE_THE_WORST * worst);
    Ok(found)
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

/// The middle value; 0 for none.
fn median(mut values: Vec<f64>) -> f64 {
    values.sort_by(f64::total_cmp);
    values.get(values.len() / 2).copied().unwrap_or(0.0)
}
