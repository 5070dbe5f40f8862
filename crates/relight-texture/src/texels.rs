//! Coefficients to plain texels, interleaved and little-endian: the loops that writing spends its time in.

use crate::dither::ordered;
use crate::{Precision, Quantizer};
use half::f16;
use half::slice::HalfFloatSliceExt;

/// Coefficients of a plane among those of its neighbours: number i is `samples[i * stride + channel]`.
#[derive(Clone, Copy)]
pub(crate) struct Row<'a> {
    pub(crate) samples: &'a [f32],
    pub(crate) stride: usize,
    pub(crate) channel: usize,
}

impl<'a> Row<'a> {
    /// Coefficients `first` to `end`.
    pub(crate) fn slice(self, first: usize, end: usize) -> Self {
        Self { samples: &self.samples[first * self.stride..end * self.stride], ..self }
    }

    pub(crate) fn iter(self) -> impl Iterator<Item = f32> + 'a {
        self.samples[self.channel..].iter().step_by(self.stride).copied()
    }

    pub(crate) fn len(self) -> usize {
        self.samples.len() / self.stride
    }

    /// Writes what the 8-bit codes of the coefficients give back, less the coefficients.
    pub(crate) fn code_errors(self, quantizer: Quantizer, errors: &mut [f32]) {
        let Quantizer { scale, bias } = quantizer;
        let codes_per_unit = quantizer.codes_per_unit();
        let error = |c: f32| {
            let code = wide_code(c, bias, codes_per_unit, 0.0);
            scale * (code as f32 / 255.0) + bias - c
        };
        // Strides that are known become vector instructions.
        match self.stride {
            1 => errors.iter_mut().zip(self.samples).for_each(|(e, c)| *e = error(*c)),
            3 => {
                let samples = self.samples[self.channel..].iter().step_by(3);
                errors.iter_mut().zip(samples).for_each(|(e, c)| *e = error(*c));
            }
            _ => errors.iter_mut().zip(self.iter()).for_each(|(e, c)| *e = error(c)),
        }
    }
}

/// Where a piece lies in the picture, for a pattern that depends on it.
#[derive(Clone, Copy)]
pub(crate) struct Place<'a> {
    /// Index of its first pixel.
    pub(crate) first: usize,
    /// Pixels in a row of the picture.
    pub(crate) width: usize,
    /// The planes' indices, one a channel.
    pub(crate) planes: &'a [usize],
}

/// Texels of one piece on their way to a file, with working space that is used again.
#[derive(Default)]
pub(crate) struct TexelBuffer {
    bytes: Vec<u8>,
    floats: Vec<f32>,
    halves: Vec<f16>,
}

impl TexelBuffer {
    /// Texels of `channels` channels, channel c from `rows[c]`; where there are no more rows the
    /// channel is 0, the fourth 1. With `dither`, 8-bit codes are dithered by their place.
    pub(crate) fn texels(
        &mut self,
        (precision, channels): (Precision, usize),
        rows: &[Row<'_>],
        quantizers: &[Quantizer],
        dither: Option<Place<'_>>,
    ) -> &[u8] {
        let texels = rows[0].len();
        if precision == Precision::U8 {
            if let (&[r, g, b], 4, None) = (rows, channels, dither) {
                self.bytes.resize(texels * 4, 0);
                let bias = [0, 1, 2].map(|c| quantizers[c].bias);
                let codes_per_unit = [0, 1, 2].map(|c| quantizers[c].codes_per_unit());
                let codes = Rgba { bias, codes_per_unit };
                if let Some(rgb) = interleaved(rows) {
                    codes.write(rgb.chunks_exact(3).map(|c| [c[0], c[1], c[2]]), &mut self.bytes);
                    return &self.bytes;
                }
                if let (1, 1, 1) = (r.stride, g.stride, b.stride) {
                    let rgb = r.samples.iter().zip(g.samples).zip(b.samples).map(|((r, g), b)| [*r, *g, *b]);
                    codes.write(rgb, &mut self.bytes);
                    return &self.bytes;
                }
            }
            self.bytes.clear();
            self.bytes.resize(texels * channels, 0);
            if channels == 4 {
                self.bytes.chunks_exact_mut(4).for_each(|texel| texel[3] = u8::MAX);
            }
            for (channel, (row, quantizer)) in rows.iter().zip(quantizers).enumerate() {
                let (bias, codes_per_unit) = (quantizer.bias, quantizer.codes_per_unit());
                let texels = self.bytes.chunks_exact_mut(channels).zip(row.iter());
                match dither {
                    None => {
                        for (texel, c) in texels {
                            texel[channel] = code(c, bias, codes_per_unit, 0.0);
                        }
                    }
                    Some(Place { first, width, planes }) => {
                        for (i, (texel, c)) in texels.enumerate() {
                            let (x, y) = ((first + i) % width, (first + i) / width);
                            texel[channel] = code(c, bias, codes_per_unit, ordered(x, y, planes[channel]));
                        }
                    }
                }
            }
            return &self.bytes;
        }
        self.floats.clear();
        self.floats.resize(texels * channels, 0.0);
        if channels == 4 {
            self.floats.chunks_exact_mut(4).for_each(|texel| texel[3] = 1.0);
        }
        for (channel, (row, quantizer)) in rows.iter().zip(quantizers).enumerate() {
            for (texel, c) in self.floats.chunks_exact_mut(channels).zip(row.iter()) {
                texel[channel] = (c - quantizer.bias) / quantizer.scale;
            }
        }
        self.encode_floats(precision)
    }

    /// The bytes of `floats` in `precision`, which is one of the floats.
    fn encode_floats(&mut self, precision: Precision) -> &[u8] {
        self.bytes.resize(self.floats.len() * precision.bytes(), 0);
        if precision == Precision::F16 {
            self.halves.resize(self.floats.len(), f16::ZERO);
            self.halves.convert_from_f32_slice(&self.floats);
            for (bytes, half) in self.bytes.chunks_exact_mut(2).zip(&self.halves) {
                bytes.copy_from_slice(&half.to_le_bytes());
            }
        } else {
            for (bytes, float) in self.bytes.chunks_exact_mut(4).zip(&self.floats) {
                bytes.copy_from_slice(&float.to_le_bytes());
            }
        }
        &self.bytes
    }
}

/// [`Quantizer::code`] to the bit, shifted by `offset` steps, in additions and comparisons that
/// compile to vector instructions of every machine, which the conversion from float to integer
/// does not.
#[inline(always)]
fn code(coefficient: f32, bias: f32, codes_per_unit: f32, offset: f32) -> u8 {
    wide_code(coefficient, bias, codes_per_unit, offset) as u8
}

/// The code in as many bits as the coefficient has: lanes keep their width.
#[inline(always)]
fn wide_code(coefficient: f32, bias: f32, codes_per_unit: f32, offset: f32) -> u32 {
    /// Floats from here to twice as much are the integers: adding it rounds to the nearest.
    const INTEGERS: f32 = 8_388_608.0;
    // `max` before `min`: NaN becomes 0, as in a conversion.
    #[expect(clippy::manual_clamp, reason = "clamp would keep NaN")]
    let exact = ((coefficient - bias) * codes_per_unit + (0.5 + offset)).max(0.0).min(255.0);
    let nearest = exact + INTEGERS;
    let above = nearest - INTEGERS > exact;
    (nearest.to_bits() & 0xff) - u32::from(above)
}

/// The samples of three rows that are R, G and B of the same samples.
fn interleaved<'a>(rows: &[Row<'a>]) -> Option<&'a [f32]> {
    let samples = rows[0].samples;
    let one = |(channel, row): (usize, &Row<'a>)| {
        row.stride == 3 && row.channel == channel && std::ptr::eq(row.samples, samples)
    };
    (rows.len() == 3 && rows.iter().enumerate().all(one)).then_some(samples)
}

/// Texels of R, G, B codes and 255.
struct Rgba {
    bias: [f32; 3],
    codes_per_unit: [f32; 3],
}

impl Rgba {
    #[inline(always)]
    fn write(&self, rgb: impl Iterator<Item = [f32; 3]>, texels: &mut [u8]) {
        for (texel, c) in texels.chunks_exact_mut(4).zip(rgb) {
            let code = |i: usize| wide_code(c[i], self.bias[i], self.codes_per_unit[i], 0.0);
            let word = code(0) | code(1) << 8 | code(2) << 16 | 0xff << 24;
            texel.copy_from_slice(&word.to_le_bytes());
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use relight_core::CoefficientRange;

    #[test]
    fn codes_are_the_quantizers_for_every_kind_of_float() {
        let ranges = [(-3.0, 5.0), (0.3, 0.3), (-1e30, 2e30), (1e-30, 3e-30)];
        for (min, max) in ranges {
            let quantizer = Quantizer::over(CoefficientRange { min, max });
            let steps = (0..=4096u32).map(|i| min - (max - min) + 3.0 * (max - min) * (i as f32 / 4096.0));
            // Every exponent and sign, NaN and infinities among them.
            let patterns = (0..=0xffffu32).map(|high| f32::from_bits(high << 16 | 0x1234));
            for c in steps.chain(patterns) {
                let fast = code(c, quantizer.bias, quantizer.codes_per_unit(), 0.0);
                assert_eq!(fast, quantizer.code(c), "{c} in {min}..{max}");
                let shifted = code(c, quantizer.bias, quantizer.codes_per_unit(), -0.3);
                assert_eq!(shifted, quantizer.dithered_code(c, -0.3), "{c} in {min}..{max}, dithered");
            }
        }
    }
}
