//! Scale, bias and codes: coefficient = scale * q + bias.

use crate::TexelDomain;
use half::f16;
use relight_core::CoefficientRange;

/// How a coefficient is stored.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub enum Precision {
    /// 8 bits, q = code / 255, with scale and bias over the plane's range.
    U8,
    /// IEEE half.
    F16,
    /// IEEE single.
    F32,
}

/// What turns coefficients of one plane into codes.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Quantizer {
    /// Coefficient per unit of q.
    pub scale: f32,
    /// Coefficient at q = 0.
    pub bias: f32,
}

impl Precision {
    /// Bytes of a texel.
    pub fn bytes(self) -> usize {
        match self {
            Self::U8 => 1,
            Self::F16 => 2,
            Self::F32 => 4,
        }
    }

    /// `u8`, `f16` or `f32`.
    pub fn name(self) -> &'static str {
        match self {
            Self::U8 => "u8",
            Self::F16 => "f16",
            Self::F32 => "f32",
        }
    }

    /// The quantizer for a plane of `range`.
    ///
    /// Floats are stored as they are; halves too unless the range leaves theirs (65504) or lies
    /// among their denormals throughout, in which case the scale brings the largest magnitude to 1.
    pub fn quantizer(self, range: CoefficientRange) -> Quantizer {
        match self {
            Self::U8 => Quantizer::over(range),
            Self::F32 => Quantizer::PLAIN,
            Self::F16 => {
                let largest = range.min.abs().max(range.max.abs());
                if largest.is_finite() && largest > 0.0 && !(1e-3..=65504.0).contains(&largest) {
                    Quantizer { scale: largest, bias: 0.0 }
                } else {
                    Quantizer::PLAIN
                }
            }
        }
    }
}

impl Quantizer {
    /// Texels are the coefficients.
    pub const PLAIN: Self = Self { scale: 1.0, bias: 0.0 };

    /// What spreads the texels of `domain` over `range`: 0..1 by scale and bias as [`Self::over`],
    /// -1..1 by a scale around 0; halves and floats are plain.
    pub fn of_domain(domain: TexelDomain, range: CoefficientRange) -> Self {
        match domain {
            TexelDomain::Unit => Self::over(range),
            TexelDomain::Signed if range.min > range.max => Self { scale: 0.0, bias: 0.0 },
            TexelDomain::Signed => Self { scale: range.min.abs().max(range.max.abs()), bias: 0.0 },
            TexelDomain::Half | TexelDomain::Float => Self::PLAIN,
        }
    }

    /// 8-bit codes 0..255 over `range`: the least coefficient is code 0, the largest 255. A range
    /// without width stores its value exactly as the bias.
    pub fn over(range: CoefficientRange) -> Self {
        if range.min > range.max {
            return Self { scale: 0.0, bias: 0.0 };
        }
        // Halved before the difference: a range of the whole of f32 must not overflow.
        let scale = ((range.max * 0.5 - range.min * 0.5) * 2.0).min(f32::MAX);
        Self { scale, bias: range.min }
    }

    /// Factor from (coefficient - bias) to codes; 0 for a range without width.
    pub fn codes_per_unit(self) -> f32 {
        let factor = 255.0 / self.scale;
        if factor.is_finite() { factor } else { 0.0 }
    }

    /// The nearest 8-bit code; 0 for NaN.
    pub fn code(self, coefficient: f32) -> u8 {
        self.dithered_code(coefficient, 0.0)
    }

    /// The 8-bit code nearest to what lies `dither` codes above `coefficient`, by
    /// the packer's ordered pattern.
    pub fn dithered_code(self, coefficient: f32, dither: f32) -> u8 {
        // The conversion clamps to 0..255, takes NaN to 0 and truncates what is now half above the code.
        ((coefficient - self.bias) * self.codes_per_unit() + (0.5 + dither)) as u8
    }

    /// The texel q of `coefficient`, which block encoders take, clamped to 0..1 or -1..1 where that is
    /// all that `domain` holds; 0 where there is no width and for NaN.
    #[inline(always)]
    pub fn texel(self, domain: TexelDomain, coefficient: f32) -> f32 {
        let q = (coefficient - self.bias) / self.scale;
        // 0 / 0, and x / 0 where the range is so narrow that scale is a denormal.
        let q = if q.is_nan() || self.scale == 0.0 { 0.0 } else { q };
        match domain {
            TexelDomain::Unit => q.clamp(0.0, 1.0),
            TexelDomain::Signed => q.clamp(-1.0, 1.0),
            TexelDomain::Half | TexelDomain::Float => q,
        }
    }

    /// The half.
    pub fn half(self, coefficient: f32) -> f16 {
        f16::from_f32((coefficient - self.bias) / self.scale)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn codes_are_the_nearest_and_the_ends_are_exact() {
        for (min, max) in [(-3.0f32, 5.0f32), (-9.0, -2.0), (1e-30, 3e-30), (-1e30, 2e30)] {
            let q = Quantizer::over(CoefficientRange { min, max });
            assert_eq!((q.code(min), q.code(max)), (0, 255));
            for i in 0..=1000 {
                let c = min + (max - min) * (i as f32 / 1000.0);
                let back = q.scale * (f32::from(q.code(c)) / 255.0) + q.bias;
                assert!((back - c).abs() <= q.scale / 255.0 * 0.5001, "{c} came back as {back}");
            }
        }
    }

    #[test]
    fn a_constant_plane_is_exact_and_an_empty_one_is_zero() {
        let q = Quantizer::over(CoefficientRange { min: 0.3, max: 0.3 });
        assert_eq!(q.scale * (f32::from(q.code(0.3)) / 255.0) + q.bias, 0.3);
        assert_eq!(Quantizer::over(CoefficientRange::EMPTY), Quantizer { scale: 0.0, bias: 0.0 });
        let denormal = Quantizer::over(CoefficientRange { min: 0.0, max: 1e-42 });
        assert_eq!(denormal.code(1e-42), 0, "a width below 1e-36 is no width");
    }

    #[test]
    fn halves_keep_their_value_unless_they_would_overflow() {
        let plain = Precision::F16.quantizer(CoefficientRange { min: -2.0, max: 7.0 });
        assert_eq!(plain.half(0.333).to_f32(), f16::from_f32(0.333).to_f32());
        let huge = Precision::F16.quantizer(CoefficientRange { min: -1e6, max: 3e5 });
        assert_eq!(huge.half(-1e6).to_f32() * huge.scale, -1e6);
    }
}
