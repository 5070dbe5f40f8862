//! Perspective pictures out of panoramas.

use crate::panorama_lookup::{Kernel, color_at};
use rayon::prelude::*;
use relight_core::relighter::Picture;
use relight_core::vectors::{cross, dot, length, scaled};
use relight_core::{Camera, CameraError, Projection};
use std::f64::consts::{FRAC_PI_2, PI};

/// How values between a panorama's pixels are found.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Filter {
    /// Between the four pixels around.
    Bilinear,
    /// Catmull and Rom's cubic over sixteen pixels: sharper, exact at the pixels' centres; may go beyond the values
    /// around it.
    Bicubic,
    /// The mean over what a pixel of the view covers, of one bilinear value or more for each pixel of the panorama
    /// in it; the bilinear value itself where the view magnifies.
    #[default]
    Area,
}

/// A perspective view out of an equirectangular panorama; angles in radians.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct PanoramaView {
    /// 0 looks at the panorama's middle, positive values to the right of it; any finite angle.
    pub yaw: f64,
    /// Upwards, -pi / 2 to pi / 2.
    pub pitch: f64,
    /// Angle between the left and the right edge, above 0 and below pi.
    pub fov_x: f64,
    /// Pixels in a row of the view.
    pub width: usize,
    /// Rows of the view; pixels are square.
    pub height: usize,
    /// How values between pixels are found.
    pub filter: Filter,
    /// The latitude of the panorama's upper edge, and below its horizon that of the lower: above 0, up to pi / 2.
    pub latitude: f64,
    /// What is seen above and below the panorama.
    pub background: [f32; 3],
}

impl PanoramaView {
    /// The camera of the view, in axes where the panorama's middle is y, its right x and its top z.
    ///
    /// # Errors
    /// [`CameraError`] for angles and sizes outside their ranges.
    pub fn camera(&self) -> Result<Camera, CameraError> {
        for (name, value, allowed, inside) in [
            ("the yaw", self.yaw, "a finite angle in degrees", self.yaw.is_finite()),
            ("the pitch", self.pitch, "-90 to 90 degrees", self.pitch.abs() <= FRAC_PI_2 + 1e-12),
        ] {
            if !inside {
                return Err(CameraError::OutOfRange { name, value: value.to_degrees(), allowed });
            }
        }
        let projection = Projection::Perspective { fov_x: self.fov_x };
        let ahead = Camera::new(projection, (self.width, self.height), [0.0; 3], AHEAD, UP)?;
        let (sin_y, cos_y) = libm::sincos(self.yaw);
        let (sin_p, cos_p) = libm::sincos(self.pitch);
        // Written out: at the poles no up vector would span a view.
        Ok(Camera {
            right: [cos_y, -sin_y, 0.0],
            up: [-sin_p * sin_y, -sin_p * cos_y, cos_p],
            forward: [cos_p * sin_y, cos_p * cos_y, sin_p],
            ..ahead
        })
    }
}

const AHEAD: [f64; 3] = [0.0, 1.0, 0.0];
const UP: [f64; 3] = [0.0, 0.0, 1.0];

/// A panorama as a camera that sees it.
struct Panorama<'a> {
    picture: &'a Picture,
    camera: Camera,
    has_poles: bool,
    background: [f64; 3],
}

impl Panorama<'_> {
    /// R, G, B in `direction`.
    fn color(&self, kernel: Kernel, direction: [f64; 3]) -> [f64; 3] {
        let Some(seen) = self.camera.seen(direction) else { return self.background };
        // Rounding must not make a hole at a pole or cut the edge off.
        let inside = (-1e-6..=self.picture.height as f64 + 1e-6).contains(&seen.y);
        if !inside && !self.has_poles {
            return self.background;
        }
        color_at(self.picture, self.has_poles, kernel, seen.x, seen.y)
    }

    /// Pixels in a radian where they are densest: along a meridian or the horizon.
    fn pixels_per_radian(&self, latitude: f64) -> f64 {
        let (width, height) = (self.picture.width as f64, self.picture.height as f64);
        (width / (2.0 * PI)).max(height / (2.0 * latitude))
    }
}

/// The picture that `view` shows of `panorama`, a whole turn in linear light.
///
/// As many channels as the panorama. Every pixel is computed by itself.
///
/// # Errors
/// [`CameraError`] for angles and sizes outside their ranges.
///
/// # Panics
/// When the panorama has no pixels or not as many samples as its size says.
pub fn view_of_panorama(panorama: &Picture, view: &PanoramaView) -> Result<Picture, CameraError> {
    let channels = panorama.channels;
    assert_eq!(
        panorama.samples.len(),
        panorama.width * panorama.height * channels,
        "samples of the panorama"
    );
    let directions = Directions::new(view, &view.camera()?);
    let projection = Projection::Equirectangular { latitude: view.latitude };
    let panorama = Panorama {
        picture: panorama,
        camera: Camera::new(projection, (panorama.width, panorama.height), [0.0; 3], AHEAD, UP)?,
        has_poles: view.latitude >= FRAC_PI_2 - 1e-9,
        background: view.background.map(f64::from),
    };
    let density = panorama.pixels_per_radian(view.latitude);
    let mut samples = vec![0.0f32; view.width * view.height * channels];
    samples.par_chunks_mut(view.width * channels).enumerate().for_each(|(y, row)| {
        for (x, pixel) in row.chunks_exact_mut(channels).enumerate() {
            let (x, y) = (x as f64, y as f64);
            let color = match view.filter {
                Filter::Bilinear => panorama.color(Kernel::Linear, directions.at(x + 0.5, y + 0.5)),
                Filter::Bicubic => panorama.color(Kernel::CatmullRom, directions.at(x + 0.5, y + 0.5)),
                Filter::Area => mean_over_pixel(&panorama, &directions, density, (x, y)),
            };
            for (sample, value) in pixel.iter_mut().zip(color) {
                *sample = value as f32;
            }
        }
    });
    Ok(Picture { width: view.width, height: view.height, channels, samples })
}

/// Directions of a view: linear in the place where their length does not matter, which saves a tangent each.
struct Directions {
    corner: [f64; 3],
    right: [f64; 3],
    down: [f64; 3],
}

impl Directions {
    fn new(view: &PanoramaView, camera: &Camera) -> Self {
        let pixel = 2.0 * libm::tan(0.5 * view.fov_x) / view.width as f64;
        let (right, down) = (scaled(camera.right, pixel), scaled(camera.up, -pixel));
        let (columns, rows) = (0.5 * view.width as f64, 0.5 * view.height as f64);
        let corner = [0, 1, 2].map(|i| camera.forward[i] - columns * right[i] - rows * down[i]);
        Self { corner, right, down }
    }

    /// What is seen at (x, y) in pixels from the upper left corner, of any length.
    fn at(&self, x: f64, y: f64) -> [f64; 3] {
        [0, 1, 2].map(|i| self.corner[i] + x * self.right[i] + y * self.down[i])
    }
}

/// The mean of bilinear values on an even grid over the pixel whose upper left corner is given, at least one
/// for each pixel of the panorama along its sides.
fn mean_over_pixel(
    panorama: &Panorama<'_>,
    directions: &Directions,
    density: f64,
    (x, y): (f64, f64),
) -> [f64; 3] {
    let needed = |from: [f64; 3], to: [f64; 3]| {
        let pixels = libm::atan2(length(cross(from, to)), dot(from, to)) * density;
        // The slack keeps a view at the panorama's own scale from being sampled twice.
        (pixels - 1e-6).ceil().max(1.0)
    };
    let across = needed(directions.at(x, y + 0.5), directions.at(x + 1.0, y + 0.5));
    let down = needed(directions.at(x + 0.5, y), directions.at(x + 0.5, y + 1.0));
    let mut sum = [0.0; 3];
    for j in 0..down as usize {
        for i in 0..across as usize {
            let direction = directions.at(x + (i as f64 + 0.5) / across, y + (j as f64 + 0.5) / down);
            let color = panorama.color(Kernel::Linear, direction);
            for (sum, value) in sum.iter_mut().zip(color) {
                *sum += value;
            }
        }
    }
    sum.map(|sum| sum / (across * down))
}
