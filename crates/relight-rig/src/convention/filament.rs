//! Filament: coefficients of `IndirectLight::Builder::irradiance`, and those that `cmgen -x sh` prints.

use super::{BY_L_M, BY_POLYNOMIAL, Places, Target, reflected, reflected_polynomial, scaled};

/// What the KTX files' `sh` and `irradiance(3, sh)` take. Filament's tool mirrors environments in x before; ours does not.
pub(super) const TARGET: Target = Target {
    name: "filament",
    stores: "irradiance / pi as factors of polynomials of the normal (pre-scaled)",
    axes: "x,y,z",
    places: Places::Parameters,
    values: &BY_POLYNOMIAL,
    convert: reflected_polynomial,
};

pub(super) const GENERIC: Target = Target {
    name: "filament-generic",
    stores: "irradiance / pi by l, m with Condon-Shortley phase, as cmgen prints it without pre-scaling",
    axes: "x,y,z",
    places: Places::Parameters,
    values: &BY_L_M,
    convert: |radiance| scaled(radiance, reflected),
};

#[cfg(test)]
mod tests {
    use super::super::evaluation::{check, sum};
    use std::f64::consts::PI;

    /// Irradiance_SphericalHarmonics of Filament's indirect lighting.
    fn filament(sh: &[[f64; 3]], [x, y, z]: [f64; 3]) -> [f64; 3] {
        sum(sh, [1.0, y, z, x, y * x, y * z, 3.0 * z * z - 1.0, z * x, x * x - y * y])
    }

    #[test]
    fn its_shader_gives_irradiance_over_pi() {
        check(&super::TARGET, 1.0 / PI, 1e-12, filament);
    }

    /// The factors by which Filament's documentation scales coefficients before they reach that shader.
    #[test]
    fn generic_ones_are_those_before_scaling() {
        check(&super::GENERIC, 1.0 / PI, 1e-5, |values, normal| {
            let factors = [
                0.282095, -0.488603, 0.488603, -0.488603, 1.092548, -1.092548, 0.315392, -1.092548, 0.546274,
            ];
            let scaled: Vec<_> = values.iter().zip(factors).map(|(value, k)| value.map(|v| v * k)).collect();
            filament(&scaled, normal)
        });
    }
}
