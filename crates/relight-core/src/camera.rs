//! Cameras: which ray a pixel sees, and where a point is seen.

use crate::vectors::{cross, dot, length, unit};
use std::f64::consts::{FRAC_PI_2, PI};
use std::fmt;

/// How rays leave a camera.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Projection {
    /// Through one point; the picture is `fov_x` radians wide, 0 to pi.
    Perspective {
        /// Angle between the left and the right edge, in radians.
        fov_x: f64,
    },
    /// Parallel; the picture is `width` units of the world wide.
    Orthographic {
        /// Distance of the left and the right edge.
        width: f64,
    },
    /// Equirectangular: azimuth along x, the whole turn from -pi to pi and growing to the right,
    /// latitude along y from `latitude` at the upper edge to -`latitude` at the lower.
    Equirectangular {
        /// In radians, 0 to pi / 2; pi / 2 is the whole sphere.
        latitude: f64,
    },
}

/// A camera: its pictures are `width` x `height` pixels, pixel (x, y) centred at (x + 0.5, y + 0.5), y down.
///
/// `right`, `up` and `forward` are orthonormal; `forward` is the middle of the picture (and of a
/// panorama), `right` x `forward` = -`up` in right-handed axes.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Camera {
    /// How rays leave it.
    pub projection: Projection,
    /// Pixels in a row.
    pub width: usize,
    /// Rows.
    pub height: usize,
    /// Where it stands.
    pub eye: [f64; 3],
    /// Unit vector to the right of the picture.
    pub right: [f64; 3],
    /// Unit vector to its top.
    pub up: [f64; 3],
    /// Unit vector into it.
    pub forward: [f64; 3],
}

/// What a pixel sees along.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Ray {
    /// Where it starts.
    pub origin: [f64; 3],
    /// Unit vector from the eye into the scene.
    pub direction: [f64; 3],
}

/// Where a camera sees a point.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Seen {
    /// Pixels from the left edge.
    pub x: f64,
    /// Pixels from the upper edge.
    pub y: f64,
    /// Distance along the ray.
    pub distance: f64,
}

/// Why there is no such camera.
#[derive(Clone, Debug, PartialEq)]
#[non_exhaustive]
pub enum CameraError {
    /// A number outside its range.
    OutOfRange {
        /// Which.
        name: &'static str,
        /// What it was.
        value: f64,
        /// What is allowed.
        allowed: &'static str,
    },
    /// Eye and target are the same, or `up` points along the view.
    NoView {
        /// Eye to target.
        forward: [f64; 3],
        /// As given.
        up: [f64; 3],
    },
}

impl fmt::Display for CameraError {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::OutOfRange { name, value, allowed } => {
                write!(f, "{name} is {value}; the camera needs {allowed}")
            }
            Self::NoView { forward, up } => write!(
                f,
                "the view along {forward:?} with {up:?} upwards is none; eye and target must differ and up must not \
                 point along the view"
            ),
        }
    }
}

impl std::error::Error for CameraError {}

impl Camera {
    /// A camera at `eye` that looks at `target`, its pictures' top as near to `up` as may be.
    ///
    /// # Errors
    /// [`CameraError`] for sizes of 0, angles and widths outside their ranges, coordinates that are not
    /// finite, and where eye, target and up span no view.
    pub fn new(
        projection: Projection,
        size: (usize, usize),
        eye: [f64; 3],
        target: [f64; 3],
        up: [f64; 3],
    ) -> Result<Self, CameraError> {
        check_coordinates(eye.into_iter().chain(target))?;
        Self::along(projection, size, eye, [0, 1, 2].map(|i| target[i] - eye[i]), up)
    }

    /// A camera at `eye` that looks along `forward`, of any length, its pictures' top as near to `up` as
    /// may be.
    ///
    /// # Errors
    /// As of [`Self::new`].
    pub fn along(
        projection: Projection,
        (width, height): (usize, usize),
        eye: [f64; 3],
        forward: [f64; 3],
        up: [f64; 3],
    ) -> Result<Self, CameraError> {
        let (name, value, allowed, inside) = match projection {
            Projection::Perspective { fov_x } => (
                "the horizontal field of view",
                fov_x.to_degrees(),
                "above 0 and below 180 degrees",
                fov_x > 0.0 && fov_x < PI,
            ),
            Projection::Orthographic { width } => {
                ("the picture's width", width, "a finite width above 0", width > 0.0 && width.is_finite())
            }
            Projection::Equirectangular { latitude } => {
                let inside = latitude > 0.0 && latitude <= FRAC_PI_2 + 1e-12;
                ("the largest latitude", latitude.to_degrees(), "above 0 and up to 90 degrees", inside)
            }
        };
        if !inside {
            return Err(CameraError::OutOfRange { name, value, allowed });
        }
        for (name, size) in [("the width in pixels", width), ("the height in pixels", height)] {
            if size == 0 {
                return Err(CameraError::OutOfRange { name, value: 0.0, allowed: "at least 1" });
            }
        }
        check_coordinates(eye.into_iter().chain(forward).chain(up))?;
        let no_view = CameraError::NoView { forward, up };
        let forward = unit(forward).ok_or_else(|| no_view.clone())?;
        let upward = unit(up).ok_or_else(|| no_view.clone())?;
        let across = cross(forward, upward);
        if dot(across, across) < 1e-12 {
            return Err(no_view);
        }
        let right = unit(across).ok_or(no_view)?;
        Ok(Self { projection, width, height, eye, right, up: cross(right, forward), forward })
    }

    /// The ray through (x, y) in pixels from the upper left corner; the middle of the first pixel is
    /// (0.5, 0.5).
    pub fn ray(&self, x: f64, y: f64) -> Ray {
        let (width, height) = (self.width as f64, self.height as f64);
        // -1 to 1 from left to right, the same scale upwards from the middle.
        let across = 2.0 * x / width - 1.0;
        let upwards = (height - 2.0 * y) / width;
        match self.projection {
            Projection::Perspective { fov_x } => {
                let half = libm::tan(0.5 * fov_x);
                let direction = self.combine(across * half, upwards * half, 1.0);
                Ray { origin: self.eye, direction: unit(direction).unwrap_or(self.forward) }
            }
            Projection::Orthographic { width } => {
                let [u, v] = [across, upwards].map(|c| 0.5 * width * c);
                let offset = self.combine(u, v, 0.0);
                Ray { origin: [0, 1, 2].map(|i| self.eye[i] + offset[i]), direction: self.forward }
            }
            Projection::Equirectangular { latitude } => {
                let (sin_a, cos_a) = libm::sincos(PI * across);
                let (sin_l, cos_l) = libm::sincos(latitude * (1.0 - 2.0 * y / height));
                Ray { origin: self.eye, direction: self.combine(cos_l * sin_a, sin_l, cos_l * cos_a) }
            }
        }
    }

    /// Where `point` is seen, whether inside the picture or beyond its edges; `None` for points behind
    /// the eye (perspective, orthographic), at it, and not finite ones.
    pub fn seen(&self, point: [f64; 3]) -> Option<Seen> {
        let from_eye = [0, 1, 2].map(|i| point[i] - self.eye[i]);
        let [u, v, w] = [self.right, self.up, self.forward].map(|axis| dot(axis, from_eye));
        let (width, height) = (self.width as f64, self.height as f64);
        let pixel =
            |across: f64, upwards: f64| (0.5 * width * (across + 1.0), 0.5 * (height - width * upwards));
        let distance = length([u, v, w]);
        let (x, y, distance) = match self.projection {
            Projection::Perspective { fov_x } => {
                let half = libm::tan(0.5 * fov_x);
                let (x, y) = pixel(u / w / half, v / w / half);
                (x, y, if w > 0.0 { distance } else { f64::NAN })
            }
            Projection::Orthographic { width } => {
                let (x, y) = pixel(2.0 * u / width, 2.0 * v / width);
                (x, y, if w > 0.0 { w } else { f64::NAN })
            }
            Projection::Equirectangular { latitude } => {
                let across = libm::atan2(u, w) / PI;
                let y = 0.5 * height * (1.0 - libm::atan2(v, libm::hypot(u, w)) / latitude);
                (0.5 * width * (across + 1.0), y, if distance > 0.0 { distance } else { f64::NAN })
            }
        };
        [x, y, distance].iter().all(|c| c.is_finite()).then_some(Seen { x, y, distance })
    }

    fn combine(&self, right: f64, up: f64, forward: f64) -> [f64; 3] {
        [0, 1, 2].map(|i| right * self.right[i] + up * self.up[i] + forward * self.forward[i])
    }
}

fn check_coordinates(mut values: impl Iterator<Item = f64>) -> Result<(), CameraError> {
    match values.find(|value| !value.is_finite()) {
        Some(value) => {
            Err(CameraError::OutOfRange { name: "a coordinate", value, allowed: "finite numbers" })
        }
        None => Ok(()),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn cameras() -> [Camera; 4] {
        let (size, eye, target, up) = ((160, 120), [0.4, -3.2, 4.4], [0.0, 2.2, 0.4], [0.0, 0.0, 1.0]);
        [
            Projection::Perspective { fov_x: 60f64.to_radians() },
            Projection::Orthographic { width: 7.0 },
            Projection::Equirectangular { latitude: FRAC_PI_2 },
            Projection::Equirectangular { latitude: 45f64.to_radians() },
        ]
        .map(|projection| Camera::new(projection, size, eye, target, up).unwrap())
    }

    #[test]
    fn axes_are_those_of_the_courts_camera() {
        let camera = cameras()[0];
        let near = |a: [f64; 3], b: [f64; 3]| (0..3).all(|i| (a[i] - b[i]).abs() < 1e-12);
        assert!(near(camera.forward, [-0.05941759110223066, 0.802137479880114, -0.5941759110223066]));
        assert!(near(camera.right, [0.997267754456709, 0.07387168551531177, 0.0]));
        assert!(near(camera.up, [-0.0438927760398137, 0.592552476537485, 0.8043351209295861]));
    }

    #[test]
    fn points_on_a_pixels_ray_are_seen_there() {
        for camera in cameras() {
            for (x, y) in [(0.5, 0.5), (159.5, 0.5), (80.0, 60.0), (3.25, 117.5), (159.5, 119.5)] {
                let ray = camera.ray(x, y);
                assert!((dot(ray.direction, ray.direction) - 1.0).abs() < 1e-14);
                for distance in [1e-6, 0.7, 1e6] {
                    let point = [0, 1, 2].map(|i| ray.origin[i] + distance * ray.direction[i]);
                    let seen = camera.seen(point).unwrap();
                    // The point itself is rounded at the eye's magnitude.
                    let allowed = 1e-7 + 1e-12 / distance * 160.0;
                    assert!((seen.x - x).abs() < allowed && (seen.y - y).abs() < allowed, "{seen:?} {x} {y}");
                    assert!((seen.distance / distance - 1.0).abs() < 1e-8, "{seen:?}");
                }
            }
        }
    }

    #[test]
    fn a_panorama_has_forward_in_the_middle_and_right_to_the_right() {
        let [.., panorama] = cameras();
        assert_eq!(panorama.ray(80.0, 60.0).direction, panorama.forward);
        let quarter = panorama.ray(120.0, 60.0).direction;
        assert!((dot(quarter, panorama.right) - 1.0).abs() < 1e-14);
        let top = panorama.ray(80.0, 0.0).direction;
        assert!((dot(top, panorama.up) - 0.5f64.sqrt()).abs() < 1e-14);
    }

    #[test]
    fn what_is_behind_or_nowhere_is_not_seen() {
        for camera in cameras() {
            let behind = [0, 1, 2].map(|i| camera.eye[i] - camera.forward[i]);
            let panorama = matches!(camera.projection, Projection::Equirectangular { .. });
            assert_eq!(camera.seen(behind).is_some(), panorama);
            assert_eq!(camera.seen(camera.eye), None);
            assert_eq!(camera.seen([f64::NAN, 0.0, 0.0]), None);
        }
    }

    #[test]
    fn no_camera_without_a_view_or_with_numbers_out_of_range() {
        let perspective = Projection::Perspective { fov_x: 1.0 };
        let (eye, up) = ([0.0; 3], [0.0, 0.0, 1.0]);
        let of = |projection, size, target, up| Camera::new(projection, size, eye, target, up);
        assert!(matches!(of(perspective, (2, 2), eye, up), Err(CameraError::NoView { .. })));
        assert!(matches!(of(perspective, (2, 2), [0.0, 0.0, -3.0], up), Err(CameraError::NoView { .. })));
        assert!(of(perspective, (0, 2), [1.0, 0.0, 0.0], up).is_err());
        assert!(of(perspective, (2, 2), [f64::INFINITY, 0.0, 0.0], up).is_err());
        for fov_x in [0.0, PI, -1.0, f64::NAN] {
            assert!(of(Projection::Perspective { fov_x }, (2, 2), [1.0, 0.0, 0.0], up).is_err());
        }
        assert!(of(Projection::Equirectangular { latitude: 1.6 }, (2, 2), [1.0, 0.0, 0.0], up).is_err());
        assert!(of(Projection::Orthographic { width: 0.0 }, (2, 2), [1.0, 0.0, 0.0], up).is_err());
    }
}
