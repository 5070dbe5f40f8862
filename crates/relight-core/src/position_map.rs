//! Where each pixel's surface is: given, or from its depth and a camera.

use crate::{Camera, Projection};
use rayon::prelude::*;
use std::fmt;

/// The surface point of each pixel, in the axes of the light directions.
///
/// Source: P of Wong et al., *Lighting Precomputation Using the Relighting Map*, equation 3, and
/// *Interactive Relighting of Panoramas*, equation 2, where V points from the scene to the eye.
#[derive(Clone, Debug, PartialEq)]
pub struct PositionMap {
    /// Pixels in a row.
    pub width: usize,
    /// Rows, the first at the top.
    pub height: usize,
    /// width x height points, row-major. NaN in all three where there is no surface; where the sky
    /// is, a point as far along the ray as the numbers go.
    pub points: Vec<[f32; 3]>,
}

/// How far away the sky is, in units of the world: any lamp is in the direction of the eye from there,
/// and squares stay finite.
pub const SKY: f64 = 1e15;

/// The point of a pixel without a surface.
pub const NO_SURFACE: [f32; 3] = [f32::NAN; 3];

/// How far from its eye a camera's pixels see.
#[derive(Clone, Debug, PartialEq)]
pub struct DepthMap {
    /// Pixels in a row.
    pub width: usize,
    /// Rows, the first at the top.
    pub height: usize,
    /// width x height distances in units of the world, row-major. Infinity is the sky; 0, negative
    /// numbers and NaN are no surface.
    pub depths: Vec<f32>,
}

/// What a depth is the length of.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum DepthKind {
    /// The way along the pixel's ray.
    Ray,
    /// The part of that along the view's middle, as a z buffer has it.
    Z,
}

/// What a pixel sees.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum PointKind {
    /// A surface.
    Surface,
    /// Nothing nearer than a thousandth of [`SKY`].
    Sky,
    /// Nothing that is known.
    Missing,
}

/// Why depths and a camera give no positions.
#[derive(Clone, Debug, PartialEq, Eq)]
#[non_exhaustive]
pub enum DepthError {
    /// They have different sizes.
    Size {
        /// Width and height of the depths.
        depth: (usize, usize),
        /// Of the camera's pictures.
        camera: (usize, usize),
    },
    /// A panorama has no middle along which z could be measured.
    ZOfPanorama,
}

impl fmt::Display for DepthError {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Size { depth, camera } => write!(
                f,
                "the depths are {} x {} where the camera's pictures are {} x {}; give the camera that saw them",
                depth.0, depth.1, camera.0, camera.1
            ),
            Self::ZOfPanorama => {
                write!(
                    f,
                    "an equirectangular camera looks everywhere and has no z; give depths along the ray"
                )
            }
        }
    }
}

impl std::error::Error for DepthError {}

impl PointKind {
    /// What a point of a [`PositionMap`] is.
    pub fn of(point: [f32; 3]) -> Self {
        if point.iter().any(|c| !c.is_finite()) {
            Self::Missing
        } else if point.iter().all(|c| f64::from(c.abs()) < SKY / 1e3) {
            Self::Surface
        } else {
            Self::Sky
        }
    }
}

impl PositionMap {
    /// The points that `camera` sees `depth` away.
    ///
    /// A depth of 0, below 0 or of NaN gives [`NO_SURFACE`]; one beyond [`SKY`], as infinity, the point
    /// `SKY` along the ray. Points are computed in f64 and rounded once.
    ///
    /// Source: P = E - d V / |V| of Wong et al., *Interactive Relighting of Panoramas*, equation 2, whose
    /// V points from the scene to the eye; ours is the ray r = -V / |V|, so that P = E + d r.
    /// # Errors
    /// [`DepthError`] for depths of another size than the camera's, and z in panoramas.
    ///
    /// # Panics
    /// When `depth` has not the depths that its size asks for.
    pub fn from_depth(camera: &Camera, depth: &DepthMap, kind: DepthKind) -> Result<Self, DepthError> {
        let Camera { width, height, .. } = *camera;
        if (depth.width, depth.height) != (width, height) {
            return Err(DepthError::Size { depth: (depth.width, depth.height), camera: (width, height) });
        }
        if kind == DepthKind::Z && matches!(camera.projection, Projection::Equirectangular { .. }) {
            return Err(DepthError::ZOfPanorama);
        }
        assert_eq!(depth.depths.len(), width * height, "a depth a pixel");
        let mut points = vec![NO_SURFACE; width * height];
        let rows = points.par_chunks_mut(width).zip(depth.depths.par_chunks(width));
        rows.enumerate().for_each(|(y, (points, depths))| {
            for (x, (point, depth)) in points.iter_mut().zip(depths).enumerate() {
                if *depth > 0.0 {
                    *point = camera.point(x, y, f64::from(*depth), kind);
                }
            }
        });
        Ok(Self { width, height, points })
    }

    /// How many points are surface, sky and missing.
    pub fn counts(&self) -> [usize; 3] {
        let mut counts = [0; 3];
        for point in &self.points {
            counts[match PointKind::of(*point) {
                PointKind::Surface => 0,
                PointKind::Sky => 1,
                PointKind::Missing => 2,
            }] += 1;
        }
        counts
    }

    /// Gives pixels without a surface that lie within `radius` pixels of one the mean of the nearest surface
    /// points around them: at an edge a camera sees partly surface and partly nothing, and the part that it sees is
    /// lit as its neighbours are.
    pub fn fill_edges(&mut self, radius: usize) {
        for _ in 0..radius {
            let before = self.points.clone();
            let (width, height) = (self.width, self.height);
            for (i, point) in self.points.iter_mut().enumerate().filter(|(_, point)| point[0].is_nan()) {
                let (x, y) = (i % width, i / width);
                let (mut sum, mut count) = ([0.0f64; 3], 0.0);
                for ny in y.saturating_sub(1)..(y + 2).min(height) {
                    for nx in x.saturating_sub(1)..(x + 2).min(width) {
                        let neighbour = before[ny * width + nx].map(f64::from);
                        if neighbour.iter().all(|c| c.abs() < SKY / 1e3) {
                            count += 1.0;
                            (0..3).for_each(|axis| sum[axis] += neighbour[axis]);
                        }
                    }
                }
                if count > 0.0 {
                    *point = sum.map(|c| (c / count) as f32);
                }
            }
        }
    }

    /// The smallest box that holds all points that are neither sky nor missing, (least, largest) by axis;
    /// `None` where there are none.
    pub fn bounds(&self) -> Option<([f32; 3], [f32; 3])> {
        let mut points = self.points.iter().filter(|point| PointKind::of(**point) == PointKind::Surface);
        let first = *points.next()?;
        Some(points.fold((first, first), |(least, largest), point| {
            ([0, 1, 2].map(|i| least[i].min(point[i])), [0, 1, 2].map(|i| largest[i].max(point[i])))
        }))
    }
}

impl Camera {
    /// What the middle of pixel (x, y) sees `depth` away, at most [`SKY`].
    fn point(&self, x: usize, y: usize, depth: f64, kind: DepthKind) -> [f32; 3] {
        let ray = self.ray(x as f64 + 0.5, y as f64 + 0.5);
        let per_depth = match kind {
            DepthKind::Ray => 1.0,
            DepthKind::Z => (0..3).map(|i| ray.direction[i] * self.forward[i]).sum(),
        };
        let distance = (depth / per_depth).min(SKY);
        [0, 1, 2].map(|i| (ray.origin[i] + distance * ray.direction[i]) as f32)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Looks down from (1, 2, 10): right is x, up is y.
    fn camera(projection: Projection) -> Camera {
        Camera::along(projection, (4, 3), [1.0, 2.0, 10.0], [0.0, 0.0, -2.0], [0.0, 1.0, 0.0]).unwrap()
    }

    fn from_depths(camera: &Camera, kind: DepthKind, depths: [f32; 12]) -> PositionMap {
        let depth = DepthMap { width: 4, height: 3, depths: depths.to_vec() };
        PositionMap::from_depth(camera, &depth, kind).unwrap()
    }

    #[test]
    fn z_depths_of_a_plane_are_the_plane_in_perspective_and_parallel_views() {
        // 90 degrees wide: at z = 7 below the eye the picture is 14 wide, 3.5 a pixel.
        let wide = camera(Projection::Perspective { fov_x: std::f64::consts::FRAC_PI_2 });
        let parallel = camera(Projection::Orthographic { width: 14.0 });
        for camera in [wide, parallel] {
            let map = from_depths(&camera, DepthKind::Z, [7.0; 12]);
            for y in 0..3 {
                for x in 0..4 {
                    let expected = [1.0 + 3.5 * (x as f32 - 1.5), 2.0 - 3.5 * (y as f32 - 1.0), 3.0];
                    let found = map.points[4 * y + x];
                    let near = (0..3).all(|i| (found[i] - expected[i]).abs() < 1e-5);
                    assert!(near, "{x} {y}: {found:?} is not {expected:?}");
                }
            }
        }
        let ray = from_depths(&parallel, DepthKind::Ray, [7.0; 12]);
        assert_eq!(ray, from_depths(&parallel, DepthKind::Z, [7.0; 12]));
    }

    #[test]
    fn depths_along_the_ray_lie_on_a_sphere_about_the_eye() {
        let panorama = camera(Projection::Equirectangular { latitude: 1.5 });
        for camera in [camera(Projection::Perspective { fov_x: 2.0 }), panorama] {
            let depths: [f32; 12] = std::array::from_fn(|i| 0.5 + i as f32);
            for (point, depth) in from_depths(&camera, DepthKind::Ray, depths).points.iter().zip(depths) {
                let squares = (0..3).map(|i| (f64::from(point[i]) - camera.eye[i]).powi(2)).sum::<f64>();
                assert!((squares.sqrt() - f64::from(depth)).abs() < 1e-5, "{point:?} {depth}");
            }
        }
    }

    #[test]
    fn no_depth_is_no_surface_and_infinite_depth_is_the_sky_along_the_ray() {
        let camera = camera(Projection::Perspective { fov_x: 1.0 });
        for kind in [DepthKind::Ray, DepthKind::Z] {
            let none = [f32::NAN, 0.0, -0.0, -3.0, f32::NEG_INFINITY];
            let (sky, near) = ([f32::INFINITY, 1e30, 2e15], [1e-45, 1e-40, 4.0, 5.0]);
            let depths: Vec<f32> = none.into_iter().chain(sky).chain(near).collect();
            let map = from_depths(&camera, kind, depths.try_into().unwrap());
            assert_eq!(map.counts(), [4, 3, 5]);
            assert!(map.points[..5].iter().flatten().all(|c| c.is_nan()));
            for at in 5..8 {
                let ray = camera.ray((at % 4) as f64 + 0.5, (at / 4) as f64 + 0.5);
                let expected = [0, 1, 2].map(|i| (camera.eye[i] + SKY * ray.direction[i]) as f32);
                assert_eq!(map.points[at], expected);
                assert!(map.points[at].iter().map(|c| c * c).sum::<f32>().is_finite());
            }
            assert_eq!(map.points[8], [1.0, 2.0, 10.0]);
            // The box knows nothing of sky and of what is missing.
            let (least, largest) = map.bounds().unwrap();
            assert_eq!((least[0], largest[1], largest[2]), (1.0, 2.0, 10.0));
            assert!(largest[0] < 4.0 && least[2] > 4.99 && least[2] < 6.0, "{least:?} {largest:?}");
        }
    }

    #[test]
    fn what_a_point_is() {
        for (point, kind) in [
            ([0.0; 3], PointKind::Surface),
            ([-0.9e12, 0.0, 3.0], PointKind::Surface),
            ([0.0, -1.1e12, 3.0], PointKind::Sky),
            ([0.0, 0.0, f32::NAN], PointKind::Missing),
            ([f32::NAN, 0.0, 0.0], PointKind::Missing),
            ([f32::NEG_INFINITY, 0.0, 0.0], PointKind::Missing),
            ([1e15, f32::NAN, 0.0], PointKind::Missing),
        ] {
            assert_eq!(PointKind::of(point), kind, "{point:?}");
        }
    }

    #[test]
    fn depths_of_another_size_and_z_in_panoramas_are_refused() {
        let depth = DepthMap { width: 3, height: 4, depths: vec![1.0; 12] };
        let panorama = camera(Projection::Equirectangular { latitude: 1.0 });
        let size = DepthError::Size { depth: (3, 4), camera: (4, 3) };
        assert_eq!(PositionMap::from_depth(&panorama, &depth, DepthKind::Ray), Err(size));
        let depth = DepthMap { width: 4, height: 3, ..depth };
        let z = PositionMap::from_depth(&panorama, &depth, DepthKind::Z);
        assert_eq!(z, Err(DepthError::ZOfPanorama));
    }

    #[test]
    fn pixels_at_an_edge_take_their_neighbours_place() {
        // A surface in the two columns at the left, sky at the right, nothing between.
        let point = |i: usize| match i % 8 {
            x @ 0..2 => [x as f32, (i / 8) as f32, 5.0],
            7 => [SKY as f32, 0.0, 0.0],
            _ => NO_SURFACE,
        };
        let mut map = PositionMap { width: 8, height: 3, points: (0..24).map(point).collect() };
        let before = map.clone();
        map.fill_edges(2);
        for (i, (after, before)) in map.points.iter().zip(&before.points).enumerate() {
            match i % 8 {
                2 | 3 => {
                    assert_eq!((after[0], after[2]), (1.0, 5.0), "pixel {i}");
                    // Of rows at the border the mean is theirs and their neighbour's.
                    assert!((after[1] - (i / 8) as f32).abs() <= 0.75, "pixel {i}: {after:?}");
                }
                4..7 => assert!(after[0].is_nan(), "the sky and what is far off lend nothing"),
                _ => assert_eq!(after, before),
            }
        }
    }
}
