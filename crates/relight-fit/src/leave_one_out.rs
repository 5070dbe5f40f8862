//! How well each picture is predicted from all others, in closed form.

use crate::row_products::{product, product_with_transposed, quadratic_form};
use crate::{Decomposition, Sample};
use relight_core::metrics::psnr;

/// A leverage this close to 1 means that a light is fitted by itself alone: nothing predicts it.
pub(crate) const FULL_LEVERAGE: f64 = 1.0 - 1e-9;

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
        // A light's residual is e - a S with a its row of the design, so its square over the sample is
        // G_ii - 2 a (S G)_i + a (S G S^T) a^T: N^2 k in all, where N rows of the hat matrix take N^3.
        let functions = decomposition.functions;
        let image = product(solution, &sample.gram, lights);
        let spread = product_with_transposed(&image, solution, lights);
        let (mut fit, mut left_out, mut leverage) = (Vec::new(), Vec::new(), Vec::new());
        for (i, row) in decomposition.design.chunks_exact(functions).enumerate() {
            let column =
                |matrix: &[f64]| row.iter().enumerate().map(|(j, a)| a * matrix[j * lights + i]).sum::<f64>();
            let square = sample.gram[i * lights + i] - 2.0 * column(&image) + quadratic_form(&spread, row);
            // Rounding may leave -1e-18 where the true value is 0.
            let (rms, h) = (square.max(0.0).sqrt(), column(solution));
            fit.push(rms);
            leverage.push(h);
            left_out.push(if h > FULL_LEVERAGE { f64::INFINITY } else { rms / (1.0 - h) });
        }
        Self { fit, left_out, leverage }
    }

    /// Root mean square of `errors` over the lights, each with its weight (mean 1).
    pub fn mean(errors: &[f64], weights: &[f64]) -> f64 {
        let sum: f64 = errors.iter().zip(weights).map(|(e, w)| w * e * e).sum();
        (sum / errors.len().max(1) as f64).sqrt()
    }

    /// Mean over lights of the PSNR of predicting each from the others, in dB of a range of 1; lights that
    /// nothing predicts don't count, and 120 dB is the most.
    pub fn left_out_psnr(&self) -> f64 {
        mean_psnr(&self.left_out)
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

/// Mean of the PSNR of root mean square errors, in dB of a range of 1; those that are not finite don't count, and 120 dB is the
/// most. 0 where none is.
pub fn mean_psnr(errors: &[f64]) -> f64 {
    let finite: Vec<f64> = errors.iter().copied().filter(|rmse| rmse.is_finite()).collect();
    finite.iter().map(|rmse| psnr(rmse.max(1e-6))).sum::<f64>() / finite.len().max(1) as f64
}
