//! The largest eigenvalues of a symmetric matrix and their vectors.

use crate::singular_values::SingularValues;
use nalgebra::DMatrix;
use rayon::prelude::*;

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
    let mut state = 0x9e37_79b9_7f4a_7c15u64;
    let mut next = || {
        // Steele, Lea, Flood, 2014: splitmix64.
        state = state.wrapping_add(0x9e37_79b9_7f4a_7c15);
        let z = (state ^ (state >> 30)).wrapping_mul(0xbf58_476d_1ce4_e5b9);
        let z = (z ^ (z >> 27)).wrapping_mul(0x94d0_49bb_1331_11eb);
        ((z ^ (z >> 31)) >> 11) as f64 / (1u64 << 52) as f64 - 1.0
    };
    let mut rows: Vec<Vec<f64>> = (0..size).map(|_| (0..width).map(|_| next()).collect()).collect();
    orthonormalize(&mut rows);
    for _ in 0..ROUNDS {
        rows = images(matrix, width, &rows);
        orthonormalize(&mut rows);
    }
    let image = images(matrix, width, &rows);
    let small = DMatrix::from_fn(rows.len(), rows.len(), |i, j| dot(&rows[i], &image[j]));
    let SingularValues { left, values, .. } = SingularValues::of(small);
    let kept = kept.min(rows.len());
    let vectors = (0..kept)
        .flat_map(|r| {
            let mut vector = vec![0.0; width];
            for (i, row) in rows.iter().enumerate() {
                vector.iter_mut().zip(row).for_each(|(sum, value)| *sum += left[(i, r)] * value);
            }
            vector
        })
        .collect();
    Principal { values: values[..kept].to_vec(), vectors }
}

/// The matrix times each row.
fn images(matrix: &[f64], width: usize, rows: &[Vec<f64>]) -> Vec<Vec<f64>> {
    rows.par_iter()
        .map(|row| {
            let mut image = vec![0.0; width];
            for (factor, of_matrix) in row.iter().zip(matrix.chunks_exact(width)) {
                image.iter_mut().zip(of_matrix).for_each(|(sum, value)| *sum += factor * value);
            }
            image
        })
        .collect()
}

/// Gram and Schmidt, twice over; rows that depend on those before them become 0.
fn orthonormalize(rows: &mut [Vec<f64>]) {
    for i in 0..rows.len() {
        let (before, rest) = rows.split_at_mut(i);
        let row = &mut rest[0];
        let length = dot(row, row).sqrt();
        for _ in 0..2 {
            for other in before.iter() {
                let along = dot(row, other);
                row.iter_mut().zip(other).for_each(|(value, o)| *value -= along * o);
            }
        }
        let left = dot(row, row).sqrt();
        let factor = if left > 1e-12 * length && left > 0.0 { 1.0 / left } else { 0.0 };
        row.iter_mut().for_each(|value| *value *= factor);
    }
}

fn dot(a: &[f64], b: &[f64]) -> f64 {
    a.iter().zip(b).map(|(x, y)| x * y).sum()
}

#[cfg(test)]
mod tests {
    use super::*;

    /// V diag(values) V^T with V of reflections.
    fn matrix_of(values: &[f64]) -> Vec<f64> {
        let n = values.len();
        let mut v: Vec<Vec<f64>> =
            (0..n).map(|i| (0..n).map(|j| ((i * 7 + j * 3) % 11) as f64 - 4.7).collect()).collect();
        for (i, row) in v.iter_mut().enumerate() {
            row[i] += 9.0;
        }
        orthonormalize(&mut v);
        (0..n * n).map(|at| (0..n).map(|l| values[l] * v[l][at / n] * v[l][at % n]).sum()).collect()
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
            let image = images(&matrix, 40, &[a.to_vec()]);
            assert!((dot(a, &image[0]) - found.values[i]).abs() < 1e-9);
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
