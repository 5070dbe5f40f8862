//! Rounded closed surfaces, made of the faces of a box.

use relight_core::vectors::{cross, difference, dot, frame_around, length, scaled, unit};
use std::collections::HashMap;

/// A mesh with a normal a vertex, wound to be seen from outside.
pub(crate) struct Surface {
    pub(crate) positions: Vec<[f64; 3]>,
    pub(crate) normals: Vec<[f64; 3]>,
    pub(crate) triangles: Vec<[u32; 3]>,
}

/// A point of a shape whose coordinates' `p`th powers add up to 1, in the direction `d`; x and y or x and z may be round.
#[derive(Clone, Copy)]
pub(crate) enum Round {
    /// An ellipsoid.
    Ellipsoid,
    /// A box with soft edges: fourth powers.
    Box,
    /// A cylinder with soft edges about the axis.
    Cylinder(usize),
}

impl Round {
    /// Below 1 within the shape, 1 on it.
    pub(crate) fn size(self, d: [f64; 3]) -> f64 {
        let [x, y, z] = d.map(|c| c * c);
        match self {
            Self::Ellipsoid => (x + y + z).sqrt(),
            Self::Box => (x * x + y * y + z * z).sqrt().sqrt(),
            Self::Cylinder(axis) => {
                let along = [x, y, z][axis];
                let across = x + y + z - along;
                (along * along + across * across).sqrt().sqrt()
            }
        }
    }
}

impl Surface {
    /// The faces of a box of `cells` (even) along each axis, blown up to a `round` shape from -1 to 1 and then moved by `place`.
    pub(crate) fn new(cells: [i32; 3], round: Round, place: impl Fn([f64; 3]) -> [f64; 3]) -> Self {
        let mut corners: HashMap<[i32; 3], u32> = HashMap::new();
        let mut positions = Vec::new();
        let mut triangles = Vec::new();
        let mut corner = |at: [i32; 3]| {
            *corners.entry(at).or_insert_with(|| {
                let d = [0, 1, 2].map(|i| f64::from(2 * at[i] - cells[i]) / f64::from(cells[i]));
                positions.push(place(scaled(d, 1.0 / round.size(d))));
                positions.len() as u32 - 1
            })
        };
        for axis in 0..3 {
            let (u, v) = ((axis + 1) % 3, (axis + 2) % 3);
            for side in [0, cells[axis]] {
                for (i, j) in (0..cells[u]).flat_map(|i| (0..cells[v]).map(move |j| (i, j))) {
                    let mut square = [[i, j], [i + 1, j], [i + 1, j + 1], [i, j + 1]].map(|[i, j]| {
                        let mut at = [side; 3];
                        (at[u], at[v]) = (i, j);
                        corner(at)
                    });
                    if side == 0 {
                        square.reverse();
                    }
                    let [a, b, c, d] = square;
                    triangles.extend([[a, b, c], [a, c, d]]);
                }
            }
        }
        let normals = smooth_normals(&positions, &triangles);
        Self { positions, normals, triangles }
    }

    /// A limb from one point to another, thicker at one end, round.
    pub(crate) fn limb(cells: [i32; 3], [from, to]: [[f64; 3]; 2], [thick, thin]: [f64; 2]) -> Self {
        let along = difference(to, from);
        let axis = unit(along).unwrap_or([0.0, 0.0, 1.0]);
        let [u, v] = frame_around(axis);
        Self::new(cells, Round::Cylinder(2), |[x, y, z]| {
            let share = 0.5 * (z + 1.0);
            let radius = thick + share * (thin - thick);
            [0, 1, 2].map(|i| from[i] + share * along[i] + radius * (x * u[i] + y * v[i]))
        })
    }

    /// A shape around `centre`.
    pub(crate) fn around(cells: [i32; 3], round: Round, centre: [f64; 3], half: [f64; 3]) -> Self {
        Self::new(cells, round, |q| [0, 1, 2].map(|i| centre[i] + half[i] * q[i]))
    }

    /// Without triangles all of whose corners are hidden, and vertices that nothing needs.
    pub(crate) fn without(self, hidden: impl Fn([f64; 3]) -> bool) -> Self {
        let hidden: Vec<bool> = self.positions.iter().map(|&position| hidden(position)).collect();
        let mut kept = vec![None; hidden.len()];
        let (mut positions, mut normals, mut triangles) = (Vec::new(), Vec::new(), Vec::new());
        for triangle in self.triangles.iter().filter(|corners| !corners.iter().all(|&v| hidden[v as usize])) {
            triangles.push(triangle.map(|vertex| {
                let vertex = vertex as usize;
                *kept[vertex].get_or_insert_with(|| {
                    positions.push(self.positions[vertex]);
                    normals.push(self.normals[vertex]);
                    positions.len() as u32 - 1
                })
            }));
        }
        Self { positions, normals, triangles }
    }

    /// All of them in one.
    pub(crate) fn joined(surfaces: impl IntoIterator<Item = Self>) -> Self {
        let mut whole = Self { positions: Vec::new(), normals: Vec::new(), triangles: Vec::new() };
        for surface in surfaces {
            let first = whole.positions.len() as u32;
            whole.positions.extend(surface.positions);
            whole.normals.extend(surface.normals);
            whole.triangles.extend(surface.triangles.iter().map(|corners| corners.map(|v| first + v)));
        }
        whole
    }

    /// Largest distance of a vertex from the middle of the box around all.
    pub(crate) fn radius(&self) -> f64 {
        let bound = |pick: fn(f64, f64) -> f64, start: f64| {
            self.positions.iter().fold([start; 3], |a, b| [0, 1, 2].map(|i| pick(a[i], b[i])))
        };
        let (low, high) = (bound(f64::min, f64::INFINITY), bound(f64::max, f64::NEG_INFINITY));
        let middle = [0, 1, 2].map(|i| 0.5 * (low[i] + high[i]));
        self.positions.iter().map(|&position| length(difference(position, middle))).fold(0.0, f64::max)
    }
}

/// Means of the triangles' normals around each vertex, weighted by their areas.
fn smooth_normals(positions: &[[f64; 3]], triangles: &[[u32; 3]]) -> Vec<[f64; 3]> {
    let mut sums = vec![[0.0; 3]; positions.len()];
    for corners in triangles {
        let [a, b, c] = corners.map(|vertex| positions[vertex as usize]);
        let normal = cross(difference(b, a), difference(c, a));
        for vertex in corners {
            let sum = &mut sums[*vertex as usize];
            *sum = [0, 1, 2].map(|i| sum[i] + normal[i]);
        }
    }
    debug_assert!(sums.iter().zip(positions).all(|(sum, _)| dot(*sum, *sum) > 0.0));
    sums.into_iter().map(|sum| unit(sum).unwrap_or([0.0, 0.0, 1.0])).collect()
}
