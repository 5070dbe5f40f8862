//! The modes of BC7 that are used, and what their codes stand for.

use super::partitions::{THREE, TWO};
use crate::block::side_by_side::{limited, nearest};

/// A mode: how ends are coded.
pub(super) trait Mode {
    const NUMBER: usize;
    const SUBSETS: usize;
    /// Ways to part a block that can be named.
    const PARTITIONS: usize;
    /// Bits of a code, its parity included.
    const BITS: u32;
    /// From one code that an end may have to the next: 2 where all channels of an end have the same parity.
    const STRIDE: f32;
    /// The parities of two ends that are tried.
    const PARITIES: &'static [[f32; 2]];
    /// From one end to the other.
    const STEPS: usize;
}

/// Parities of ends that have one each.
const EACH: &[[f32; 2]] = &[[0.0, 0.0], [0.0, 1.0], [1.0, 0.0], [1.0, 1.0]];

/// Alpha has the parity, too: it is 254 or 255.
pub(super) struct Mode6;

impl Mode for Mode6 {
    const NUMBER: usize = 6;
    const SUBSETS: usize = 1;
    const PARTITIONS: usize = 1;
    const BITS: u32 = 8;
    const STRIDE: f32 = 2.0;
    const PARITIES: &'static [[f32; 2]] = EACH;
    const STEPS: usize = 15;
}

pub(super) struct Mode1;

impl Mode for Mode1 {
    const NUMBER: usize = 1;
    const SUBSETS: usize = 2;
    const PARTITIONS: usize = 64;
    const BITS: u32 = 7;
    const STRIDE: f32 = 2.0;
    const PARITIES: &'static [[f32; 2]] = &[[0.0, 0.0], [1.0, 1.0]];
    const STEPS: usize = 7;
}

pub(super) struct Mode3;

impl Mode for Mode3 {
    const NUMBER: usize = 3;
    const SUBSETS: usize = 2;
    const PARTITIONS: usize = 64;
    const BITS: u32 = 8;
    const STRIDE: f32 = 2.0;
    const PARITIES: &'static [[f32; 2]] = EACH;
    const STEPS: usize = 3;
}

pub(super) struct Mode0;

impl Mode for Mode0 {
    const NUMBER: usize = 0;
    const SUBSETS: usize = 3;
    const PARTITIONS: usize = 16;
    const BITS: u32 = 5;
    const STRIDE: f32 = 2.0;
    const PARITIES: &'static [[f32; 2]] = EACH;
    const STEPS: usize = 7;
}

pub(super) struct Mode2;

impl Mode for Mode2 {
    const NUMBER: usize = 2;
    const SUBSETS: usize = 3;
    const PARTITIONS: usize = 64;
    const BITS: u32 = 5;
    const STRIDE: f32 = 1.0;
    const PARITIES: &'static [[f32; 2]] = &[[0.0, 0.0]];
    const STEPS: usize = 3;
}

/// A way to part a block as bits from the first texel on: one each for two subsets, two for three.
pub(super) fn parting_of<M: Mode>(partition: usize) -> u32 {
    match M::SUBSETS {
        1 => 0,
        2 => u32::from(TWO[partition].0),
        _ => THREE[partition].0,
    }
}

/// The subset of a texel by such bits.
#[inline(always)]
pub(super) fn subset_in<M: Mode>(parting: u32, texel: usize) -> u32 {
    match M::SUBSETS {
        1 => 0,
        2 => parting >> texel & 1,
        _ => parting >> (2 * texel) & 3,
    }
}

/// The largest code.
#[inline(always)]
pub(super) fn most<M: Mode>() -> f32 {
    ((1 << M::BITS) - 1) as f32
}

/// The nearest code of a parity to a value of 0..255.
#[inline(always)]
pub(super) fn code<M: Mode>(value: f32, parity: f32) -> f32 {
    let top = most::<M>() - (M::STRIDE - 1.0) * (1.0 - parity);
    let place = limited(value * (most::<M>() / 255.0), most::<M>()) - parity;
    limited(M::STRIDE * nearest(place / M::STRIDE), top - parity) + parity
}

/// What a code stands for, 0..255: its leading bits repeated.
#[inline(always)]
pub(super) fn value<M: Mode>(code: f32) -> f32 {
    match M::BITS {
        8 => code,
        7 => 2.0 * code + if code >= 64.0 { 1.0 } else { 0.0 },
        // A fourth without its fraction.
        _ => 8.0 * code + nearest(0.25 * code - 0.375),
    }
}

/// The weight of the second end after so many steps: 64ths, as the format rounds them.
#[inline(always)]
pub(super) fn weight<M: Mode>(steps: f32) -> f32 {
    nearest(steps * (64.0 / M::STEPS as f32)) / 64.0
}

/// The nearest integer to a number of 64ths, halves rounded up as decoders do.
#[inline(always)]
pub(super) fn rounded(value: f32) -> f32 {
    nearest(value + 1.0 / 256.0)
}

/// A code among those that there are.
#[inline(always)]
pub(super) fn kept<M: Mode>(code: f32, parity: f32) -> f32 {
    let top = most::<M>() - (M::STRIDE - 1.0) * (1.0 - parity);
    limited(code - parity, top - parity) + parity
}
