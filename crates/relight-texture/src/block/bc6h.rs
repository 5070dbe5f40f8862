//! BC6H, both signs: an encoder that makes the error in q small, not that of the halves' bits.
//!
//! The format interpolates on a nearly logarithmic scale (`scale`), and coefficients are linear:
//! so indices are chosen by the exact decoded values, and ends are fitted with each texel's slope.
//! Integers, sums, products and square roots only: the same bytes everywhere.

mod fit;
mod modes;
mod scale;

use super::encode::BlockRow;
use super::{BlockCoding, Quality};
use fit::{Ends, Members, Texels, members};
use modes::{ANCHORS, MODES, Mode, PARTITIONS};
use scale::Scale;

/// How hard to look.
struct Effort {
    /// Rounds of indices and ends before ends become codes.
    refits: usize,
    /// Partitions into two lines that are tried.
    partitions: usize,
    /// Modes tried a line or partition, the finest that fit.
    modes: usize,
    /// Rounds of moving codes by one step.
    steps: usize,
}

fn effort(quality: Quality) -> Effort {
    match quality {
        Quality::Fast => Effort { refits: 2, partitions: 0, modes: 1, steps: 0 },
        Quality::Normal => Effort { refits: 2, partitions: 2, modes: 1, steps: 1 },
        Quality::High => Effort { refits: 2, partitions: 4, modes: 1, steps: 2 },
        Quality::Best => Effort { refits: 3, partitions: 12, modes: 2, steps: 4 },
    }
}

pub(super) fn unsigned(row: BlockRow<'_>, coding: BlockCoding, out: &mut [u8]) {
    encode(&row, Scale { signed: false }, coding, out);
}

pub(super) fn signed(row: BlockRow<'_>, coding: BlockCoding, out: &mut [u8]) {
    encode(&row, Scale { signed: true }, coding, out);
}

fn encode(row: &BlockRow<'_>, scale: Scale, coding: BlockCoding, out: &mut [u8]) {
    let effort = effort(coding.quality);
    for (texels, block) in row.blocks::<48>().zip(out.chunks_exact_mut(16)) {
        block.copy_from_slice(&encode_block(&Texels::new(&texels, scale), &effort));
    }
}

/// A block in a mode.
struct Candidate {
    error: f32,
    mode: &'static Mode,
    partition: usize,
    /// Two ends a line.
    codes: [[i32; 3]; 4],
    indices: [u8; 16],
}

fn encode_block(texels: &Texels, effort: &Effort) -> [u8; 16] {
    let mut best: Option<Candidate> = None;
    let mut keep = |found: Candidate| {
        if best.as_ref().is_none_or(|best| found.error < best.error) {
            best = Some(found);
        }
        best.as_ref().map_or(0.0, |best| best.error)
    };
    let whole = [members(u16::MAX); 2];
    let lines = [fitted::<16>(texels, &whole[0], effort)];
    let mut error = f32::INFINITY;
    for found in candidates::<16>(texels, &lines, (0, &whole), effort) {
        error = keep(found);
    }
    let mut ranked: [(f32, usize); 32] = std::array::from_fn(|p| (0.0, p));
    if effort.partitions > 0 && error > 0.0 {
        ranked = ranked.map(|(_, p)| (texels.guess(&members(PARTITIONS[p])), p));
        ranked.sort_by(|a, b| a.0.total_cmp(&b.0));
    }
    for (guess, partition) in &ranked[..effort.partitions] {
        // The guess takes the texels for evenly spread along the lines, which few blocks are.
        if error <= 0.7 * guess {
            break;
        }
        let split = [!PARTITIONS[*partition], PARTITIONS[*partition]].map(members);
        let lines = split.each_ref().map(|line| fitted::<8>(texels, line, effort));
        for found in candidates::<8>(texels, &lines, (*partition, &split), effort) {
            error = keep(found);
        }
    }
    let best = best.expect("the mode of one line without differences holds any ends");
    best.mode.block(&best.codes, best.partition, &best.indices)
}

/// Ends of a line of N colours through some of the texels.
fn fitted<const N: usize>(texels: &Texels, line: &Members, effort: &Effort) -> Ends {
    let mut ends = texels.first_ends(line);
    for _ in 0..effort.refits {
        let rounded = ends.map(|end| end.map(|position| position as i32));
        let (index, _) = texels.assign::<N>(rounded, line);
        ends = texels.refit::<N>(ends, line, &index);
    }
    ends
}

/// A partition's number and the members of its lines.
type Split<'a> = (usize, &'a [Members; 2]);

/// The lines in each of the finest modes that can hold them.
fn candidates<'a, const N: usize>(
    texels: &'a Texels,
    lines: &'a [Ends],
    split: Split<'a>,
    effort: &'a Effort,
) -> impl Iterator<Item = Candidate> + 'a {
    let modes = MODES.iter().filter(|mode| mode.lines == lines.len());
    modes.filter_map(move |mode| in_mode::<N>(texels, lines, split, mode, effort)).take(effort.modes)
}

fn in_mode<const N: usize>(
    texels: &Texels,
    lines: &[Ends],
    split: Split<'_>,
    mode: &'static Mode,
    effort: &Effort,
) -> Option<Candidate> {
    let mut codes = [[0; 3]; 4];
    for (ends, line) in codes.chunks_exact_mut(2).zip(lines) {
        for (end, position) in ends.iter_mut().zip(line) {
            *end = position.map(|position| texels.scale.code(position, mode.bits));
        }
    }
    let [a, b, ..] = codes;
    if !mode.fits(&codes) && !mode.fits(&[b, a, codes[2], codes[3]]) {
        return None;
    }
    let mut best = assigned::<N>(texels, codes, split, mode)?;
    for _ in 0..effort.steps {
        let codes = stepped::<N>(texels, &best, split.1);
        if codes == best.codes {
            break;
        }
        match assigned::<N>(texels, codes, split, mode) {
            Some(found) if found.error < best.error => best = found,
            _ => break,
        }
    }
    Some(best)
}

/// Indices for given ends, turned such that anchors are in the lower half; none when the codes do
/// not fit the mode that way round.
fn assigned<const N: usize>(
    texels: &Texels,
    mut codes: [[i32; 3]; 4],
    (partition, split): Split<'_>,
    mode: &'static Mode,
) -> Option<Candidate> {
    let (mut indices, mut error) = ([0; 16], 0.0);
    for (line, ends) in codes.chunks_exact_mut(2).take(mode.lines).enumerate() {
        let positions =
            [ends[0], ends[1]].map(|end| end.map(|code| texels.scale.position_of_code(code, mode.bits)));
        let (index, of_line) = texels.assign::<N>(positions, &split[line]);
        error += of_line;
        let anchor = if line == 0 { 0 } else { ANCHORS[partition] };
        let turned = usize::from(index[anchor]) >= N / 2;
        if turned {
            ends.swap(0, 1);
        }
        for (i, index) in index.into_iter().enumerate().filter(|(i, _)| split[line][*i] == 1.0) {
            indices[i] = if turned { N as u8 - 1 - index } else { index };
        }
    }
    mode.fits(&codes).then_some(Candidate { error, mode, partition, codes, indices })
}

/// The codes after the best single step of each end's channels, for the candidate's indices.
fn stepped<const N: usize>(texels: &Texels, candidate: &Candidate, split: &[Members; 2]) -> [[i32; 3]; 4] {
    let Candidate { mode, indices, .. } = candidate;
    let (scale, bits) = (texels.scale, mode.bits);
    let mut codes = candidate.codes;
    for line in 0..mode.lines {
        for c in 0..3 {
            let bins = texels.bins::<N>(c, &split[line], indices);
            let error =
                |ends: [i32; 2]| bins.error(scale, ends.map(|code| scale.position_of_code(code, bits)));
            let ends = [codes[2 * line][c], codes[2 * line + 1][c]];
            let mut best = (error(ends), ends);
            for (da, db) in [(-1, 0), (1, 0), (0, -1), (0, 1), (-1, -1), (1, 1), (-1, 1), (1, -1)] {
                let moved = [ends[0] + da, ends[1] + db];
                let mut all = codes;
                (all[2 * line][c], all[2 * line + 1][c]) = (moved[0], moved[1]);
                if moved.iter().all(|code| scale.has_code(*code, bits)) && mode.fits(&all) {
                    let error = error(moved);
                    if error < best.0 {
                        best = (error, moved);
                    }
                }
            }
            (codes[2 * line][c], codes[2 * line + 1][c]) = (best.1[0], best.1[1]);
        }
    }
    codes
}

#[cfg(test)]
mod tests {
    use super::*;

    /// The next of a sequence of numbers below `range` (an LCG's high bits).
    fn next(state: &mut u64, range: i32) -> i32 {
        *state = state.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
        ((*state >> 33) % range as u64) as i32
    }

    #[test]
    fn blocks_of_every_mode_decode_to_the_colours_between_their_ends() {
        let mut state = 7;
        for signed in [false, true] {
            let scale = Scale { signed };
            for (number, mode) in MODES.iter().enumerate() {
                for round in 0..200 {
                    let partition = if mode.lines == 2 { round % 32 } else { 0 };
                    let mut codes = [[0; 3]; 4];
                    for end in 0..2 * mode.lines {
                        for c in 0..3 {
                            codes[end][c] = loop {
                                let anywhere = next(&mut state, 1 << mode.bits);
                                let near = next(&mut state, 512) - 256;
                                let code = match mode.deltas {
                                    Some(bits) if end > 0 => codes[0][c] + near % (1 << (bits[c] - 1)),
                                    _ if signed => anywhere - (1 << (mode.bits - 1)),
                                    _ => anywhere,
                                };
                                if scale.has_code(code, mode.bits) {
                                    break code;
                                }
                            };
                        }
                    }
                    assert!(mode.fits(&codes));
                    let split = PARTITIONS[partition];
                    let line = |i: usize| if mode.lines == 2 { usize::from(split >> i & 1) } else { 0 };
                    let colors = 16 / mode.lines;
                    let anchor = |i: usize| i == 0 || mode.lines == 2 && i == ANCHORS[partition];
                    let indices = std::array::from_fn(|i| {
                        next(&mut state, colors as i32 / if anchor(i) { 2 } else { 1 }) as u8
                    });
                    let block = mode.block(&codes, partition, &indices);

                    let mut halves = [0; 48];
                    bcdec_rs::bc6h_half(&block, &mut halves, 12, signed);
                    for i in 0..16 {
                        for c in 0..3 {
                            let position =
                                |end: usize| scale.position_of_code(codes[2 * line(i) + end][c], mode.bits);
                            // The 64ths of the source, from its formula rather than from the table.
                            let (k, last) = (i32::from(indices[i]), colors as i32 - 1);
                            let weight = (64 * k + last / 2) / last;
                            let between = (position(0) * (64 - weight) + position(1) * weight + 32) >> 6;
                            let decoded = half::f16::from_bits(halves[3 * i + c]).to_f32();
                            assert_eq!(
                                scale.q(between),
                                decoded,
                                "mode {number}, signed {signed}, texel {i}, {c}"
                            );
                        }
                    }
                }
            }
        }
    }

    #[test]
    fn positions_of_halves_are_those_of_their_values() {
        for bits in 0..=0x3c00u16 {
            let q = half::f16::from_bits(bits).to_f32();
            for signed in [false, true] {
                let scale = Scale { signed };
                assert_eq!(scale.q(scale.position(q) as i32), q, "{bits:#x}, signed {signed}");
                if signed {
                    assert_eq!(scale.q(scale.position(-q) as i32), -q, "-{bits:#x}");
                }
            }
        }
    }
}
