//! The fit: one k x N matrix for all pixels.
//!
//! Source: Wong et al., *Lighting Precomputation Using the Relighting Map*, eq. 1; the
//! pseudo-inverse by singular values in f64 with a ridge (docs/stability.md says why).

use crate::{Decomposition, FitError, LeaveOneOut, LightWeights, Sample};
use relight_core::{Basis, Direction, FitFigures};

/// How strongly coefficients are held small, as a part of the largest singular value squared.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Ridge {
    /// The family's own, or more where generalised cross-validation finds that much better.
    Auto,
    /// This, 0 to 1.
    Fixed(f64),
}

/// Ridges tried by [`Ridge::Auto`], as multiples of the family's, up to `LARGEST`.
const STEP: f64 = 10.0;

/// The largest ridge that [`Ridge::Auto`] takes.
const LARGEST: f64 = 0.1;

/// A larger ridge must lower the predicted error to this part (0.5 dB) to be taken: less than that
/// is noise, and a larger ridge blurs.
const WORTH: f64 = 0.944;

/// The solved fit of a basis to a light set.
#[derive(Clone, Debug)]
pub struct LeastSquares {
    /// Functions of light.
    pub basis: Basis,
    /// The basis on the lights.
    pub decomposition: Decomposition,
    /// The ridge that was taken, relative to the largest singular value squared.
    pub ridge: f64,
    /// k x N, row-major: coefficients = solution x values.
    pub solution: Vec<f64>,
    /// Errors of each light on the sample.
    pub leave_one_out: LeaveOneOut,
    /// The same over all lights.
    pub figures: FitFigures,
}

impl LeastSquares {
    /// Fits `argmin_c |W^(1/2) (A c - y)|^2 + ridge s0^2 |c|^2`, where `A[i][j] = b_j(light i)` is
    /// shared by all pixels, so that `c = solution x y`.
    ///
    /// # Errors
    /// [`FitError::NoLights`], or [`FitError::Ridge`] for a ridge outside 0..1.
    pub fn new(
        basis: Basis,
        directions: &[Direction],
        weighting: LightWeights,
        ridge: Ridge,
        sample: &Sample,
    ) -> Result<Self, FitError> {
        let decomposition = Decomposition::new(&basis, directions, weighting)?;
        Self::judged(basis, decomposition, ridge, |decomposition, ridge| {
            let solution = decomposition.solution(ridge);
            let errors = LeaveOneOut::of(decomposition, &solution, sample);
            (solution, errors)
        })
    }

    /// The fit whose ridge is the one that `judge` finds best; it gives the solution with a ridge and its errors.
    pub(crate) fn judged(
        basis: Basis,
        decomposition: Decomposition,
        ridge: Ridge,
        judge: impl Fn(&Decomposition, f64) -> (Vec<f64>, LeaveOneOut),
    ) -> Result<Self, FitError> {
        let judge = |ridge: f64| {
            let (solution, errors) = judge(&decomposition, ridge);
            let predicted = errors.cross_validation(&decomposition.weights);
            (ridge, solution, errors, predicted)
        };
        let (ridge, solution, leave_one_out, _) = match ridge {
            Ridge::Fixed(ridge) if !(0.0..=1.0).contains(&ridge) => return Err(FitError::Ridge { ridge }),
            Ridge::Fixed(ridge) => judge(ridge),
            Ridge::Auto => {
                let mut best = judge(basis.family().ridge);
                let mut ridge = best.0.max(f64::EPSILON) * STEP;
                while ridge <= LARGEST {
                    let tried = judge(ridge);
                    if tried.3 < WORTH * best.3 {
                        best = tried;
                    }
                    ridge *= STEP;
                }
                best
            }
        };
        let fit_rmse = LeaveOneOut::mean(&leave_one_out.fit, &decomposition.weights);
        let leave_one_out_rmse = LeaveOneOut::mean(&leave_one_out.left_out, &decomposition.weights);
        let figures = FitFigures { fit_rmse, leave_one_out_rmse };
        Ok(Self { basis, decomposition, ridge, solution, leave_one_out, figures })
    }

    /// The solution in f32, as the kernel takes it.
    pub fn solution_f32(&self) -> Vec<f32> {
        self.solution.iter().map(|&value| value as f32).collect()
    }
}
