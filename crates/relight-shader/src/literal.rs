//! Numbers as all three languages read them.

/// The shortest decimal that reads back as `value` to the bit, with a point: `0.1`, `-2.5`, `1.0e30`.
///
/// Denormals are written as zero, which is what a GPU may take them for: the asset is the same on
/// all of them.
///
/// # Panics
/// For NaN and infinities, which no language has a literal for and no packing holds.
pub(crate) fn literal(value: f32) -> String {
    assert!(value.is_finite(), "{value} as a constant of a shader: scales and biases are finite");
    if value.is_subnormal() || value == 0.0 {
        return "0.0".to_owned();
    }
    let text = format!("{value:?}");
    match text.split_once('e') {
        Some((digits, exponent)) if !digits.contains('.') => format!("{digits}.0e{exponent}"),
        _ => text,
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn literals_come_back_to_the_bit_and_have_a_point() {
        let mut state = 1u32;
        let patterns = std::iter::repeat_with(|| {
            state = state.wrapping_mul(1_664_525).wrapping_add(1_013_904_223);
            f32::from_bits(state)
        });
        let edges = [1e30, -1e30, 1e-30, f32::MAX, f32::MIN_POSITIVE, -0.1, 16_777_216.0];
        for value in edges.into_iter().chain(patterns.take(20_000).filter(|v| v.is_normal())) {
            let text = literal(value);
            assert!(text.contains('.'), "{text}");
            assert_eq!(text.parse::<f32>().unwrap().to_bits(), value.to_bits(), "{text}");
        }
        assert_eq!(literal(1e30), "1.0e30");
        assert_eq!(literal(-1.5e-30), "-1.5e-30");
    }

    #[test]
    fn denormals_and_negative_zero_are_zero() {
        for value in [1e-42f32, -1e-42, -0.0, f32::from_bits(1)] {
            assert_eq!(literal(value), "0.0");
        }
    }
}
