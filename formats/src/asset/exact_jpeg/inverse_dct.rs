//! The inverse DCT of 8 x 8 coefficients in integers, with the roundings of libjpeg's accurate one.
//!
//! Source: Loeffler, Ligtenberg, Moschytz, *Practical Fast 1-D DCT Algorithms with 11 Multiplications*, figure 1
//! (their 12-multiplication form), backwards; constants and roundings as in libjpeg's `jidctint.c`. All sums are
//! exact, so that their order is free; the constants, rounded one by one, are not.

use relight_core::Vectorized;
use std::num::Wrapping;

/// Bits after the point of the constants.
const CONSTANT_BITS: u32 = 13;

/// Bits after the point that are kept between the two passes.
const KEPT_BITS: u32 = 2;

/// `value` with [`CONSTANT_BITS`] after the point, rounded.
const fn fixed(value: f64) -> Wrapping<i32> {
    Wrapping((value * ONE.0 as f64 + 0.5) as i32)
}

const ONE: Wrapping<i32> = Wrapping(1 << CONSTANT_BITS);

/// Eight transforms of eight numbers, one a column; results are 2^`bits` times as large before they are rounded,
/// halves up. Sums of damaged files may wrap.
#[inline(always)]
fn transformed(rows: &[[i32; 8]; 8], bits: u32) -> [[i32; 8]; 8] {
    let mut results = [[0; 8]; 8];
    for column in 0..8 {
        let c = |row: usize| Wrapping(rows[row][column]);
        // Even coefficients: a butterfly of 0 and 4, a rotation of 2 and 6.
        let rotated = (c(2) + c(6)) * fixed(0.541_196_100);
        let low = rotated + c(2) * fixed(0.765_366_865);
        let high = rotated - c(6) * fixed(1.847_759_065);
        let half = Wrapping(1 << (bits - 1));
        let sum = (c(0) + c(4)) * ONE + half;
        let difference = (c(0) - c(4)) * ONE + half;
        let even = [sum + low, difference + high, difference - high, sum - low];
        // Odd ones: rotations that share their products.
        let shared = (c(1) + c(3) + c(5) + c(7)) * fixed(1.175_875_602);
        let of_17 = (c(1) + c(7)) * fixed(0.899_976_223);
        let of_35 = (c(3) + c(5)) * fixed(2.562_915_447);
        let of_37 = shared - (c(3) + c(7)) * fixed(1.961_570_560);
        let of_15 = shared - (c(1) + c(5)) * fixed(0.390_180_644);
        let odd = [
            c(1) * fixed(1.501_321_110) - of_17 + of_15,
            c(3) * fixed(3.072_711_026) - of_35 + of_37,
            c(5) * fixed(2.053_119_869) - of_35 + of_15,
            c(7) * fixed(0.298_631_336) - of_17 + of_37,
        ];
        for i in 0..4 {
            results[i][column] = (even[i] + odd[i]).0 >> bits;
            results[7 - i][column] = (even[i] - odd[i]).0 >> bits;
        }
    }
    results
}

#[inline(always)]
fn transposed(rows: &[[i32; 8]; 8]) -> [[i32; 8]; 8] {
    let mut columns = [[0; 8]; 8];
    for (y, row) in rows.iter().enumerate() {
        for (column, value) in columns.iter_mut().zip(row) {
            column[y] = *value;
        }
    }
    columns
}

/// The codes of a block, row by row, from its coefficients times their steps, row by row.
pub(super) struct InverseDct<'a>(pub(super) &'a [[i32; 8]; 8]);

impl Vectorized for InverseDct<'_> {
    type Output = [[u8; 8]; 8];

    // Loops rather than closures, which the compiler would leave at the level of every machine.
    #[inline(always)]
    fn run(self) -> Self::Output {
        let columns_done = transformed(self.0, CONSTANT_BITS - KEPT_BITS);
        // Of the factor 8 that both passes together leave, too.
        let done = transformed(&transposed(&columns_done), CONSTANT_BITS + KEPT_BITS + 3);
        let mut codes = [[0; 8]; 8];
        for (codes, row) in codes.iter_mut().zip(&transposed(&done)) {
            for (place, sample) in codes.iter_mut().zip(row) {
                *place = code(*sample);
            }
        }
        codes
    }
}

/// The code of every pixel of a block that has no coefficient but its mean, times its step: the same as
/// [`InverseDct`] gives, whose passes round such a block once.
pub(super) fn flat(mean: i32) -> u8 {
    code(mean.wrapping_add(4) >> 3)
}

/// Of a sample about 0.
#[inline(always)]
fn code(sample: i32) -> u8 {
    sample.wrapping_add(128).clamp(0, 255) as u8
}

#[cfg(test)]
mod tests {
    use super::*;
    use relight_core::CpuLevel;
    use std::array::from_fn;
    use std::f64::consts::PI;

    /// T.81 A.3.3, by its double sum.
    fn codes_by_definition(coefficients: &[[i32; 8]; 8]) -> [[f64; 8]; 8] {
        let cosine = |x: usize, u: usize| {
            let norm = if u == 0 { 0.5f64.sqrt() } else { 1.0 };
            norm * libm::cos((2 * x + 1) as f64 * u as f64 * PI / 16.0) / 2.0
        };
        from_fn(|y| {
            from_fn(|x| {
                let term =
                    |i: usize| f64::from(coefficients[i / 8][i % 8]) * cosine(x, i % 8) * cosine(y, i / 8);
                ((0..64).map(term).sum::<f64>() + 128.0).clamp(0.0, 255.0)
            })
        })
    }

    #[test]
    fn codes_are_those_of_the_definition_at_every_cpu_level() {
        let mut state = 5u64;
        let mut random = |below: i32| {
            state = state.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
            ((state >> 33) % below as u64) as i32
        };
        let mut largest = 0.0f64;
        for round in 0..2000 {
            let mut coefficients = [[0; 8]; 8];
            coefficients[0][0] = random(2048) - 1024;
            for _ in 0..round % 40 {
                coefficients[random(8) as usize][random(8) as usize] = random(400) - 200;
            }
            let found = InverseDct(&coefficients).run();
            let expected = codes_by_definition(&coefficients);
            for (found, expected) in found.iter().flatten().zip(expected.iter().flatten()) {
                largest = largest.max((f64::from(*found) - expected).abs());
            }
            assert!(CpuLevel::available().all(|level| level.run(InverseDct(&coefficients)) == found));
            let mut mean = [[0; 8]; 8];
            mean[0][0] = coefficients[0][0];
            assert_eq!(InverseDct(&mean).run(), [[flat(mean[0][0]); 8]; 8]);
        }
        assert!((0.5..0.6).contains(&largest), "off by {largest}");
        // Nothing that a file may say is too large.
        for value in [i32::MIN, i32::MAX, 32_767 * 65_535] {
            InverseDct(&[[value; 8]; 8]).run();
            flat(value);
        }
    }
}
