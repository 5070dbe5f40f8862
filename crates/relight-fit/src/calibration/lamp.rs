//! Where a lamp is, by what several spheres show of it.

use super::Ray;
use relight_core::Direction;
use relight_core::vectors::{difference, dot, length, scaled};

/// Rays whose directions are all within this many radians of each other (1 degree) don't tell how far away they meet: a tenth
/// of a degree in a highlight would move that by a tenth.
pub const NEARLY_PARALLEL: f64 = 0.017_453_292_519_943_295;

/// Where rays meet.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct LampPosition {
    /// The point that is nearest to all rays.
    pub position: [f64; 3],
    /// Root mean square of the angles, in radians, between the rays and the ways from their origins to that point.
    pub residual: f64,
}

/// Rounds in which rays are weighed anew by their length.
const ROUNDS: usize = 5;

/// The mean of the rays' directions and the largest angle to it in radians; `None` where they cancel.
pub fn mean_direction(rays: &[Ray]) -> Option<(Direction, f64)> {
    let sum: [f64; 3] = std::array::from_fn(|c| rays.iter().map(|ray| ray.direction[c]).sum());
    let mean = Direction::new(sum[0], sum[1], sum[2]).ok()?;
    let angle = |ray: &Ray| angle_between(ray.direction, mean.components());
    Some((mean, rays.iter().map(angle).fold(0.0, f64::max)))
}

/// The point of least squared angles to all `rays`; `None` for fewer than two, for nearly parallel ones, and where rays
/// meet only behind their origins.
///
/// Least squares over distances to the rays, each divided by the way along it, which is the angle.
pub fn position_of(rays: &[Ray]) -> Option<LampPosition> {
    let widest = rays
        .iter()
        .enumerate()
        .flat_map(|(i, a)| rays[i + 1..].iter().map(move |b| angle_between(a.direction, b.direction)));
    if widest.fold(0.0, f64::max) < NEARLY_PARALLEL {
        return None;
    }
    let mut weights = vec![1.0; rays.len()];
    let mut position = [0.0; 3];
    for _ in 0..ROUNDS {
        position = nearest_point(rays, &weights)?;
        for (weight, ray) in weights.iter_mut().zip(rays) {
            let way = dot(difference(position, ray.origin), ray.direction);
            if way.is_nan() || way <= 0.0 {
                return None;
            }
            *weight = 1.0 / (way * way);
        }
    }
    let square = |ray: &Ray| angle_between(difference(position, ray.origin), ray.direction).powi(2);
    let residual = (rays.iter().map(square).sum::<f64>() / rays.len() as f64).sqrt();
    Some(LampPosition { position, residual })
}

/// The point of least weighted squared distances: `sum w (I - d d^T) (x - o) = 0`.
fn nearest_point(rays: &[Ray], weights: &[f64]) -> Option<[f64; 3]> {
    let mut matrix = nalgebra::Matrix3::<f64>::zeros();
    let mut right = nalgebra::Vector3::<f64>::zeros();
    // About the mean origin, so that far pictures' coordinates cost no digits.
    let count = rays.len() as f64;
    let middle: [f64; 3] = std::array::from_fn(|c| rays.iter().map(|ray| ray.origin[c]).sum::<f64>() / count);
    for (Ray { origin, direction }, weight) in rays.iter().zip(weights) {
        let from = difference(*origin, middle);
        let across = difference(from, scaled(*direction, dot(from, *direction)));
        for row in 0..3 {
            for column in 0..3 {
                let one = if row == column { 1.0 } else { 0.0 };
                matrix[(row, column)] += weight * (one - direction[row] * direction[column]);
            }
            right[row] += weight * across[row];
        }
    }
    let found = matrix.cholesky()?.solve(&right);
    let point: [f64; 3] = std::array::from_fn(|c| middle[c] + found[c]);
    point.iter().all(|c| c.is_finite()).then_some(point)
}

/// The angle between two vectors of any length, accurate near 0.
fn angle_between(a: [f64; 3], b: [f64; 3]) -> f64 {
    libm::atan2(length(relight_core::vectors::cross(a, b)), dot(a, b))
}
