//! DirectXMath, D3DX, cmft, google/spherical-harmonics, Sloan's papers: radiance as rigs have it.

use super::{BY_L_M, Places, Target};

pub(super) const TARGET: Target = Target {
    name: "directxmath",
    stores: "radiance by l, m with Condon-Shortley phase, for XMSHDot with a cosine lobe",
    axes: "x,y,z",
    places: Places::Parameters,
    values: &BY_L_M,
    convert: |radiance| radiance.to_vec(),
};

#[cfg(test)]
mod tests {
    use super::super::evaluation::{check, sum};
    use std::f64::consts::PI;

    /// XMSHEvalDirection's polynomials of order 3, which XMSHEvalDirectionalLight scales by the bands of a cosine lobe.
    #[test]
    fn dot_with_a_cosine_lobe_is_irradiance() {
        check(&super::TARGET, 1.0, 1e-12, |values, [x, y, z]| {
            let lobe = [PI, 2.0 * PI / 3.0, PI / 4.0];
            let [a, b, c] = [0.488_602_511_902_919_9, 1.092_548_430_592_079_2, 0.315_391_565_252_520_05];
            let directions = [
                0.282_094_791_773_878_14,
                -a * y,
                a * z,
                -a * x,
                b * x * y,
                -b * y * z,
                c * (3.0 * z * z - 1.0),
                -b * x * z,
                b / 2.0 * (x * x - y * y),
            ];
            sum(values, std::array::from_fn::<_, 9, _>(|i| lobe[i.isqrt()] * directions[i]))
        });
    }
}
