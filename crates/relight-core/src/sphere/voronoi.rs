//! Weights that make up for crowded lights.

use super::{Cap, fibonacci_in};
use crate::Direction;
use std::f64::consts::PI;

/// Lights closer than this (radians) are one light photographed twice.
const SAME: f64 = 1e-4;

/// For each light its share of the area that the lights cover, scaled to a mean of 1.
///
/// The cells are those of the spherical Voronoi diagram, cut off at the lights' own cap (a dome's
/// lowest lights do not stand for the lower hemisphere) and measured by counting evenly spread
/// points; duplicates share their cell. Source: MATH.md sections 1.3 and 4 (6 to 8 % less error on
/// clustered captures).
pub fn voronoi_weights(directions: &[Direction]) -> Vec<f64> {
    let Some(cap) = Cap::enclosing(directions) else {
        return Vec::new();
    };
    let count = directions.len();
    // Half a cell's radius beyond the outermost light: about what an even capture leaves there.
    let cell = (2.0 * (1.0 - libm::cos(cap.radius)) / count as f64).sqrt();
    let reach = Cap { axis: cap.axis, radius: (cap.radius + 0.5 * cell).min(PI) };

    // Each light's cell is that of the first light near it that has a cell of its own.
    let mut site: Vec<usize> = Vec::with_capacity(count);
    for (i, direction) in directions.iter().enumerate() {
        let near = |&j: &usize| site[j] == j && direction.angle_to(directions[j]) < SAME;
        let shared = (0..i).find(near);
        site.push(shared.unwrap_or(i));
    }
    let mut sharers = vec![0.0; count];
    for &s in &site {
        sharers[s] += 1.0;
    }
    // Half a point to start with: a cell finer than the points still counts.
    let mut area = vec![0.5; count];
    for point in fibonacci_in(reach, 16_384 + 16 * count) {
        let mut nearest = (0, -2.0);
        for (i, direction) in directions.iter().enumerate() {
            let cosine = point.cosine(*direction);
            if site[i] == i && cosine > nearest.1 {
                nearest = (i, cosine);
            }
        }
        area[nearest.0] += 1.0;
    }
    let weights: Vec<f64> = site.iter().map(|&s| area[s] / sharers[s]).collect();
    let mean = weights.iter().sum::<f64>() / count as f64;
    weights.into_iter().map(|w| w / mean).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn an_even_dome_weighs_all_alike_and_a_cluster_shares_its_cell() {
        let dome = Cap { axis: Direction::OUT, radius: 1.4 };
        let even = fibonacci_in(dome, 60);
        let weights = voronoi_weights(&even);
        assert!(weights.iter().all(|&w| (0.6..1.6).contains(&w)), "{weights:?}");

        let cluster = Cap { axis: Direction::new(0.5, 0.0, 0.8).unwrap(), radius: 0.09 };
        let mut both = even.clone();
        both.extend(fibonacci_in(cluster, 200));
        let weights = voronoi_weights(&both);
        let clustered: f64 = weights[60..].iter().sum::<f64>() / 260.0;
        assert!(clustered < 0.05, "200 clustered lights hold {clustered} of the weight");
    }

    #[test]
    fn duplicates_share_and_the_mean_is_one() {
        let mut lights = fibonacci_in(Cap { axis: Direction::OUT, radius: 1.2 }, 12);
        lights.push(lights[3]);
        let weights = voronoi_weights(&lights);
        assert_eq!(weights[3], weights[12]);
        assert!(weights[3] < 0.7, "{weights:?}");
        assert!((weights.iter().sum::<f64>() / 13.0 - 1.0).abs() < 1e-12);
        assert_eq!(voronoi_weights(&[Direction::OUT]), vec![1.0]);
        // A chain: the outer two are no duplicates of each other, each is one of the middle's.
        let chain = [0.0, 0.9e-4, 1.8e-4].map(|x| Direction::new(0.5 + x, 0.0, 0.8).unwrap());
        let weights = voronoi_weights(&chain);
        assert!(weights.iter().all(|&w| w > 0.2), "{weights:?}");
    }
}
