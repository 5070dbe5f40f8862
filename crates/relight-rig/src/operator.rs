//! What makes a rig's parameters of the light at its samples: one matrix, made once.
//!
//! Source: *Irradiance Rigs*, section 2.2, equation 1 and L = (M^T M)^-1 M^T. Where the mesh leaves parameters undetermined
//! that inverse does not exist (flat meshes, nodes without surface near them), so L is a pseudo-inverse by SVD in f64, of
//! coordinates that run from -1 to 1 over the mesh (MATH.md, section 1.4: in world coordinates the condition number is
//! 5e4 to 5e7), and nodes of lattices are held to their neighbours.

use crate::{AxisFunction, Model};
use nalgebra::DMatrix;

/// Singular values below this part of the largest one count as 0.
const RANK: f64 = 1e-6;

/// Weight of the differences between neighbouring nodes against that of the samples.
///
/// A hundredth of MATH.md's 1e-4, which doubles the error of a 4 x 4 x 4 lattice on a sphere towards its diagonal (docs/stability.md).
const SMOOTHNESS: f64 = 1e-6;

/// parameters x samples, row-major: the pseudo-inverse of the weights at `points` (coordinates in the mesh's box).
///
/// Where points determine a lattice it is the least-squares solution to SMOOTHNESS; nodes that no point is near follow
/// their neighbours, and the same light at all points is reproduced. Other parameters that points leave open are 0.
pub fn least_squares(model: &Model, points: &[[f64; 3]]) -> Vec<f64> {
    let (parameters, samples) = (model.parameters().len(), points.len());
    let mut weights = vec![0.0; parameters];
    let mut matrix = DMatrix::<f64>::zeros(samples, parameters);
    for (row, &point) in points.iter().enumerate() {
        model.weights(point, &mut weights);
        matrix.row_mut(row).copy_from_slice(&weights);
    }
    let differences = differences(model);
    if differences.is_empty() {
        return pseudo_inverse(matrix, samples);
    }
    let largest = matrix.singular_values().max();
    let mut stacked = matrix.resize_vertically(samples + differences.len(), 0.0);
    for (row, terms) in differences.iter().enumerate() {
        for &(parameter, factor) in terms {
            stacked[(samples + row, parameter)] += SMOOTHNESS.sqrt() * largest * factor;
        }
    }
    pseudo_inverse(stacked, samples)
}

/// The first `columns` columns of the pseudo-inverse of `matrix`, row-major.
fn pseudo_inverse(matrix: DMatrix<f64>, columns: usize) -> Vec<f64> {
    let svd = matrix.svd(true, true);
    let (Some(u), Some(v_t)) = (svd.u, svd.v_t) else { return Vec::new() };
    let limit = RANK * svd.singular_values.max();
    let mut u_t = u.transpose();
    for (mut row, &value) in u_t.row_iter_mut().zip(&svd.singular_values) {
        row *= if value > limit { 1.0 / value } else { 0.0 };
    }
    let inverse = v_t.transpose() * u_t.columns(0, columns);
    inverse.transpose().as_slice().to_vec()
}

/// The graph Laplacian of a lattice: for each node, by how much its neighbours differ from it. None for models without nodes.
fn differences(model: &Model) -> Vec<Vec<(usize, f64)>> {
    let parameters = model.parameters();
    let index: std::collections::HashMap<_, _> =
        parameters.iter().enumerate().map(|(i, p)| (*p, i)).collect();
    let rows = parameters.iter().enumerate().map(|(parameter, product)| {
        let mut terms = Vec::new();
        for axis in 0..3 {
            let AxisFunction::Hat { node, nodes } = product[axis] else { continue };
            for neighbour in [node.wrapping_sub(1), node + 1] {
                let mut other = *product;
                other[axis] = AxisFunction::Hat { node: neighbour, nodes };
                if let Some(&other) = index.get(&other) {
                    terms.push((parameter, 1.0));
                    terms.push((other, -1.0));
                }
            }
        }
        terms
    });
    rows.filter(|terms| !terms.is_empty()).collect()
}
