//! The largest eigenvalues of a symmetric matrix and their vectors.

use crate::row_products::{dot, product, product_with_transposed};
use crate::singular_values::SingularValues;
use nalgebra::DMatrix;
use relight_core::SplitMix64;

/// Vectors beyond those wanted: the iteration converges by the ratio of the first eigenvalue left out to the
/// last wanted.
const MORE: usize = 10;

/// Rounds of the iteration.
const ROUNDS: usize = 16;

/// Eigenvalues, falling, and their vectors.
pub(crate) struct Principal {
    pub(crate) values: Vec<f64>,
    /// Row by row, each of length 1.
    pub(crate) vectors: Vec<f64>,
}

/// The `count` largest of a positive semidefinite matrix, `width` x `width`; fewer where it has fewer.
///
/// Subspace iteration from fixed vectors, then Rayleigh and Ritz. Sums run in order: the bits are the same on
/// every machine and with any number of threads.
/// Source: Halko, Martinsson, Tropp, *Finding structure with randomness*, 2011, algorithm 4.4.
pub(crate) fn principal(matrix: &[f64], width: usize, count: usize) -> Principal {
    let kept = count.min(width);
    let size = (kept + MORE).min(width);
    let mut random = SplitMix64::new(0x9e37_79b9_7f4a_7c15);
    let mut rows: Vec<f64> = (0..size * width).map(|_| 2.0 * random.unit() - 1.0).collect();
    orthonormalize(&mut rows, width);
    for _ in 0..ROUNDS {
        rows = product(&rows, matrix, width);
        orthonormalize(&mut rows, width);
    }
    let image = product(&rows, matrix, width);
    let small = DMatrix::from_row_slice(size, size, &product_with_transposed(&rows, &image, width));
    let SingularValues { left, values, .. } = SingularValues::of(small);
    // Column by column, as nalgebra stores them: the combinations' factors.
    let vectors = product(&left.as_slice()[..kept * size], &rows, width);
    Principal { values: values[..kept].to_vec(), vectors }
}

/// Gram and Schmidt, twice over; rows that depend on those before them become 0.
fn orthonormalize(rows: &mut [f64], width: usize) {
    for i in 0..rows.len() / width {
        let (before, rest) = rows.split_at_mut(i * width);
        let row = &mut rest[..width];
        let length = dot(row, row).sqrt();
        for _ in 0..2 {
            for other in before.chunks_exact(width) {
                let along = dot(row, other);
                row.iter_mut().zip(other).for_each(|(value, o)| *value -= along * o);
            }
        }
        let left = dot(row, row).sqrt();
        let factor = if left > 1e-12 * length && left > 0.0 { 1.0 / left } else { 0.0 };
        row.iter_mut().for_each(|value| *value *= factor);
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// V diag(values) V^T with V of reflections.
    fn matrix_of(values: &[f64]) -> Vec<f64> {
        let n = values.len();
        let entry = |i: usize, j: usize| ((i * 7 + j * 3) % 11) as f64 - if i == j { -4.3 } else { 4.7 };
        let mut v: Vec<f64> = (0..n * n).map(|at| entry(at / n, at % n)).collect();
        orthonormalize(&mut v, n);
        let sum = |i: usize, j: usize| (0..n).map(|l| values[l] * v[l * n + i] * v[l * n + j]).sum();
        (0..n * n).map(|at| sum(at / n, at % n)).collect()
    }

    #[test]
    fn the_largest_come_first_even_in_pairs() {
        let values: Vec<f64> =
            (0..40).map(|i| [3.0, 3.0, 1.0, 0.5, 0.5][i % 5] * 0.5f64.powi(i as i32 / 5)).collect();
        let matrix = matrix_of(&values);
        let mut sorted = values;
        sorted.sort_by(|a, b| b.total_cmp(a));
        let found = principal(&matrix, 40, 12);
        for (found, expected) in found.values.iter().zip(&sorted) {
            assert!((found - expected).abs() < 1e-6 * sorted[0], "{found} {expected}");
        }
        let vectors: Vec<&[f64]> = found.vectors.chunks_exact(40).collect();
        for (i, a) in vectors.iter().enumerate() {
            let image = product(a, &matrix, 40);
            assert!((dot(a, &image) - found.values[i]).abs() < 1e-9);
            for (j, b) in vectors.iter().enumerate() {
                assert!((dot(a, b) - f64::from(u8::from(i == j))).abs() < 1e-9);
            }
        }
    }

    #[test]
    fn matrices_of_low_rank_and_zeros_have_finite_answers() {
        let found = principal(&matrix_of(&[2.0, 1.0, 0.0, 0.0, 0.0, 0.0]), 6, 6);
        assert!((found.values[0] - 2.0).abs() < 1e-12 && (found.values[1] - 1.0).abs() < 1e-12);
        assert!(found.values[2..].iter().all(|value| value.abs() < 1e-12));
        let zero = principal(&[0.0; 25], 5, 3);
        assert!(zero.values.iter().chain(&zero.vectors).all(|value| *value == 0.0));
    }
}
