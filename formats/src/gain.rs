//! Pictures as if their lamps had been brighter or darker, or of another colour.

use crate::picture::Samples;
use crate::samples::linear_of_code8;
use relight_core::{CpuLevel, Space, srgb_from_linear};

/// What the linear light of a picture's channels is multiplied by, ready for its samples.
///
/// Nothing is rounded to codes again and nothing is cut at 1: values are as fine as f32.
pub(crate) struct Gain {
    factors: [f32; 3],
    channels: usize,
    space: Space,
    /// For 8 bits: the value of each code in each channel. 16 bits are computed, as a table would take 768 KiB a picture.
    of_code8: Box<[[f32; 256]; 3]>,
}

/// Bytes of a [`Gain`].
pub(crate) const GAIN_BYTES: u64 = 3 * 256 * 4;

impl Gain {
    /// Of pictures with `channels` a pixel, of which the first `factors` are; `None` where those are 1: then samples are
    /// to be taken as they are.
    pub(crate) fn new(factors: [f32; 3], channels: usize, space: Space) -> Option<Self> {
        if factors[..channels] == [1.0; 3][..channels] {
            return None;
        }
        let value = |factor: f32, code: usize| in_space(space, linear_of_code8()[code] * factor);
        let of_code8 = Box::new(factors.map(|factor| std::array::from_fn(|code| value(factor, code))));
        Some(Self { factors, channels, space, of_code8 })
    }

    /// As [`Samples::copy_to`], where the first value is of channel `channel`.
    ///
    /// # Panics
    /// When the samples end before `out` does.
    pub(crate) fn copy(
        &self,
        samples: &Samples,
        level: CpuLevel,
        first: usize,
        channel: usize,
        out: &mut [f32],
    ) {
        let of_sample = (0..self.channels).cycle().skip(channel);
        if let Samples::U8(codes) = samples {
            let codes = &codes[first..first + out.len()];
            for ((value, &code), channel) in out.iter_mut().zip(codes).zip(of_sample) {
                *value = self.of_code8[channel][usize::from(code)];
            }
            return;
        }
        samples.copy_to(Space::Linear, level, first, out);
        for (value, channel) in out.iter_mut().zip(of_sample) {
            *value = in_space(self.space, *value * self.factors[channel]);
        }
    }

    /// The value of a full code in `channel`.
    pub(crate) fn full_scale(&self, channel: usize) -> f32 {
        self.of_code8[channel][255]
    }
}

fn in_space(space: Space, linear: f32) -> f32 {
    match space {
        Space::Linear => linear,
        Space::Encoded => srgb_from_linear(linear),
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use half::f16;
    use relight_core::linear_from_srgb;

    #[test]
    fn every_sample_type_is_multiplied_in_linear_light_channel_by_channel() {
        let factors = [0.5, 1.0, 1.75];
        let codes = [3u8, 90, 200, 255, 254, 131, 17];
        let kinds = [
            Samples::U8(codes.to_vec()),
            Samples::U16(codes.iter().map(|&code| u16::from(code) * 257).collect()),
            Samples::F32(codes.iter().map(|&code| linear_from_srgb(f32::from(code) / 255.0)).collect()),
            Samples::F16(
                codes.iter().map(|&code| f16::from_f32(linear_from_srgb(f32::from(code) / 255.0))).collect(),
            ),
        ];
        for samples in &kinds {
            for space in [Space::Linear, Space::Encoded] {
                let gain = Gain::new(factors, 3, space).unwrap();
                // From within a pixel, as spans of other lengths would begin.
                let mut out = [0.0f32; 5];
                gain.copy(samples, CpuLevel::detect(), 2, 2, &mut out);
                for (at, value) in out.iter().enumerate() {
                    let code = f64::from(codes[at + 2]) / 255.0;
                    let linear =
                        if code <= 0.04045 { code / 12.92 } else { power((code + 0.055) / 1.055, 2.4) };
                    let scaled = linear * f64::from(factors[(at + 2) % 3]);
                    let expected = match space {
                        Space::Linear => scaled,
                        Space::Encoded if scaled <= 0.003_130_8 => 12.92 * scaled,
                        Space::Encoded => 1.055 * power(scaled, 1.0 / 2.4) - 0.055,
                    };
                    let tolerance = if matches!(samples, Samples::F16(_)) { 1e-3 } else { 2e-6 };
                    assert!(
                        (f64::from(*value) - expected).abs() < tolerance,
                        "{space:?} {at}: {value} {expected}"
                    );
                }
            }
        }
        assert!(Gain::new([1.0; 3], 3, Space::Encoded).is_none());
        assert!(Gain::new([1.0, 2.0, 2.0], 1, Space::Encoded).is_none());
    }

    #[allow(clippy::disallowed_methods, reason = "a test's own formula, within a tolerance")]
    fn power(base: f64, exponent: f64) -> f64 {
        base.powf(exponent)
    }
}
