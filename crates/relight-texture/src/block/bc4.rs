//! BC4 and BC5: one or two channels of eight evenly spaced values, or of six and the domain's ends.
//!
//! An own encoder, since the `dds` crate adds squares in an order that depends on the processor's
//! vectors and so breaks ties differently; and it has no exhaustive search for signed values.
//! Source of the format: Microsoft, *Texture Block Compression in Direct3D 11*.

use super::encode::BlockRow;
use super::{BlockCoding, Quality};
use relight_core::{CpuLevel, Vectorized};

/// An expression for each of a block's 16 values. A macro rather than `map`, which is not inlined into what is
/// compiled for a CPU level.
macro_rules! lanes {
    (|$i:ident| $expression:expr) => {{
        let mut out = [0.0f32; 16];
        for ($i, out) in out.iter_mut().enumerate() {
            *out = $expression;
        }
        out
    }};
}

/// 16 values of a channel in codes: 0..255, or -127..127.
struct Channel {
    values: [f32; 16],
    least: i32,
    largest: i32,
}

/// Two codes and the steps from one to the other: 7, or 5 where the domain's ends are in the palette
/// too.
#[derive(Clone, Copy, PartialEq)]
struct Palette {
    low: i32,
    high: i32,
    steps: usize,
}

/// The best so far, and its error.
type Best = (f32, Palette);

/// How hard to look.
struct Effort {
    /// How many steps of seven a start spreads over the block's range; the others lie beyond.
    starts: &'static [f32],
    /// Rounds of moving the codes.
    moves: usize,
    /// Whether the palette with the domain's ends is tried even where nothing is close to them.
    always_ends: bool,
    /// Codes around the best that are tried exhaustively.
    window: i32,
    /// The same where all values lie within 16 codes: there, codes further apart whose steps
    /// happen to meet the values are often much better.
    narrow_window: i32,
}

fn effort(quality: Quality) -> Effort {
    match quality {
        Quality::Fast => Effort { starts: &[7.0], moves: 0, always_ends: false, window: 0, narrow_window: 0 },
        Quality::Normal => {
            Effort { starts: &[7.0], moves: 3, always_ends: false, window: 0, narrow_window: 2 }
        }
        Quality::High => {
            Effort { starts: &[7.0, 6.0], moves: 8, always_ends: true, window: 0, narrow_window: 5 }
        }
        Quality::Best => Effort {
            starts: &[7.0, 6.0, 5.0, 4.0, 3.0, 2.0],
            moves: 20,
            always_ends: true,
            window: 6,
            narrow_window: 12,
        },
    }
}

pub(super) fn bc4(row: BlockRow<'_>, coding: BlockCoding, out: &mut [u8]) {
    one_channel(&row, false, coding, out);
}

pub(super) fn bc4_signed(row: BlockRow<'_>, coding: BlockCoding, out: &mut [u8]) {
    one_channel(&row, true, coding, out);
}

pub(super) fn bc5(row: BlockRow<'_>, coding: BlockCoding, out: &mut [u8]) {
    two_channels(&row, false, coding, out);
}

pub(super) fn bc5_signed(row: BlockRow<'_>, coding: BlockCoding, out: &mut [u8]) {
    two_channels(&row, true, coding, out);
}

fn one_channel(row: &BlockRow<'_>, signed: bool, coding: BlockCoding, out: &mut [u8]) {
    for (values, block) in row.blocks::<16>().zip(out.chunks_exact_mut(8)) {
        block.copy_from_slice(&encode(values, signed, coding.quality));
    }
}

fn two_channels(row: &BlockRow<'_>, signed: bool, coding: BlockCoding, out: &mut [u8]) {
    for (values, block) in row.blocks::<32>().zip(out.chunks_exact_mut(16)) {
        for (c, half) in block.chunks_exact_mut(8).enumerate() {
            let channel = std::array::from_fn(|i| values[2 * i + c]);
            half.copy_from_slice(&encode(channel, signed, coding.quality));
        }
    }
}

/// The block of 16 values, 0..1 or -1..1, by the widest vectors there are: a block's values fit one, and no sum
/// depends on how wide they are.
pub(super) fn encode(values: [f32; 16], signed: bool, quality: Quality) -> [u8; 8] {
    CpuLevel::detect().run(Block { values, signed, effort: &effort(quality) })
}

struct Block<'a> {
    values: [f32; 16],
    signed: bool,
    effort: &'a Effort,
}

impl Vectorized for Block<'_> {
    type Output = [u8; 8];

    #[inline(always)]
    fn run(self) -> [u8; 8] {
        let (least, largest) = if self.signed { (-127, 127) } else { (0, 255) };
        let channel = Channel { values: lanes!(|i| self.values[i] * largest as f32), least, largest };
        let palette = channel.palette(self.effort);
        channel.block(palette)
    }
}

/// The nearest integer, for magnitudes below 2^22, in two additions.
#[inline(always)]
fn nearest(value: f32) -> f32 {
    (value + 12_582_912.0) - 12_582_912.0
}

/// The nearest of 0 to STEPS. Comparisons rather than `clamp`, whose care for NaN costs a third.
#[inline(always)]
fn nearest_step<const STEPS: usize>(along: f32) -> f32 {
    let most = STEPS as f32;
    let low = if along > 0.0 { along } else { 0.0 };
    nearest(if low < most { low } else { most })
}

/// The size of a step, and its inverse (0 without a range).
#[inline(always)]
fn step<const STEPS: usize>(low: f32, high: f32) -> (f32, f32) {
    let range = high - low;
    (range / STEPS as f32, if range > 0.0 { STEPS as f32 / range } else { 0.0 })
}

/// The sum, in an order that needs no shuffling of vectors.
#[inline(always)]
fn sum(values: [f32; 16]) -> f32 {
    let mut four = [0.0; 4];
    for (i, four) in four.iter_mut().enumerate() {
        *four = (values[i] + values[4 + i]) + (values[8 + i] + values[12 + i]);
    }
    (four[0] + four[2]) + (four[1] + four[3])
}

impl Channel {
    #[inline(always)]
    fn palette(&self, effort: &Effort) -> Palette {
        let (low, high) = self.range(|_| true);
        let (least, largest) = (self.least as f32, self.largest as f32);
        let mut best = (f32::INFINITY, Palette { low: 0, high: 0, steps: 5 });
        let range = high - low;
        for start in effort.starts {
            // Beyond that end which is further from the domain's.
            let beyond = range * (7.0 / start - 1.0);
            let (a, b) = if low - least > largest - high { (beyond, 0.0) } else { (0.0, beyond) };
            // Outliers shall not choose everyone's steps.
            let inset = range * 0.03;
            let (a, b) = (a - inset, b - inset);
            self.improve::<7>(self.refitted::<7>(low - a, high + b), effort, &mut best);
        }
        // Values within a step of the domain's end gain from its being in the palette for nothing.
        let step = range / 7.0;
        let close = effort.moves > 0 && (low - step < least || high + step > largest);
        if close || effort.always_ends || range < 1.0 {
            let (low, high) = self.range(|value| value > least + 0.5 && value < largest - 0.5);
            let (low, high) = if low > high { (least, largest) } else { (low, high) };
            self.improve::<5>(self.refitted::<5>(low, high), effort, &mut best);
        }
        let window = if range < 16.0 { effort.narrow_window } else { effort.window };
        if window > 0 && best.0 > 0.0 {
            let at = best.1;
            self.search::<7>(at, window, 1, &mut best);
            if effort.always_ends {
                self.search::<5>(at, window, 1, &mut best);
            }
        }
        best.1
    }

    /// The least and the largest of some of the values.
    #[inline(always)]
    fn range(&self, of: impl Fn(f32) -> bool) -> (f32, f32) {
        let low = lanes!(|i| if of(self.values[i]) { self.values[i] } else { f32::INFINITY });
        let high = lanes!(|i| if of(self.values[i]) { self.values[i] } else { f32::NEG_INFINITY });
        let (mut lowest, mut highest) = (f32::INFINITY, f32::NEG_INFINITY);
        for (low, high) in low.into_iter().zip(high) {
            lowest = if low < lowest { low } else { lowest };
            highest = if high > highest { high } else { highest };
        }
        (lowest, highest)
    }

    /// Ends of least squared error for the nearest steps between the given ones, twice.
    #[inline(always)]
    fn refitted<const STEPS: usize>(&self, mut low: f32, mut high: f32) -> (f32, f32) {
        for _ in 0..2 {
            let (_, inverse) = step::<STEPS>(low, high);
            // How far along each value is, and the values from `low` on.
            let along = lanes!(|i| nearest_step::<STEPS>((self.values[i] - low) * inverse) / STEPS as f32);
            let from_low = lanes!(|i| self.values[i] - low);
            let (b, bb) = (sum(along), sum(lanes!(|i| along[i] * along[i])));
            let (x, bx) = (sum(from_low), sum(lanes!(|i| along[i] * from_low[i])));
            let (aa, ab, ax) = (16.0 - 2.0 * b + bb, b - bb, x - bx);
            let determinant = aa * bb - ab * ab;
            if determinant < 1e-3 {
                break;
            }
            let (least, largest) = (self.least as f32, self.largest as f32);
            high = (low + (bx * aa - ax * ab) / determinant).clamp(least, largest);
            low = (low + (ax * bb - bx * ab) / determinant).clamp(least, largest);
        }
        (low, high)
    }

    /// Ends as codes, moved by ever smaller strides while that helps.
    #[inline(always)]
    fn improve<const STEPS: usize>(&self, (low, high): (f32, f32), effort: &Effort, best: &mut Best) {
        let code = |value: f32| (nearest(value) as i32).clamp(self.least, self.largest);
        let mut at = Palette { low: code(low), high: code(high), steps: STEPS };
        if STEPS == 7 && at.low == at.high {
            // Seven steps need two different codes: their order tells them from five.
            at.low = (at.low - 1).max(self.least);
            at.high = at.high.max(at.low + 1);
        }
        let mut found = (self.error::<STEPS>(at), at);
        let mut stride = ((at.high - at.low) / 8).max(1);
        for _ in 0..effort.moves {
            let before = found;
            self.search::<STEPS>(before.1, stride, stride, &mut found);
            if found.1 == before.1 {
                if stride == 1 {
                    break;
                }
                stride /= 2;
            }
        }
        if found.0 < best.0 {
            *best = found;
        }
    }

    /// Tries all ends within so many codes of those given, in strides.
    #[inline(always)]
    fn search<const STEPS: usize>(&self, at: Palette, window: i32, stride: i32, best: &mut Best) {
        let gap = if STEPS == 7 { 1 } else { 0 };
        for low in (at.low - window..=at.low + window).step_by(stride as usize) {
            for high in (at.high - window..=at.high + window).step_by(stride as usize) {
                let new = (low, high) != (at.low, at.high) || STEPS != at.steps;
                if new && low >= self.least && high <= self.largest && high - low >= gap {
                    let palette = Palette { low, high, steps: STEPS };
                    let error = self.error::<STEPS>(palette);
                    if error < best.0 {
                        *best = (error, palette);
                    }
                }
            }
        }
    }

    /// The sum of squared differences, in codes.
    #[inline(always)]
    fn error<const STEPS: usize>(&self, palette: Palette) -> f32 {
        let low = palette.low as f32;
        let (step, inverse) = step::<STEPS>(low, palette.high as f32);
        let (least, largest) = (self.least as f32, self.largest as f32);
        sum(lanes!(|i| {
            let value = self.values[i];
            let k = nearest_step::<STEPS>((value - low) * inverse);
            let mut difference = (value - (low + k * step)).abs();
            if STEPS == 5 {
                let (down, up) = (value - least, largest - value);
                difference = if down < difference { down } else { difference };
                difference = if up < difference { up } else { difference };
            }
            difference * difference
        }))
    }

    #[inline(always)]
    fn block(&self, palette: Palette) -> [u8; 8] {
        let Palette { low, high, steps } = palette;
        let (first, second, indices) =
            if steps == 7 { (high, low, self.seven(palette)) } else { (low, high, self.five(palette)) };
        let mut bits = 0;
        for (i, index) in indices.into_iter().enumerate() {
            bits |= index << (16 + 3 * i);
        }
        let mut block = bits.to_le_bytes();
        (block[0], block[1]) = (first as u8, second as u8);
        block
    }

    /// Indices where the higher code is stored first.
    #[inline(always)]
    fn seven(&self, palette: Palette) -> [u64; 16] {
        let low = palette.low as f32;
        let (_, inverse) = step::<7>(low, palette.high as f32);
        self.values.map(|value| match nearest_step::<7>((value - low) * inverse) as u64 {
            7 => 0,
            0 => 1,
            k => 8 - k,
        })
    }

    /// Indices where the lower code is stored first.
    #[inline(always)]
    fn five(&self, palette: Palette) -> [u64; 16] {
        let low = palette.low as f32;
        let (step, inverse) = step::<5>(low, palette.high as f32);
        self.values.map(|value| {
            let k = nearest_step::<5>((value - low) * inverse);
            let difference = (value - (low + k * step)).abs();
            match k as u64 {
                _ if value - (self.least as f32) < difference => 6,
                _ if (self.largest as f32) - value < difference => 7,
                0 => 0,
                5 => 1,
                k => k + 1,
            }
        })
    }
}
