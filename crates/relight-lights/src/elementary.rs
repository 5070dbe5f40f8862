//! Elementary functions in f32 that are loops' bodies: no branch, no table, no library call, so that a loop
//! over them becomes vector instructions, with the same bits at every CPU level.

/// 1.5 x 2^23: adding it rounds to the nearest integer, which then stands in the low bits.
const INTEGERS: f32 = 12_582_912.0;

/// exp(x) for x from -87 to 0 (below, exp(-87) = 1.6e-38), within 2e-7 of it relatively.
///
/// Source: Cephes, `expf`: r = x - n ln 2 in two parts, a polynomial of degree 5 beyond 1 + r.
#[inline(always)]
pub(crate) fn exp(x: f32) -> f32 {
    let x = x.max(-87.0);
    let shifted = x * std::f32::consts::LOG2_E + INTEGERS;
    let n = shifted - INTEGERS;
    let r = (x - n * 0.693_359_4) - n * -2.121_944_4e-4;
    let p = 1.987_569_2e-4;
    let p = p * r + 1.398_2e-3;
    let p = p * r + 8.333_452e-3;
    let p = p * r + 4.166_579_6e-2;
    let p = p * r + 1.666_666_5e-1;
    let p = p * r + 0.5;
    (p * (r * r) + r + 1.0) * power_of_two(shifted)
}

/// The same within 8e-5 relatively, by a polynomial of degree 3.
///
/// Source: coefficients least in relative error over |r| <= ln 2 / 2 (Lawson's iteration).
#[inline(always)]
pub(crate) fn coarse_exp(x: f32) -> f32 {
    let (r, shifted) = reduced(x);
    let p = 0.165_668_41;
    let p = p * r + 0.504_963_4;
    let p = p * r + 1.000_164_2;
    (p * r + 0.999_928_1) * power_of_two(shifted)
}

/// The same within 7e-6 relatively, by a polynomial of degree 4.
///
/// Source: as for [`coarse_exp`].
#[inline(always)]
pub(crate) fn fine_exp(x: f32) -> f32 {
    let (r, shifted) = reduced(x);
    let p = 0.041_458_614;
    let p = p * r + 0.167_909_09;
    let p = p * r + 0.500_043_6;
    let p = p * r + 0.999_963_4;
    (p * r + 0.999_999_3) * power_of_two(shifted)
}

/// x = r + n ln 2, and n + [`INTEGERS`].
#[inline(always)]
fn reduced(x: f32) -> (f32, f32) {
    let x = x.max(-87.0);
    let shifted = x * std::f32::consts::LOG2_E + INTEGERS;
    (x - (shifted - INTEGERS) * std::f32::consts::LN_2, shifted)
}

/// 2^n from n + [`INTEGERS`], for n from -126 to 127.
#[inline(always)]
fn power_of_two(shifted: f32) -> f32 {
    f32::from_bits((shifted.to_bits().wrapping_sub(INTEGERS.to_bits()).wrapping_add(127)) << 23)
}

/// The square of an angle whose half has these squared sine and cosine, within 3e-7 of pi^2.
///
/// Where it is small it is 4 times the sine's, without the cancellation of 1 - cosine.
/// Source: coefficients of asin(sqrt(z)) / sqrt(z) of least error over z <= 1/2, 1.6e-8 (Lawson's iteration).
#[inline(always)]
pub(crate) fn squared_angle(sine2: f32, cosine2: f32) -> f32 {
    let far = sine2 > cosine2;
    let z = if far { cosine2 } else { sine2 };
    let p = 0.112_059_72;
    let p = p * z - 0.093_916_625;
    let p = p * z + 0.077_858_42;
    let p = p * z + 0.016_091_293;
    let p = p * z + 0.046_552_967;
    let p = p * z + 0.074_880_87;
    let p = p * z + 0.166_669_16;
    // asin(sqrt(z)) / sqrt(z).
    let ratio = p * z + 1.0;
    let beyond = std::f32::consts::PI - 2.0 * (z.max(0.0).sqrt() * ratio);
    if far { beyond * beyond } else { 4.0 * (z * (ratio * ratio)) }
}

/// The widest Gaussian for which [`coarse_squared_angle`] and [`fine_squared_angle`] are made.
pub(crate) const NARROW: f64 = 0.6;

/// The squared angle by a polynomial in the squared sine of its half, of degree 4: a Gaussian of a spread
/// up to [`NARROW`] errs by 1.3e-4. The angle's slope opposite to the centre, where no polynomial follows it,
/// is where such a Gaussian is 0.
///
/// Source: coefficients least in the error of the Gaussians of all those spreads (Lawson's iteration).
#[inline(always)]
pub(crate) fn coarse_squared_angle(sine2: f32) -> f32 {
    let p = 1.544_153_9;
    let p = p * sine2 + 0.188_702_46;
    let p = p * sine2 + 1.402_231_6;
    (p * sine2 + 3.998_609_5) * sine2
}

/// The same, of degree 5, within 4.8e-5.
#[inline(always)]
pub(crate) fn fine_squared_angle(sine2: f32) -> f32 {
    let p = 2.166_816_2;
    let p = p * sine2 - 1.039_330_5;
    let p = p * sine2 + 1.118_530_5;
    let p = p * sine2 + 1.297_306_2;
    (p * sine2 + 4.000_515_5) * sine2
}

/// Linear light from an sRGB-encoded value, as [`relight_core::linear_from_srgb`] within 2e-6 relatively for
/// values to 1000.
///
/// Source: IEC 61966-2-1; x^2.4 = exp2(2.4 log2 x), the logarithm by the series of atanh on the mantissa.
#[inline(always)]
pub(crate) fn linear_from_srgb(encoded: f32) -> f32 {
    let x = ((encoded + 0.055) * (1.0 / 1.055)).max(1e-6);
    let curve = x * x * power_0_4(x);
    let straight = (encoded * (1.0 / 12.92)).max(0.0);
    if encoded <= 0.04045 { straight } else { curve }
}

/// x^0.4 for normal x above 0.
#[inline(always)]
fn power_0_4(x: f32) -> f32 {
    // x = m 2^e, m from sqrt(1/2) to sqrt(2).
    let bits = x.to_bits();
    let e = (bits.wrapping_sub(0x3f35_04f3) as i32) >> 23;
    let m = f32::from_bits(bits.wrapping_sub((e as u32) << 23));
    // log2 m = 2 / ln 2 atanh((m - 1) / (m + 1)).
    let t = (m - 1.0) / (m + 1.0);
    let t2 = t * t;
    let p = 0.320_598_9;
    let p = p * t2 + 0.412_198_58;
    let p = p * t2 + 0.577_078_04;
    let p = p * t2 + 0.961_796_7;
    let p = p * t2 + 2.885_39;
    // 0.4 e in its own parts, so that e large leaves the fraction's digits.
    let power = 0.4 * (e as f32) + 0.4 * (p * t);
    let shifted = power + INTEGERS;
    let r = (power - (shifted - INTEGERS)) * std::f32::consts::LN_2;
    let q = 1.398_2e-3;
    let q = q * r + 8.333_452e-3;
    let q = q * r + 4.166_579_6e-2;
    let q = q * r + 1.666_666_5e-1;
    let q = q * r + 0.5;
    (q * (r * r) + r + 1.0) * power_of_two(shifted)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn exponentials_are_within_their_errors() {
        let mut worst = [0.0f64; 3];
        for i in 0..=870_000 {
            let x = -1e-4 * i as f32;
            let exact = libm::exp(f64::from(x));
            for (worst, value) in worst.iter_mut().zip([exp(x), fine_exp(x), coarse_exp(x)]) {
                *worst = worst.max((f64::from(value) / exact - 1.0).abs());
            }
        }
        assert!(worst[0] < 2e-7 && worst[1] < 7e-6 && worst[2] < 8e-5, "{worst:?}");
        assert_eq!(exp(0.0), 1.0);
        assert_eq!(exp(-1e30), exp(-87.0));
        assert!(exp(-87.0) > 0.0 && exp(-87.0) < 2e-38);
    }

    #[test]
    fn squared_angles_hold_from_the_same_to_the_opposite_direction() {
        let mut worst = [0.0f64; 3];
        let gaussian = |squared: f64| libm::exp(-squared / (2.0 * NARROW * NARROW));
        for i in 1..=1_000_000 {
            let s = i as f32 / 1e6;
            let angle = 2.0 * libm::asin(f64::from(s).sqrt());
            let squares = [squared_angle(s, 1.0 - s), fine_squared_angle(s), coarse_squared_angle(s)];
            let [exact, fine, coarse] = squares.map(f64::from);
            let errors = [
                exact - angle * angle,
                gaussian(fine) - gaussian(angle * angle),
                gaussian(coarse) - gaussian(angle * angle),
            ];
            worst = [0, 1, 2].map(|i| worst[i].max(errors[i].abs()));
        }
        assert!(worst[0] < 3e-6 && worst[1] < 4.8e-5 && worst[2] < 1.3e-4, "{worst:?}");
        assert_eq!(squared_angle(0.0, 1.0), 0.0);
        // Denormal distances keep their digits.
        assert!((squared_angle(1e-30, 1.0) / 4e-30 - 1.0).abs() < 1e-6);
        assert!((squared_angle(1.0, 0.0) - std::f32::consts::PI.powi(2)).abs() < 2e-6);
    }

    #[test]
    fn the_transfer_is_the_standards() {
        for i in 0..2_000_000 {
            let encoded = -0.1 + 1e-6 * f64::from(i) as f32;
            let (found, exact) = (linear_from_srgb(encoded), relight_core::linear_from_srgb(encoded));
            assert!((found - exact).abs() <= 2e-6 * exact.max(1e-3), "{encoded}: {found} for {exact}");
        }
        for encoded in [2.5, 17.0, 999.0] {
            let (found, exact) = (linear_from_srgb(encoded), relight_core::linear_from_srgb(encoded));
            assert!((found / exact - 1.0).abs() < 2e-6, "{encoded}: {found} for {exact}");
        }
        assert_eq!(linear_from_srgb(f32::NAN.max(0.0)), 0.0);
    }
}
