//! What one plane of a `.ptm` in JPEG says of another.
//!
//! Source: FORMATS.md of this project: plane = (stored + p - 128) mod 256, where p is the reference plane, or
//! 255 less it where it is inverted.

/// The code that a reference's `code` predicts.
pub(super) fn predict(code: u8, inverted: bool) -> u8 {
    if inverted { 255 - code } else { code }
}

/// What is stored of a pixel instead of its `code`.
pub(super) fn residual(code: u8, predicted: u8) -> u8 {
    code.wrapping_sub(predicted).wrapping_add(128)
}

/// Turns what is stored of a plane into the plane.
pub(super) fn restore(stored: &mut [u8], reference: &[u8], inverted: bool) {
    for (code, &of_reference) in stored.iter_mut().zip(reference) {
        *code = code.wrapping_add(predict(of_reference, inverted)).wrapping_sub(128);
    }
}
