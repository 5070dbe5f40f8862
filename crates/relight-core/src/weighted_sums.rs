//! The one product behind fitting and relighting: rows of samples summed with weights.
//!
//! One source over fixed-width lanes is compiled again for each instruction set. Rust never fuses
//! a * b + c, and every sum runs over the terms in order, so all builds give the same bits; the
//! test holds each of them to the textbook loop.

use crate::CpuLevel;
use crate::cpu::Kind;

/// Samples that the kernel sums side by side.
const LANES: usize = 16;

/// Rows of output that it keeps in registers at once.
const ROWS: usize = 6;

/// Where rows lie: each starts `stride` samples after the one before.
#[derive(Clone, Copy, Debug)]
pub struct Rows<T> {
    /// All rows.
    pub samples: T,
    /// Distance of one row's first sample from the next one's.
    pub stride: usize,
}

/// `output[r][x] = sum over i of matrix[r][i] * input[i][x]`, i rising from 0, in f32, for x in
/// `0..width`.
///
/// `matrix` is rows x terms, row-major.
///
/// # Panics
/// When `width` exceeds a stride or a slice is too short for these shapes.
pub fn weighted_sums(
    level: CpuLevel,
    matrix: &[f32],
    terms: usize,
    input: Rows<&[f32]>,
    output: Rows<&mut [f32]>,
    width: usize,
) {
    let rows = matrix.len().checked_div(terms).unwrap_or(0);
    assert!(width <= input.stride && width <= output.stride, "width {width} exceeds a stride");
    assert!(rows == 0 || input.samples.len() >= (terms - 1) * input.stride + width, "input is too short");
    assert!(rows == 0 || output.samples.len() >= (rows - 1) * output.stride + width, "output is too short");
    match level.kind() {
        Kind::Baseline => kernel(matrix, terms, input, output, width),
        // SAFETY: a `CpuLevel` exists only for instruction sets that this machine has.
        #[cfg(target_arch = "x86_64")]
        Kind::Avx2 => unsafe { kernel_avx2(matrix, terms, input, output, width) },
        // SAFETY: as above.
        #[cfg(target_arch = "x86_64")]
        Kind::Avx512 => unsafe { kernel_avx512(matrix, terms, input, output, width) },
        #[cfg(not(target_arch = "x86_64"))]
        _ => kernel(matrix, terms, input, output, width),
    }
}

#[cfg(target_arch = "x86_64")]
#[target_feature(enable = "avx2")]
fn kernel_avx2(m: &[f32], terms: usize, input: Rows<&[f32]>, output: Rows<&mut [f32]>, width: usize) {
    kernel(m, terms, input, output, width);
}

#[cfg(target_arch = "x86_64")]
#[target_feature(enable = "avx512f,avx512vl,avx512bw,avx512dq")]
fn kernel_avx512(m: &[f32], terms: usize, input: Rows<&[f32]>, output: Rows<&mut [f32]>, width: usize) {
    kernel(m, terms, input, output, width);
}

#[inline(always)]
fn kernel(matrix: &[f32], terms: usize, input: Rows<&[f32]>, output: Rows<&mut [f32]>, width: usize) {
    let rows = matrix.len().checked_div(terms).unwrap_or(0);
    let mut first = 0;
    while first < rows {
        let block = (rows - first).min(ROWS);
        let weights = &matrix[first * terms..(first + block) * terms];
        let stride = output.stride;
        let out = Rows { samples: &mut output.samples[first * stride..], stride };
        match block {
            6 => block_of::<6>(weights, terms, input, out, width),
            5 => block_of::<5>(weights, terms, input, out, width),
            4 => block_of::<4>(weights, terms, input, out, width),
            3 => block_of::<3>(weights, terms, input, out, width),
            2 => block_of::<2>(weights, terms, input, out, width),
            _ => block_of::<1>(weights, terms, input, out, width),
        }
        first += block;
    }
}

/// `R` rows of output at once: each input sample is loaded once for all of them.
#[inline(always)]
fn block_of<const R: usize>(
    weights: &[f32],
    terms: usize,
    input: Rows<&[f32]>,
    output: Rows<&mut [f32]>,
    width: usize,
) {
    let rows: [&[f32]; R] = std::array::from_fn(|r| &weights[r * terms..(r + 1) * terms]);
    let mut x = 0;
    while x + LANES <= width {
        let mut sums = [[0.0f32; LANES]; R];
        for i in 0..terms {
            let samples = &input.samples[i * input.stride + x..][..LANES];
            for r in 0..R {
                let weight = rows[r][i];
                for lane in 0..LANES {
                    sums[r][lane] += weight * samples[lane];
                }
            }
        }
        for (r, sum) in sums.iter().enumerate() {
            output.samples[r * output.stride + x..][..LANES].copy_from_slice(sum);
        }
        x += LANES;
    }
    for x in x..width {
        for r in 0..R {
            let mut sum = 0.0;
            for i in 0..terms {
                sum += rows[r][i] * input.samples[i * input.stride + x];
            }
            output.samples[r * output.stride + x] = sum;
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn textbook(matrix: &[f32], terms: usize, input: &[f32], stride: usize, width: usize) -> Vec<f32> {
        let rows = matrix.len() / terms;
        let mut output = vec![f32::NAN; rows * stride];
        for r in 0..rows {
            for x in 0..width {
                let mut sum = 0.0f32;
                for i in 0..terms {
                    sum += matrix[r * terms + i] * input[i * stride + x];
                }
                output[r * stride + x] = sum;
            }
        }
        output
    }

    #[test]
    fn every_level_gives_the_bits_of_the_textbook_loop_at_every_size() {
        let mut seed = 1u32;
        let mut random = || {
            seed = seed.wrapping_mul(1_664_525).wrapping_add(1_013_904_223);
            (seed >> 8) as f32 / 8_388_608.0 - 1.0
        };
        for (rows, terms) in [(1, 1), (2, 3), (5, 50), (6, 7), (7, 12), (13, 31), (25, 50)] {
            for width in [1, 5, 15, 16, 17, 48, 100] {
                let stride = width + 3;
                let matrix: Vec<f32> = (0..rows * terms).map(|_| random()).collect();
                let input: Vec<f32> = (0..terms * stride).map(|_| random()).collect();
                let expected = textbook(&matrix, terms, &input, stride, width);
                for level in CpuLevel::available() {
                    let mut output = vec![f32::NAN; rows * stride];
                    let (samples, out) = (&input[..], &mut output[..]);
                    weighted_sums(level, &matrix, terms, Rows { samples, stride }, Rows { samples: out, stride }, width);
                    let same = expected.iter().zip(&output).all(|(a, b)| a.to_bits() == b.to_bits());
                    assert!(same, "{} differs at {rows} x {terms} x {width}", level.name());
                }
            }
        }
    }
}
