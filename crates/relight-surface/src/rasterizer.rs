//! Which triangle a pixel sees, and where on it.
//!
//! Edges are planes through the eye (homogeneous 2-D rasterising), so triangles that reach behind the eye need
//! no clipping: a pixel is inside where it lies on the inner side of three such planes, and sees the triangle
//! when that point is in front of the eye. Two triangles that share an edge compute its plane with opposite
//! signs to the bit, so that no pixel between them is missed or drawn twice.
//! Source: Olano and Greer, *Triangle Scan Conversion using 2D Homogeneous Coordinates*, 1997.

use crate::{Mesh, SurfaceError};
use rayon::prelude::*;
use relight_core::vectors::{cross, difference, dot, wide};
use relight_core::{Camera, Projection};

/// Rows drawn at a time.
const BAND: usize = 16;

/// What a pixel sees of a mesh.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Fragment {
    /// Index of the triangle; [`Fragment::NOTHING`] where none is seen.
    pub triangle: u32,
    /// How much of each corner, on the triangle itself (perspective-correct); they add up to 1.
    pub weights: [f32; 3],
}

impl Fragment {
    /// The triangle of a pixel that sees none.
    pub const NOTHING: u32 = u32::MAX;

    /// A pixel that sees no triangle.
    pub const NONE: Self = Self { triangle: Self::NOTHING, weights: [0.0; 3] };
}

/// What every pixel of a picture sees.
#[derive(Clone, Debug, PartialEq)]
pub struct Fragments {
    /// Pixels in a row.
    pub width: usize,
    /// Rows, the first at the top.
    pub height: usize,
    /// width x height, row-major.
    pub fragments: Vec<Fragment>,
}

/// What each pixel of `camera` sees at its centre: the nearest triangle in front of the eye, the earlier one
/// where two are equally near.
///
/// Edges belong to triangles by the top-left rule; triangles without area are skipped, both sides are drawn.
///
/// # Errors
/// Those of [`Mesh::check`], and [`SurfaceError::PanoramicCamera`].
pub fn rasterize(mesh: &Mesh, camera: &Camera) -> Result<Fragments, SurfaceError> {
    mesh.check()?;
    let (half, is_perspective) = match camera.projection {
        Projection::Perspective { fov_x } => (libm::tan(0.5 * fov_x), true),
        Projection::Orthographic { width } => (0.5 * width, false),
        Projection::Equirectangular { .. } => return Err(SurfaceError::PanoramicCamera),
    };
    let corners = mesh.positions.iter().map(|&position| {
        let from_eye = difference(wide(position), camera.eye);
        let [u, v, depth] = [camera.right, camera.up, camera.forward].map(|axis| dot(axis, from_eye));
        Corner { homogeneous: [u / half, v / half, if is_perspective { depth } else { 1.0 }], depth }
    });
    let (width, height) = (camera.width as f64, camera.height as f64);
    Ok(fragments(&Drawing {
        corners: corners.collect(),
        triangles: &mesh.triangles,
        size: (camera.width, camera.height),
        across: &|x| 2.0 * (x as f64 + 0.5) / width - 1.0,
        upwards: &|y| (height - 2.0 * (y as f64 + 0.5)) / width,
        pixel_of: &|across, upwards| (0.5 * width * (across + 1.0), 0.5 * (height - width * upwards)),
    }))
}

/// Whether the centre of each texel of a lightmap of `width` x `height` lies in a triangle of `mesh`, by its
/// lightmap coordinates; row-major.
///
/// # Errors
/// Those of [`Mesh::check`], and [`SurfaceError::Missing`] for a mesh without coordinates.
pub fn chart_coverage(mesh: &Mesh, width: usize, height: usize) -> Result<Vec<bool>, SurfaceError> {
    mesh.check()?;
    let coordinates = mesh.lightmap_coordinates()?;
    let corner = |&[u, v]: &[f32; 2]| Corner {
        homogeneous: [f64::from(u) * width as f64, -f64::from(v) * height as f64, 1.0],
        depth: 1.0,
    };
    let fragments = fragments(&Drawing {
        corners: coordinates.iter().map(corner).collect(),
        triangles: &mesh.triangles,
        size: (width, height),
        across: &|x| x as f64 + 0.5,
        upwards: &|y| -(y as f64 + 0.5),
        pixel_of: &|across, upwards| (across, -upwards),
    });
    Ok(fragments.fragments.iter().map(|fragment| fragment.triangle != Fragment::NOTHING).collect())
}

/// A vertex as the picture plane has it.
#[derive(Clone, Copy)]
struct Corner {
    /// The point is seen at (x / z, y / z) of the picture plane.
    homogeneous: [f64; 3],
    /// Seen where above 0, the nearest one.
    depth: f64,
}

/// Triangles and the picture plane that they are drawn on.
struct Drawing<'a> {
    corners: Vec<Corner>,
    triangles: &'a [[u32; 3]],
    size: (usize, usize),
    /// Coordinate of a column's centre on the picture plane, growing.
    across: &'a (dyn Fn(usize) -> f64 + Sync),
    /// Coordinate of a row's centre, falling.
    upwards: &'a (dyn Fn(usize) -> f64 + Sync),
    /// Pixels from the upper left corner of a place of the picture plane.
    pixel_of: &'a (dyn Fn(f64, f64) -> (f64, f64) + Sync),
}

/// Pixels that a triangle may cover: columns and rows, ends excluded.
#[derive(Clone, Copy)]
struct Bounds {
    columns: (usize, usize),
    rows: (usize, usize),
}

fn fragments(drawing: &Drawing<'_>) -> Fragments {
    let (width, height) = drawing.size;
    let bounds: Vec<_> = drawing.triangles.par_iter().map(|&triangle| bounds_of(drawing, triangle)).collect();
    let mut fragments = vec![Fragment::NONE; width * height];
    fragments.par_chunks_mut(BAND * width).enumerate().for_each(|(band, out)| {
        let rows = (band * BAND, band * BAND + out.len() / width);
        let mut nearest = vec![f64::INFINITY; out.len()];
        for (index, bounds) in bounds.iter().enumerate() {
            let (top, bottom) = (bounds.rows.0.max(rows.0), bounds.rows.1.min(rows.1));
            if top < bottom {
                let bounds = Bounds { rows: (top, bottom), ..*bounds };
                draw(drawing, index, bounds, rows.0 * width, out, &mut nearest);
            }
        }
    });
    Fragments { width, height, fragments }
}

fn bounds_of(drawing: &Drawing<'_>, triangle: [u32; 3]) -> Bounds {
    let nothing = Bounds { columns: (0, 0), rows: (0, 0) };
    let corners = triangle.map(|vertex| drawing.corners[vertex as usize]);
    if corners.iter().all(|corner| corner.depth <= 0.0) {
        return nothing;
    }
    let (width, height) = drawing.size;
    if corners.iter().any(|corner| corner.homogeneous[2] <= 0.0) {
        return Bounds { columns: (0, width), rows: (0, height) };
    }
    let places = corners.map(|Corner { homogeneous: [x, y, z], .. }| (drawing.pixel_of)(x / z, y / z));
    // A pixel more on each side: the edges decide, these bounds only save time.
    let range = |of: fn(&(f64, f64)) -> f64, size: usize| {
        let least = places.iter().map(of).fold(f64::INFINITY, f64::min) - 1.0;
        let largest = places.iter().map(of).fold(f64::NEG_INFINITY, f64::max) + 1.0;
        ((least.floor().max(0.0) as usize).min(size), (largest.ceil().max(0.0) as usize).min(size))
    };
    Bounds { columns: range(|place| place.0, width), rows: range(|place| place.1, height) }
}

fn draw(
    drawing: &Drawing<'_>,
    index: usize,
    bounds: Bounds,
    first: usize,
    out: &mut [Fragment],
    nearest: &mut [f64],
) {
    let corners = drawing.triangles[index].map(|vertex| drawing.corners[vertex as usize]);
    let [a, b, c] = corners.map(|corner| corner.homogeneous);
    let edges = [cross(b, c), cross(c, a), cross(a, b)];
    // Its sign is that of every edge inside; 0 for triangles that are seen along their plane or have no area. Where
    // rounding makes it another number for those, no pixel is on the inner side of all edges.
    let orientation = dot(a, edges[0]);
    if orientation == 0.0 || !orientation.is_finite() {
        return;
    }
    let edges = if orientation < 0.0 { edges.map(|edge| edge.map(|c| -c)) } else { edges };
    // Centres on an edge belong to the triangle to the right of it, or below where it is level.
    let owns = edges.map(|[x, y, _]| x > 0.0 || (x == 0.0 && y < 0.0));
    for row in bounds.rows.0..bounds.rows.1 {
        let upwards = (drawing.upwards)(row);
        for column in bounds.columns.0..bounds.columns.1 {
            let across = (drawing.across)(column);
            let inner = edges.map(|[x, y, z]| x * across + y * upwards + z);
            let inside = (0..3).all(|i| inner[i] > 0.0 || (inner[i] == 0.0 && owns[i]));
            let sum = inner[0] + inner[1] + inner[2];
            if !inside || sum <= 0.0 {
                continue;
            }
            let weights = inner.map(|value| value / sum);
            let depth = (0..3).fold(0.0, |sum, i| sum + weights[i] * corners[i].depth);
            let pixel = row * drawing.size.0 + column - first;
            if depth > 0.0 && depth < nearest[pixel] {
                nearest[pixel] = depth;
                out[pixel] = Fragment { triangle: index as u32, weights: weights.map(|w| w as f32) };
            }
        }
    }
}
