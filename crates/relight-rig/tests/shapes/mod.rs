//! Meshes with surfaces that are known.

#![allow(dead_code, reason = "each test file uses some of them")]

use relight_rig::Surface;

/// Vertices, normals and triangles.
#[derive(Clone, Debug, Default)]
pub(crate) struct Shape {
    pub(crate) positions: Vec<[f32; 3]>,
    pub(crate) normals: Vec<[f32; 3]>,
    pub(crate) triangles: Vec<[u32; 3]>,
}

impl Shape {
    pub(crate) fn surface(&self) -> Surface<'_> {
        Surface { positions: &self.positions, normals: &self.normals, triangles: &self.triangles }
    }

    pub(crate) fn moved(mut self, map: impl Fn([f32; 3]) -> [f32; 3]) -> Self {
        self.positions.iter_mut().for_each(|p| *p = map(*p));
        self
    }

    fn quad(&mut self, corners: [[f32; 3]; 4], normal: [f32; 3]) {
        let first = self.positions.len() as u32;
        self.positions.extend(corners);
        self.normals.extend([normal; 4]);
        self.triangles.extend([[0, 1, 2], [0, 2, 3]].map(|t| t.map(|i: u32| first + i)));
    }
}

/// The unit sphere, by latitude and longitude; its box is exactly -1 to 1.
pub(crate) fn sphere(steps: usize) -> Shape {
    let mut shape = Shape::default();
    let (rows, columns) = (steps, 2 * steps);
    for row in 0..=rows {
        for column in 0..=columns {
            let (t, p) = (
                std::f64::consts::PI * row as f64 / rows as f64,
                std::f64::consts::TAU * column as f64 / columns as f64,
            );
            let place =
                [libm::sin(t) * libm::cos(p), libm::sin(t) * libm::sin(p), libm::cos(t)].map(|c| c as f32);
            shape.positions.push(place);
            shape.normals.push(place);
        }
    }
    let at = |row: usize, column: usize| (row * (columns + 1) + column) as u32;
    for row in 0..rows {
        for column in 0..columns {
            let (a, b, c, d) =
                (at(row, column), at(row + 1, column), at(row + 1, column + 1), at(row, column + 1));
            shape.triangles.extend([[a, b, c], [a, c, d]]);
        }
    }
    shape
}

/// A box from `least` to `most`.
pub(crate) fn cuboid(least: [f32; 3], most: [f32; 3]) -> Shape {
    let mut shape = Shape::default();
    for axis in 0..3 {
        for (side, at) in [(-1.0, least), (1.0, most)] {
            let corner = |u: usize, v: usize| {
                let mut p = [0.0; 3];
                p[axis] = at[axis];
                p[(axis + 1) % 3] = [least, most][u][(axis + 1) % 3];
                p[(axis + 2) % 3] = [least, most][v][(axis + 2) % 3];
                p
            };
            let mut normal = [0.0; 3];
            normal[axis] = side;
            shape.quad([corner(0, 0), corner(1, 0), corner(1, 1), corner(0, 1)], normal);
        }
    }
    shape
}

/// Two boxes in the form of an L: long along x, with a tower at the end; most of its box is empty.
pub(crate) fn ell() -> Shape {
    let (mut shape, tower) =
        (cuboid([0.0, 0.0, 0.0], [4.0, 1.0, 0.4]), cuboid([0.0, 0.0, 0.4], [0.4, 1.0, 3.0]));
    let first = shape.positions.len() as u32;
    shape.positions.extend(tower.positions);
    shape.normals.extend(tower.normals);
    shape.triangles.extend(tower.triangles.iter().map(|t| t.map(|i| first + i)));
    shape
}

/// A unit square in the plane z = 0, seen from above.
pub(crate) fn flat() -> Shape {
    let mut shape = Shape::default();
    shape.quad([[-1.0, -1.0, 0.0], [1.0, -1.0, 0.0], [1.0, 1.0, 0.0], [-1.0, 1.0, 0.0]], [0.0, 0.0, 1.0]);
    shape
}
