//! What tests of all targets hold them to: irradiance under lopsided radiance, by the harmonics themselves.

#![allow(clippy::unwrap_used, reason = "a helper fails as its test does")]

use super::{HARMONICS, Target};
use relight_core::Direction;
use relight_core::basis::evaluate_sh;
use relight_core::sphere::{Cap, fibonacci_in};
use std::f64::consts::PI;

/// Radiance with a value of its own in every place, so that a swap or a sign shows.
pub(crate) fn lopsided() -> [[f64; 3]; HARMONICS] {
    std::array::from_fn(|i| {
        [0, 1, 2].map(|c| 0.3 + 0.17 * ((7 * i + 5 * c) % 11) as f64 - 0.09 * (i * c) as f64)
    })
}

/// Irradiance at a normal.
pub(crate) fn irradiance(radiance: &[[f64; 3]; HARMONICS], normal: [f64; 3]) -> [f64; 3] {
    let mut harmonics = [0.0; HARMONICS];
    evaluate_sh(2, Direction::new(normal[0], normal[1], normal[2]).unwrap(), &mut harmonics);
    let lobe = [PI, 2.0 * PI / 3.0, PI / 4.0];
    [0, 1, 2].map(|c| (0..HARMONICS).map(|i| lobe[i.isqrt()] * radiance[i][c] * harmonics[i]).sum())
}

/// Normals all around.
pub(crate) fn normals() -> Vec<[f64; 3]> {
    let all = Cap { axis: Direction::new(0.3, -0.5, 0.8).unwrap(), radius: PI };
    fibonacci_in(all, 200).into_iter().map(Direction::components).collect()
}

/// Holds what `shader` makes of a target's values to irradiance times `scale`, in the scene's axes.
pub(crate) fn check(
    target: &Target,
    scale: f64,
    tolerance: f64,
    shader: impl Fn(&[[f64; 3]], [f64; 3]) -> [f64; 3],
) {
    let radiance = lopsided();
    let values = (target.convert)(&radiance);
    assert_eq!(values.len(), target.values.len(), "{}", target.name);
    for normal in normals() {
        let (got, expected) = (shader(&values, normal), irradiance(&radiance, normal));
        for c in 0..3 {
            let error = (got[c] - scale * expected[c]).abs();
            assert!(error < tolerance, "{} at {normal:?}, channel {c}: off by {error}", target.name);
        }
    }
}

/// A sum of values by factors.
pub(crate) fn sum<const N: usize>(values: &[[f64; 3]], factors: [f64; N]) -> [f64; 3] {
    [0, 1, 2].map(|c| values.iter().zip(factors).map(|(value, factor)| value[c] * factor).sum())
}
