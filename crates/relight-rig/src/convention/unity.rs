//! Unity: `SphericalHarmonicsL2`, from which it fills `unity_SHAr` and its fellows.

use super::{BY_POLYNOMIAL, Places, Target, reflected_polynomial};

/// Its axes are left-handed, y up; importers of glTF turn x around, and so does this.
pub(super) const TARGET: Target = Target {
    name: "unity",
    stores: "irradiance / pi as factors of polynomials of the normal, [channel, 0 .. 8] of SphericalHarmonicsL2",
    axes: "-x,y,z",
    places: Places::Parameters,
    values: &BY_POLYNOMIAL,
    convert: reflected_polynomial,
};

#[cfg(test)]
mod tests {
    use super::super::Axes;
    use super::super::evaluation::{check, irradiance, lopsided, normals};
    use std::f64::consts::PI;

    /// ShadeSH9 on what Unity packs: SHAr (x, y, z, 1) of the linear part, SHBr of four products, SHC of x^2 - y^2.
    fn shade_sh9(sh: &[[f64; 3]], [x, y, z]: [f64; 3]) -> [f64; 3] {
        [0, 1, 2].map(|c| {
            let sh = |i: usize| sh[i][c];
            let a = [sh(3), sh(1), sh(2), sh(0) - sh(6)];
            let b = [sh(4), sh(5), 3.0 * sh(6), sh(7)];
            let linear = a[0] * x + a[1] * y + a[2] * z + a[3];
            // normal.xyzz * normal.yzzx
            let products = b[0] * x * y + b[1] * y * z + b[2] * z * z + b[3] * z * x;
            linear + products + sh(8) * (x * x - y * y)
        })
    }

    #[test]
    fn its_shader_gives_irradiance_over_pi() {
        check(&super::TARGET, 1.0 / PI, 1e-12, shade_sh9);
    }

    #[test]
    fn a_normal_with_x_turned_around_sees_what_the_scenes_own_does() {
        let axes = Axes::parse(super::TARGET.axes).unwrap();
        let values = (super::TARGET.convert)(&axes.harmonics(&lopsided()));
        for [x, y, z] in normals() {
            let (got, expected) = (shade_sh9(&values, [-x, y, z]), irradiance(&lopsided(), [x, y, z]));
            assert!((0..3).all(|c| (got[c] - expected[c] / PI).abs() < 1e-12), "{got:?} {expected:?}");
        }
    }
}
