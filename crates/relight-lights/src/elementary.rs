//! Elementary functions in f32 that are loops' bodies: no branch, no table, no library call, so that a loop
//! over them becomes vector instructions, with the same bits at every CPU level.

/// Values that go through a function together. One operation on all of them, then the next: so many
/// independent chains keep the vector units busy, where one after another each operation would wait for the one
/// before.
pub(crate) const LANES: usize = 64;

/// [`LANES`] values.
pub(crate) type Lanes = [f32; LANES];

/// `expression` for each lane `i`.
macro_rules! lanes {
    (|$i:ident| $expression:expr) => {{
        let mut out = [0.0f32; LANES];
        for $i in 0..LANES {
            out[$i] = $expression;
        }
        out
    }};
}
pub(crate) use lanes;

/// 1.5 x 2^23: adding it rounds to the nearest integer, which then stands in the low bits.
const INTEGERS: f32 = 12_582_912.0;

/// exp(x) for x from -87 to 0 (below, exp(-87) = 1.6e-38), within 2e-7 of it relatively.
///
/// Source: Cephes, `expf`: r = x - n ln 2 in two parts, a polynomial of degree 5 beyond 1 + r.
#[inline(always)]
pub(crate) fn exp(x: &Lanes) -> Lanes {
    let x = lanes!(|i| x[i].max(-87.0));
    let shifted = lanes!(|i| x[i] * std::f32::consts::LOG2_E + INTEGERS);
    let n = lanes!(|i| shifted[i] - INTEGERS);
    let r = lanes!(|i| x[i] - n[i] * 0.693_359_4);
    let r = lanes!(|i| r[i] - n[i] * -2.121_944_4e-4);
    let p = lanes!(|i| 1.987_569_2e-4 * r[i] + 1.398_2e-3);
    let p = lanes!(|i| p[i] * r[i] + 8.333_452e-3);
    let p = lanes!(|i| p[i] * r[i] + 4.166_579_6e-2);
    let p = lanes!(|i| p[i] * r[i] + 1.666_666_5e-1);
    let p = lanes!(|i| p[i] * r[i] + 0.5);
    let p = lanes!(|i| p[i] * (r[i] * r[i]) + r[i] + 1.0);
    lanes!(|i| p[i] * power_of_two(shifted[i]))
}

/// 2^x for x from -125 to 0 (below, 2^-125), within 4e-6 relatively, by a polynomial of degree 4.
///
/// Source: coefficients least in relative error over |r| <= 1/2 (Lawson's iteration).
#[inline(always)]
pub(crate) fn fine_exp2(x: &Lanes) -> Lanes {
    let (r, shifted) = fraction(x);
    let p = lanes!(|i| 0.009_570_103 * r[i] + 0.055_917_863);
    let p = lanes!(|i| p[i] * r[i] + 0.240_247_44);
    let p = lanes!(|i| p[i] * r[i] + 0.693_121_8);
    let p = lanes!(|i| p[i] * r[i] + 0.999_999_3);
    lanes!(|i| p[i] * power_of_two(shifted[i]))
}

/// x = r + n, and n + [`INTEGERS`].
#[inline(always)]
fn fraction(x: &Lanes) -> (Lanes, Lanes) {
    let x = lanes!(|i| x[i].max(-125.0));
    let shifted = lanes!(|i| x[i] + INTEGERS);
    (lanes!(|i| x[i] - (shifted[i] - INTEGERS)), shifted)
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
pub(crate) fn squared_angle(sine2: &Lanes, cosine2: &Lanes) -> Lanes {
    let z = lanes!(|i| if sine2[i] > cosine2[i] { cosine2[i] } else { sine2[i] });
    let p = lanes!(|i| 0.112_059_72 * z[i] - 0.093_916_625);
    let p = lanes!(|i| p[i] * z[i] + 0.077_858_42);
    let p = lanes!(|i| p[i] * z[i] + 0.016_091_293);
    let p = lanes!(|i| p[i] * z[i] + 0.046_552_967);
    let p = lanes!(|i| p[i] * z[i] + 0.074_880_87);
    let p = lanes!(|i| p[i] * z[i] + 0.166_669_16);
    // asin(sqrt(z)) / sqrt(z).
    let ratio = lanes!(|i| p[i] * z[i] + 1.0);
    lanes!(|i| {
        let beyond = std::f32::consts::PI - 2.0 * (z[i].max(0.0).sqrt() * ratio[i]);
        let near = 4.0 * (z[i] * (ratio[i] * ratio[i]));
        if sine2[i] > cosine2[i] { beyond * beyond } else { near }
    })
}

/// The widest Gaussian that short polynomials follow.
pub(crate) const NARROW: f64 = 0.6;

/// The squared angle as a polynomial in the squared sine of its half, from the first power on: a Gaussian of a
/// spread up to [`NARROW`] errs by 4.8e-5. The angle's slope opposite to the centre, where no polynomial follows
/// it, is where such a Gaussian is 0.
///
/// Source: coefficients least in the error of the Gaussians of all those spreads (Lawson's iteration).
pub(crate) const FINE_SQUARED_ANGLE: [f64; 5] =
    [4.000_515_461, 1.297_306_180_0, 1.118_530_511_9, -1.039_330_482_5, 2.166_816_234_6];

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
        let mut worst = [0.0f64; 2];
        for i in 0..=86_990 {
            let x = -1e-3 * i as f32;
            let [e, two] = [libm::exp(f64::from(x)), libm::exp2(f64::from(x))];
            let values = [(exp(&[x; LANES])[3], e), (fine_exp2(&[x; LANES])[3], two)];
            for (worst, (value, exact)) in worst.iter_mut().zip(values) {
                *worst = worst.max((f64::from(value) / exact - 1.0).abs());
            }
        }
        assert!(worst[0] < 2e-7 && worst[1] < 4e-6, "{worst:?}");
        let [zero, far, farther] = [0.0, -87.0, -1e30].map(|x| exp(&[x; LANES])[0]);
        assert!(zero == 1.0 && far == farther && far > 0.0 && far < 2e-38);
        assert!(fine_exp2(&[-1e30; LANES])[0] < 1e-37 && fine_exp2(&[-1e30; LANES])[0] > 0.0);
    }

    #[test]
    fn squared_angles_hold_from_the_same_to_the_opposite_direction() {
        let of = |s: f32, c: f32| squared_angle(&[s; LANES], &[c; LANES])[7];
        let gaussian = |squared: f64| libm::exp(-squared / (2.0 * NARROW * NARROW));
        let polynomial = |c: &[f64], s: f64| c.iter().rev().fold(0.0, |sum, c| (sum + c) * s);
        let mut worst = [0.0f64; 2];
        for i in 1..=100_000 {
            let s = i as f32 / 1e5;
            let angle = 2.0 * libm::asin(f64::from(s).sqrt());
            let fine = polynomial(&FINE_SQUARED_ANGLE, f64::from(s));
            let errors =
                [f64::from(of(s, 1.0 - s)) - angle * angle, gaussian(fine) - gaussian(angle * angle)];
            worst = [0, 1].map(|i| worst[i].max(errors[i].abs()));
        }
        assert!(worst[0] < 3e-6 && worst[1] < 4.8e-5, "{worst:?}");
        assert_eq!(of(0.0, 1.0), 0.0);
        // Denormal distances keep their digits.
        assert!((of(1e-30, 1.0) / 4e-30 - 1.0).abs() < 1e-6);
        assert!((of(1.0, 0.0) - std::f32::consts::PI.powi(2)).abs() < 2e-6);
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
