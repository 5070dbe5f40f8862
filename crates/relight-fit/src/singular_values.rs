//! Singular value decomposition by one-sided Jacobi rotations.
//!
//! Source: Hestenes 1958; Demmel, Veselic, *Jacobi's method is more accurate than QR*, 1992. It is
//! here because the decomposition of nalgebra 0.35 is off by some percent where singular values come
//! in pairs, which a symmetric dome of lights brings about (docs/stability.md); a few hundred
//! columns need no faster one.

use nalgebra::DMatrix;

/// `A = U S V^T` of an m x n matrix, r = min(m, n).
pub(crate) struct SingularValues {
    /// m x r; a column whose singular value is 0 is 0.
    pub(crate) left: DMatrix<f64>,
    /// r values, falling.
    pub(crate) values: Vec<f64>,
    /// n x r.
    pub(crate) right: DMatrix<f64>,
}

/// Columns count as orthogonal when their cosine is below this: the rounding of a dot product of a
/// hundred terms. A smaller one turns them for ever.
const ORTHOGONAL: f64 = 4e-15;

/// Sweeps over all pairs of columns; convergence is quadratic, ten do for the worst matrix met.
const MOST_SWEEPS: usize = 60;

impl SingularValues {
    /// Decomposes `matrix`.
    pub(crate) fn of(matrix: DMatrix<f64>) -> Self {
        if matrix.nrows() < matrix.ncols() {
            let Self { left, values, right } = Self::of(matrix.transpose());
            return Self { left: right, values, right: left };
        }
        if matrix.nrows() > matrix.ncols() {
            // Rotations then work on short columns.
            let (q, r) = matrix.qr().unpack();
            let Self { left, values, right } = Self::of_square(r);
            return Self { left: product(&q, &left), values, right };
        }
        Self::of_square(matrix)
    }

    fn of_square(mut columns: DMatrix<f64>) -> Self {
        let n = columns.ncols();
        let mut right = DMatrix::identity(n, n);
        for _ in 0..MOST_SWEEPS {
            let mut turned = false;
            for p in 0..n {
                for q in p + 1..n {
                    turned |= orthogonalize(&mut columns, &mut right, p, q);
                }
            }
            if !turned {
                break;
            }
        }
        let lengths: Vec<f64> = (0..n).map(|j| dot(&columns, j, j).sqrt()).collect();
        let mut order: Vec<usize> = (0..n).collect();
        order.sort_by(|&a, &b| lengths[b].total_cmp(&lengths[a]));
        let unit = |i: usize, j: usize| if lengths[j] > 0.0 { columns[(i, j)] / lengths[j] } else { 0.0 };
        Self {
            left: DMatrix::from_fn(n, n, |i, r| unit(i, order[r])),
            values: order.iter().map(|&j| lengths[j]).collect(),
            right: DMatrix::from_fn(n, n, |i, r| right[(i, order[r])]),
        }
    }
}

/// Turns columns p and q so that they become orthogonal; whether they had to be turned.
fn orthogonalize(columns: &mut DMatrix<f64>, right: &mut DMatrix<f64>, p: usize, q: usize) -> bool {
    let (a, b, c) = (dot(columns, p, p), dot(columns, q, q), dot(columns, p, q));
    if c.abs() <= ORTHOGONAL * (a * b).sqrt() {
        return false;
    }
    let zeta = (b - a) / (2.0 * c);
    let tangent = zeta.signum() / (zeta.abs() + (1.0 + zeta * zeta).sqrt());
    let cosine = 1.0 / (1.0 + tangent * tangent).sqrt();
    let sine = cosine * tangent;
    for matrix in [columns, right] {
        for i in 0..matrix.nrows() {
            let (x, y) = (matrix[(i, p)], matrix[(i, q)]);
            matrix[(i, p)] = cosine * x - sine * y;
            matrix[(i, q)] = sine * x + cosine * y;
        }
    }
    true
}

/// Inner product of columns p and q, summed in order.
fn dot(columns: &DMatrix<f64>, p: usize, q: usize) -> f64 {
    columns.column(p).iter().zip(columns.column(q).iter()).map(|(x, y)| x * y).sum()
}

/// The product, summed in order on every machine.
fn product(a: &DMatrix<f64>, b: &DMatrix<f64>) -> DMatrix<f64> {
    DMatrix::from_fn(a.nrows(), b.ncols(), |i, j| (0..a.ncols()).map(|l| a[(i, l)] * b[(l, j)]).sum())
}

#[cfg(test)]
mod tests {
    use super::*;

    fn check(matrix: &DMatrix<f64>) {
        let svd = SingularValues::of(matrix.clone());
        let rank = matrix.nrows().min(matrix.ncols());
        assert_eq!((svd.left.ncols(), svd.right.ncols(), svd.values.len()), (rank, rank, rank));
        assert!(svd.values.windows(2).all(|w| w[0] >= w[1]));
        let scale = svd.values[0].max(1e-300);
        for i in 0..matrix.nrows() {
            for j in 0..matrix.ncols() {
                let sum: f64 = (0..rank).map(|r| svd.left[(i, r)] * svd.values[r] * svd.right[(j, r)]).sum();
                assert!((sum - matrix[(i, j)]).abs() < 1e-13 * scale, "({i}, {j}): {sum} {}", matrix[(i, j)]);
            }
        }
        for a in 0..rank {
            for b in 0..a {
                assert!(dot(&svd.right, a, b).abs() < 1e-12 && dot(&svd.left, a, b).abs() < 1e-12, "{a} {b}");
            }
        }
    }

    #[test]
    fn tall_wide_and_square_matrices_come_back() {
        let value = |i: usize, j: usize| libm::sin((i * 7 + j * 13) as f64) + if i == j { 2.0 } else { 0.0 };
        for (m, n) in [(1, 1), (9, 4), (4, 9), (7, 7), (50, 25), (12, 36)] {
            check(&DMatrix::from_fn(m, n, value));
        }
    }

    #[test]
    fn pairs_of_equal_singular_values_and_deficient_matrices_come_back() {
        // Lights on three rings of eight: cos and sin of the azimuth have equal singular values.
        let ring = |i: usize| (i % 8) as f64 * std::f64::consts::FRAC_PI_4;
        let height = |i: usize| 0.2 + 0.3 * (i / 8) as f64;
        check(&DMatrix::from_fn(24, 4, |i, j| match j {
            0 => height(i) * libm::cos(ring(i)),
            1 => height(i) * libm::sin(ring(i)),
            2 => 1.0,
            _ => height(i),
        }));
        check(&DMatrix::from_fn(6, 5, |i, j| if j < 3 { (i * 3 + j) as f64 } else { 0.0 }));
        check(&DMatrix::zeros(3, 3));
    }

    #[test]
    fn small_singular_values_keep_their_digits() {
        // Columns of lengths 1 .. 1e-12: QR iterations lose the small ones, Jacobi does not.
        let matrix =
            DMatrix::from_fn(8, 4, |i, j| libm::cos((i * (j + 1)) as f64) * libm::pow(10.0, -4.0 * j as f64));
        let scaled = SingularValues::of(matrix.clone()).values;
        let again = SingularValues::of(matrix * 1e-100).values;
        for (a, b) in scaled.iter().zip(&again) {
            assert!((a * 1e-100 / b - 1.0).abs() < 1e-12, "{a} {b}");
        }
        assert!(scaled[3] > 1e-13 && scaled[3] < 1e-11, "{scaled:?}");
    }
}
