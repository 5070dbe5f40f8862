//! What a rig makes of lights.

use crate::{Light, Placement, Projector, Quantity, RigPart, cosine_lobe};
use rayon::prelude::*;
use relight_core::basis::evaluate_sh;
use relight_core::{CpuLevel, Direction};
use std::f64::consts::PI;

/// Samples that look together.
const TOGETHER: usize = 16;

/// Writes what each coefficient of radiance gives in light reflected by a white diffuser (irradiance / pi) with this normal;
/// `out` has a place for each of bands^2 functions, of 11 bands at most.
pub fn reflection(normal: [f64; 3], out: &mut [f64]) {
    let [x, y, z] = normal;
    let bands = out.len().isqrt();
    // Normals are unit vectors; what is none has no side to light.
    let Ok(direction) = Direction::new(x, y, z) else { return out.fill(0.0) };
    evaluate_sh(bands - 1, direction, out);
    for l in 0..bands {
        for value in &mut out[l * l..(l + 1) * (l + 1)] {
            *value *= cosine_lobe(l) / PI;
        }
    }
}

impl RigPart {
    /// The rig's vectors under `lights`, each with the share of it that goes through the rig: parameters x bands^2 of R, G, B of
    /// radiance, row-major, in the scene's axes.
    ///
    /// In f64, light by light: what judges [`Self::coefficients_by`].
    pub fn coefficients(
        &self,
        lights: &[(&Light, f64)],
        placement: &Placement,
        bands: usize,
    ) -> Vec<[f64; 3]> {
        let lights: Vec<Light> = lights
            .iter()
            .map(|(light, share)| Light { color: light.color.map(|c| c * share), ..(*light).clone() })
            .collect();
        let values = |points: &[[f64; 3]], out: &mut [[f64; 3]]| {
            out.fill([0.0; 3]);
            for (&point, out) in points.iter().zip(out.chunks_exact_mut(bands * bands)) {
                lights.iter().for_each(|light| light.add_projection(point, bands, out));
            }
        };
        self.parameters(placement, bands, values, |point, values, gradients| {
            for light in &lights {
                light.add_projection_with_gradient(point, bands, values, gradients);
            }
        })
    }

    /// The rig's vectors under the lights of a projector, in f32: many lights at once.
    pub fn coefficients_by(
        &self,
        projector: &Projector,
        placement: &Placement,
        bands: usize,
        level: CpuLevel,
    ) -> Vec<[f64; 3]> {
        let values = |points: &[[f64; 3]], out: &mut [[f64; 3]]| projector.project_all(level, points, out);
        self.parameters(placement, bands, values, |point, values, gradients| {
            projector.project_with_gradient(level, point, values, gradients);
        })
    }

    /// Looks from all samples: by `values` from some at once, vector after vector, and by `slopes`, which is given zeros.
    fn parameters(
        &self,
        placement: &Placement,
        bands: usize,
        values: impl Fn(&[[f64; 3]], &mut [[f64; 3]]) + Sync,
        slopes: impl Fn([f64; 3], &mut [[f64; 3]], &mut [[[f64; 3]; 3]]) + Sync,
    ) -> Vec<[f64; 3]> {
        let functions = bands * bands;
        let mut seen = vec![[0.0; 3]; self.samples.len() * functions];
        let looks = self.samples.par_chunks(TOGETHER).zip(seen.par_chunks_mut(TOGETHER * functions));
        looks.for_each(|(samples, seen)| {
            let mut points = Vec::new();
            let mut of_points = Vec::new();
            for (sample, seen) in samples.iter().zip(seen.chunks_exact_mut(functions)) {
                let point = placement.point(sample.position);
                match sample.quantity {
                    Quantity::Value => {
                        points.push(point);
                        of_points.push(seen);
                    }
                    Quantity::Slope(axis) => {
                        let mut gradients = vec![[[0.0; 3]; 3]; functions];
                        slopes(point, seen, &mut gradients);
                        let mut along = [0.0; 3];
                        along[axis] = self.frame.half_extent[axis];
                        let along = placement.direction(along);
                        for (out, gradient) in seen.iter_mut().zip(&gradients) {
                            *out =
                                [0, 1, 2].map(|c| (0..3).fold(0.0, |sum, i| sum + along[i] * gradient[i][c]));
                        }
                    }
                }
            }
            let mut together = vec![[0.0; 3]; points.len() * functions];
            values(&points, &mut together);
            for (out, seen) in of_points.into_iter().zip(together.chunks_exact(functions)) {
                out.copy_from_slice(seen);
            }
        });
        self.parameters_of(&seen, functions)
    }

    /// The operator applied to what the samples see, vector after vector of `functions` coefficients.
    fn parameters_of(&self, seen: &[[f64; 3]], functions: usize) -> Vec<[f64; 3]> {
        let mut coefficients = vec![[0.0; 3]; self.model.parameters().len() * functions];
        for (row, out) in self
            .operator
            .chunks_exact(self.samples.len().max(1))
            .zip(coefficients.chunks_exact_mut(functions))
        {
            for (factor, values) in row.iter().zip(seen.chunks_exact(functions)) {
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
