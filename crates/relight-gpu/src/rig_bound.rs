//! How far a GPU's floats may be off in light by rigs and by sphere lights.

use crate::SphereSight;
use relight_core::vectors::{difference, length, wide};
use relight_rig::{AxisFunction, Frame, Model, cosine_lobe};
use std::f64::consts::PI;

/// What one operation of a float rounds by, relative.
const ROUNDING: f64 = 1.0 / 16_777_216.0;

/// Roundings of a vector's sum: 18 harmonics at most, a few operations each, of which few err the same way.
const ROUNDINGS_OF_SUM: f64 = 8.0;

/// Roundings of a coordinate in the box: its difference, scale and shift.
const ROUNDINGS_OF_COORDINATE: f64 = 4.0;

/// Of a sphere light against that of one that faces, away from the surface and as (1 - r / d)^(-1/2) near it: three times what
/// lavapipe was measured to have. The slope over r / d has that root in it, and r / d is a rounded float.
const SPHERE: [f64; 2] = [1e-6, 5e-7];

/// How far `relight_reflectance` may be off.
#[derive(Clone, Debug)]
pub struct RigBound<'a> {
    model: &'a Model,
    frame: &'a Frame,
    /// The most that any vector can reflect.
    reach: f64,
}

impl<'a> RigBound<'a> {
    /// Under lights whose coefficients are vectors x bands^2 of R, G, B.
    pub fn new(model: &'a Model, frame: &'a Frame, bands: usize, coefficients: &[[f32; 3]]) -> Self {
        let functions = bands * bands;
        let reach_of = |vector: &[[f32; 3]]| {
            // No harmonic of a band exceeds sqrt((2 l + 1) / 4 pi).
            let term = |(i, value): (usize, &[f32; 3])| {
                let l = i.isqrt();
                let largest = value.iter().fold(0.0f64, |a, c| a.max(f64::from(c.abs())));
                cosine_lobe(l).abs() / PI * ((2 * l + 1) as f64 / (4.0 * PI)).sqrt() * largest
            };
            vector.iter().enumerate().map(term).sum::<f64>()
        };
        let reach = coefficients.chunks_exact(functions).map(reach_of).fold(0.0, f64::max);
        Self { model, frame, reach }
    }

    /// At a point of the mesh: roundings of the sum, and of coordinates times how fast weights change with them.
    pub fn at(&self, position: [f64; 3]) -> f64 {
        let coordinates = self.frame.coordinates(position);
        let mut weights = vec![0.0; self.model.parameters().len()];
        self.model.weights(coordinates, &mut weights);
        let weight: f64 = weights.iter().map(|weight| weight.abs()).sum();
        let largest = coordinates.iter().fold(1.0f64, |a, c| a.max(c.abs()));
        let slope = |axis: usize| {
            let of_product = |product: &[AxisFunction; 3]| match product[axis] {
                AxisFunction::One => 0.0,
                AxisFunction::Coordinate => 1.0,
                // Of two nodes, each half a step of (nodes - 1) / 2.
                AxisFunction::Hat { nodes, .. } => (nodes - 1) as f64,
            };
            self.model.parameters().iter().map(of_product).fold(0.0, f64::max)
        };
        let of_coordinates: f64 = (0..3)
            .map(|axis| ROUNDINGS_OF_COORDINATE * (1.0 + coordinates[axis].abs()) * slope(axis))
            .sum::<f64>()
            * largest
            * largest;
        ROUNDING * self.reach * (ROUNDINGS_OF_SUM * weight + of_coordinates)
    }
}

impl SphereSight {
    /// How far `relight_sphere_reflectance` may be off: 1e-6 of what a facing light reflects, (r / d)^2, or
    /// 5e-7 / sqrt(1 - r / d) of it, whichever is more.
    pub fn bound(&self) -> f64 {
        let distance = length(difference(wide(self.centre), wide(self.position)));
        let s = (f64::from(self.radius) / distance).min(1.0);
        s * s * SPHERE[0].max(SPHERE[1] / (1.0 - s).max(2.0 * ROUNDING).sqrt())
    }
}
