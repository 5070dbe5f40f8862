//! Samples as bytes and as f32 in fitting space.

use crate::picture::{SampleType, Samples};
use half::f16;
use half::slice::HalfFloatSliceExt;
use relight_core::{CpuLevel, Space, linear_from_srgb, srgb_from_linear, unit_values_from_codes};

impl Samples {
    /// How each sample is stored.
    pub fn sample_type(&self) -> SampleType {
        match self {
            Self::U8(_) => SampleType::U8,
            Self::U16(_) => SampleType::U16,
            Self::F16(_) => SampleType::F16,
            Self::F32(_) => SampleType::F32,
        }
    }

    /// Bytes that they take.
    pub(crate) fn bytes(&self) -> u64 {
        self.as_bytes().len() as u64
    }

    /// `count` samples of 0.
    pub(crate) fn zeroed(sample_type: SampleType, count: usize) -> Self {
        match sample_type {
            SampleType::U8 => Self::U8(vec![0; count]),
            SampleType::U16 => Self::U16(vec![0; count]),
            SampleType::F16 => Self::F16(vec![f16::ZERO; count]),
            SampleType::F32 => Self::F32(vec![0.0; count]),
        }
    }

    /// The samples as they lie in memory.
    pub(crate) fn as_bytes(&self) -> &[u8] {
        match self {
            Self::U8(samples) => samples,
            Self::U16(samples) => bytemuck::cast_slice(samples),
            Self::F16(samples) => bytemuck::cast_slice(samples),
            Self::F32(samples) => bytemuck::cast_slice(samples),
        }
    }

    /// The samples as they lie in memory, to be filled.
    pub(crate) fn as_bytes_mut(&mut self) -> &mut [u8] {
        match self {
            Self::U8(samples) => samples,
            Self::U16(samples) => bytemuck::cast_slice_mut(samples),
            Self::F16(samples) => bytemuck::cast_slice_mut(samples),
            Self::F32(samples) => bytemuck::cast_slice_mut(samples),
        }
    }

    /// Grey samples repeated for R, G and B where `to` is 3 and `from` is 1; otherwise unchanged.
    pub(crate) fn widened(self, from: usize, to: usize) -> Self {
        fn repeated<T: Copy>(samples: &[T]) -> Vec<T> {
            samples.iter().flat_map(|&sample| [sample; 3]).collect()
        }
        if (from, to) != (1, 3) {
            return self;
        }
        match self {
            Self::U8(samples) => Self::U8(repeated(&samples)),
            Self::U16(samples) => Self::U16(repeated(&samples)),
            Self::F16(samples) => Self::F16(repeated(&samples)),
            Self::F32(samples) => Self::F32(repeated(&samples)),
        }
    }

    /// Writes samples `first ..` to `out` as f32 in `space`: integers are sRGB-encoded 0..1, floats
    /// linear.
    ///
    /// # Panics
    /// When the samples end before `out` does.
    pub fn copy_to(&self, space: Space, level: CpuLevel, first: usize, out: &mut [f32]) {
        let end = first + out.len();
        match self {
            Self::U8(codes) => match space {
                Space::Encoded => unit_values_from_codes(level, &codes[first..end], out),
                Space::Linear => {
                    for (value, code) in out.iter_mut().zip(&codes[first..end]) {
                        *value = linear_of_code8()[usize::from(*code)];
                    }
                }
            },
            Self::U16(codes) => {
                for (value, code) in out.iter_mut().zip(&codes[first..end]) {
                    let encoded = f32::from(*code) / 65535.0;
                    *value = if space == Space::Linear { linear_from_srgb(encoded) } else { encoded };
                }
            }
            Self::F16(halves) => {
                halves[first..end].convert_to_f32_slice(out);
                encode_floats(space, out);
            }
            Self::F32(floats) => {
                out.copy_from_slice(&floats[first..end]);
                encode_floats(space, out);
            }
        }
    }
}

/// Float pictures are linear: encodes them where encoded values are wanted.
fn encode_floats(space: Space, values: &mut [f32]) {
    if space == Space::Encoded {
        for value in values {
            *value = srgb_from_linear(*value);
        }
    }
}

/// Linear light of each 8-bit code.
pub(crate) fn linear_of_code8() -> &'static [f32; 256] {
    static TABLE: std::sync::OnceLock<[f32; 256]> = std::sync::OnceLock::new();
    TABLE.get_or_init(|| std::array::from_fn(|code| linear_from_srgb(code as f32 / 255.0)))
}
