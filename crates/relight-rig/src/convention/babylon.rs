//! Babylon.js: `SphericalHarmonics` of irradiance, before it divides by pi and scales for rendering.

use super::{BY_L_M, Places, Target, irradiated, scaled};

/// Its current signs; builds before SH3ylmBasisConstants (2020) knew no phase.
pub(super) const TARGET: Target = Target {
    name: "babylon",
    stores: "irradiance by l, m with Condon-Shortley phase, for SphericalHarmonics.FromArray, then convertIrradianceToLambertianRadiance",
    axes: "x,y,z",
    places: Places::Parameters,
    values: &BY_L_M,
    convert: |radiance| scaled(radiance, irradiated),
};

#[cfg(test)]
pub(super) mod tests {
    use super::super::evaluation::{check, sum};
    use std::f64::consts::PI;

    /// convertIrradianceToLambertianRadiance, preScaleForRendering and computeEnvironmentIrradiance, one after the other.
    pub(crate) fn rendered(values: &[[f64; 3]], [x, y, z]: [f64; 3]) -> [f64; 3] {
        let basis = [1.0, -3.0, 3.0, -3.0, 15.0, -15.0, 1.25, -15.0, 3.75];
        let scaled: Vec<_> = values
            .iter()
            .zip(basis)
            .map(|(value, k): (_, f64)| value.map(|v| v / PI * k.signum() * (k.abs() / (4.0 * PI)).sqrt()))
            .collect();
        sum(&scaled, [1.0, y, z, x, y * x, y * z, 3.0 * z * z - 1.0, z * x, x * x - y * y])
    }

    #[test]
    fn its_shader_gives_irradiance_over_pi() {
        check(&super::TARGET, 1.0 / PI, 1e-12, rendered);
    }
}
