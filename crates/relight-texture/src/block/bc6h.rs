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
use fit::{Ends, Texels};
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
        Quality::Fast => Effort { refits: 1, partitions: 0, modes: 1, steps: 0 },
        Quality::Normal => Effort { refits: 2, partitions: 2, modes: 1, steps: 1 },
        Quality::High => Effort { refits: 3, partitions: 6, modes: 2, steps: 2 },
        Quality::Best => Effort { refits: 4, partitions: 32, modes: 10, steps: 8 },
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
    let whole = [fitted(texels, u16::MAX, 16, effort)];
    let mut error = f32::INFINITY;
    for found in candidates(texels, &whole, 0, effort) {
        error = keep(found);
    }
    let mut ranked: [(f32, usize); 32] =
        std::array::from_fn(
            |p| if effort.partitions > 0 { (texels.guess(PARTITIONS[p]), p) } else { (0.0, p) },
        );
    ranked.sort_by(|a, b| a.0.total_cmp(&b.0));
    for (_, partition) in &ranked[..effort.partitions] {
        if error == 0.0 {
            break;
        }
        let second = PARTITIONS[*partition];
        let lines = [!second, second].map(|line| fitted(texels, line, 8, effort));
        for found in candidates(texels, &lines, *partition, effort) {
            error = keep(found);
        }
    }
    let best = best.expect("the mode of one line without differences holds any ends");
    best.mode.block(&best.codes, best.partition, &best.indices)
}

/// Ends of a line through some of the texels.
fn fitted(texels: &Texels, line: u16, colors: usize, effort: &Effort) -> Ends {
    let mut ends = texels.first_ends(line);
    for _ in 0..effort.refits {
        let rounded = ends.map(|end| end.map(|position| position as i32));
        let assigned = texels.assign(rounded, colors);
        ends = texels.refit(ends, line, &assigned.index, colors);
    }
    ends
}

/// The lines in each of the finest modes that can hold them.
fn candidates<'a>(
    texels: &'a Texels,
    lines: &'a [Ends],
    partition: usize,
    effort: &'a Effort,
) -> impl Iterator<Item = Candidate> + 'a {
    let modes = MODES.iter().filter(|mode| mode.lines == lines.len());
    modes.filter_map(move |mode| in_mode(texels, lines, partition, mode, effort)).take(effort.modes)
}

fn in_mode(
    texels: &Texels,
    lines: &[Ends],
    partition: usize,
    mode: &'static Mode,
    effort: &Effort,
) -> Option<Candidate> {
    let mut codes = [[0; 3]; 4];
    for (ends, line) in codes.chunks_exact_mut(2).zip(lines) {
        for (end, position) in ends.iter_mut().zip(line) {
            *end = position.map(|position| texels.scale.code(position, mode.bits));
        }
    }
    let mut best = assigned(texels, codes, partition, mode)?;
    for _ in 0..effort.steps {
        let codes = stepped(texels, &best);
        if codes == best.codes {
            break;
        }
        match assigned(texels, codes, partition, mode) {
            Some(found) if found.error < best.error => best = found,
            _ => break,
        }
    }
    Some(best)
}

/// The texels of each line.
fn line_texels(mode: &Mode, partition: usize) -> [u16; 2] {
    if mode.lines == 1 { [u16::MAX, 0] } else { [!PARTITIONS[partition], PARTITIONS[partition]] }
}

/// Indices for given ends, turned such that anchors are in the lower half; none when the codes do
/// not fit the mode that way round.
fn assigned(
    texels: &Texels,
    mut codes: [[i32; 3]; 4],
    partition: usize,
    mode: &'static Mode,
) -> Option<Candidate> {
    let colors = 16 / mode.lines;
    let (mut indices, mut error) = ([0; 16], 0.0);
    for line in 0..mode.lines {
        let members = line_texels(mode, partition)[line];
        let ends = &mut codes[2 * line..2 * line + 2];
        let positions =
            [0, 1].map(|end| ends[end].map(|code| texels.scale.position_of_code(code, mode.bits)));
        let assigned = texels.assign(positions, colors);
        error += assigned.error_of(members);
        let anchor = if line == 0 { 0 } else { ANCHORS[partition] };
        let turned = usize::from(assigned.index[anchor]) >= colors / 2;
        if turned {
            ends.swap(0, 1);
        }
        for i in (0..16).filter(|i| members >> i & 1 == 1) {
            indices[i] = if turned { colors as u8 - 1 - assigned.index[i] } else { assigned.index[i] };
        }
    }
    mode.fits(&codes).then_some(Candidate { error, mode, partition, codes, indices })
}

/// The codes after the best single step of each end's channels, for the candidate's indices.
fn stepped(texels: &Texels, candidate: &Candidate) -> [[i32; 3]; 4] {
    let Candidate { mode, partition, indices, .. } = candidate;
    let mut codes = candidate.codes;
    for line in 0..mode.lines {
        let members = line_texels(mode, *partition)[line];
        for c in 0..3 {
            let ends = [codes[2 * line][c], codes[2 * line + 1][c]];
            let mut best = (f32::INFINITY, ends);
            // The codes as they are come first: a step must be better.
            for (da, db) in [(0, 0), (-1, 0), (1, 0), (0, -1), (0, 1), (-1, -1), (1, 1), (-1, 1), (1, -1)] {
                let moved = [ends[0] + da, ends[1] + db];
                let mut all = codes;
                (all[2 * line][c], all[2 * line + 1][c]) = (moved[0], moved[1]);
                if !moved.iter().all(|code| texels.scale.has_code(*code, mode.bits)) || !mode.fits(&all) {
                    continue;
                }
                let positions = moved.map(|code| texels.scale.position_of_code(code, mode.bits));
                let error = texels.channel_error(c, positions, members, indices, 16 / mode.lines);
                if error < best.0 {
                    best = (error, moved);
                }
            }
            (codes[2 * line][c], codes[2 * line + 1][c]) = (best.1[0], best.1[1]);
        }
    }
    codes
}
