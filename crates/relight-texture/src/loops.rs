//! Loops over the coefficients of a run, compiled for each level of vector instructions; their bits are the same at all levels.

use crate::texels::Row;
use crate::{Quantizer, TexelDomain};
use relight_core::{CpuLevel, Vectorized};

/// Sums of their own for the lanes of the widest vector, whatever the machine's.
const LANES: usize = 16;

/// Writes the coefficients of `row` one after another.
pub(crate) fn gather(level: CpuLevel, row: Row<'_>, out: &mut [f32]) {
    level.run(Gather { row, out });
}

struct Gather<'a> {
    row: Row<'a>,
    out: &'a mut [f32],
}

impl Vectorized for Gather<'_> {
    type Output = ();

    #[inline(always)]
    fn run(self) {
        let Self { row: Row { samples, stride, channel }, out } = self;
        match (stride, channel) {
            (1, _) => out.copy_from_slice(samples),
            (3, 0) => pick::<3, 0>(samples, out),
            (3, 1) => pick::<3, 1>(samples, out),
            (3, 2) => pick::<3, 2>(samples, out),
            _ => {
                for (out, pixel) in out.iter_mut().zip(samples.chunks_exact(stride)) {
                    *out = pixel[channel];
                }
            }
        }
    }
}

/// Every `STRIDE`th value from `CHANNEL` on: known numbers become shuffles.
#[inline(always)]
fn pick<const STRIDE: usize, const CHANNEL: usize>(samples: &[f32], out: &mut [f32]) {
    for (out, pixel) in out.iter_mut().zip(samples.as_chunks::<STRIDE>().0) {
        *out = pixel[CHANNEL];
    }
}

/// Takes `factor` times `errors` from `coefficients`.
pub(crate) fn subtract(level: CpuLevel, factor: f32, errors: &[f32], coefficients: &mut [f32]) {
    level.run(Subtract { factor, errors, coefficients });
}

struct Subtract<'a> {
    factor: f32,
    errors: &'a [f32],
    coefficients: &'a mut [f32],
}

impl Vectorized for Subtract<'_> {
    type Output = ();

    #[inline(always)]
    fn run(self) {
        for (c, error) in self.coefficients.iter_mut().zip(self.errors) {
            *c -= self.factor * error;
        }
    }
}

/// Makes errors against what was given those against the coefficients `row`.
pub(crate) fn add_purpose(level: CpuLevel, given: &[f32], row: Row<'_>, errors: &mut [f32]) {
    level.run(AddPurpose { given, row, errors });
}

struct AddPurpose<'a> {
    given: &'a [f32],
    row: Row<'a>,
    errors: &'a mut [f32],
}

impl Vectorized for AddPurpose<'_> {
    type Output = ();

    #[inline(always)]
    fn run(self) {
        let Self { given, row: Row { samples, stride, channel }, errors } = self;
        match (stride, channel) {
            (3, 0) => add_difference::<3, 0>(given, samples, errors),
            (3, 1) => add_difference::<3, 1>(given, samples, errors),
            (3, 2) => add_difference::<3, 2>(given, samples, errors),
            (1, _) => add_difference::<1, 0>(given, samples, errors),
            _ => {
                for ((e, given), pixel) in errors.iter_mut().zip(given).zip(samples.chunks_exact(stride)) {
                    *e += given - pixel[channel];
                }
            }
        }
    }
}

#[inline(always)]
fn add_difference<const STRIDE: usize, const CHANNEL: usize>(
    given: &[f32],
    samples: &[f32],
    errors: &mut [f32],
) {
    for ((e, given), pixel) in errors.iter_mut().zip(given).zip(samples.as_chunks::<STRIDE>().0) {
        *e += given - pixel[CHANNEL];
    }
}

/// The sum of the squares of `errors`.
pub(crate) fn sum_of_squares(level: CpuLevel, errors: &[f32]) -> f64 {
    level.run(Squares(errors)).iter().sum()
}

struct Squares<'a>(&'a [f32]);

impl Vectorized for Squares<'_> {
    type Output = [f64; LANES];

    #[inline(always)]
    fn run(self) -> [f64; LANES] {
        let mut squares = [0.0; LANES];
        let (whole, rest) = self.0.as_chunks::<LANES>();
        for errors in whole {
            for i in 0..LANES {
                squares[i] += f64::from(errors[i]) * f64::from(errors[i]);
            }
        }
        for (square, error) in squares.iter_mut().zip(rest) {
            *square += f64::from(*error) * f64::from(*error);
        }
        squares
    }
}

/// Writes coefficients as texels of `domain` before they are coded, channel `channel` of `channels`.
pub(crate) fn texels(
    level: CpuLevel,
    (quantizer, domain): (Quantizer, TexelDomain),
    coefficients: &[f32],
    (channel, channels): (usize, usize),
    out: &mut [f32],
) {
    let place = Place { channel, channels };
    level.run(TexelsOf { quantizer, domain, coefficients, place, out });
}

/// A channel among others.
#[derive(Clone, Copy)]
struct Place {
    channel: usize,
    channels: usize,
}

/// `write` of the loop for each place that a channel may have, as numbers that the compiler knows.
macro_rules! of_place {
    ($loop:expr, $place:expr) => {
        match ($place.channels, $place.channel) {
            (1, _) => $loop.write::<1, 0>(),
            (2, 0) => $loop.write::<2, 0>(),
            (2, _) => $loop.write::<2, 1>(),
            (3, 0) => $loop.write::<3, 0>(),
            (3, 1) => $loop.write::<3, 1>(),
            (3, _) => $loop.write::<3, 2>(),
            (_, 0) => $loop.write::<4, 0>(),
            (_, 1) => $loop.write::<4, 1>(),
            (_, 2) => $loop.write::<4, 2>(),
            _ => $loop.write::<4, 3>(),
        }
    };
}

struct TexelsOf<'a> {
    quantizer: Quantizer,
    domain: TexelDomain,
    coefficients: &'a [f32],
    place: Place,
    out: &'a mut [f32],
}

impl Vectorized for TexelsOf<'_> {
    type Output = ();

    #[inline(always)]
    fn run(self) {
        of_place!(self, self.place)
    }
}

impl TexelsOf<'_> {
    #[inline(always)]
    fn write<const CHANNELS: usize, const CHANNEL: usize>(self) {
        let Self { quantizer, domain, coefficients, out, .. } = self;
        for (texel, c) in out.as_chunks_mut::<CHANNELS>().0.iter_mut().zip(coefficients) {
            texel[CHANNEL] = quantizer.texel(domain, *c);
        }
    }
}

/// Writes what texels give back less the coefficients that they were made of; of texels channel `channel` of `channels`.
pub(crate) fn texel_errors(
    level: CpuLevel,
    quantizer: Quantizer,
    texels: &[f32],
    (channel, channels): (usize, usize),
    coefficients: &[f32],
    out: &mut [f32],
) {
    let place = Place { channel, channels };
    level.run(TexelErrors { quantizer, texels, place, coefficients, out });
}

struct TexelErrors<'a> {
    quantizer: Quantizer,
    texels: &'a [f32],
    place: Place,
    coefficients: &'a [f32],
    out: &'a mut [f32],
}

impl Vectorized for TexelErrors<'_> {
    type Output = ();

    #[inline(always)]
    fn run(self) {
        of_place!(self, self.place)
    }
}

impl TexelErrors<'_> {
    #[inline(always)]
    fn write<const CHANNELS: usize, const CHANNEL: usize>(self) {
        let Self { quantizer: Quantizer { scale, bias }, texels, coefficients, out, .. } = self;
        let texels = texels.as_chunks::<CHANNELS>().0;
        for ((out, texel), c) in out.iter_mut().zip(texels).zip(coefficients) {
            *out = scale * texel[CHANNEL] + bias - c;
        }
    }
}

/// Writes codes 0..255 of RGBA as q of the first `channels` of them, 3 or 4.
pub(crate) fn q_of_codes(level: CpuLevel, codes: &[u8], channels: usize, out: &mut [f32]) {
    level.run(QOfCodes { codes, channels, out });
}

struct QOfCodes<'a> {
    codes: &'a [u8],
    channels: usize,
    out: &'a mut [f32],
}

impl Vectorized for QOfCodes<'_> {
    type Output = ();

    #[inline(always)]
    fn run(self) {
        match self.channels {
            3 => q_of_rgba::<3>(self.codes, self.out),
            _ => q_of_rgba::<4>(self.codes, self.out),
        }
    }
}

#[inline(always)]
fn q_of_rgba<const CHANNELS: usize>(codes: &[u8], out: &mut [f32]) {
    for (q, codes) in out.as_chunks_mut::<CHANNELS>().0.iter_mut().zip(codes.as_chunks::<4>().0) {
        for c in 0..CHANNELS {
            q[c] = f32::from(codes[c]) / 255.0;
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Numbers of all sizes and signs, not a number and infinities among them.
    fn values(count: usize, seed: u32) -> Vec<f32> {
        let hashed = |i: usize| (i as u32 + 1).wrapping_mul(0x9e37_79b9).wrapping_add(seed.wrapping_mul(977));
        let value = |i: usize| match i % 23 {
            5 => f32::NAN,
            11 => f32::INFINITY,
            17 => f32::NEG_INFINITY,
            _ => (hashed(i) >> 8) as f32 / (1 << 23) as f32 - 1.0,
        };
        (0..count).map(value).collect()
    }

    fn bits(values: &[f32]) -> Vec<u32> {
        // What not a number looks like inside is nobody's business.
        values.iter().map(|value| if value.is_nan() { u32::MAX } else { value.to_bits() }).collect()
    }

    #[test]
    fn rows_of_any_stride_at_every_level_are_those_of_their_iterator() {
        for level in CpuLevel::available() {
            for (stride, pixels) in [(1, 100), (2, 33), (3, 101), (4, 7), (5, 40)] {
                let samples = values(stride * pixels, 1);
                for channel in 0..stride {
                    let row = Row { samples: &samples, stride, channel };
                    let mut out = vec![9.0; pixels];
                    gather(level, row, &mut out);
                    let expected: Vec<f32> = row.iter().collect();
                    assert_eq!(bits(&out), bits(&expected), "{stride} {channel}");

                    let (given, before) = (values(pixels, 2), values(pixels, 3));
                    let mut errors = before.clone();
                    add_purpose(level, &given, row, &mut errors);
                    let expected: Vec<f32> =
                        (0..pixels).map(|i| before[i] + (given[i] - expected[i])).collect();
                    assert_eq!(bits(&errors), bits(&expected), "{stride} {channel}");
                }
            }
        }
    }

    #[test]
    fn texels_are_the_quantizers_and_their_errors_what_they_give_back() {
        let coefficients = values(103, 4);
        let quantizers = [
            Quantizer { scale: 0.7, bias: -0.2 },
            Quantizer { scale: 0.0, bias: 0.4 },
            Quantizer { scale: 1e-40, bias: 0.0 },
        ];
        let domains = [TexelDomain::Unit, TexelDomain::Signed, TexelDomain::Half, TexelDomain::Float];
        for level in CpuLevel::available() {
            for (quantizer, domain) in quantizers.iter().flat_map(|q| domains.map(|domain| (*q, domain))) {
                for (channel, channels) in
                    (1..=4).flat_map(|channels| (0..channels).map(move |c| (c, channels)))
                {
                    let mut out = vec![7.0; 103 * channels];
                    texels(level, (quantizer, domain), &coefficients, (channel, channels), &mut out);
                    let mut errors = vec![0.0; 103];
                    texel_errors(level, quantizer, &out, (channel, channels), &coefficients, &mut errors);
                    for (i, c) in coefficients.iter().enumerate() {
                        let q = quantizer.texel(domain, *c);
                        let texel = &out[i * channels..][..channels];
                        let error = quantizer.scale * q + quantizer.bias - c;
                        assert_eq!(
                            bits(&[texel[channel], errors[i]]),
                            bits(&[q, error]),
                            "{c} {quantizer:?}"
                        );
                        assert!(
                            texel.iter().enumerate().all(|(other, value)| other == channel || *value == 7.0)
                        );
                    }
                }
            }
        }
    }

    #[test]
    fn sums_have_the_same_bits_at_every_level() {
        let errors: Vec<f32> = (0..1003).map(|i| libm::sinf(i as f32 * 0.37)).collect();
        let sums: Vec<u64> =
            CpuLevel::available().map(|level| sum_of_squares(level, &errors).to_bits()).collect();
        let plain: f64 = errors.iter().map(|error| f64::from(*error) * f64::from(*error)).sum();
        assert!(sums.iter().all(|sum| *sum == sums[0]));
        assert!((f64::from_bits(sums[0]) / plain - 1.0).abs() < 1e-14);
        let mut changed = errors.clone();
        subtract(CpuLevel::detect(), 0.5, &errors, &mut changed);
        assert!(changed.iter().zip(&errors).all(|(changed, error)| *changed == error - 0.5 * error));
    }

    #[test]
    fn codes_are_parts_of_255() {
        let codes: Vec<u8> = (0..=255).collect();
        for (level, channels) in CpuLevel::available().flat_map(|level| [(level, 3), (level, 4)]) {
            let mut out = vec![0.0; 64 * channels];
            q_of_codes(level, &codes, channels, &mut out);
            for (i, q) in out.iter().enumerate() {
                assert_eq!(*q, f32::from(codes[i / channels * 4 + i % channels]) / 255.0);
            }
        }
    }
}
