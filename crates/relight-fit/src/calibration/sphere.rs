//! What a mirror sphere shows of its surroundings.

use relight_core::vectors::{difference, dot, scaled, unit};
use std::fmt;

/// From where pictures are seen.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Viewer {
    /// From infinitely far: all rays run along z.
    Orthographic,
    /// From above the picture's middle.
    Perspective {
        /// Height of the eye in pixels of the plane z = 0, above 0.
        distance: f64,
    },
}

/// A sphere as a picture shows it.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct SphereOutline {
    /// Middle of the outline from the left edge, in pixels.
    pub x: f64,
    /// Middle of the outline from the top edge, in pixels.
    pub y: f64,
    /// Radius of the outline in pixels; of an ellipse, the mean of its half axes.
    pub radius: f64,
    /// Height of the sphere's middle over the plane z = 0 in pixels; `None` for its radius: it rests there.
    pub rise: Option<f64>,
}

/// A mirror sphere in space.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct MirrorSphere {
    /// Its middle.
    pub centre: [f64; 3],
    /// Its radius.
    pub radius: f64,
}

/// Light's way back from a place on a sphere.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Ray {
    /// Where the sphere reflects.
    pub origin: [f64; 3],
    /// Unit vector towards what is seen there.
    pub direction: [f64; 3],
}

/// Why an outline is no sphere's.
#[derive(Clone, Copy, Debug, PartialEq)]
#[non_exhaustive]
pub enum SphereError {
    /// The radius is below 2 pixels or not finite.
    Radius {
        /// The radius in pixels.
        radius: f64,
    },
    /// The outline's middle is outside the picture.
    Outside {
        /// The middle in pixels.
        at: [f64; 2],
        /// Width and height of the picture.
        size: (usize, usize),
    },
    /// The sphere would hold the eye.
    TooNear {
        /// The radius in pixels.
        radius: f64,
        /// Height of the eye in pixels.
        distance: f64,
    },
}

impl fmt::Display for SphereError {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Radius { radius } => {
                write!(
                    f,
                    "a sphere's radius of {radius} pixels is outside 2..1000000; give that of its outline in pixels"
                )
            }
            Self::Outside { at: [x, y], size: (width, height) } => {
                write!(
                    f,
                    "the sphere's middle {x}, {y} is outside the pictures of {width} x {height} pixels; give pixels from the top left"
                )
            }
            Self::TooNear { radius, distance } => {
                write!(
                    f,
                    "a sphere of radius {radius} pixels reaches the eye, which --fov puts {distance:.0} pixels away; give the angle of the whole width"
                )
            }
        }
    }
}

impl std::error::Error for SphereError {}

/// Rounds after which an outline's sphere stands still to rounding; each takes off a factor of about radius / distance.
const ROUNDS: usize = 100;

impl MirrorSphere {
    /// The sphere with this outline in pictures of `width` x `height` pixels.
    ///
    /// In perspective the outline is an ellipse, whose middle is not the sphere's: the sphere is sought whose ellipse has that
    /// middle and mean half axis.
    /// # Errors
    /// [`SphereError`].
    pub fn from_outline(
        outline: &SphereOutline,
        (width, height): (usize, usize),
        viewer: Viewer,
    ) -> Result<Self, SphereError> {
        let SphereOutline { x, y, radius, rise } = *outline;
        if !(2.0..=1e6).contains(&radius) {
            return Err(SphereError::Radius { radius });
        }
        if !((0.0..=width as f64).contains(&x) && (0.0..=height as f64).contains(&y)) {
            return Err(SphereError::Outside { at: [x, y], size: (width, height) });
        }
        let [x, y] = place([x, y], (width, height));
        let Viewer::Perspective { distance } = viewer else {
            return Ok(Self { centre: [x, y, rise.unwrap_or(radius)], radius });
        };
        let too_near = SphereError::TooNear { radius, distance };
        let mut sphere = Self { centre: [x, y, rise.unwrap_or(radius)], radius };
        for _ in 0..ROUNDS {
            let [cx, cy, cz] = sphere.centre;
            let depth = distance - cz;
            let aside = cx * cx + cy * cy;
            // Squares of the distance to the middle; of it without the outline's cone.
            let square = aside + depth * depth;
            let rest = depth * depth - sphere.radius * sphere.radius;
            if !(rest > 0.0 && depth > 0.0) {
                return Err(too_near);
            }
            let shift = distance * depth / rest;
            let across = distance * sphere.radius * (square - sphere.radius * sphere.radius).sqrt() / rest;
            let along = distance * sphere.radius / rest.sqrt();
            let factor = 2.0 * radius / (across + along);
            sphere.radius *= factor;
            sphere.centre[0] += (x - cx * shift) * depth / distance;
            sphere.centre[1] += (y - cy * shift) * depth / distance;
            sphere.centre[2] = rise.unwrap_or(sphere.radius);
        }
        if sphere.centre.iter().all(|c| c.is_finite()) { Ok(sphere) } else { Err(too_near) }
    }

    /// What the sphere shows at `at`, in pixels from the top left of pictures of this size; `None` beside it.
    pub fn reflection(&self, at: [f64; 2], size: (usize, usize), viewer: Viewer) -> Option<Ray> {
        let [x, y] = place(at, size);
        let (eye, view) = match viewer {
            Viewer::Orthographic => ([x, y, self.centre[2] + 2.0 * self.radius], [0.0, 0.0, -1.0]),
            Viewer::Perspective { distance } => ([0.0, 0.0, distance], unit([x, y, -distance])?),
        };
        let from_centre = difference(eye, self.centre);
        let nearest = -dot(from_centre, view);
        let reach = nearest * nearest - dot(from_centre, from_centre) + self.radius * self.radius;
        if reach.is_nan() || reach < 0.0 {
            return None;
        }
        let way = nearest - reach.sqrt();
        let origin: [f64; 3] = std::array::from_fn(|c| eye[c] + way * view[c]);
        let normal = unit(difference(origin, self.centre))?;
        let direction = unit(difference(view, scaled(normal, 2.0 * dot(view, normal))))?;
        Some(Ray { origin, direction })
    }
}

/// A place in a picture as x and y from its middle, y up.
fn place([x, y]: [f64; 2], (width, height): (usize, usize)) -> [f64; 2] {
    [x - 0.5 * width as f64, 0.5 * height as f64 - y]
}
