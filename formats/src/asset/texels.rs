//! Coefficients to texels, interleaved and little-endian: the loops that writing spends its time in.

use half::f16;
use half::slice::HalfFloatSliceExt;
use relight_texture::{Precision, Quantizer};

/// Texels of one piece on their way to a file, with working space that is used again.
#[derive(Default)]
pub(super) struct TexelBuffer {
    bytes: Vec<u8>,
    floats: Vec<f32>,
    halves: Vec<f16>,
}

impl TexelBuffer {
    /// R, G, B, 1 texels of `rgb`, interleaved R, G, B.
    pub(super) fn rgba_from_rgb(
        &mut self,
        precision: Precision,
        rgb: &[f32],
        quantizers: &[Quantizer],
    ) -> &[u8] {
        let bias = [0, 1, 2].map(|c| quantizers[c].bias);
        if precision == Precision::U8 {
            self.bytes.resize(rgb.len() / 3 * 4, 0);
            rgba_codes(rgb, bias, [0, 1, 2].map(|c| quantizers[c].codes_per_unit()), &mut self.bytes);
            return &self.bytes;
        }
        let scale = [0, 1, 2].map(|c| quantizers[c].scale);
        self.floats.resize(rgb.len() / 3 * 4, 0.0);
        for (texel, c) in self.floats.chunks_exact_mut(4).zip(rgb.chunks_exact(3)) {
            let value = |i: usize| (c[i] - bias[i]) / scale[i];
            texel.copy_from_slice(&[value(0), value(1), value(2), 1.0]);
        }
        self.encode_floats(precision)
    }

    /// Texels of `channels` channels, channel c from `rows[c]`; where there are no more rows the
    /// channel is 0, the fourth 1.
    pub(super) fn texels_from_rows(
        &mut self,
        precision: Precision,
        rows: &[&[f32]],
        quantizers: &[Quantizer],
        channels: usize,
    ) -> &[u8] {
        let texels = rows[0].len();
        if precision == Precision::U8 {
            self.bytes.clear();
            self.bytes.resize(texels * channels, 0);
            if channels == 4 {
                self.bytes.chunks_exact_mut(4).for_each(|texel| texel[3] = u8::MAX);
            }
            for (channel, (row, quantizer)) in rows.iter().zip(quantizers).enumerate() {
                let (bias, codes_per_unit) = (quantizer.bias, quantizer.codes_per_unit());
                for (texel, c) in self.bytes.chunks_exact_mut(channels).zip(*row) {
                    texel[channel] = code(*c, bias, codes_per_unit);
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
            for (texel, c) in self.floats.chunks_exact_mut(channels).zip(*row) {
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

/// [`Quantizer::code`] to the bit, in additions and comparisons that compile to vector instructions
/// of every machine, which the conversion from float to integer does not.
#[inline(always)]
pub(super) fn code(coefficient: f32, bias: f32, codes_per_unit: f32) -> u8 {
    wide_code(coefficient, bias, codes_per_unit) as u8
}

/// The code in as many bits as the coefficient has: lanes keep their width.
#[inline(always)]
fn wide_code(coefficient: f32, bias: f32, codes_per_unit: f32) -> u32 {
    /// Floats from here to twice as much are the integers: adding it rounds to the nearest.
    const INTEGERS: f32 = 8_388_608.0;
    // `max` before `min`: NaN becomes 0, as in a conversion.
    #[expect(clippy::manual_clamp, reason = "clamp would keep NaN")]
    let exact = ((coefficient - bias) * codes_per_unit + 0.5).max(0.0).min(255.0);
    let nearest = exact + INTEGERS;
    let above = nearest - INTEGERS > exact;
    (nearest.to_bits() & 0xff) - u32::from(above)
}

/// Texels of R, G, B codes and 255.
fn rgba_codes(rgb: &[f32], bias: [f32; 3], codes_per_unit: [f32; 3], texels: &mut [u8]) {
    for (texel, c) in texels.chunks_exact_mut(4).zip(rgb.chunks_exact(3)) {
        let code = |i: usize| wide_code(c[i], bias[i], codes_per_unit[i]);
        let word = code(0) | code(1) << 8 | code(2) << 16 | 0xff << 24;
        texel.copy_from_slice(&word.to_le_bytes());
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
                let fast = code(c, quantizer.bias, quantizer.codes_per_unit());
                assert_eq!(fast, quantizer.code(c), "{c} in {min}..{max}");
            }
        }
    }
}
