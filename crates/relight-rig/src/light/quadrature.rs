//! Gauss and Legendre's nodes.

use std::f64::consts::PI;

/// A node in 0..1 and its weight; weights add up to 1.
pub(super) type Node = (f64, f64);

/// Gauss and Legendre's rule of `N` points on 0..1: exact for polynomials of degree 2 N - 1.
///
/// Source: Newton's iteration from the roots of the first asymptotic term.
pub(super) fn gauss_legendre<const N: usize>() -> [Node; N] {
    let mut nodes = [(0.0, 0.0); N];
    for (i, node) in nodes.iter_mut().enumerate() {
        let mut x = libm::cos(PI * (i as f64 + 0.75) / (N as f64 + 0.5));
        let mut slope = 1.0;
        // Convergence is quadratic: five steps do for N = 200.
        for _ in 0..8 {
            let (mut before, mut value) = (1.0, x);
            for l in 2..=N {
                let l = l as f64;
                (before, value) = (value, ((2.0 * l - 1.0) * x * value - (l - 1.0) * before) / l);
            }
            slope = N as f64 * (before - x * value) / ((1.0 - x) * (1.0 + x));
            x -= value / slope;
        }
        *node = (0.5 * (1.0 - x), 1.0 / ((1.0 - x) * (1.0 + x) * slope * slope));
    }
    nodes
}
