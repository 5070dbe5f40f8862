//! How well each picture is predicted from all others, in closed form.

use crate::{Decomposition, Sample};

/// A leverage this close to 1 means that a light is fitted by itself alone: nothing predicts it.
const FULL_LEVERAGE: f64 = 1.0 - 1e-9;

/// Errors of a fit on a [`Sample`], one a light.
#[derive(Clone, Debug, PartialEq)]
pub struct LeaveOneOut {
    /// Root mean square error of each picture in the fit of all.
    pub fit: Vec<f64>,
    /// Root mean square error of each picture predicted from all others; infinite where no other
    /// light says anything about it.
    pub left_out: Vec<f64>,
    /// Diagonal of the hat matrix: how much of each picture's own value its fit is, 0..1.
    pub leverage: Vec<f64>,
}

impl LeaveOneOut {
    /// The errors of `solution` (k x N) on `sample`.
    ///
    /// Leaving light i out changes its residual r_i to r_i / (1 - h_ii), h the hat matrix; the
    /// weights of the others stay as they are. Source: Allen, *The relationship between variable
    /// selection and data augmentation* (PRESS), 1974.
    ///
    /// # Panics
    /// When `sample` is of another number of lights.
    pub fn of(decomposition: &Decomposition, solution: &[f64], sample: &Sample) -> Self {
        let lights = decomposition.lights;
        assert_eq!(lights, sample.lights, "sample of another light set");
        let hat = decomposition.hat(solution);
        let (mut fit, mut left_out, mut leverage) = (Vec::new(), Vec::new(), Vec::new());
        for (i, row) in hat.chunks_exact(lights).enumerate() {
            let mut residual: Vec<f64> = row.iter().map(|h| -h).collect();
            residual[i] += 1.0;
            let rms = sample.rms(&residual);
            fit.push(rms);
            leverage.push(row[i]);
            left_out.push(if row[i] > FULL_LEVERAGE { f64::INFINITY } else { rms / (1.0 - row[i]) });
        }
        Self { fit, left_out, leverage }
    }

    /// Root mean square of `errors` over the lights, each with its weight (mean 1).
    pub fn mean(errors: &[f64], weights: &[f64]) -> f64 {
        let sum: f64 = errors.iter().zip(weights).map(|(e, w)| w * e * e).sum();
        (sum / errors.len().max(1) as f64).sqrt()
    }

    /// Root mean square error predicted for lights that were not fitted: the fit's own error over
    /// the lights' mean freedom, 1 - mean leverage; infinite when no freedom is left.
    ///
    /// Unlike the mean of the left-out errors it is not ruled by the few lights on the capture's
    /// rim, whose prediction is an extrapolation.
    /// Source: Golub, Heath, Wahba, *Generalized Cross-Validation*, 1979.
    pub fn cross_validation(&self, weights: &[f64]) -> f64 {
        let freedom = 1.0 - self.leverage.iter().sum::<f64>() / self.leverage.len().max(1) as f64;
        if freedom > 1.0 - FULL_LEVERAGE { Self::mean(&self.fit, weights) / freedom } else { f64::INFINITY }
    }
}
