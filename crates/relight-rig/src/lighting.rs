//! What a rig makes of lights.

use crate::{Light, Placement, Quantity, RigPart};
use rayon::prelude::*;
use relight_core::Direction;
use std::f64::consts::PI;
use relight_core::basis::evaluate_sh;

/// Factors that make irradiance of radiance, by band.
///
/// Source: Ramamoorthi and Hanrahan, *An Efficient Representation for Irradiance Environment Maps*.
pub const COSINE_LOBE: [f64; 11] = [
    PI,
    2.0 * PI / 3.0,
    PI / 4.0,
    0.0,
    -PI / 24.0,
    0.0,
    PI / 64.0,
    0.0,
    -PI / 128.0,
    0.0,
    7.0 * PI / 1536.0,
];

/// Writes what each coefficient of radiance gives in light reflected by a white diffuser (irradiance / pi) with this normal;
/// `out` has a place for each of bands^2 functions, of 11 bands at most.
pub fn reflection(normal: [f64; 3], out: &mut [f64]) {
    let [x, y, z] = normal;
    let bands = out.len().isqrt();
    // Normals are unit vectors; what is none has no side to light.
    let Ok(direction) = Direction::new(x, y, z) else { return out.fill(0.0) };
    evaluate_sh(bands - 1, direction, out);
    for (l, lobe) in COSINE_LOBE.iter().enumerate().take(bands) {
        for value in &mut out[l * l..(l + 1) * (l + 1)] {
            *value *= lobe / PI;
        }
    }
}

impl RigPart {
    /// The rig's vectors under `lights`, each with the share of it that goes through the rig: parameters x bands^2 of R, G, B of
    /// radiance, row-major, in the scene's axes.
    ///
    /// In f64, light by light: the judge of the fast way.
    pub fn coefficients(
        &self,
        lights: &[(&Light, f64)],
        placement: &Placement,
        bands: usize,
    ) -> Vec<[f64; 3]> {
        let functions = bands * bands;
        let seen: Vec<Vec<[f64; 3]>> = self
            .samples
            .par_iter()
            .map(|sample| {
                let point = placement.point(sample.position);
                let mut sum = vec![[0.0; 3]; functions];
                for (light, share) in lights {
                    let mut values = vec![[0.0; 3]; functions];
                    match sample.quantity {
                        Quantity::Value => light.add_projection(point, bands, &mut values),
                        Quantity::Slope(axis) => {
                            let mut gradients = vec![[[0.0; 3]; 3]; functions];
                            light.add_projection_with_gradient(point, bands, &mut values, &mut gradients);
                            let mut along = [0.0; 3];
                            along[axis] = self.frame.half_extent[axis];
                            let along = placement.direction(along);
                            for (value, gradient) in values.iter_mut().zip(&gradients) {
                                *value = [0, 1, 2]
                                    .map(|c| (0..3).fold(0.0, |sum, i| sum + along[i] * gradient[i][c]));
                            }
                        }
                    }
                    for (sum, value) in sum.iter_mut().zip(values) {
                        *sum = [0, 1, 2].map(|c| sum[c] + share * value[c]);
                    }
                }
                sum
            })
            .collect();
        self.parameters_of(&seen, functions)
    }

    /// The operator applied to what the samples see, a vector of `functions` coefficients each.
    pub(crate) fn parameters_of(&self, seen: &[Vec<[f64; 3]>], functions: usize) -> Vec<[f64; 3]> {
        let mut coefficients = vec![[0.0; 3]; self.model.parameters().len() * functions];
        for (row, out) in
            self.operator.chunks_exact(seen.len().max(1)).zip(coefficients.chunks_exact_mut(functions))
        {
            for (factor, values) in row.iter().zip(seen) {
                for (out, value) in out.iter_mut().zip(values) {
                    *out = [0, 1, 2].map(|c| out[c] + factor * value[c]);
                }
            }
        }
        coefficients
    }

    /// Light reflected by a white diffuser at a point of the mesh (in the mesh's axes) whose normal in the scene is `normal`.
    pub fn reflectance(&self, coefficients: &[[f64; 3]], point: [f64; 3], normal: [f64; 3]) -> [f64; 3] {
        let parameters = self.model.parameters().len();
        let mut weights = vec![0.0; parameters];
        self.model.weights(self.frame.coordinates(point), &mut weights);
        let functions = coefficients.len() / parameters;
        let mut reflection_of = vec![0.0; functions];
        reflection(normal, &mut reflection_of);
        let mut sum = [0.0; 3];
        for (weight, values) in weights.iter().zip(coefficients.chunks_exact(functions)) {
            for (reflection, value) in reflection_of.iter().zip(values) {
                sum = [0, 1, 2].map(|c| sum[c] + weight * reflection * value[c]);
            }
        }
        sum
    }
}
