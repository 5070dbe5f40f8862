//! The basis on the lights, taken apart by singular values: what can be fitted, and how safely.

use crate::FitError;
use crate::row_products::product;
use crate::singular_values::SingularValues;
use nalgebra::DMatrix;
use relight_core::sphere::voronoi_weights;
use relight_core::{Basis, Direction};

/// Singular values below this part of the largest count as zero.
///
/// Source: MATH.md section 1.3; real captures of deficient sets (a ring, a plane) show 1e-16, the
/// worst usable ones 1e-5.
pub const RANK_TOLERANCE: f64 = 1e-6;

/// How much each light counts.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum LightWeights {
    /// By the area of its cell on the sphere: crowded lights share.
    Voronoi,
    /// All alike.
    Uniform,
}

/// `W^(1/2) A = U S V^T` of `A[i][j] = b_j(light i)` with weights `W` on the lights.
#[derive(Clone, Debug)]
pub struct Decomposition {
    /// N x k, row-major: the basis on the lights, without weights.
    pub design: Vec<f64>,
    /// Number of lights N.
    pub lights: usize,
    /// Number of functions k.
    pub functions: usize,
    /// Weight of each light, mean 1.
    pub weights: Vec<f64>,
    /// Singular values of the weighted design, falling; min(N, k) of them.
    pub singular_values: Vec<f64>,
    /// N x r (r = min(N, k)).
    left: DMatrix<f64>,
    /// k x r.
    right: DMatrix<f64>,
}

impl Decomposition {
    /// Decomposes `basis` on `directions`.
    ///
    /// # Errors
    /// [`FitError::NoLights`] without lights.
    pub fn new(basis: &Basis, directions: &[Direction], weighting: LightWeights) -> Result<Self, FitError> {
        let (lights, functions) = (directions.len(), basis.count());
        if lights == 0 {
            return Err(FitError::NoLights);
        }
        let mut design = vec![0.0; lights * functions];
        for (row, direction) in design.chunks_exact_mut(functions).zip(directions) {
            basis.evaluate(*direction, row);
        }
        let weights = match weighting {
            LightWeights::Voronoi => voronoi_weights(directions),
            LightWeights::Uniform => vec![1.0; lights],
        };
        let weighted =
            DMatrix::from_fn(lights, functions, |i, j| weights[i].sqrt() * design[i * functions + j]);
        let SingularValues { left, values, right } = SingularValues::of(weighted);
        Ok(Self { design, lights, functions, weights, singular_values: values, left, right })
    }

    /// How many directions of coefficient space the lights determine.
    pub fn rank(&self) -> usize {
        let largest = self.singular_values.first().copied().unwrap_or(0.0);
        self.singular_values.iter().filter(|&&s| s > RANK_TOLERANCE * largest && s > 0.0).count()
    }

    /// Ratio of the largest to the smallest singular value; infinite when the lights leave a
    /// function undetermined.
    pub fn condition(&self) -> f64 {
        if self.rank() < self.functions {
            return f64::INFINITY;
        }
        match (self.singular_values.first(), self.singular_values.last()) {
            (Some(largest), Some(least)) => largest / least,
            _ => f64::INFINITY,
        }
    }

    /// The k x N matrix (row-major) that turns a pixel's values under all lights into its
    /// coefficients: `V diag(s / (s^2 + ridge s0^2)) U^T W^(1/2)`, singular values below
    /// [`RANK_TOLERANCE`] left out, which is the least-norm solution where lights don't suffice.
    ///
    /// Source: MATH.md sections 1.2 and 1.3.
    pub fn solution(&self, ridge: f64) -> Vec<f64> {
        let largest = self.singular_values.first().copied().unwrap_or(0.0);
        let filter: Vec<f64> = self.singular_values[..self.rank()]
            .iter()
            .map(|s| s / (s * s + ridge * largest * largest))
            .collect();
        let mut solution = vec![0.0; self.functions * self.lights];
        for (j, row) in solution.chunks_exact_mut(self.lights).enumerate() {
            for (i, value) in row.iter_mut().enumerate() {
                let mut sum = 0.0;
                for (r, factor) in filter.iter().enumerate() {
                    sum += self.right[(j, r)] * factor * self.left[(i, r)];
                }
                *value = sum * self.weights[i].sqrt();
            }
        }
        solution
    }

    /// The N x N hat matrix (row-major) of `solution`: fitted values = hat x values.
    pub fn hat(&self, solution: &[f64]) -> Vec<f64> {
        product(&self.design, solution, self.lights)
    }
}
