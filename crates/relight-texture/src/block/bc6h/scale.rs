//! The scale on which BC6H interpolates: the bits of a half, read as an integer and stretched.
//!
//! A position is what the source calls an unquantised value: 0..65535, or -32767..32767 for the
//! signed form. Its half is position x 31 / 64 (31 / 32) as an integer, so that the scale is close
//! to a logarithm of q: one octave of q is 1024 halves.

/// Unsigned or signed.
#[derive(Clone, Copy)]
pub(super) struct Scale {
    pub(super) signed: bool,
}

/// 2^112: what is between the exponents of halves and floats.
const HALF_TO_FLOAT: f32 = f32::from_bits((127 + 112) << 23);

/// 2^-14, the least half that is no denormal.
const LEAST_NORMAL: f32 = f32::from_bits((127 - 14) << 23);

impl Scale {
    /// The position of the half nearest to q: its integer part has that half.
    pub(super) fn position(self, q: f32) -> f32 {
        let half = if q.abs() < LEAST_NORMAL {
            (q.abs() * 16_777_216.0 + 0.5) as u32 as f32
        } else {
            ((q.abs().to_bits() - (112 << 23) + (1 << 12)) >> 13) as f32
        };
        // In the middle of the two positions that share the half; a signed half has but one.
        let position = if self.signed { half * (32.0 / 31.0) + 0.984 } else { (half + 0.5) * (64.0 / 31.0) };
        position.copysign(q)
    }

    /// dq / d(half) at q.
    pub(super) fn slope(self, q: f32) -> f32 {
        f32::from_bits(q.abs().max(LEAST_NORMAL).to_bits() & 0x7f80_0000) / 1024.0
    }

    /// q at a position.
    #[inline]
    pub(super) fn q(self, position: i32) -> f32 {
        if self.signed {
            let bits = (((position.unsigned_abs() << 5) - position.unsigned_abs()) >> 5) << 13;
            f32::from_bits(bits | (position as u32 & 0x8000_0000)) * HALF_TO_FLOAT
        } else {
            f32::from_bits((((position << 5) - position) >> 6 << 13) as u32) * HALF_TO_FLOAT
        }
    }

    /// The position that a code of so many bits stands for.
    pub(super) fn position_of_code(self, code: i32, bits: u32) -> i32 {
        if bits >= 16 {
            return code;
        }
        let (magnitude, bits, top) =
            if self.signed { (code.abs(), bits - 1, 0x7fff) } else { (code, bits, 0xffff) };
        let unsigned = match magnitude {
            0 => 0,
            all if all >= (1 << bits) - 1 => top,
            other => (other * (top + 1) + ((top + 1) >> 1)) >> bits,
        };
        if code < 0 { -unsigned } else { unsigned }
    }

    /// The code of so many bits near to a position.
    pub(super) fn code(self, position: f32, bits: u32) -> i32 {
        let (range, largest) = self.codes(bits);
        let rounded = if bits >= 16 {
            position.abs()
        } else {
            // Codes stand in the middle of their steps.
            position.abs() * (range as f32 / if self.signed { 32768.0 } else { 65536.0 })
        };
        let code = (rounded as i32).min(largest);
        if position < 0.0 { -code } else { code }
    }

    /// Steps on the positive side, and the largest code.
    fn codes(self, bits: u32) -> (i32, i32) {
        let range = 1 << if self.signed { bits - 1 } else { bits };
        (range, range - 1)
    }

    /// Whether a code exists.
    pub(super) fn has_code(self, code: i32, bits: u32) -> bool {
        let (_, largest) = self.codes(bits);
        (if self.signed { -largest } else { 0 }..=largest).contains(&code)
    }
}
