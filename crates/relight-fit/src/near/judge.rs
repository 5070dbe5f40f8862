//! How well a fit under near lamps does, and which ridge does best: pixel by pixel, as each has a design of its own.

use super::{NearLamps, absolute_ridge, ridge_solution};
use crate::leave_one_out::FULL_LEVERAGE;
use crate::row_products::{combination, dot};
use crate::sample::spread_pixels;
use crate::{Decomposition, FitError, LeastSquares, LeaveOneOut, LightWeights, Ridge};
use rayon::prelude::*;
use relight_core::{Basis, Stack};

/// Pixels that are solved exactly to judge a fit: a solution takes some tenths of a millisecond.
const JUDGES: usize = 256;

/// A judging pixel: the basis at the lamps as it sees them, and its values, N x channels.
struct Judge {
    design: Vec<f64>,
    /// Whether each lamp lights it.
    is_lit: Vec<bool>,
    values: Vec<f64>,
}

/// Fits `basis` to the directions of the middle of `lamps`' surface, whose errors are those of pixels all over the picture,
/// each under its own directions.
///
/// `stack` has the pictures as a [`LevelledStack`](super::LevelledStack) gives them. Weights of the lights are those of the
/// middle. The solution is the middle's; [`NearSolutions`](super::NearSolutions) has those of other places.
///
/// # Errors
/// As [`LeastSquares::new`], and [`FitError::Stack`].
///
/// # Panics
/// When `stack` has not as many pictures as there are lamps, or another size than the surface.
pub fn near_least_squares(
    basis: Basis,
    lamps: &NearLamps,
    weighting: LightWeights,
    ridge: Ridge,
    stack: &dyn Stack,
) -> Result<LeastSquares, FitError> {
    assert_eq!(stack.lights(), lamps.positions.len(), "a lamp a picture");
    assert_eq!((stack.width(), stack.height()), lamps.surface.size(), "positions of the pictures' size");
    let judges = judges(&basis, lamps, stack)?;
    let channels = stack.channels();
    let decomposition = Decomposition::new(&basis, &lamps.directions, weighting)?;
    let design = lamps.design(&basis, lamps.middle);
    LeastSquares::judged(basis, decomposition, ridge, |decomposition, ridge| {
        let largest = decomposition.singular_values.first().copied().unwrap_or(0.0);
        let ridge = absolute_ridge(ridge, largest);
        let errors = errors(&judges, &decomposition.weights, ridge, channels);
        (ridge_solution(&design, &decomposition.weights, ridge), errors)
    })
}

fn judges(basis: &Basis, lamps: &NearLamps, stack: &dyn Stack) -> Result<Vec<Judge>, FitError> {
    let (lights, channels) = (stack.lights(), stack.channels());
    let judge = |pixel: usize| {
        let rows = stack.rows(pixel * channels..(pixel + 1) * channels)?;
        let mut values = vec![0.0; lights * channels];
        values.chunks_exact_mut(channels).enumerate().for_each(|(light, out)| rows.copy(light, 0, out));
        let point = lamps.point(pixel);
        Ok(Judge {
            design: lamps.design(basis, point),
            is_lit: (0..lights).map(|light| lamps.direction(light, point).is_some()).collect(),
            values: values.into_iter().map(f64::from).collect(),
        })
    };
    spread_pixels(stack.pixels(), JUDGES).into_iter().map(judge).collect()
}

/// Squared errors of one light, summed.
#[derive(Clone, Default)]
struct Sums {
    judges: f64,
    fit: f64,
    left_out: f64,
    leverage: f64,
}

fn errors(judges: &[Judge], weights: &[f64], ridge: f64, channels: usize) -> LeaveOneOut {
    let lights = weights.len();
    let of_judge = |judge: &Judge| -> Vec<Sums> {
        let solution = ridge_solution(&judge.design, weights, ridge);
        let functions = solution.len() / lights;
        // k x channels.
        let coefficients: Vec<f64> =
            solution.chunks_exact(lights).flat_map(|row| combination(row, &judge.values, channels)).collect();
        let rows = judge.design.chunks_exact(functions).zip(judge.values.chunks_exact(channels));
        rows.enumerate()
            .map(|(light, (row, values))| {
                if !judge.is_lit[light] {
                    return Sums::default();
                }
                let fitted = combination(row, &coefficients, channels);
                let square =
                    fitted.iter().zip(values).map(|(a, b)| (a - b) * (a - b)).sum::<f64>() / channels as f64;
                let column: Vec<f64> = (0..functions).map(|j| solution[j * lights + light]).collect();
                let leverage = dot(row, &column);
                let freedom = 1.0 - leverage;
                let left_out =
                    if leverage > FULL_LEVERAGE { f64::INFINITY } else { square / (freedom * freedom) };
                Sums { judges: 1.0, fit: square, left_out, leverage }
            })
            .collect()
    };
    let mut sums = vec![Sums::default(); lights];
    for of_judge in judges.par_iter().map(of_judge).collect::<Vec<_>>() {
        for (sum, more) in sums.iter_mut().zip(of_judge) {
            sum.judges += more.judges;
            sum.fit += more.fit;
            sum.left_out += more.left_out;
            sum.leverage += more.leverage;
        }
    }
    let mean =
        |of: fn(&Sums) -> f64| -> Vec<f64> { sums.iter().map(|sum| of(sum) / sum.judges.max(1.0)).collect() };
    // What lights nothing can't be predicted from anything.
    let left_out =
        |sum: &Sums| if sum.judges > 0.0 { (sum.left_out / sum.judges).sqrt() } else { f64::INFINITY };
    LeaveOneOut {
        fit: mean(|sum| sum.fit).into_iter().map(f64::sqrt).collect(),
        left_out: sums.iter().map(left_out).collect(),
        leverage: mean(|sum| sum.leverage),
    }
}
