//! The one product behind fitting and relighting: rows of samples summed with weights.
//!
//! One source is expanded for each instruction set by a macro. It writes its vectors out: left to
//! the compiler, the same loop over arrays ran between 28 and 3 GFLOP/s from one small change to
//! the next (docs/accuracy.md). Multiplications and additions stay apart, never fused, and every
//! sum runs over the terms in order, so all builds give the same bits; the test holds each of them
//! to the textbook loop.

use crate::CpuLevel;
use crate::cpu::Kind;

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
    let shape = Shape { terms, input_stride: input.stride, output_stride: output.stride, width };
    match level.kind() {
        #[cfg(target_arch = "x86_64")]
        // SAFETY: SSE2 is part of x86-64.
        Kind::Baseline => unsafe { sse2::rows(matrix, input.samples, output.samples, shape) },
        #[cfg(target_arch = "x86_64")]
        // SAFETY: a `CpuLevel` exists only for instruction sets that this machine has.
        Kind::Avx2 => unsafe { avx2::rows(matrix, input.samples, output.samples, shape) },
        #[cfg(target_arch = "x86_64")]
        // SAFETY: as above.
        Kind::Avx512 => unsafe { avx512::rows(matrix, input.samples, output.samples, shape) },
        #[cfg(not(target_arch = "x86_64"))]
        _ => columns(matrix, input.samples, output.samples, shape, 0),
    }
}

/// The sizes of a product.
#[derive(Clone, Copy)]
struct Shape {
    terms: usize,
    input_stride: usize,
    output_stride: usize,
    width: usize,
}

/// The columns from `first` on: what the kernels below leave over, and all of them on machines
/// without one. Written over arrays, which compilers turn into vectors where they can.
fn columns(matrix: &[f32], input: &[f32], output: &mut [f32], shape: Shape, first: usize) {
    const LANES: usize = 8;
    for (r, weights) in matrix.chunks_exact(shape.terms.max(1)).enumerate() {
        let mut x = first;
        while x < shape.width {
            let lanes = LANES.min(shape.width - x);
            let mut sums = [0.0f32; LANES];
            for (weight, row) in weights.iter().zip(input[x..].chunks(shape.input_stride)) {
                for (sum, sample) in sums.iter_mut().zip(&row[..lanes]) {
                    *sum += weight * sample;
                }
            }
            output[r * shape.output_stride + x..][..lanes].copy_from_slice(&sums[..lanes]);
            x += lanes;
        }
    }
}

/// The kernel for one instruction set: six rows of two vectors each stay in registers, twelve sums
/// that hide the latency of an addition; each sample that is loaded serves six rows, each weight
/// two vectors.
#[cfg(target_arch = "x86_64")]
macro_rules! kernel {
    ($name:ident, $features:literal, $lanes:literal, $zero:ident, $splat:ident, $load:ident, $store:ident, $add:ident, $mul:ident) => {
        mod $name {
            use super::{Shape, columns};
            use std::arch::x86_64::{$add, $load, $mul, $splat, $store, $zero};

            const LANES: usize = $lanes;
            const ROWS: usize = 6;

            #[target_feature(enable = $features)]
            pub(super) fn rows(matrix: &[f32], input: &[f32], output: &mut [f32], shape: Shape) {
                let blocks = matrix.chunks(ROWS * shape.terms.max(1));
                for (block, weights) in blocks.enumerate() {
                    let out = &mut output[block * ROWS * shape.output_stride..];
                    match weights.len() / shape.terms {
                        6 => block_of::<6>(weights, input, out, shape),
                        5 => block_of::<5>(weights, input, out, shape),
                        4 => block_of::<4>(weights, input, out, shape),
                        3 => block_of::<3>(weights, input, out, shape),
                        2 => block_of::<2>(weights, input, out, shape),
                        _ => block_of::<1>(weights, input, out, shape),
                    }
                }
            }

            #[target_feature(enable = $features)]
            fn block_of<const R: usize>(weights: &[f32], input: &[f32], output: &mut [f32], shape: Shape) {
                // The weights of a term side by side, so that the inner loop walks one array.
                let by_term: Vec<[f32; R]> =
                    (0..shape.terms).map(|i| std::array::from_fn(|r| weights[r * shape.terms + i])).collect();
                let mut x = 0;
                while x + 2 * LANES <= shape.width {
                    let mut sums = [[$zero(); 2]; R];
                    for (weights, row) in by_term.iter().zip(input[x..].chunks(shape.input_stride)) {
                        let samples = &row[..2 * LANES];
                        // SAFETY: `samples` holds two vectors.
                        let (a, b) = unsafe { ($load(samples.as_ptr()), $load(samples.as_ptr().add(LANES))) };
                        for r in 0..R {
                            let weight = $splat(weights[r]);
                            sums[r][0] = $add(sums[r][0], $mul(weight, a));
                            sums[r][1] = $add(sums[r][1], $mul(weight, b));
                        }
                    }
                    for (r, [a, b]) in sums.into_iter().enumerate() {
                        let out = &mut output[r * shape.output_stride + x..][..2 * LANES];
                        // SAFETY: `out` holds two vectors.
                        unsafe {
                            $store(out.as_mut_ptr(), a);
                            $store(out.as_mut_ptr().add(LANES), b);
                        }
                    }
                    x += 2 * LANES;
                }
                columns(weights, input, output, shape, x);
            }
        }
    };
}

#[cfg(target_arch = "x86_64")]
kernel!(sse2, "sse2", 4, _mm_setzero_ps, _mm_set1_ps, _mm_loadu_ps, _mm_storeu_ps, _mm_add_ps, _mm_mul_ps);
#[cfg(target_arch = "x86_64")]
kernel!(
    avx2,
    "avx2",
    8,
    _mm256_setzero_ps,
    _mm256_set1_ps,
    _mm256_loadu_ps,
    _mm256_storeu_ps,
    _mm256_add_ps,
    _mm256_mul_ps
);
#[cfg(target_arch = "x86_64")]
kernel!(
    avx512,
    "avx512f",
    16,
    _mm512_setzero_ps,
    _mm512_set1_ps,
    _mm512_loadu_ps,
    _mm512_storeu_ps,
    _mm512_add_ps,
    _mm512_mul_ps
);

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
            for width in [1, 5, 15, 16, 17, 32, 48, 100] {
                let stride = width + 3;
                let matrix: Vec<f32> = (0..rows * terms).map(|_| random()).collect();
                let input: Vec<f32> = (0..terms * stride).map(|_| random()).collect();
                let expected = textbook(&matrix, terms, &input, stride, width);
                for level in CpuLevel::available() {
                    let mut output = vec![f32::NAN; rows * stride];
                    let (samples, out) = (&input[..], &mut output[..]);
                    weighted_sums(
                        level,
                        &matrix,
                        terms,
                        Rows { samples, stride },
                        Rows { samples: out, stride },
                        width,
                    );
                    let same = expected.iter().zip(&output).all(|(a, b)| a.to_bits() == b.to_bits());
                    assert!(same, "{} differs at {rows} x {terms} x {width}", level.name());
                }
            }
        }
    }
}
