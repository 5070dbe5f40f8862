//! The sRGB transfer function (IEC 61966-2-1) and luminance, the same bits on every platform.

/// Rec. 709 luminance weights of linear R, G and B.
pub const LUMINANCE: [f32; 3] = [0.2126, 0.7152, 0.0722];

/// Linear light from an sRGB-encoded value.
///
/// 0..1 is the standard's curve; above 1 the curve goes on, below 0 gives 0.
/// Source: IEC 61966-2-1.
pub fn linear_from_srgb(encoded: f32) -> f32 {
    if encoded <= 0.04045 { (encoded / 12.92).max(0.0) } else { libm::powf((encoded + 0.055) / 1.055, 2.4) }
}

/// An sRGB-encoded value from linear light; the inverse of [`linear_from_srgb`].
///
/// Source: IEC 61966-2-1.
pub fn srgb_from_linear(linear: f32) -> f32 {
    if linear <= 0.003_130_8 {
        (linear * 12.92).max(0.0)
    } else {
        1.055 * libm::powf(linear, 1.0 / 2.4) - 0.055
    }
}

/// Weighted sum of R, G and B with [`LUMINANCE`].
pub fn luminance(rgb: [f32; 3]) -> f32 {
    LUMINANCE[0] * rgb[0] + LUMINANCE[1] * rgb[1] + LUMINANCE[2] * rgb[2]
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_16_bit_code_survives_the_way_there_and_back() {
        for code in 0..=65535u32 {
            let encoded = code as f32 / 65535.0;
            let back = srgb_from_linear(linear_from_srgb(encoded));
            assert_eq!((back * 65535.0).round() as u32, code);
        }
    }

    #[test]
    fn known_values() {
        assert!((linear_from_srgb(0.5) - 0.214_041_14).abs() < 1e-7);
        assert_eq!(linear_from_srgb(1.0), 1.0);
        assert_eq!(linear_from_srgb(-0.25), 0.0);
        assert!((linear_from_srgb(1.5) - 2.537_15).abs() < 1e-4);
    }
}
