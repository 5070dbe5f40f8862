//! Godot 4: the spherical harmonics of a `LightmapGIData` probe.

use super::{BY_L_M, Places, Target, phase, scaled};
use std::f64::consts::PI;

pub(super) const TARGET: Target = Target {
    name: "godot",
    stores: "radiance / pi by l, m without Condon-Shortley phase, for the probes of LightmapGI",
    axes: "x,y,z",
    places: Places::Parameters,
    values: &BY_L_M,
    convert: |radiance| scaled(radiance, |i| phase(i) / PI),
};

#[cfg(test)]
mod tests {
    use super::super::evaluation::{check, sum};
    use std::f64::consts::PI;

    /// The sum for `lightmap_captures` of its forward renderer.
    #[test]
    fn its_shader_gives_irradiance_over_pi() {
        check(&super::TARGET, 1.0 / PI, 1e-5, |values, [x, y, z]| {
            let c = [0.886227, 1.023327, 0.858086, 0.247708, 0.429043];
            sum(
                values,
                [
                    c[0],
                    c[1] * y,
                    c[1] * z,
                    c[1] * x,
                    c[2] * x * y,
                    c[2] * y * z,
                    c[3] * (3.0 * z * z - 1.0),
                    c[2] * x * z,
                    c[4] * (x * x - y * y),
                ],
            )
        });
    }
}
