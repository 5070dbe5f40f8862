//! The papers' cube maps: a function of direction tabulated on the faces of a cube.
//!
//! Source: Wong et al., *Interactive Relighting of Panoramas*, figure 10.

use crate::path::Directions;
use relight_core::{Basis, Direction};

/// The functions of a basis on six faces, bilinear between the texels' centres.
#[derive(Clone, Debug)]
pub(crate) struct CubeMaps {
    size: usize,
    count: usize,
    /// Faces +x, -x, +y, -y, +z, -z; on each (size + 2)^2 texels, a border of one around the face so that
    /// no lookup leaves it; k values a texel.
    texels: Vec<f32>,
}

impl CubeMaps {
    /// Samples `basis` at the texels' centres of faces of `size` x `size`.
    pub(crate) fn new(basis: &Basis, size: usize) -> Self {
        let (size, count) = (size.max(1), basis.count());
        let mut texels = Vec::with_capacity(6 * (size + 2) * (size + 2) * count);
        let mut functions = vec![0.0; count];
        for face in 0..6 {
            for row in 0..size + 2 {
                for column in 0..size + 2 {
                    // Texels of the border lie beyond the face, on its plane.
                    let [u, v] =
                        [column, row].map(|i| (2 * i) as f64 / size as f64 - 1.0 - 1.0 / size as f64);
                    let sign = if face % 2 == 0 { 1.0 } else { -1.0 };
                    let mut vector = [sign; 3];
                    vector[(face / 2 + 1) % 3] = u;
                    vector[(face / 2 + 2) % 3] = v;
                    let direction = Direction::new(vector[0], vector[1], vector[2]).unwrap_or(Direction::OUT);
                    basis.evaluate(direction, &mut functions);
                    texels.extend(functions.iter().map(|value| *value as f32));
                }
            }
        }
        Self { size, count, texels }
    }

    /// Writes function j of direction i to `rows[j * n + i]`.
    pub(crate) fn evaluate(&self, directions: Directions<'_>, rows: &mut [f32]) {
        let n = directions.x.len();
        let edge = self.size + 2;
        for i in 0..n {
            let vector = [directions.x[i], directions.y[i], directions.z[i]];
            let axis = (0..3).fold(0, |best, a| if vector[a].abs() > vector[best].abs() { a } else { best });
            let major = vector[axis];
            let face = 2 * axis + usize::from(major < 0.0);
            let place = |c: f32| {
                let at = (0.5 * self.size as f32) * (c / major.abs() + 1.0) + 0.5;
                // `as` takes NaN, of directions that are none, to 0.
                let first = (at as usize).min(edge - 2);
                (first, (at - first as f32).clamp(0.0, 1.0))
            };
            let (column, u) = place(vector[(axis + 1) % 3]);
            let (row, v) = place(vector[(axis + 2) % 3]);
            let texel = |row: usize, column: usize| {
                let start = ((face * edge + row) * edge + column) * self.count;
                &self.texels[start..start + self.count]
            };
            let (a, b) = (texel(row, column), texel(row, column + 1));
            let (c, d) = (texel(row + 1, column), texel(row + 1, column + 1));
            for j in 0..self.count {
                let upper = a[j] + u * (b[j] - a[j]);
                let lower = c[j] + u * (d[j] - c[j]);
                rows[j * n + i] = upper + v * (lower - upper);
            }
        }
    }
}
