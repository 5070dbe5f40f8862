//! Products of matrices that lie row by row in f64: every sum runs in order, so the bits are the same on every
//! machine and with any number of threads.

use rayon::prelude::*;

/// Sum of products.
pub(crate) fn dot(a: &[f64], b: &[f64]) -> f64 {
    a.iter().zip(b).map(|(x, y)| x * y).sum()
}

/// The sum of `rows`, of `width` numbers each, times `factors`.
pub(crate) fn combination(factors: &[f64], rows: &[f64], width: usize) -> Vec<f64> {
    let mut sums = vec![0.0; width];
    for (factor, row) in factors.iter().zip(rows.chunks_exact(width)) {
        sums.iter_mut().zip(row).for_each(|(sum, value)| *sum += factor * value);
    }
    sums
}

/// `a b`, rows of `b` being of `width` numbers.
pub(crate) fn product(a: &[f64], b: &[f64], width: usize) -> Vec<f64> {
    let inner = b.len() / width;
    a.par_chunks_exact(inner).flat_map_iter(|row| combination(row, b, width)).collect()
}

/// `a b^T`, rows of both being of `width` numbers.
pub(crate) fn product_with_transposed(a: &[f64], b: &[f64], width: usize) -> Vec<f64> {
    a.chunks_exact(width).flat_map(|x| b.chunks_exact(width).map(move |y| dot(x, y))).collect()
}

/// `v^T matrix v` of a square matrix.
pub(crate) fn quadratic_form(matrix: &[f64], v: &[f64]) -> f64 {
    matrix.chunks_exact(v.len().max(1)).zip(v).fold(0.0, |sum, (row, factor)| sum + factor * dot(row, v))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn products_of_lopsided_matrices() {
        // 2 x 3 and 3 x 2.
        let (a, b) = ([1.0, 2.0, 3.0, 4.0, 5.0, 6.0], [7.0, 8.0, 9.0, 10.0, 11.0, 12.0]);
        assert_eq!(product(&a, &b, 2), [58.0, 64.0, 139.0, 154.0]);
        assert_eq!(product(&a[..2], &a, 3), [9.0, 12.0, 15.0]);
        assert_eq!(product_with_transposed(&a, &b, 3), [50.0, 68.0, 122.0, 167.0]);
        assert_eq!(combination(&a[..2], &a, 3), [9.0, 12.0, 15.0]);
        assert_eq!(quadratic_form(&[1.0, 2.0, -3.0, 5.0], &[2.0, 3.0]), 43.0);
    }
}
