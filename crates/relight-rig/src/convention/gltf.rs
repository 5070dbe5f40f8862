//! glTF's EXT_lights_image_based: nine `irradianceCoefficients`.
//!
//! The extension does not say which signs its harmonics have. Babylon.js, which loads it, has the phase now and had none in
//! former builds, so there are two rows.

use super::{BY_L_M, Places, Target, irradiated, phase, scaled};

pub(super) const TARGET: Target = Target {
    name: "gltf",
    stores: "irradiance by l, m with Condon-Shortley phase, as today's readers of EXT_lights_image_based have it",
    axes: "x,y,z",
    places: Places::Parameters,
    values: &BY_L_M,
    convert: |radiance| scaled(radiance, irradiated),
};

pub(super) const WITHOUT_PHASE: Target = Target {
    name: "gltf-without-phase",
    stores: "irradiance by l, m without Condon-Shortley phase, as older readers of EXT_lights_image_based have it",
    axes: "x,y,z",
    places: Places::Parameters,
    values: &BY_L_M,
    convert: |radiance| scaled(radiance, |i| irradiated(i) * phase(i)),
};

#[cfg(test)]
mod tests {
    use super::super::babylon::tests::rendered;
    use super::super::evaluation::{check, sum};
    use std::f64::consts::PI;

    #[test]
    fn its_reader_gives_irradiance_over_pi() {
        check(&super::TARGET, 1.0 / PI, 1e-12, rendered);
    }

    /// Positive factors throughout, as the polynomials of older builds had them.
    #[test]
    fn older_readers_do_without_phase() {
        check(&super::WITHOUT_PHASE, 1.0, 1e-5, |values, [x, y, z]| {
            let [a, b] = [0.488603, 1.092548];
            sum(
                values,
                [
                    0.282095,
                    a * y,
                    a * z,
                    a * x,
                    b * x * y,
                    b * y * z,
                    0.315392 * (3.0 * z * z - 1.0),
                    b * x * z,
                    0.546274 * (x * x - y * y),
                ],
            )
        });
    }
}
