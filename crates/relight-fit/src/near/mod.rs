//! Lamps near a surface: each pixel sees them from another direction and another distance.
//!
//! [`NearLamps`] knows where lamps and surface are, [`LevelledStack`] takes fall-off and vignetting out of pictures,
//! [`near_least_squares`] judges a fit, and [`NearSolutions`] holds what makes coefficients of a pixel's values at every place.

mod judge;
mod levelled;
mod solutions;

pub use judge::near_least_squares;
pub use levelled::LevelledStack;
pub(crate) use solutions::NearScratch;
pub use solutions::{MOST_OFF, NearSolutions, near_bytes};

use crate::FitError;
use nalgebra::DMatrix;
use relight_core::vectors::{difference, length, wide};
use relight_core::{Basis, Direction, PointKind, PositionMap};

/// A lamp that is nearer to a point than this part of its distance from the middle stands at the surface there: what its
/// direction is hangs on less than positions are known to.
pub const AT_SURFACE: f64 = 1e-3;

/// The least ridge, relative to the largest singular value squared: it stands for the least-norm solution where lamps don't
/// determine all functions (docs/stability.md, singular values below 1e-6 count as none).
const LEAST_RIDGE: f64 = 1e-12;

/// Where the surface of each pixel is, in the axes and the unit of the lamps' positions.
#[derive(Clone, Debug, PartialEq)]
pub enum NearSurface {
    /// The plane z = 0, seen from straight above.
    Plane {
        /// Pixels in a row.
        width: usize,
        /// Rows, the first at the top.
        height: usize,
        /// x and y of the middle of the upper left pixel.
        first: [f64; 2],
        /// Edge of a pixel, above 0.
        pixel: f64,
    },
    /// A point a pixel.
    Points(PositionMap),
}

/// How a lens darkens the picture away from its axis: by the fourth power of the cosine.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Vignetting {
    /// Distance from the lens to the picture in pixels, above 0.
    pub focal: f64,
    /// Where the axis meets the picture: pixels to the right of its left edge and below its top edge.
    pub axis: [f64; 2],
}

/// Lamps at known places around a surface at a known place.
#[derive(Clone, Debug)]
pub struct NearLamps {
    positions: Vec<[f64; 3]>,
    surface: NearSurface,
    middle: [f64; 3],
    /// From the middle, by lamp.
    distances: Vec<f64>,
    directions: Vec<Direction>,
    vignetting: Option<Vignetting>,
}

impl NearSurface {
    /// Width and height in pixels.
    pub fn size(&self) -> (usize, usize) {
        match self {
            Self::Plane { width, height, .. } => (*width, *height),
            Self::Points(map) => (map.width, map.height),
        }
    }

    /// The point of pixel `pixel`, counted in rows from the top left.
    fn point(&self, pixel: usize) -> [f32; 3] {
        match self {
            Self::Plane { width, first, pixel: edge, .. } => {
                let (x, y) = (pixel % width, pixel / width);
                [(first[0] + edge * x as f64) as f32, (first[1] - edge * y as f64) as f32, 0.0]
            }
            Self::Points(map) => map.points[pixel],
        }
    }
}

impl NearLamps {
    /// Lamps at `positions`, in picture order, around `surface`.
    ///
    /// Directions and distances that stand for the whole picture are those from its middle: the origin for a plane, the mean of
    /// all points for others. Pixels without a surface, and those of the sky, are taken to lie in that middle.
    ///
    /// # Errors
    /// [`FitError::NoLights`] without lamps, [`FitError::LampInTheMiddle`] for a lamp in the middle or nowhere,
    /// [`FitError::NoSurface`] for a map without a single point.
    pub fn new(
        positions: Vec<[f64; 3]>,
        mut surface: NearSurface,
        vignetting: Option<Vignetting>,
    ) -> Result<Self, FitError> {
        if positions.is_empty() {
            return Err(FitError::NoLights);
        }
        let middle = match &mut surface {
            NearSurface::Plane { .. } => [0.0; 3],
            NearSurface::Points(map) => {
                let is_surface = |point: &&[f32; 3]| PointKind::of(**point) == PointKind::Surface;
                let (mut sum, mut count) = ([0.0f64; 3], 0usize);
                for point in map.points.iter().filter(is_surface) {
                    (0..3).for_each(|axis| sum[axis] += f64::from(point[axis]));
                    count += 1;
                }
                if count == 0 {
                    return Err(FitError::NoSurface);
                }
                let middle = sum.map(|sum| sum / count as f64);
                let elsewhere = map.points.iter_mut().filter(|point| !is_surface(&&**point));
                elsewhere.for_each(|point| *point = middle.map(|c| c as f32));
                middle
            }
        };
        let ways = positions.iter().map(|position| difference(*position, middle));
        let (mut distances, mut directions) = (Vec::new(), Vec::new());
        for (light, [x, y, z]) in ways.enumerate() {
            let direction = Direction::new(x, y, z).map_err(|_| FitError::LampInTheMiddle { light })?;
            distances.push(length([x, y, z]));
            directions.push(direction);
        }
        Ok(Self { positions, surface, middle, distances, directions, vignetting })
    }

    /// Where the lamps are, in picture order.
    pub fn positions(&self) -> &[[f64; 3]] {
        &self.positions
    }

    /// From the middle of the surface towards each lamp.
    pub fn directions(&self) -> &[Direction] {
        &self.directions
    }

    /// From the middle of the surface to each lamp.
    pub fn distances(&self) -> &[f64] {
        &self.distances
    }

    /// Where the surface is.
    pub fn surface(&self) -> &NearSurface {
        &self.surface
    }

    /// Lamps in or behind the plane z = 0 where that is the surface: they light nothing and are left out of the fit.
    pub fn behind(&self) -> Vec<usize> {
        (0..self.positions.len()).filter(|&light| self.is_behind(light)).collect()
    }

    fn is_behind(&self, light: usize) -> bool {
        matches!(self.surface, NearSurface::Plane { .. }) && self.positions[light][2] <= 0.0
    }

    /// The point of each pixel.
    pub fn position_map(&self) -> PositionMap {
        let (width, height) = self.surface.size();
        let points = (0..width * height).map(|pixel| self.surface.point(pixel)).collect();
        PositionMap { width, height, points }
    }

    /// The part of light that the lens lets through at pixel `pixel`, 1 on its axis.
    ///
    /// Source: the cosine fourth law, E = L (pi / 4) (d / f)^2 cos^4(a), as in Horn, *Robot Vision*, 1986, section 10.3.
    pub fn transmission(&self, pixel: usize) -> f64 {
        let Some(Vignetting { focal, axis }) = self.vignetting else { return 1.0 };
        let (width, _) = self.surface.size();
        let x = (pixel % width) as f64 + 0.5 - axis[0];
        let y = (pixel / width) as f64 + 0.5 - axis[1];
        let square = 1.0 + (x * x + y * y) / (focal * focal);
        1.0 / (square * square)
    }

    /// Whether the transmission differs from pixel to pixel.
    pub fn is_vignetted(&self) -> bool {
        self.vignetting.is_some()
    }

    /// From `point` towards lamp `light`; `None` where the lamp says nothing there: it stands at the surface or behind it.
    pub fn direction(&self, light: usize, point: [f64; 3]) -> Option<Direction> {
        let [x, y, z] = difference(self.positions[light], point);
        if self.is_behind(light) || length([x, y, z]) < AT_SURFACE * self.distances[light] {
            return None;
        }
        Direction::new(x, y, z).ok()
    }

    /// The basis at the lamps as `point` sees them, N x k, row-major; zeros for lamps that say nothing there.
    fn design(&self, basis: &Basis, point: [f64; 3]) -> Vec<f64> {
        let functions = basis.count();
        let mut design = vec![0.0; self.positions.len() * functions];
        for (light, row) in design.chunks_exact_mut(functions).enumerate() {
            if let Some(direction) = self.direction(light, point) {
                basis.evaluate(direction, row);
            }
        }
        design
    }

    /// The point of pixel `pixel` in f64.
    fn point(&self, pixel: usize) -> [f64; 3] {
        wide(self.surface.point(pixel))
    }
}

/// The k x N matrix (row-major) `argmin_c |W^(1/2) (A c - y)|^2 + ridge |c|^2` of `design` A, N x k.
///
/// By QR of A over `ridge^(1/2) I`, which squares no condition. A row of zeros has no weight.
fn ridge_solution(design: &[f64], weights: &[f64], ridge: f64) -> Vec<f64> {
    let lights = weights.len();
    let functions = design.len() / lights;
    let root = ridge.sqrt();
    let stacked = DMatrix::from_fn(lights + functions, functions, |i, j| match i.checked_sub(lights) {
        None => weights[i].sqrt() * design[i * functions + j],
        Some(row) if row == j => root,
        Some(_) => 0.0,
    });
    let (q, r) = stacked.qr().unpack();
    let mut solution = vec![0.0; functions * lights];
    // Back substitution, all lights at a time.
    for j in (0..functions).rev() {
        let (upper, lower) = solution.split_at_mut((j + 1) * lights);
        let row = &mut upper[j * lights..];
        for (i, value) in row.iter_mut().enumerate() {
            *value = q[(i, j)] * weights[i].sqrt();
        }
        for (later, known) in lower.chunks_exact(lights).enumerate() {
            let factor = r[(j, j + 1 + later)];
            row.iter_mut().zip(known).for_each(|(value, known)| *value -= factor * known);
        }
        row.iter_mut().for_each(|value| *value /= r[(j, j)]);
    }
    solution
}

/// The ridge of a node: relative to the singular values in the middle, so that it is the same everywhere.
fn absolute_ridge(ridge: f64, largest: f64) -> f64 {
    ridge.max(LEAST_RIDGE) * largest * largest
}
