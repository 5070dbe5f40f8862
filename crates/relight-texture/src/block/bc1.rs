//! BC1, and the colours of BC3: four colours evenly spaced between two ends of 5:6:5 bits, or three in BC1.
//!
//! An own encoder of many blocks side by side: ends along the principal axis, then in turns the nearest colour for each texel and,
//! by least squares over whole codes, the best ends for that. Blocks do not depend on each other nor on how wide vectors are.
//! Source of the format: Microsoft, *Texture Block Compression in Direct3D 10*; of the turns: Brown, *squish* (2006), where ends are not
//! yet codes.

#![expect(clippy::needless_range_loop, reason = "a lane of several rows at once")]

use super::encode::BlockRow;
use super::side_by_side::{
    Ends, LANES, Lanes, TEXELS, Texels, ends_on_axis, gather, keep_better, limited, moments_of, nearest,
    principal_axis,
};
use super::{BlockCoding, Quality, bc4};
use relight_core::{CpuLevel, Vectorized};

/// The largest code of each channel.
const MOST: [f32; 3] = [31.0, 63.0, 31.0];

/// How hard to look.
struct Effort {
    /// How much of the range along the axis is cut off at its start and at its end to begin with, all pairs of these.
    insets: &'static [f32],
    /// Turns of texels and ends.
    turns: usize,
    /// Rounds in which each code of the ends is moved by one.
    moves: usize,
    /// Whether three colours are tried where they can be had.
    three: bool,
}

fn effort(quality: Quality) -> Effort {
    match quality {
        Quality::Fast => Effort { insets: &[0.0625], turns: 2, moves: 0, three: false },
        Quality::Normal => Effort { insets: &[0.0, 0.15], turns: 2, moves: 0, three: false },
        Quality::High => Effort { insets: &[0.0, 0.125, 0.25], turns: 3, moves: 1, three: true },
        Quality::Best => Effort { insets: &[-0.1, 0.0, 0.1, 0.2, 0.3, 0.4], turns: 4, moves: 6, three: true },
    }
}

pub(super) fn bc1(row: BlockRow<'_>, coding: BlockCoding, out: &mut [u8]) {
    encode::<8>(&row, &effort(coding.quality), 0, out);
}

pub(super) fn bc3(row: BlockRow<'_>, coding: BlockCoding, out: &mut [u8]) {
    encode::<16>(&row, &Effort { three: false, ..effort(coding.quality) }, 8, out);
    for (texels, block) in row.blocks::<64>().zip(out.chunks_exact_mut(16)) {
        let fourth = std::array::from_fn(|i| texels[4 * i + 3]);
        block[..8].copy_from_slice(&bc4::encode(fourth, false, coding.quality));
    }
}

/// Puts the colours of a row of blocks at `offset` of blocks of `BYTES`.
fn encode<const BYTES: usize>(row: &BlockRow<'_>, effort: &Effort, offset: usize, out: &mut [u8]) {
    let level = CpuLevel::detect();
    let mut texels = [[[0.0; LANES]; 3]; TEXELS];
    for (index, out) in out.chunks_mut(LANES * BYTES).enumerate() {
        gather(row, index, out.len() / BYTES, &mut texels);
        let found = level.run(Blocks { texels: &texels, effort });
        for (lane, block) in out.chunks_exact_mut(BYTES).enumerate() {
            block[offset..offset + 8].copy_from_slice(&found.block(lane));
        }
    }
}

struct Blocks<'a> {
    /// By texel and channel, 0..1.
    texels: &'a Texels,
    effort: &'a Effort,
}

/// The best of each block.
struct Found {
    error: Lanes,
    /// Whole codes.
    ends: Ends,
    /// From one end to the other: 3, or 2.
    steps: Lanes,
    /// Both ends as they are stored, the first in the lower half.
    words: [u32; LANES],
    /// Those of the texels, the first lowest.
    indices: [u32; LANES],
}

/// What the nearest steps between two ends make of a block.
struct Sums {
    error: Lanes,
    /// Of steps, and of their squares.
    steps: Lanes,
    squares: Lanes,
    /// By channel: of steps times texels.
    products: [Lanes; 3],
}

impl Vectorized for Blocks<'_> {
    type Output = Found;

    #[inline(always)]
    fn run(self) -> Found {
        let mut totals = [[0.0; LANES]; 3];
        for texel in self.texels {
            for (total, values) in totals.iter_mut().zip(texel) {
                for i in 0..LANES {
                    total[i] += values[i];
                }
            }
        }
        let mut means = totals;
        for mean in &mut means {
            for i in 0..LANES {
                mean[i] /= TEXELS as f32;
            }
        }
        let axis = principal_axis(&moments_of(self.texels, &[[1.0; LANES]; TEXELS], &means));
        let range = self.range(&totals, &axis);
        let mut best = self.best::<3>(&totals, &means, &axis, &range);
        if self.effort.three {
            let other = self.best::<2>(&totals, &means, &axis, &range);
            for i in 0..LANES {
                best.steps[i] = if other.error[i] < best.error[i] { 2.0 } else { 3.0 };
            }
            keep_better(&other.error, &other.ends, &mut best.error, &mut best.ends);
        }
        self.finish(&mut best);
        best
    }
}

impl Blocks<'_> {
    /// The least and the largest place of texels along the axis, from the mean.
    #[inline(always)]
    fn range(&self, totals: &[Lanes; 3], axis: &[Lanes; 3]) -> [Lanes; 2] {
        let mut range = [[f32::INFINITY; LANES], [f32::NEG_INFINITY; LANES]];
        for texel in self.texels {
            for i in 0..LANES {
                let place = axis[0][i] * texel[0][i] + axis[1][i] * texel[1][i] + axis[2][i] * texel[2][i];
                range[0][i] = if place < range[0][i] { place } else { range[0][i] };
                range[1][i] = if place > range[1][i] { place } else { range[1][i] };
            }
        }
        for i in 0..LANES {
            let sum = axis[0][i] * totals[0][i] + axis[1][i] * totals[1][i] + axis[2][i] * totals[2][i];
            range[0][i] -= sum / TEXELS as f32;
            range[1][i] -= sum / TEXELS as f32;
        }
        range
    }

    /// The best ends for so many steps between them.
    #[inline(always)]
    fn best<const STEPS: usize>(
        &self,
        totals: &[Lanes; 3],
        means: &[Lanes; 3],
        axis: &[Lanes; 3],
        range: &[Lanes; 2],
    ) -> Found {
        let mut best = Found {
            error: [f32::INFINITY; LANES],
            ends: [[[0.0; LANES]; 3]; 2],
            steps: [STEPS as f32; LANES],
            words: [0; LANES],
            indices: [0; LANES],
        };
        self.try_ends::<STEPS>(&flat::<STEPS>(totals), &mut best);
        let insets = self.effort.insets;
        for (low, high) in insets.iter().flat_map(|low| insets.iter().map(move |high| (low, high))) {
            let mut ends = ends_on_axis(means, axis, range, [*low, *high]);
            for end in &mut ends {
                for c in 0..3 {
                    for i in 0..LANES {
                        end[c][i] *= MOST[c];
                    }
                }
            }
            let mut sums = self.sums::<STEPS>(&ends);
            for _ in 0..self.effort.turns {
                ends = refitted::<STEPS>(totals, &sums, &ends);
                sums = self.try_ends::<STEPS>(&ends, &mut best);
            }
        }
        for _ in 0..self.effort.moves {
            for end in 0..2 {
                for c in 0..3 {
                    for step in [-1.0, 1.0] {
                        let mut ends = best.ends;
                        for code in &mut ends[end][c] {
                            *code = limited(*code + step, MOST[c]);
                        }
                        self.try_ends::<STEPS>(&ends, &mut best);
                    }
                }
            }
        }
        best
    }

    /// Finds what is stored of the best ends.
    #[inline(always)]
    fn finish(&self, best: &mut Found) {
        let line = Line::new(&best.ends, &best.steps);
        let mut turned = [0.0; LANES];
        for i in 0..LANES {
            let [a, b] = &best.ends;
            let first = (a[0][i] as u32) << 11 | (a[1][i] as u32) << 5 | a[2][i] as u32;
            let second = (b[0][i] as u32) << 11 | (b[1][i] as u32) << 5 | b[2][i] as u32;
            // Four colours are told by the larger end coming first.
            let turn = (first < second) == (best.steps[i] == 3.0);
            turned[i] = if turn { best.steps[i] } else { 0.0 };
            best.words[i] = if turn { second | first << 16 } else { first | second << 16 };
        }
        for (texel, values) in self.texels.iter().enumerate() {
            for i in 0..LANES {
                let step = (line.place(values, i).0 - turned[i]).abs();
                // Index 1 is the other end; those between follow. Of equal ends 0 is right.
                let index = if step == best.steps[i] { 1 } else { step as u32 + u32::from(step > 0.0) };
                let is_flat = best.words[i] >> 16 == best.words[i] & 0xffff;
                best.indices[i] |= if is_flat { 0 } else { index << (2 * texel) };
            }
        }
    }

    /// What the nearest steps make of ends in codes, whole or not.
    #[inline(always)]
    fn sums<const STEPS: usize>(&self, ends: &Ends) -> Sums {
        let line = Line::new(ends, &[STEPS as f32; LANES]);
        let mut sums = Sums {
            error: [0.0; LANES],
            steps: [0.0; LANES],
            squares: [0.0; LANES],
            products: [[0.0; LANES]; 3],
        };
        for texel in self.texels {
            for i in 0..LANES {
                let (k, from) = line.place(texel, i);
                let x = from[0] - k * line.step[0][i];
                let y = from[1] - k * line.step[1][i];
                let z = from[2] - k * line.step[2][i];
                sums.error[i] += x * x + y * y + z * z;
                sums.steps[i] += k;
                sums.squares[i] += k * k;
                sums.products[0][i] += k * texel[0][i];
                sums.products[1][i] += k * texel[1][i];
                sums.products[2][i] += k * texel[2][i];
            }
        }
        sums
    }

    /// Keeps ends of whole codes where they are better than the best.
    #[inline(always)]
    fn try_ends<const STEPS: usize>(&self, ends: &Ends, best: &mut Found) -> Sums {
        let sums = self.sums::<STEPS>(ends);
        keep_better(&sums.error, ends, &mut best.error, &mut best.ends);
        sums
    }
}

/// The line between two ends: values 0..1.
struct Line {
    start: [Lanes; 3],
    step: [Lanes; 3],
    /// What a difference from the start is multiplied by to give steps; 0 where the ends meet.
    along: [Lanes; 3],
    steps: Lanes,
}

impl Line {
    #[inline(always)]
    fn new(ends: &Ends, steps: &Lanes) -> Self {
        let mut line = Self {
            start: [[0.0; LANES]; 3],
            step: [[0.0; LANES]; 3],
            along: [[0.0; LANES]; 3],
            steps: *steps,
        };
        let mut square = [0.0f32; LANES];
        for c in 0..3 {
            for i in 0..LANES {
                let step = (ends[1][c][i] - ends[0][c][i]) / (steps[i] * MOST[c]);
                line.start[c][i] = ends[0][c][i] / MOST[c];
                line.step[c][i] = step;
                square[i] += step * step;
            }
        }
        for c in 0..3 {
            for i in 0..LANES {
                let inverse = if square[i] > 0.0 { 1.0 / square[i] } else { 0.0 };
                line.along[c][i] = line.step[c][i] * inverse;
            }
        }
        line
    }

    /// The nearest step to a texel of block `i`, and how far the texel is from the start.
    #[inline(always)]
    fn place(&self, texel: &[Lanes; 3], i: usize) -> (f32, [f32; 3]) {
        let from =
            [texel[0][i] - self.start[0][i], texel[1][i] - self.start[1][i], texel[2][i] - self.start[2][i]];
        let along = from[0] * self.along[0][i] + from[1] * self.along[1][i] + from[2] * self.along[2][i];
        (nearest(limited(along, self.steps[i])), from)
    }
}

/// Ends whose first step is the mean, to a step of one code: ends that are equal or a code apart.
#[inline(always)]
fn flat<const STEPS: usize>(totals: &[Lanes; 3]) -> Ends {
    let mut ends = [[[0.0; LANES]; 3]; 2];
    let count = STEPS as f32;
    for c in 0..3 {
        for i in 0..LANES {
            let steps = nearest(totals[c][i] * (count * MOST[c] / TEXELS as f32));
            let code = nearest(steps / count);
            ends[0][c][i] = code;
            ends[1][c][i] = limited(code + (steps - count * code), MOST[c]);
        }
    }
    ends
}

/// Whole codes of least squared error for given steps, of those around the best real ones; the old ends, rounded, where all texels have
/// the same.
#[inline(always)]
fn refitted<const STEPS: usize>(totals: &[Lanes; 3], sums: &Sums, old: &Ends) -> Ends {
    let mut ends = *old;
    let count = STEPS as f32;
    for c in 0..3 {
        for i in 0..LANES {
            // Sums of squares and products of 1 - k / STEPS and k / STEPS, and of these with texels in codes.
            let bb = sums.squares[i] / (count * count);
            let ab = sums.steps[i] / count - bb;
            let aa = TEXELS as f32 - 2.0 * sums.steps[i] / count + bb;
            let bx = sums.products[c][i] * (MOST[c] / count);
            let ax = totals[c][i] * MOST[c] - bx;
            let determinant = aa * bb - ab * ab;
            let is_line = determinant > 1e-2;
            let inverse = 1.0 / if is_line { determinant } else { 1.0 };
            let first = if is_line { (ax * bb - bx * ab) * inverse } else { old[0][c][i] };
            let second = if is_line { (bx * aa - ax * ab) * inverse } else { old[1][c][i] };
            // Of two ways the better: round one end and take the best whole code for the other beside it.
            let for_second = if is_line { ab / bb } else { 0.0 };
            let for_first = if is_line { ab / aa } else { 0.0 };
            let a0 = nearest(limited(first, MOST[c]));
            let b0 = nearest(limited(second - for_second * (a0 - first), MOST[c]));
            let b1 = nearest(limited(second, MOST[c]));
            let a1 = nearest(limited(first - for_first * (b1 - second), MOST[c]));
            let (u, v) = (a0 - first, b0 - second);
            let error = aa * u * u + 2.0 * ab * u * v + bb * v * v;
            let (u, v) = (a1 - first, b1 - second);
            let other = aa * u * u + 2.0 * ab * u * v + bb * v * v;
            let a = if other < error { a1 } else { a0 };
            let b = if other < error { b1 } else { b0 };
            ends[0][c][i] = a;
            ends[1][c][i] = b;
        }
    }
    ends
}

impl Found {
    /// The bytes of a block.
    fn block(&self, lane: usize) -> [u8; 8] {
        (u64::from(self.words[lane]) | u64::from(self.indices[lane]) << 32).to_le_bytes()
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::block::side_by_side::tests::row;

    /// As the format says it, without rounding: BC1's colours of a block, R, G, B.
    fn decoded(block: &[u8]) -> [[f32; 3]; TEXELS] {
        let bits = u64::from_le_bytes(block.try_into().unwrap());
        let ends = [bits & 0xffff, bits >> 16 & 0xffff];
        let colors = ends.map(|end| [end >> 11, end >> 5 & 63, end & 31].map(|code| code as f32));
        std::array::from_fn(|texel| {
            let share = match (bits >> (32 + 2 * texel) & 3, ends[0] > ends[1]) {
                (0, _) => 0.0,
                (1, _) => 1.0,
                (2, true) => 1.0 / 3.0,
                (3, true) => 2.0 / 3.0,
                (2, false) => 0.5,
                _ => panic!("black that is no colour of ours"),
            };
            std::array::from_fn(|c| (colors[0][c] + share * (colors[1][c] - colors[0][c])) / MOST[c])
        })
    }

    #[test]
    fn every_level_finds_the_same_and_what_it_says() {
        let texels = row(LANES);
        let mut blocks = [[[0.0; LANES]; 3]; TEXELS];
        for (texel, values) in blocks.iter_mut().enumerate() {
            for c in 0..3 {
                values[c] = std::array::from_fn(|lane| {
                    texels[(texel / 4 * 4 * LANES + 4 * lane + texel % 4) * 3 + c]
                });
            }
        }
        for quality in Quality::all() {
            let found = |level: CpuLevel| level.run(Blocks { texels: &blocks, effort: &effort(quality) });
            let expected = found(CpuLevel::BASELINE);
            for level in CpuLevel::available() {
                let other = found(level);
                for lane in 0..LANES {
                    assert_eq!(other.block(lane), expected.block(lane), "{} {lane}", level.name());
                }
            }
            for lane in 0..LANES {
                let colors = decoded(&expected.block(lane));
                let mut error = 0.0;
                for (texel, color) in colors.iter().enumerate() {
                    error += (0..3).map(|c| (color[c] - blocks[texel][c][lane]).powi(2)).sum::<f32>();
                }
                assert!((error - expected.error[lane]).abs() < 1e-4 * (1.0 + error), "{quality:?} {lane}");
            }
        }
    }

    #[test]
    fn three_colours_are_found_in_bc1_and_never_made_of_bc3() {
        let texels = row(60);
        let coding = BlockCoding { quality: Quality::High, ..BlockCoding::default() };
        let (mut bc1_blocks, mut bc3_blocks) = (vec![0; 60 * 8], vec![0; 60 * 16]);
        bc1(BlockRow { texels: &texels, width: 240, channels: 3 }, coding, &mut bc1_blocks);
        let four: Vec<f32> = texels.chunks_exact(3).flat_map(|t| [t[0], t[1], t[2], 1.0]).collect();
        bc3(BlockRow { texels: &four, width: 240, channels: 4 }, coding, &mut bc3_blocks);
        let is_three = |block: &[u8]| block[..2].iter().rev().le(block[2..4].iter().rev());
        let three = bc1_blocks.chunks_exact(8).filter(|block| is_three(block) && block[4..] != [0; 4]);
        assert!(three.count() > 5);
        let three = bc3_blocks.chunks_exact(16).map(|block| &block[8..]);
        assert_eq!(three.filter(|block| is_three(block) && block[4..] != [0; 4]).count(), 0);
    }

    #[test]
    fn blocks_do_not_depend_on_their_neighbours() {
        let texels = row(37);
        let coding = BlockCoding::default();
        let mut all = vec![0; 37 * 8];
        bc1(BlockRow { texels: &texels, width: 4 * 37, channels: 3 }, coding, &mut all);
        for (block, expected) in all.chunks_exact(8).enumerate() {
            let alone: Vec<f32> =
                (0..4).flat_map(|y| texels[(y * 4 * 37 + 4 * block) * 3..][..12].to_vec()).collect();
            let mut found = [0; 8];
            bc1(BlockRow { texels: &alone, width: 4, channels: 3 }, coding, &mut found);
            assert_eq!(found, expected, "{block}");
        }
    }
}
