//! Codes of pictures as f32.

use crate::CpuLevel;
use crate::cpu::Kind;

/// Writes code / 255 to `values`, as the product code x (1 / 255) in f32, the same at all levels.
///
/// # Panics
/// When the slices differ in length.
pub fn unit_values_from_codes(level: CpuLevel, codes: &[u8], values: &mut [f32]) {
    assert_eq!(codes.len(), values.len(), "slices of different lengths");
    match level.kind() {
        // SAFETY: a `CpuLevel` exists only for instruction sets that this machine has.
        #[cfg(target_arch = "x86_64")]
        Kind::Avx2 => unsafe { avx2(codes, values) },
        // SAFETY: as above.
        #[cfg(target_arch = "x86_64")]
        Kind::Avx512 => unsafe { avx512(codes, values) },
        _ => convert(codes, values),
    }
}

#[inline(always)]
fn convert(codes: &[u8], values: &mut [f32]) {
    for (value, code) in values.iter_mut().zip(codes) {
        *value = f32::from(*code) * (1.0 / 255.0);
    }
}

#[cfg(target_arch = "x86_64")]
#[target_feature(enable = "avx2")]
fn avx2(codes: &[u8], values: &mut [f32]) {
    convert(codes, values);
}

#[cfg(target_arch = "x86_64")]
#[target_feature(enable = "avx512f,avx512bw,avx512vl")]
fn avx512(codes: &[u8], values: &mut [f32]) {
    convert(codes, values);
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_level_gives_the_same_bits_and_white_is_one() {
        let codes: Vec<u8> = (0..777).map(|i| (i * 7 % 256) as u8).collect();
        for level in CpuLevel::available() {
            let mut values = vec![f32::NAN; codes.len()];
            unit_values_from_codes(level, &codes, &mut values);
            for (code, value) in codes.iter().zip(&values) {
                assert_eq!(value.to_bits(), (f32::from(*code) * (1.0 / 255.0)).to_bits());
                assert!((value - f32::from(*code) / 255.0).abs() <= f32::EPSILON / 2.0);
            }
            assert_eq!(values[codes.iter().position(|&c| c == 255).unwrap()], 1.0);
        }
    }
}
