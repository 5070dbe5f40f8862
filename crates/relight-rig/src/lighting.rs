//! What a rig makes of lights.

use crate::{Light, Placement, Projector, Quantity, RigPart, cosine_lobe};
use rayon::prelude::*;
use relight_core::basis::evaluate_sh;
use relight_core::{CpuLevel, Direction};
use std::f64::consts::PI;

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
        self.parameters(placement, bands, |point, values, gradients| {
            for light in &lights {
                match gradients.is_empty() {
                    true => light.add_projection(point, bands, values),
                    false => light.add_projection_with_gradient(point, bands, values, gradients),
                }
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
        self.parameters(placement, bands, |point, values, gradients| match gradients.is_empty() {
            true => projector.project(level, point, values),
            false => projector.project_with_gradient(level, point, values, gradients),
        })
    }

    /// Looks from all samples by `look`, which adds values and, where there is room for them, slopes.
    fn parameters(
        &self,
        placement: &Placement,
        bands: usize,
        look: impl Fn([f64; 3], &mut [[f64; 3]], &mut [[[f64; 3]; 3]]) + Sync,
    ) -> Vec<[f64; 3]> {
        let functions = bands * bands;
        let seen = self.samples.par_iter().map(|sample| {
            let point = placement.point(sample.position);
            let mut values = vec![[0.0; 3]; functions];
            let Quantity::Slope(axis) = sample.quantity else {
                look(point, &mut values, &mut []);
                return values;
            };
            let mut gradients = vec![[[0.0; 3]; 3]; functions];
            look(point, &mut values, &mut gradients);
            let mut along = [0.0; 3];
            along[axis] = self.frame.half_extent[axis];
            let along = placement.direction(along);
            let slope = |gradient: &[[f64; 3]; 3]| {
                [0, 1, 2].map(|c| (0..3).fold(0.0, |sum, i| sum + along[i] * gradient[i][c]))
            };
            gradients.iter().map(slope).collect()
        });
        let seen: Vec<Vec<[f64; 3]>> = seen.collect();
        self.parameters_of(&seen, functions)
    }

    /// The operator applied to what the samples see, a vector of `functions` coefficients each.
    fn parameters_of(&self, seen: &[Vec<[f64; 3]>], functions: usize) -> Vec<[f64; 3]> {
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
