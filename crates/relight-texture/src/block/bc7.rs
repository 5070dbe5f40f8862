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

use super::encode::BlockRow;
use super::side_by_side::{
    Ends, LANES, Lanes, Mask, TEXELS, Texels, beside_axis, ends_on_axis, gather, keep_better, limited,
    moments_of, nearest, principal_axis,
};
use super::{BlockCoding, Quality};
use modes::{Mode, Mode0, Mode1, Mode2, Mode3, Mode6, code, kept, most, rounded, subset_of, value, weight};
use partitions::{THREE, TWO};
use relight_core::{CpuLevel, Vectorized};

/// Ways to part a block that mode 0 can name.
const MODE_0_PARTITIONS: usize = 16;

/// Most ways to part a block that are tried in a mode.
const MOST_TRIED: usize = 16;

/// How hard to look.
struct Effort {
    /// How much of the range along the axis is cut off at its start and at its end to begin with, all pairs of these.
    insets: &'static [f32],
    /// The same of one line, mode 6.
    insets_of_one: &'static [f32],
    /// Turns of texels and ends.
    turns: usize,
    /// How many ways to part the block are tried in modes 1, 3, 0 and 2.
    tried: [usize; 4],
}

fn effort(quality: Quality) -> Effort {
    match quality {
        Quality::Fast => {
            Effort { insets: &[0.0], insets_of_one: &[-0.02, 0.02], turns: 1, tried: [1, 0, 0, 0] }
        }
        Quality::Normal => {
            Effort { insets: &[0.0], insets_of_one: &[-0.03, 0.03], turns: 2, tried: [3, 3, 0, 0] }
        }
        Quality::High => {
            Effort { insets: &[0.0], insets_of_one: &[-0.04, 0.0, 0.04], turns: 2, tried: [12, 16, 4, 4] }
        }
        Quality::Best => Effort {
            insets: &[0.0, 0.12],
            insets_of_one: &[-0.1, -0.05, 0.0, 0.05, 0.1],
            turns: 4,
            tried: [16, 16, 8, 16],
        },
    }
}

pub(super) fn bc7(row: BlockRow<'_>, coding: BlockCoding, out: &mut [u8]) {
    let level = CpuLevel::detect();
    let effort = effort(coding.quality);
    let mut texels = [[[0.0; LANES]; 3]; TEXELS];
    for (index, out) in out.chunks_mut(LANES * 16).enumerate() {
        gather(&row, index, out.len() / 16, 255.0, &mut texels);
        let found = level.run(Blocks { texels: &texels, effort: &effort });
        for (lane, block) in out.chunks_exact_mut(16).enumerate() {
            block.copy_from_slice(&found.block(lane, &texels));
        }
    }
}

struct Blocks<'a> {
    /// 0..255.
    texels: &'a Texels,
    effort: &'a Effort,
}

/// The best of each block.
struct Found {
    error: Lanes,
    mode: [usize; LANES],
    partition: [usize; LANES],
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

impl Vectorized for Blocks<'_> {
    type Output = Found;

    // Loops, as closures would be compiled without the level's instructions.
    #[inline(always)]
    fn run(self) -> Found {
        let mut best = Found {
            error: [f32::INFINITY; LANES],
            mode: [0; LANES],
            partition: [0; LANES],
            codes: [[[[0.0; LANES]; 3]; 2]; 3],
        };
        self.try_mode::<Mode6>(&[0; LANES], &mut best);
        let [of_1, of_3, of_0, of_2] = self.effort.tried;
        if of_1.max(of_3) > 0 {
            let closest = self
                .closest::<2>(TWO.len(), of_1.max(of_3), |partition, texel| TWO[partition].0 >> texel & 1);
            for partition in &closest[..of_1] {
                self.try_mode::<Mode1>(partition, &mut best);
            }
            for partition in &closest[..of_3] {
                self.try_mode::<Mode3>(partition, &mut best);
            }
        }
        let of_three = |partition: usize, texel: usize| (THREE[partition].0 >> (2 * texel) & 3) as u16;
        if of_0 > 0 {
            let closest = self.closest::<3>(MODE_0_PARTITIONS, of_0, of_three);
            for partition in &closest[..of_0] {
                self.try_mode::<Mode0>(partition, &mut best);
            }
        }
        if of_2 > 0 {
            let closest = self.closest::<3>(THREE.len(), of_2, of_three);
            for partition in &closest[..of_2] {
                self.try_mode::<Mode2>(partition, &mut best);
            }
        }
        best
    }
}

impl Blocks<'_> {
    /// The ways to part each block, of the first `count`, whose subsets lie closest to lines: so many `tried`, the closest first.
    #[inline(always)]
    fn closest<const SUBSETS: usize>(
        &self,
        count: usize,
        tried: usize,
        subset_of: impl Fn(usize, usize) -> u16,
    ) -> [[usize; LANES]; MOST_TRIED] {
        // Of each texel: R, G, B and their products. In f32 about the block's mean, or squares would drown what varies.
        let mut products: [Products; TEXELS] = [[[0.0; LANES]; 9]; TEXELS];
        let mut means = [[0.0; LANES]; 3];
        for texel in self.texels {
            for c in 0..3 {
                for i in 0..LANES {
                    means[c][i] += texel[c][i] / TEXELS as f32;
                }
            }
        }
        for (texel, products) in self.texels.iter().zip(&mut products) {
            for i in 0..LANES {
                let [x, y, z] =
                    [texel[0][i] - means[0][i], texel[1][i] - means[1][i], texel[2][i] - means[2][i]];
                products[0][i] = x;
                products[1][i] = y;
                products[2][i] = z;
                products[3][i] = x * x;
                products[4][i] = x * y;
                products[5][i] = x * z;
                products[6][i] = y * y;
                products[7][i] = y * z;
                products[8][i] = z * z;
            }
        }
        let (totals, _) = sums_of(&products, |_| true);
        /// Bits of a score that hold a number.
        const NUMBERS: u32 = 63;
        let mut least = [[f32::INFINITY; LANES]; MOST_TRIED];
        for partition in 0..count {
            let mut score = [0.0; LANES];
            let mut rest = totals;
            let mut rest_count = TEXELS;
            for subset in 1..=SUBSETS {
                // The last subset is what is left.
                let mut sums = rest;
                let mut texels = rest_count;
                if subset < SUBSETS {
                    let of_subset = |texel: usize| usize::from(subset_of(partition, texel)) == subset;
                    (sums, texels) = sums_of(&products, of_subset);
                    for (rest, sum) in rest.iter_mut().zip(&sums) {
                        for i in 0..LANES {
                            rest[i] -= sum[i];
                        }
                    }
                    rest_count -= texels;
                }
                let moments = moments_about_mean(&sums, texels);
                beside_axis(&moments, &mut score);
            }
            // The partition's number in the last bits of its score: sorting one sorts both.
            for i in 0..LANES {
                let bits = limited(score[i], f32::MAX).to_bits() & !NUMBERS | partition as u32;
                score[i] = f32::from_bits(bits);
            }
            for least in least.iter_mut().take(tried) {
                let (new, old) = (score, *least);
                for i in 0..LANES {
                    least[i] = if new[i] < old[i] { new[i] } else { old[i] };
                }
                for i in 0..LANES {
                    score[i] = if new[i] < old[i] { old[i] } else { new[i] };
                }
            }
        }
        least.map(|row| row.map(|score| (score.to_bits() & NUMBERS) as usize))
    }

    /// Keeps a mode where it is better than the best.
    #[inline(always)]
    fn try_mode<M: Mode>(&self, partition: &[usize; LANES], best: &mut Found) {
        let mut codes = [[[[0.0; LANES]; 3]; 2]; 3];
        let mut error = [0.0f32; LANES];
        for (subset, codes) in codes.iter_mut().enumerate().take(M::SUBSETS) {
            let mut mask = [[0.0; LANES]; TEXELS];
            for (texel, mask) in mask.iter_mut().enumerate() {
                for i in 0..LANES {
                    mask[i] = f32::from(u8::from(subset_of::<M>(partition[i], texel) == subset));
                }
            }
            let fit = self.fit::<M>(&mask);
            for i in 0..LANES {
                error[i] += fit.error[i];
            }
            *codes = fit.codes;
        }
        for i in 0..LANES {
            if error[i] < best.error[i] {
                best.error[i] = error[i];
                best.mode[i] = M::NUMBER;
                best.partition[i] = partition[i];
                for (best, codes) in best.codes.iter_mut().zip(&codes) {
                    for end in 0..2 {
                        for c in 0..3 {
                            best[end][c][i] = codes[end][c][i];
                        }
                    }
                }
            }
        }
    }

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
                let w = mask[i] * w;
                sums.error[i] += mask[i] * (x * x + y * y + z * z);
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

/// Of a texel or of some: R, G, B and the products RR, RG, RB, GG, GB, BB.
type Products = [Lanes; 9];

/// The sums of some texels, and how many they are.
#[inline(always)]
fn sums_of(products: &[Products; TEXELS], is_in: impl Fn(usize) -> bool) -> (Products, usize) {
    let mut sums = [[0.0; LANES]; 9];
    let mut count = 0;
    for (texel, products) in products.iter().enumerate() {
        if !is_in(texel) {
            continue;
        }
        count += 1;
        for (sum, product) in sums.iter_mut().zip(products) {
            for i in 0..LANES {
                sum[i] += product[i];
            }
        }
    }
    (sums, count)
}

/// The moments xx, xy, xz, yy, yz, zz of `count` texels about their mean.
#[inline(always)]
fn moments_about_mean(sums: &Products, count: usize) -> [Lanes; 6] {
    let inverse = 1.0 / count as f32;
    let mut moments = [[0.0; LANES]; 6];
    for i in 0..LANES {
        let [x, y, z] = [sums[0][i], sums[1][i], sums[2][i]];
        moments[0][i] = sums[3][i] - x * x * inverse;
        moments[1][i] = sums[4][i] - x * y * inverse;
        moments[2][i] = sums[5][i] - x * z * inverse;
        moments[3][i] = sums[6][i] - y * y * inverse;
        moments[4][i] = sums[7][i] - y * z * inverse;
        moments[5][i] = sums[8][i] - z * z * inverse;
    }
    moments
}

/// Codes of least squared error for given weights, of those around the best real ends; those of the ends themselves where all texels have
/// the same weight.
#[inline(always)]
fn refitted<M: Mode>(subset: &Subset<'_>, sums: &Sums, ends: &Ends) -> Ends {
    let mut codes = [[[0.0; LANES]; 3]; 2];
    let mut least = [f32::INFINITY; LANES];
    for &[first_parity, second_parity] in M::PARITIES {
        let mut own = [[[0.0; LANES]; 3]; 2];
        let mut error = [0.0f32; LANES];
        for c in 0..3 {
            for i in 0..LANES {
                let (bb, ab) = (sums.squares[i], sums.weights[i] - sums.squares[i]);
                let aa = subset.count[i] - 2.0 * sums.weights[i] + bb;
                let (bx, ax) = (sums.products[c][i], subset.totals[c][i] - sums.products[c][i]);
                let determinant = aa * bb - ab * ab;
                let is_line = determinant > 1e-3;
                let inverse = 1.0 / if is_line { determinant } else { 1.0 };
                let first = if is_line { (ax * bb - bx * ab) * inverse } else { ends[0][c][i] };
                let second = if is_line { (bx * aa - ax * ab) * inverse } else { ends[1][c][i] };
                let skew = if is_line { ab / bb } else { 0.0 };
                let near = code::<M>(first, first_parity);
                let (mut a, mut b, mut of_channel) = (near, near, f32::INFINITY);
                // The codes on both sides of the first end, each with the best second one.
                let aside = if value::<M>(near) < first { M::STRIDE } else { -M::STRIDE };
                for step in [0.0, aside] {
                    let x = kept::<M>(near + step, first_parity);
                    let u = value::<M>(x) - first;
                    let y = code::<M>(second - skew * u, second_parity);
                    let v = value::<M>(y) - second;
                    let error = aa * u * u + 2.0 * ab * u * v + bb * v * v;
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
        let mut modes = [0; 8];
        for quality in Quality::all() {
            for index in 0..6 {
                let mut texels = [[[0.0; LANES]; 3]; TEXELS];
                gather(&row, index, LANES, 255.0, &mut texels);
                let effort = effort(quality);
                let found = |level: CpuLevel| level.run(Blocks { texels: &texels, effort: &effort });
                let expected = found(CpuLevel::BASELINE);
                for level in CpuLevel::available() {
                    let other = found(level);
                    for lane in 0..LANES {
                        let blocks = [&other, &expected].map(|found| found.block(lane, &texels));
                        assert_eq!(blocks[0], blocks[1], "{} {lane}", level.name());
                    }
                }
                for lane in 0..LANES {
                    let mut decoded = [0; 64];
                    bcdec_rs::bc7(&expected.block(lane, &texels), &mut decoded, 16);
                    let mut error = 0.0;
                    for (values, codes) in texels.iter().zip(decoded.chunks_exact(4)) {
                        assert!(codes[3] >= 254, "opaque");
                        error += (0..3).map(|c| (f32::from(codes[c]) - values[c][lane]).powi(2)).sum::<f32>();
                    }
                    let mode = expected.mode[lane];
                    modes[mode] += 1;
                    let said = expected.error[lane];
                    assert!((error - said).abs() < 0.1 + 1e-4 * said, "mode {mode}: {error}, not {said}");
                }
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
