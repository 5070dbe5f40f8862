//! The sphere, or its upper half, unfolded onto a square: where tables over directions have their nodes.
//!
//! Source: Meyer et al., *On Floating-Point Normal Vectors*, EGSR 2010; Cigolle et al., *A Survey of Efficient
//! Representations for Independent Unit Vectors*, JCGT 3(2), 2014 (octahedral and its hemispherical form).

use crate::Direction;
use serde::{Deserialize, Serialize};

/// Nodes of a square grid over directions, the outermost on the square's edge: where the edges of the
/// unfolded sphere meet, nodes lie in the same direction, so that what is interpolated has no seam.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub struct Octahedral {
    /// Nodes along an edge, 2 to [`Octahedral::LARGEST`].
    pub nodes: usize,
    /// Whether the square is the half with z >= 0 alone; directions below count as those of their azimuth on
    /// the horizon.
    pub hemisphere: bool,
}

/// The four nodes around a direction, numbered row by row, and how much each counts.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct OctahedralTaps {
    /// Numbers of nodes.
    pub nodes: [usize; 4],
    /// Not negative; the sum is 1.
    pub weights: [f64; 4],
}

impl Octahedral {
    /// The most nodes along an edge.
    pub const LARGEST: usize = 256;

    /// Number of nodes in all.
    pub fn count(self) -> usize {
        self.nodes * self.nodes
    }

    /// Whether the number of nodes is in its range.
    pub fn is_valid(self) -> bool {
        (2..=Self::LARGEST).contains(&self.nodes)
    }

    /// Where a direction lies in the unit square.
    pub fn place(self, direction: Direction) -> [f64; 2] {
        let [x, y, z] = direction.components();
        if self.hemisphere {
            let sum = x.abs() + y.abs() + z.max(0.0);
            // Straight down there is no azimuth: it counts as x.
            let (p, q) = if sum > 0.0 { (x / sum, y / sum) } else { (1.0, 0.0) };
            return [0.5 * (p + q + 1.0), 0.5 * (p - q + 1.0)];
        }
        let sum = x.abs() + y.abs() + z.abs();
        let (p, q) = (x / sum, y / sum);
        let side = |value: f64| if value >= 0.0 { 1.0 } else { -1.0 };
        let (p, q) = match z < 0.0 {
            true => ((1.0 - q.abs()) * side(p), (1.0 - p.abs()) * side(q)),
            false => (p, q),
        };
        [0.5 * (p + 1.0), 0.5 * (q + 1.0)]
    }

    /// The direction of a node.
    ///
    /// # Panics
    /// When there is no such node.
    pub fn direction(self, node: usize) -> Direction {
        assert!(node < self.count(), "node {node}");
        let along = |i: usize| 2.0 * i as f64 / (self.nodes - 1) as f64 - 1.0;
        let (a, b) = (along(node % self.nodes), along(node / self.nodes));
        let (p, q) = if self.hemisphere { (0.5 * (a + b), 0.5 * (a - b)) } else { (a, b) };
        let z = 1.0 - p.abs() - q.abs();
        let side = |value: f64| if value >= 0.0 { 1.0 } else { -1.0 };
        let (x, y) = match z < 0.0 && !self.hemisphere {
            true => ((1.0 - q.abs()) * side(p), (1.0 - p.abs()) * side(q)),
            false => (p, q),
        };
        let z = if self.hemisphere { z.max(0.0) } else { z };
        Direction::new(x, y, z).unwrap_or(Direction::OUT)
    }

    /// The nodes around a direction.
    pub fn taps(self, direction: Direction) -> OctahedralTaps {
        let last = self.nodes - 1;
        let [(column, s), (row, t)] = self.place(direction).map(|place| {
            let at = place * last as f64;
            let before = (at.floor().max(0.0) as usize).min(last - 1);
            (before, (at - before as f64).clamp(0.0, 1.0))
        });
        let first = row * self.nodes + column;
        OctahedralTaps {
            nodes: [first, first + 1, first + self.nodes, first + self.nodes + 1],
            weights: [(1.0 - s) * (1.0 - t), s * (1.0 - t), (1.0 - s) * t, s * t],
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::sphere::{Cap, fibonacci_in};
    use std::f64::consts::PI;

    fn interpolated(square: Octahedral, of: impl Fn(Direction) -> f64, direction: Direction) -> f64 {
        let OctahedralTaps { nodes, weights } = square.taps(direction);
        (0..4).map(|i| weights[i] * of(square.direction(nodes[i]))).sum()
    }

    #[test]
    fn nodes_come_back_and_smooth_functions_are_interpolated() {
        for hemisphere in [false, true] {
            let square = Octahedral { nodes: 33, hemisphere };
            for node in 0..square.count() {
                let direction = square.direction(node);
                let OctahedralTaps { nodes, weights } = square.taps(direction);
                let weight: f64 = (0..4)
                    .filter(|&i| square.direction(nodes[i]).angle_to(direction) < 1e-9)
                    .map(|i| weights[i])
                    .sum();
                assert!((weight - 1.0).abs() < 1e-9, "{hemisphere} {node}");
            }
            let radius = if hemisphere { 0.5 * PI } else { PI };
            let of = |d: Direction| d.x() * d.y() + 0.5 * d.z();
            let worst = fibonacci_in(Cap { axis: Direction::OUT, radius }, 5000)
                .into_iter()
                .map(|direction| (interpolated(square, of, direction) - of(direction)).abs())
                .fold(0.0, f64::max);
            assert!(worst < 0.02, "{hemisphere} {worst}");
        }
    }

    #[test]
    fn the_unfolded_edges_meet_and_what_lies_below_a_half_counts_as_its_horizon() {
        let square = Octahedral { nodes: 9, hemisphere: false };
        let of = |d: Direction| d.x() + 2.0 * d.y() - d.z() + d.x() * d.y();
        for azimuth in [0.0, 0.5 * PI, PI, -0.5 * PI] {
            // The seams below the horizon are at the axes' azimuths.
            for elevation in [-0.3, -1.0, -1.5] {
                let at = |turn: f64| {
                    let direction = Direction::from_azimuth_elevation(azimuth + turn, elevation).unwrap();
                    interpolated(square, of, direction)
                };
                assert!((at(1e-9) - at(-1e-9)).abs() < 1e-7, "{azimuth} {elevation}");
            }
        }
        let half = Octahedral { nodes: 9, hemisphere: true };
        let below = Direction::new(0.3, -0.4, -0.7).unwrap();
        let (found, expected) = (half.taps(below), half.taps(Direction::new(0.3, -0.4, 0.0).unwrap()));
        assert_eq!(found.nodes, expected.nodes);
        assert!((0..4).all(|i| (found.weights[i] - expected.weights[i]).abs() < 1e-12));
        let down = half.taps(Direction::new(0.0, 0.0, -1.0).unwrap());
        assert!(down.weights.iter().all(|weight| weight.is_finite()));
    }
}
