//! Points spread over a mesh's surface by its area.

use crate::{Frame, RigError, SurfacePoint};
use rayon::prelude::*;
use relight_core::SplitMix64;
use relight_core::vectors::{cross, difference, dot, length, scaled, unit, wide};

/// Triangles of a part, in the mesh's axes.
#[derive(Clone, Copy, Debug)]
pub struct Surface<'a> {
    /// Where the vertices are, in finite numbers.
    pub positions: &'a [[f32; 3]],
    /// Out of the surface, one a vertex; where there are none, the triangles' own count.
    pub normals: &'a [[f32; 3]],
    /// Three vertices each; those without area are no surface.
    pub triangles: &'a [[u32; 3]],
}

/// Candidates for each point, among which it moves to the middle of its cell.
const CANDIDATES: usize = 24;

/// Steps of Lloyd's relaxation at most: more move hardly any point, as they begin far apart.
const STEPS: usize = 16;

impl Surface<'_> {
    /// Box and sphere around the vertices.
    ///
    /// # Errors
    /// [`RigError::NoSurface`] without vertices.
    pub fn frame(&self) -> Result<Frame, RigError> {
        let ends = |pick: fn(f64, f64) -> f64| {
            let points = self.positions.iter().map(|&p| wide(p));
            points.reduce(|a, b| [0, 1, 2].map(|i| pick(a[i], b[i])))
        };
        let (Some(least), Some(largest)) = (ends(f64::min), ends(f64::max)) else {
            return Err(RigError::NoSurface);
        };
        let centre = [0, 1, 2].map(|i| 0.5 * (least[i] + largest[i]));
        let half_extent = [0, 1, 2].map(|i| 0.5 * (largest[i] - least[i]));
        let distances = self.positions.iter().map(|&p| length(difference(wide(p), centre)));
        let radius = distances.fold(0.0, f64::max);
        // A single point has no size to compare distances with: that of a unit.
        Ok(Frame { centre, half_extent, radius: if radius > 0.0 { radius } else { 1.0 } })
    }

    /// `count` points or fewer, evenly over the area: each in the middle of its cell of the surface (Lloyd's relaxation
    /// among candidates). Surfaces without area give their vertices. The same `seed` gives the same points.
    ///
    /// Source: *Irradiance Rigs*, section 2.2 ("Lloyd's repulsion algorithm").
    ///
    /// # Errors
    /// [`RigError::NoSurface`] without vertices.
    pub fn spread(&self, count: usize, seed: u64) -> Result<Vec<SurfacePoint>, RigError> {
        let candidates = self.strewn(CANDIDATES * count, seed)?;
        let chosen = relaxed(&candidates, count);
        Ok(chosen.into_iter().map(|candidate| candidates[candidate]).collect())
    }

    /// `count` points by area, one at random in each of as many shares of it; of a surface without area its vertices.
    ///
    /// # Errors
    /// [`RigError::NoSurface`] without vertices.
    pub fn strewn(&self, count: usize, seed: u64) -> Result<Vec<SurfacePoint>, RigError> {
        let frame = self.frame()?;
        // Up to each triangle, its own area included; relative to the frame, so that no size over- or underflows.
        let mut area = 0.0;
        let areas = self.triangles.iter().map(|&triangle| {
            let [a, b, c] =
                self.corners(triangle).map(|p| scaled(difference(p, frame.centre), 1.0 / frame.radius));
            area += 0.5 * length(cross(difference(b, a), difference(c, a)));
            area
        });
        let areas: Vec<f64> = areas.collect();
        if area == 0.0 {
            return Ok(self.vertices(count));
        }
        let mut random = SplitMix64::new(seed);
        let mut triangle = 0;
        let points = (0..count).map(|share| {
            let at = (share as f64 + random.unit()) / count as f64 * area;
            while areas[triangle] <= at && triangle + 1 < areas.len() {
                triangle += 1;
            }
            // A uniform point of a triangle: Shirley and Chiu's square to triangle.
            let root = random.unit().sqrt();
            let across = random.unit();
            self.point(self.triangles[triangle], [1.0 - root, root * (1.0 - across), root * across])
        });
        Ok(points.collect())
    }

    fn corners(&self, triangle: [u32; 3]) -> [[f64; 3]; 3] {
        triangle.map(|vertex| wide(self.positions[vertex as usize]))
    }

    fn point(&self, triangle: [u32; 3], weights: [f64; 3]) -> SurfacePoint {
        let corners = self.corners(triangle);
        let blend = |values: [[f64; 3]; 3]| {
            [0, 1, 2].map(|i| (0..3).fold(0.0, |sum, corner| sum + weights[corner] * values[corner][i]))
        };
        let [a, b, c] = corners;
        let flat = unit(cross(difference(b, a), difference(c, a))).unwrap_or([0.0, 0.0, 1.0]);
        let normal = match self.normals {
            [] => flat,
            normals => {
                let smooth = blend(triangle.map(|vertex| wide(normals[vertex as usize])));
                // Normals of a vertex without direction, or those that cancel each other.
                if dot(smooth, smooth) > 1e-12 { unit(smooth).unwrap_or(flat) } else { flat }
            }
        };
        SurfacePoint { position: blend(corners), normal }
    }

    /// At most `count` vertices, all different, evenly through their list.
    fn vertices(&self, count: usize) -> Vec<SurfacePoint> {
        let mut seen = std::collections::HashSet::new();
        let different = |p: &[f32; 3]| seen.insert(p.map(|c| (c + 0.0).to_bits()));
        let positions: Vec<[f32; 3]> = self.positions.iter().copied().filter(different).collect();
        let step = positions.len().div_ceil(count.max(1)).max(1);
        // Without a surface no side is out: upwards and downwards both, so that errors are seen from either.
        let both =
            |&p: &[f32; 3]| [1.0, -1.0].map(|z| SurfacePoint { position: wide(p), normal: [0.0, 0.0, z] });
        positions.iter().step_by(step).flat_map(both).collect()
    }
}

/// Indices of `count` candidates, each the nearest to the middle of those that are nearest to it.
fn relaxed(candidates: &[SurfacePoint], count: usize) -> Vec<usize> {
    if candidates.len() <= count {
        return (0..candidates.len()).collect();
    }
    let mut chosen = far_apart(candidates, count);
    for _ in 0..STEPS {
        let places = Places::new(chosen.iter().map(|&i| candidates[i].position));
        let cells: Vec<usize> = candidates.par_iter().map(|point| places.nearest(point.position)).collect();
        let mut sums = vec![([0.0; 3], 0usize); count];
        for (point, &cell) in candidates.iter().zip(&cells) {
            let (sum, points) = &mut sums[cell];
            *sum = [0, 1, 2].map(|i| sum[i] + point.position[i]);
            *points += 1;
        }
        let mut best = vec![(0, f64::INFINITY); count];
        for (i, (point, &cell)) in candidates.iter().zip(&cells).enumerate() {
            let (sum, points) = sums[cell];
            let distance = square(scaled(sum, 1.0 / points as f64), point.position);
            if distance < best[cell].1 {
                best[cell] = (i, distance);
            }
        }
        let moved = chosen
            .iter()
            .zip(&best)
            .map(|(&old, &(new, distance))| if distance.is_finite() { new } else { old });
        let moved: Vec<usize> = moved.collect();
        if moved == chosen {
            break;
        }
        chosen = moved;
    }
    chosen
}

/// Places among which the nearest is looked for, [`LANES`] side by side.
struct Places {
    axes: [Vec<[f64; LANES]>; 3],
}

/// Places that are compared at once.
const LANES: usize = 8;

impl Places {
    fn new(places: impl Iterator<Item = [f64; 3]>) -> Self {
        let mut axes: [Vec<[f64; LANES]>; 3] = Default::default();
        for (i, place) in places.enumerate() {
            for (axis, coordinate) in axes.iter_mut().zip(place) {
                if i % LANES == 0 {
                    // Lanes without a place are nowhere near.
                    axis.push([f64::INFINITY; LANES]);
                }
                axis[i / LANES][i % LANES] = coordinate;
            }
        }
        Self { axes }
    }

    /// The index of the place nearest to `point`, the first of several.
    fn nearest(&self, point: [f64; 3]) -> usize {
        let (mut least, mut at) = ([f64::INFINITY; LANES], [0usize; LANES]);
        let [x, y, z] = &self.axes;
        for (row, ((x, y), z)) in x.iter().zip(y).zip(z).enumerate() {
            for i in 0..LANES {
                let d = [x[i] - point[0], y[i] - point[1], z[i] - point[2]];
                let square = d[0] * d[0] + d[1] * d[1] + d[2] * d[2];
                let nearer = square < least[i];
                least[i] = if nearer { square } else { least[i] };
                at[i] = if nearer { row } else { at[i] };
            }
        }
        let places = (0..LANES).map(|i| (least[i], LANES * at[i] + i));
        places.fold((f64::INFINITY, 0), |best, place| if place < best { place } else { best }).1
    }
}

/// Indices of `count` candidates, each the farthest from those before it.
fn far_apart(candidates: &[SurfacePoint], count: usize) -> Vec<usize> {
    let mut squares = vec![f64::INFINITY; candidates.len()];
    let mut chosen = vec![0];
    while chosen.len() < count {
        let last = candidates[chosen[chosen.len() - 1]].position;
        let mut farthest = (0, 0.0);
        for (i, (point, least)) in candidates.iter().zip(&mut squares).enumerate() {
            *least = least.min(square(last, point.position));
            if *least > farthest.1 {
                farthest = (i, *least);
            }
        }
        chosen.push(farthest.0);
    }
    chosen
}

fn square(a: [f64; 3], b: [f64; 3]) -> f64 {
    let d = difference(a, b);
    dot(d, d)
}
