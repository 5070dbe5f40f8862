//! BC7 of opaque colours: one line of 16 colours (mode 6), two of 8 or of 4 (modes 1 and 3), three of 8 or of 4 (modes 0 and 2).
//!
//! An own encoder of many blocks side by side, as that of BC1: ends along the principal axis of a subset, then in turns the nearest
//! colour for each texel and, by least squares over whole codes, the best ends for that. Of the ways to part a block those are tried
//! whose subsets lie closest to lines. What the format has for transparency (modes 4, 5 and 7) is not used.
//! Source of the format: Khronos Data Format Specification 1.3, chapter 20 (BPTC).

#![expect(clippy::needless_range_loop, reason = "a lane of several rows at once")]

mod bits;
mod modes;
mod partitions;
mod promising;

use super::encode::BlockRow;
use super::side_by_side::{
    Ends, LANES, Lanes, Mask, TEXELS, Texels, ends_on_axis, keep_better, limited, moments_of, nearest,
    principal_axis,
};
use super::{BlockCoding, Quality};
use modes::{
    Mode, Mode0, Mode1, Mode2, Mode3, Mode6, code, kept, most, parting_of, rounded, subset_in, value, weight,
};
use promising::{Promises, Promising, partition_of};
use relight_core::{CpuLevel, Vectorized};
use std::marker::PhantomData;

/// How hard to look.
struct Effort {
    /// How much of the range along the axis is cut off at its start and at its end to begin with, all pairs of these.
    insets: &'static [f32],
    /// The same of one line, mode 6.
    insets_of_one: &'static [f32],
    /// Turns of texels and ends.
    turns: usize,
    /// How many ways to part the block are tried at most in modes 1, 3, 0 and 2.
    tried: [usize; 4],
    /// How much of the error that evenly spread values leave a way must promise to be worth it: less lets more be tried.
    left: f32,
}

fn effort(quality: Quality) -> Effort {
    match quality {
        Quality::Fast => {
            let insets_of_one = &[-0.02, 0.02];
            Effort { insets: &[0.0], insets_of_one, turns: 1, tried: [1, 0, 0, 0], left: 0.3 }
        }
        Quality::Normal => {
            let insets_of_one = &[-0.03, 0.03];
            Effort { insets: &[0.0], insets_of_one, turns: 2, tried: [1, 1, 0, 0], left: 0.3 }
        }
        Quality::High => {
            let insets_of_one = &[-0.04, 0.0, 0.04];
            Effort { insets: &[0.0], insets_of_one, turns: 2, tried: [12, 16, 4, 4], left: 0.3 }
        }
        Quality::Best => {
            let insets_of_one = &[-0.1, -0.05, 0.0, 0.05, 0.1];
            Effort { insets: &[0.0, 0.12], insets_of_one, turns: 4, tried: [16, 16, 8, 16], left: 0.1 }
        }
    }
}

pub(super) fn bc7(row: BlockRow<'_>, coding: BlockCoding, out: &mut [u8]) {
    let blocks = blocks_of(&row);
    let best = search(CpuLevel::detect(), &blocks, &effort(coding.quality));
    for ((best, texels), out) in best.iter().zip(&blocks).zip(out.chunks_exact_mut(16)) {
        out.copy_from_slice(&best.block(texels));
    }
}

/// The texels of a block, R, G, B of each, 0..255.
type Block = [f32; 3 * TEXELS];

/// The blocks of a row.
fn blocks_of(row: &BlockRow<'_>) -> Vec<Block> {
    let mut blocks: Vec<Block> = row.blocks().collect();
    blocks.iter_mut().flatten().for_each(|q| *q *= 255.0);
    blocks
}

/// The best that was found for a block.
struct Best {
    error: f32,
    mode: usize,
    partition: usize,
    /// By subset and end.
    codes: [[[f32; 3]; 2]; 3],
}

impl Best {
    /// Keeps what was found in a lane for the mode `M` where it is better.
    fn keep_better<M: Mode>(&mut self, partition: usize, found: &Found, lane: usize) {
        if found.error[lane] < self.error {
            *self = Self {
                error: found.error[lane],
                mode: M::NUMBER,
                partition,
                codes: std::array::from_fn(|subset| {
                    let ends = &found.codes[subset];
                    std::array::from_fn(|end| std::array::from_fn(|c| ends[end][c][lane]))
                }),
            };
        }
    }
}

/// The best of each block.
///
/// One line is tried for all of them, then the ways to part them that promise to be better, one after another and many blocks side
/// by side: what a way promises is its texels' distance from their lines and the least that steps along these err by.
fn search(level: CpuLevel, blocks: &[Block], effort: &Effort) -> Vec<Best> {
    let mut best = Vec::with_capacity(blocks.len());
    let mut promises = Vec::with_capacity(blocks.len().div_ceil(LANES));
    let mut texels = [[[0.0; LANES]; 3]; TEXELS];
    for blocks in blocks.chunks(LANES) {
        gather(blocks.iter(), &mut texels);
        let own = Blocks { texels: &texels, effort };
        let found = level.run(OfMode { blocks: own, parting: [0; LANES], mode: PhantomData::<Mode6> });
        for lane in 0..blocks.len() {
            let mut of_block =
                Best { error: f32::INFINITY, mode: Mode6::NUMBER, partition: 0, codes: [[[0.0; 3]; 2]; 3] };
            of_block.keep_better::<Mode6>(0, &found, lane);
            best.push(of_block);
        }
        promises.push(level.run(Promising { texels: &texels, tried: effort.tried, left: effort.left }));
    }
    for rank in 0..effort.tried.into_iter().max().unwrap_or(0) {
        let mut round = Round { level, blocks, effort, promises: &promises, rank, best: &mut best };
        round.try_mode::<Mode1>(0);
        round.try_mode::<Mode3>(1);
        round.try_mode::<Mode0>(2);
        round.try_mode::<Mode2>(3);
    }
    best
}

/// The ways to part the blocks that rank alike among those of their block.
struct Round<'a> {
    level: CpuLevel,
    blocks: &'a [Block],
    effort: &'a Effort,
    promises: &'a [Promises],
    rank: usize,
    best: &'a mut [Best],
}

impl Round<'_> {
    /// Tries those of a mode, number `list` of those that are tried.
    fn try_mode<M: Mode>(&mut self, list: usize) {
        if self.rank >= self.effort.tried[list] {
            return;
        }
        let promised = |block: usize| self.promises[block / LANES][list][self.rank][block % LANES];
        let wanted: Vec<(usize, usize)> = (0..self.blocks.len())
            .filter(|&block| promised(block) < self.best[block].error)
            .map(|block| (block, partition_of(promised(block))))
            .collect();
        let mut texels = [[[0.0; LANES]; 3]; TEXELS];
        let mut parting = [0; LANES];
        for wanted in wanted.chunks(LANES) {
            gather(wanted.iter().map(|(block, _)| &self.blocks[*block]), &mut texels);
            for (parting, (_, partition)) in parting.iter_mut().zip(wanted) {
                *parting = parting_of::<M>(*partition);
            }
            let blocks = Blocks { texels: &texels, effort: self.effort };
            let found = self.level.run(OfMode { blocks, parting, mode: PhantomData::<M> });
            for (lane, (block, partition)) in wanted.iter().enumerate() {
                self.best[*block].keep_better::<M>(*partition, &found, lane);
            }
        }
    }
}

/// Puts blocks side by side; what lanes beyond them held stays.
fn gather<'a>(blocks: impl Iterator<Item = &'a Block>, texels: &mut Texels) {
    for (lane, block) in blocks.enumerate() {
        for (texel, values) in texels.iter_mut().zip(block.as_chunks::<3>().0) {
            for c in 0..3 {
                texel[c][lane] = values[c];
            }
        }
    }
}

struct Blocks<'a> {
    /// 0..255.
    texels: &'a Texels,
    effort: &'a Effort,
}

/// The best ends in a mode for a way to part each block.
struct OfMode<'a, M> {
    blocks: Blocks<'a>,
    /// As of [`parting_of`].
    parting: [u32; LANES],
    mode: PhantomData<M>,
}

/// What was found in a mode.
struct Found {
    error: Lanes,
    /// By subset.
    codes: [Ends; 3],
}

/// The best ends of a subset, in codes.
struct Fit {
    error: Lanes,
    codes: Ends,
}

/// What texels of a subset are together.
struct Subset<'a> {
    mask: &'a Mask,
    count: Lanes,
    totals: [Lanes; 3],
}

/// What the nearest colours between two ends make of a subset.
struct Sums {
    error: Lanes,
    /// Of weights of the second end, and of their squares.
    weights: Lanes,
    squares: Lanes,
    /// By channel: of weights times texels.
    products: [Lanes; 3],
}

impl<M: Mode> Vectorized for OfMode<'_, M> {
    type Output = Found;

    // Loops, as closures would be compiled without the level's instructions.
    #[inline(always)]
    fn run(self) -> Found {
        let mut found = Found { error: [0.0; LANES], codes: [[[[0.0; LANES]; 3]; 2]; 3] };
        for subset in 0..M::SUBSETS {
            let mut mask = [[0.0; LANES]; TEXELS];
            for texel in 0..TEXELS {
                for i in 0..LANES {
                    let is_in = subset_in::<M>(self.parting[i], texel) == subset as u32;
                    mask[texel][i] = if is_in { 1.0 } else { 0.0 };
                }
            }
            let fit = self.blocks.fit::<M>(&mask);
            for i in 0..LANES {
                found.error[i] += fit.error[i];
            }
            found.codes[subset] = fit.codes;
        }
        found
    }
}

impl Blocks<'_> {
    /// The best ends of the texels that count.
    #[inline(always)]
    fn fit<M: Mode>(&self, mask: &Mask) -> Fit {
        let mut subset = Subset { mask, count: [0.0; LANES], totals: [[0.0; LANES]; 3] };
        for (texel, mask) in self.texels.iter().zip(mask) {
            for i in 0..LANES {
                subset.count[i] += mask[i];
                subset.totals[0][i] += mask[i] * texel[0][i];
                subset.totals[1][i] += mask[i] * texel[1][i];
                subset.totals[2][i] += mask[i] * texel[2][i];
            }
        }
        let mut means = [[0.0; LANES]; 3];
        for c in 0..3 {
            for i in 0..LANES {
                means[c][i] = subset.totals[c][i] / subset.count[i];
            }
        }
        let (axis, range) = self.line(mask, &means);
        let mut best = Fit { error: [f32::INFINITY; LANES], codes: [[[0.0; LANES]; 3]; 2] };
        // Of texels that are nearly the same: the codes around their mean.
        let mut around = [[[0.0; LANES]; 3]; 2];
        let half = 0.49 * M::STRIDE * 255.0 / most::<M>();
        for c in 0..3 {
            for i in 0..LANES {
                around[0][c][i] = code::<M>(means[c][i] - half, M::PARITIES[0][0]);
                around[1][c][i] = code::<M>(means[c][i] + half, M::PARITIES[0][1]);
            }
        }
        self.try_codes::<M>(&subset, &around, &mut best);
        let insets = if M::SUBSETS == 1 { self.effort.insets_of_one } else { self.effort.insets };
        for (low, high) in insets.iter().flat_map(|low| insets.iter().map(move |high| (low, high))) {
            let ends = ends_on_axis(&means, &axis, &range, [*low, *high]);
            let mut sums = self.sums::<M>(mask, &ends);
            for _ in 0..self.effort.turns {
                let codes = refitted::<M>(&subset, &sums, &ends);
                sums = self.try_codes::<M>(&subset, &codes, &mut best);
            }
        }
        best
    }

    /// The principal axis of the texels that count, and their least and largest place along it from the mean.
    #[inline(always)]
    fn line(&self, mask: &Mask, means: &[Lanes; 3]) -> ([Lanes; 3], [Lanes; 2]) {
        let axis = principal_axis(&moments_of(self.texels, mask, means));
        // The mean is among them: others count as there.
        let mut range = [[0.0f32; LANES]; 2];
        for (texel, mask) in self.texels.iter().zip(mask) {
            for i in 0..LANES {
                let [x, y, z] =
                    [texel[0][i] - means[0][i], texel[1][i] - means[1][i], texel[2][i] - means[2][i]];
                let place = mask[i] * (axis[0][i] * x + axis[1][i] * y + axis[2][i] * z);
                range[0][i] = if place < range[0][i] { place } else { range[0][i] };
                range[1][i] = if place > range[1][i] { place } else { range[1][i] };
            }
        }
        (axis, range)
    }

    /// What the nearest colours make of ends, 0..255.
    #[inline(always)]
    fn sums<M: Mode>(&self, mask: &Mask, ends: &Ends) -> Sums {
        let steps = M::STEPS as f32;
        let mut along = [[0.0; LANES]; 3];
        for i in 0..LANES {
            let x = ends[1][0][i] - ends[0][0][i];
            let y = ends[1][1][i] - ends[0][1][i];
            let z = ends[1][2][i] - ends[0][2][i];
            let square = x * x + y * y + z * z;
            let inverse = if square > 0.0 { steps / square } else { 0.0 };
            along[0][i] = x * inverse;
            along[1][i] = y * inverse;
            along[2][i] = z * inverse;
        }
        let mut sums = Sums {
            error: [0.0; LANES],
            weights: [0.0; LANES],
            squares: [0.0; LANES],
            products: [[0.0; LANES]; 3],
        };
        for (texel, mask) in self.texels.iter().zip(mask) {
            for i in 0..LANES {
                let from =
                    [texel[0][i] - ends[0][0][i], texel[1][i] - ends[0][1][i], texel[2][i] - ends[0][2][i]];
                let place = from[0] * along[0][i] + from[1] * along[1][i] + from[2] * along[2][i];
                let w = weight::<M>(nearest(limited(place, steps)));
                let x = texel[0][i] - rounded(ends[0][0][i] + w * (ends[1][0][i] - ends[0][0][i]));
                let y = texel[1][i] - rounded(ends[0][1][i] + w * (ends[1][1][i] - ends[0][1][i]));
                let z = texel[2][i] - rounded(ends[0][2][i] + w * (ends[1][2][i] - ends[0][2][i]));
                let error = x * x + y * y + z * z;
                // Of one subset every texel is.
                let (w, error) = if M::SUBSETS == 1 { (w, error) } else { (mask[i] * w, mask[i] * error) };
                sums.error[i] += error;
                sums.weights[i] += w;
                sums.squares[i] += w * w;
                sums.products[0][i] += w * texel[0][i];
                sums.products[1][i] += w * texel[1][i];
                sums.products[2][i] += w * texel[2][i];
            }
        }
        sums
    }

    /// Keeps codes of ends where they are better than the best.
    #[inline(always)]
    fn try_codes<M: Mode>(&self, subset: &Subset<'_>, codes: &Ends, best: &mut Fit) -> Sums {
        let mut ends = [[[0.0; LANES]; 3]; 2];
        for end in 0..2 {
            for c in 0..3 {
                for i in 0..LANES {
                    ends[end][c][i] = value::<M>(codes[end][c][i]);
                }
            }
        }
        let sums = self.sums::<M>(subset.mask, &ends);
        keep_better(&sums.error, codes, &mut best.error, &mut best.codes);
        sums
    }
}

/// Codes of least squared error for given weights, of those around the best real ends; those of the ends themselves where all texels have
/// the same weight.
#[inline(always)]
fn refitted<M: Mode>(subset: &Subset<'_>, sums: &Sums, ends: &Ends) -> Ends {
    let (mut aa, mut ab, mut skew) = ([0.0; LANES], [0.0; LANES], [0.0; LANES]);
    let mut real = *ends;
    for i in 0..LANES {
        let bb = sums.squares[i];
        ab[i] = sums.weights[i] - bb;
        aa[i] = subset.count[i] - 2.0 * sums.weights[i] + bb;
        let determinant = aa[i] * bb - ab[i] * ab[i];
        let is_line = determinant > 1e-3;
        let inverse = 1.0 / if is_line { determinant } else { 1.0 };
        skew[i] = if is_line { ab[i] / bb } else { 0.0 };
        for c in 0..3 {
            let (bx, ax) = (sums.products[c][i], subset.totals[c][i] - sums.products[c][i]);
            real[0][c][i] = if is_line { (ax * bb - bx * ab[i]) * inverse } else { ends[0][c][i] };
            real[1][c][i] = if is_line { (bx * aa[i] - ax * ab[i]) * inverse } else { ends[1][c][i] };
        }
    }
    let mut codes = [[[0.0; LANES]; 3]; 2];
    let mut least = [f32::INFINITY; LANES];
    for &[first_parity, second_parity] in M::PARITIES {
        let mut own = [[[0.0; LANES]; 3]; 2];
        let mut error = [0.0f32; LANES];
        for c in 0..3 {
            for i in 0..LANES {
                let (first, second) = (real[0][c][i], real[1][c][i]);
                let near = code::<M>(first, first_parity);
                let (mut a, mut b, mut of_channel) = (near, near, f32::INFINITY);
                // The codes on both sides of the first end, each with the best second one.
                let aside = if value::<M>(near) < first { M::STRIDE } else { -M::STRIDE };
                for step in [0.0, aside] {
                    let x = kept::<M>(near + step, first_parity);
                    let u = value::<M>(x) - first;
                    let y = code::<M>(second - skew[i] * u, second_parity);
                    let v = value::<M>(y) - second;
                    let error = aa[i] * u * u + 2.0 * ab[i] * u * v + sums.squares[i] * v * v;
                    let better = error < of_channel;
                    of_channel = if better { error } else { of_channel };
                    a = if better { x } else { a };
                    b = if better { y } else { b };
                }
                own[0][c][i] = a;
                own[1][c][i] = b;
                error[i] += of_channel;
            }
        }
        keep_better(&error, &own, &mut least, &mut codes);
    }
    codes
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::block::side_by_side::tests::row;

    #[test]
    fn every_level_finds_the_same_and_decoders_find_what_it_says() {
        let texels = row(6 * LANES);
        let row = BlockRow { texels: &texels, width: 4 * 6 * LANES, channels: 3 };
        let blocks = blocks_of(&row);
        let mut modes = [0; 8];
        for quality in Quality::all() {
            let expected = search(CpuLevel::BASELINE, &blocks, &effort(quality));
            for level in CpuLevel::available() {
                let others = search(level, &blocks, &effort(quality));
                for (block, (other, expected)) in blocks.iter().zip(others.iter().zip(&expected)) {
                    assert_eq!(other.block(block), expected.block(block), "{}", level.name());
                }
            }
            for (block, found) in blocks.iter().zip(&expected) {
                let mut decoded = [0; 64];
                bcdec_rs::bc7(&found.block(block), &mut decoded, 16);
                let mut error = 0.0;
                for (values, codes) in block.chunks_exact(3).zip(decoded.chunks_exact(4)) {
                    assert!(codes[3] >= 254, "opaque");
                    error += (0..3).map(|c| (f32::from(codes[c]) - values[c]).powi(2)).sum::<f32>();
                }
                modes[found.mode] += 1;
                let said = found.error;
                assert!((error - said).abs() < 0.1 + 1e-4 * said, "mode {}: {error}, not {said}", found.mode);
            }
        }
        assert!([0, 1, 2, 3, 6].iter().all(|&mode| modes[mode] > 0), "{modes:?}");
    }

    #[test]
    fn blocks_do_not_depend_on_their_neighbours() {
        let texels = row(37);
        let coding = BlockCoding::default();
        let mut all = vec![0; 37 * 16];
        bc7(BlockRow { texels: &texels, width: 4 * 37, channels: 3 }, coding, &mut all);
        for (block, expected) in all.chunks_exact(16).enumerate() {
            let alone: Vec<f32> =
                (0..4).flat_map(|y| texels[(y * 4 * 37 + 4 * block) * 3..][..12].to_vec()).collect();
            let mut found = [0; 16];
            bc7(BlockRow { texels: &alone, width: 4, channels: 3 }, coding, &mut found);
            assert_eq!(found, expected, "{block}");
        }
    }
}
