//! three.js: `SphericalHarmonics3` of a `LightProbe`.

use super::{BY_L_M, Places, Target, phase, scaled};

pub(super) const TARGET: Target = Target {
    name: "threejs",
    stores: "radiance by l, m without Condon-Shortley phase, for LightProbe.sh.coefficients",
    axes: "x,y,z",
    places: Places::Parameters,
    values: &BY_L_M,
    convert: |radiance| scaled(radiance, phase),
};

#[cfg(test)]
mod tests {
    use super::super::evaluation::{check, sum};

    /// shGetIrradianceAt of its shaders, which divide by pi later.
    #[test]
    fn its_shader_gives_irradiance() {
        check(&super::TARGET, 1.0, 2e-5, |values, [x, y, z]| {
            let [a, b] = [2.0 * 0.511664, 2.0 * 0.429043];
            sum(
                values,
                [
                    0.886227,
                    a * y,
                    a * z,
                    a * x,
                    b * x * y,
                    b * y * z,
                    0.743125 * z * z - 0.247708,
                    b * x * z,
                    0.429043 * (x * x - y * y),
                ],
            )
        });
    }
}
