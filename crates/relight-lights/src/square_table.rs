//! Learned functions: their own table, bilinear between nodes on an octahedral square.

use crate::path::Directions;
use relight_core::basis::{FunctionsOfLight, Learned};
use relight_core::sphere::Octahedral;

/// The table of learned functions made ready.
#[derive(Clone, Debug)]
pub(crate) struct SquareTable {
    square: Octahedral,
    count: usize,
    /// By node, then function.
    values: Vec<f32>,
}

impl SquareTable {
    pub(crate) fn new(learned: &Learned) -> Self {
        Self { square: learned.square(), count: learned.count(), values: learned.table().to_vec() }
    }

    /// Writes function j of direction i to `rows[j * n + i]`.
    ///
    /// As [`Octahedral::taps`], in f32: the square is continuous, so that a place which rounding moves to the
    /// next cell has the same value there.
    pub(crate) fn evaluate(&self, directions: Directions<'_>, rows: &mut [f32]) {
        let n = directions.x.len();
        let (edge, last) = (self.square.nodes, self.square.nodes - 1);
        let mut functions = vec![0.0f32; self.count];
        for i in 0..n {
            let place = self.place(directions.x[i], directions.y[i], directions.z[i]);
            let [(column, s), (row, t)] = place.map(|place| {
                let at = place * last as f32;
                // `as` takes NaN, of directions that are none, to 0.
                let before = (at as usize).min(last - 1);
                (before, (at - before as f32).clamp(0.0, 1.0))
            });
            let first = row * edge + column;
            let node = |node: usize| &self.values[node * self.count..][..self.count];
            let nodes = [node(first), node(first + 1), node(first + edge), node(first + edge + 1)];
            let [a, b, c, d] = [(1.0 - s) * (1.0 - t), s * (1.0 - t), (1.0 - s) * t, s * t];
            for (j, value) in functions.iter_mut().enumerate() {
                *value = a * nodes[0][j] + b * nodes[1][j] + c * nodes[2][j] + d * nodes[3][j];
            }
            for (row, value) in rows.chunks_exact_mut(n).zip(&functions) {
                row[i] = *value;
            }
        }
    }

    fn place(&self, x: f32, y: f32, z: f32) -> [f32; 2] {
        if self.square.hemisphere {
            let sum = x.abs() + y.abs() + z.max(0.0);
            let (p, q) = if sum > 0.0 { (x / sum, y / sum) } else { (1.0, 0.0) };
            return [0.5 * (p + q + 1.0), 0.5 * (p - q + 1.0)];
        }
        let sum = x.abs() + y.abs() + z.abs();
        let (p, q) = (x / sum, y / sum);
        let side = |value: f32| if value >= 0.0 { 1.0 } else { -1.0 };
        let (p, q) = match z < 0.0 {
            true => ((1.0 - q.abs()) * side(p), (1.0 - p.abs()) * side(q)),
            false => (p, q),
        };
        [0.5 * (p + 1.0), 0.5 * (q + 1.0)]
    }
}
