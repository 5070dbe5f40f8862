//! Coefficients as engines and libraries keep them: order, signs and scale of each.
//!
//! A rig's vectors hold radiance L_lm by l * l + l + m with Condon-Shortley phase. Every target is a file with its function and
//! a row of [`TARGETS`]; each is tested by evaluating what it stores as the target's own shader does.
//! Source: MATH.md section 3.

mod axes;
mod babylon;
mod bevy;
mod directxmath;
mod filament;
mod gltf;
mod godot;
mod threejs;
mod unity;

#[cfg(test)]
pub(crate) mod evaluation;

pub use axes::Axes;
pub use bevy::{AmbientCubes, ambient_cubes};

use crate::cosine_lobe;
use std::f64::consts::PI;

/// How many harmonics targets keep: three bands.
pub const HARMONICS: usize = 9;

/// Who reads coefficients.
#[derive(Debug)]
pub struct Target {
    /// What it is called.
    pub name: &'static str,
    /// What its values are, in one sentence.
    pub stores: &'static str,
    /// Its axes in those of the scene, as [`Axes::parse`] reads them.
    pub axes: &'static str,
    /// Where there are values.
    pub places: Places,
    /// What each of a place's values belongs to, in order.
    pub values: &'static [&'static str],
    /// R, G, B of each value from those of radiance.
    pub convert: fn(&[[f64; 3]; HARMONICS]) -> Vec<[f64; 3]>,
}

/// Where a target has values.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Places {
    /// At each vector of harmonics of the rig; the engine blends them by the model's weights.
    Parameters,
    /// At each cell of a volume around the mesh; the engine blends them by its sampler.
    Cells,
}

/// All targets, in the order in which they are listed to users.
pub const TARGETS: [&Target; 11] = [
    &directxmath::TARGET,
    &filament::TARGET,
    &filament::GENERIC,
    &unity::TARGET,
    &threejs::TARGET,
    &babylon::TARGET,
    &godot::TARGET,
    &bevy::TARGET,
    &gltf::TARGET,
    &gltf::WITHOUT_PHASE,
    &crate::zh3::TARGET,
];

impl Target {
    /// The target of that name.
    pub fn by_name(name: &str) -> Option<&'static Self> {
        TARGETS.into_iter().find(|target| target.name == name)
    }
}

/// Names of the harmonics by l, m, in order.
const BY_L_M: [&str; HARMONICS] = ["l0m0", "l1m-1", "l1m0", "l1m1", "l2m-2", "l2m-1", "l2m0", "l2m1", "l2m2"];

/// What multiplies each of nine values: 1, y, z, x, xy, yz, 3 z^2 - 1, xz, x^2 - y^2.
const BY_POLYNOMIAL: [&str; HARMONICS] = ["1", "y", "z", "x", "xy", "yz", "3zz-1", "xz", "xx-yy"];

/// Irradiance of a harmonic of radiance.
fn irradiated(harmonic: usize) -> f64 {
    cosine_lobe(harmonic.isqrt())
}

/// Reflected radiance of a white diffuser, irradiance / pi, of a harmonic of radiance.
fn reflected(harmonic: usize) -> f64 {
    irradiated(harmonic) / PI
}

/// The factor of a harmonic that drops, or brings in, the Condon-Shortley phase: (-1)^m.
fn phase(harmonic: usize) -> f64 {
    let l = harmonic.isqrt();
    if (harmonic - l * l).abs_diff(l) % 2 == 1 { -1.0 } else { 1.0 }
}

/// Factors of the bare polynomials in harmonics without phase.
fn polynomial(harmonic: usize) -> f64 {
    let squared = [1.0, 3.0, 3.0, 3.0, 15.0, 15.0, 1.25, 15.0, 3.75][harmonic];
    (squared / (4.0 * PI)).sqrt()
}

/// Every harmonic by a factor of its own.
fn scaled(radiance: &[[f64; 3]; HARMONICS], factor: impl Fn(usize) -> f64) -> Vec<[f64; 3]> {
    (0..HARMONICS).map(|i| radiance[i].map(|value| factor(i) * value)).collect()
}

/// Reflected radiance of a white diffuser, irradiance / pi, as factors of bare polynomials of the normal.
fn reflected_polynomial(radiance: &[[f64; 3]; HARMONICS]) -> Vec<[f64; 3]> {
    scaled(radiance, |i| reflected(i) * polynomial(i) * phase(i))
}
