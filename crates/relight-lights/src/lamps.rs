//! Where a local light comes from at each pixel of a row, and how strong it is there.

use crate::elementary::{LANES, lanes, squared_angle};
use crate::horizon::Horizon;
use crate::path::Directions;
use crate::scene::{Attenuation, Gobo, HorizonRule, Lamp, Light, Spot};
use relight_core::relighter::Picture;
use relight_core::texture_lookup::{bilinear_taps, color_at};
use relight_core::vectors::{cross, difference, dot, frame_around, length, scaled};
use relight_core::{CpuLevel, Direction, PositionMap, Vectorized, Wrap};
use std::f32::consts::PI;

/// Lamps nearer to a surface than this are at it: no direction is the right one, and they light nothing there.
pub const AT_THE_SURFACE: f32 = 1e-15;

/// Positions of a row of pixels.
#[derive(Clone, Debug, Default)]
pub(crate) struct RowPositions {
    x: Vec<f32>,
    y: Vec<f32>,
    z: Vec<f32>,
}

/// A light's directions and strengths along a row of pixels.
#[derive(Clone, Debug, Default)]
pub(crate) struct RowLight {
    x: Vec<f32>,
    y: Vec<f32>,
    z: Vec<f32>,
    /// Intensity and attenuation together; 0 where the pixel has no surface or the lamp is at it.
    pub(crate) strength: Vec<f32>,
    /// By channel, where a picture is in the light's way.
    pub(crate) gobo: Option<[Vec<f32>; 3]>,
}

impl RowPositions {
    /// Of the pixels from `first` on.
    pub(crate) fn load(&mut self, level: CpuLevel, map: &PositionMap, first: usize, pixels: usize) {
        for axis in [&mut self.x, &mut self.y, &mut self.z] {
            axis.resize(pixels, 0.0);
        }
        level.run(Apart { points: &map.points[first..first + pixels], to: self });
    }
}

/// Points to their coordinates, each axis by itself.
struct Apart<'a> {
    points: &'a [[f32; 3]],
    to: &'a mut RowPositions,
}

impl Vectorized for Apart<'_> {
    type Output = ();

    #[inline(always)]
    fn run(self) {
        let n = self.points.len();
        let (x, y, z) = (&mut self.to.x[..n], &mut self.to.y[..n], &mut self.to.z[..n]);
        for i in 0..n {
            [x[i], y[i], z[i]] = self.points[i];
        }
    }
}

impl RowLight {
    pub(crate) fn directions(&self) -> Directions<'_> {
        Directions { x: &self.x, y: &self.y, z: &self.z }
    }

    /// Whether no pixel of the row gets any of it.
    pub(crate) fn is_dark(&self) -> bool {
        self.strength.iter().all(|strength| *strength == 0.0)
    }

    /// Takes sample `index` of the light at the pixels of `positions`; says at how many pixels the lamp is at
    /// the surface.
    pub(crate) fn aim(
        &mut self,
        level: CpuLevel,
        light: &Light,
        index: usize,
        horizon: &Horizon,
        positions: &RowPositions,
    ) -> usize {
        let pixels = positions.x.len();
        for values in [&mut self.x, &mut self.y, &mut self.z, &mut self.strength] {
            values.resize(pixels, 0.0);
        }
        self.gobo = None;
        let Some(position) = light.position() else { return 0 };
        let at_surface = level.run(Aim {
            positions,
            lamp: position.map(|c| c as f32),
            intensity: light.intensity as f32,
            attenuation: light.attenuation,
            out: self,
        });
        match &light.lamp {
            Lamp::Spot(spot) => {
                level.run(Cone { spot, row: self });
                if let Some(gobo) = spot.gobo.as_ref().filter(|gobo| gobo.on) {
                    self.gobo = Some(self.through(spot, gobo));
                }
            }
            Lamp::Sphere { radius, samples, .. } => {
                let physical = matches!(light.attenuation, Attenuation::InverseSquare { .. });
                level.run(Disc {
                    positions,
                    lamp: position.map(|c| c as f32),
                    radius: *radius as f32,
                    sample: disc_sample(index, *samples),
                    share: 1.0 / *samples as f32,
                    physical: physical.then_some(light.intensity as f32),
                    row: self,
                });
            }
            _ => {}
        }
        self.below_horizon(horizon);
        at_surface
    }

    /// Applies the horizon's rule to directions that the capture doesn't know.
    fn below_horizon(&mut self, horizon: &Horizon) {
        if horizon.is_everywhere() {
            return;
        }
        let axis = horizon.cap.axis.components().map(|c| c as f32);
        // A little inside the rim, so that rounding takes nothing for known that isn't.
        let known = match horizon.rule {
            HorizonRule::Fade => libm::cos(horizon.cap.radius) as f32 + 1e-6,
            _ => f32::INFINITY,
        };
        for i in 0..self.x.len() {
            let cosine = self.x[i] * axis[0] + self.y[i] * axis[1] + self.z[i] * axis[2];
            if cosine >= known || self.strength[i] == 0.0 {
                continue;
            }
            let [x, y, z] = [self.x[i], self.y[i], self.z[i]].map(f64::from);
            if let Ok(direction) = Direction::new(x, y, z) {
                let taken = horizon.take(direction);
                [self.x[i], self.y[i], self.z[i]] = taken.direction.components().map(|c| c as f32);
                self.strength[i] *= taken.factor as f32;
            }
        }
    }

    /// The gobo's colours at the pixels, by channel.
    fn through(&self, spot: &Spot, gobo: &Gobo) -> [Vec<f32>; 3] {
        let axis = spot.axis.components();
        let up = perpendicular(gobo.up.components(), axis);
        let right = cross(axis, up);
        let half = libm::tan(spot.cone);
        let mut out = [const { Vec::new() }; 3];
        for i in 0..self.x.len() {
            // From the lamp to the surface.
            let to = [-self.x[i], -self.y[i], -self.z[i]].map(f64::from);
            let [u, v, w] = [right, up, axis].map(|a| dot(a, to));
            let lit = w > 0.0 && self.strength[i] != 0.0;
            let color = if lit { color_of(&gobo.picture, u / w / half, v / w / half) } else { [0.0; 3] };
            for (out, value) in out.iter_mut().zip(color) {
                out.push(value);
            }
        }
        out
    }
}

/// The colour at (u, v), -1 to 1 to the right and upwards; the edge goes on.
fn color_of(picture: &Picture, u: f64, v: f64) -> [f32; 3] {
    let place = [0.5 * (1.0 + u), 0.5 * (1.0 - v)];
    color_at(picture, &bilinear_taps(picture.width, picture.height, Wrap::Clamp, place))
}

/// The unit vector nearest to `vector` that is perpendicular to `axis`; any where they are parallel.
fn perpendicular(vector: [f64; 3], axis: [f64; 3]) -> [f64; 3] {
    let rest = difference(vector, scaled(axis, dot(vector, axis)));
    if length(rest) > 1e-9 {
        return scaled(rest, 1.0 / length(rest));
    }
    frame_around(axis)[0]
}

/// Unit vectors towards a lamp and its strength.
struct Aim<'a> {
    positions: &'a RowPositions,
    lamp: [f32; 3],
    intensity: f32,
    attenuation: Attenuation,
    out: &'a mut RowLight,
}

impl Vectorized for Aim<'_> {
    type Output = usize;

    #[inline(always)]
    fn run(self) -> usize {
        let [a, b, c] = self.lamp;
        let n = self.out.x.len();
        let (px, py, pz) = (&self.positions.x[..n], &self.positions.y[..n], &self.positions.z[..n]);
        let (x, y, z) = (&mut self.out.x[..n], &mut self.out.y[..n], &mut self.out.z[..n]);
        let strength = &mut self.out.strength[..n];
        // strength = intensity (constant + inverse / d + square / max(d, nearest)^2).
        let (constant, inverse, square, nearest) = match self.attenuation {
            Attenuation::None => (1.0, 0.0, 0.0, 1.0),
            Attenuation::Inverse { a0 } => (0.0, a0 as f32, 0.0, 1.0),
            Attenuation::InverseSquare { nearest } => (0.0, 0.0, 1.0, (nearest * nearest) as f32),
        };
        let mut at_surface = 0u32;
        for i in 0..n {
            let (dx, dy, dz) = (a - px[i], b - py[i], c - pz[i]);
            let squared = dx * dx + dy * dy + dz * dz;
            // False for NaN: a pixel without a surface.
            let aimed = squared > AT_THE_SURFACE * AT_THE_SURFACE;
            at_surface += u32::from(squared <= AT_THE_SURFACE * AT_THE_SURFACE);
            let squared = if aimed { squared } else { 1.0 };
            let reciprocal = 1.0 / squared.sqrt();
            x[i] = if aimed { dx * reciprocal } else { 0.0 };
            y[i] = if aimed { dy * reciprocal } else { 0.0 };
            z[i] = if aimed { dz * reciprocal } else { 1.0 };
            let factor = constant + inverse * reciprocal + square / squared.max(nearest);
            strength[i] = if aimed { self.intensity * factor } else { 0.0 };
        }
        at_surface as usize
    }
}

/// A spot's fall-off with the angle from its axis.
struct Cone<'a> {
    spot: &'a Spot,
    row: &'a mut RowLight,
}

impl Vectorized for Cone<'_> {
    type Output = ();

    #[inline(always)]
    fn run(self) {
        let [a, b, c] = self.spot.axis.components().map(|c| c as f32);
        let n = self.row.x.len();
        let (x, y, z) = (&self.row.x[..n], &self.row.y[..n], &self.row.z[..n]);
        let strength = &mut self.row.strength[..n];
        // A cone of 180 degrees is all directions, the one behind included.
        let cone = if self.spot.cone >= std::f64::consts::PI { 4.0 } else { self.spot.cone as f32 };
        let width = (self.spot.cone - self.spot.beam) as f32;
        // A sharp edge is a very steep one.
        let slope = if width > 1e-12 { 1.0 / width } else { 1e12 };
        for (first, strength) in (0..).step_by(LANES).zip(strength.chunks_mut(LANES)) {
            let lanes = strength.len();
            let [x, y, z] = [x, y, z].map(|axis| {
                let mut values = [0.0; LANES];
                values[..lanes].copy_from_slice(&axis[first..first + lanes]);
                values
            });
            // To the surface is minus to the lamp.
            let (dx, dy, dz) = (lanes!(|i| x[i] + a), lanes!(|i| y[i] + b), lanes!(|i| z[i] + c));
            let s = lanes!(|i| (0.25 * (dx[i] * dx[i] + dy[i] * dy[i] + dz[i] * dz[i])).min(1.0));
            let squared = squared_angle(&s, &lanes!(|i| 1.0 - s[i]));
            let factor = lanes!(|i| ((cone - squared[i].sqrt()) * slope).clamp(0.0, 1.0));
            strength.iter_mut().zip(&factor).for_each(|(strength, factor)| *strength *= factor);
        }
    }
}

/// One direction into the disc that a sphere is from each pixel.
struct Disc<'a> {
    positions: &'a RowPositions,
    lamp: [f32; 3],
    radius: f32,
    sample: DiscSample,
    /// One over the number of samples.
    share: f32,
    /// The intensity, where strength is that of the disc's solid angle.
    physical: Option<f32>,
    row: &'a mut RowLight,
}

/// A place on a disc seen from its axis.
#[derive(Clone, Copy, Debug)]
struct DiscSample {
    /// Share of the disc's solid angle that lies further in, 0 to 1.
    inside: f32,
    cos: f32,
    sin: f32,
}

/// Sample `index` of `count`, each with the same solid angle: a golden-angle spiral, a single one in the
/// middle.
fn disc_sample(index: usize, count: usize) -> DiscSample {
    /// pi (3 - sqrt 5).
    const GOLDEN_ANGLE: f64 = 2.399_963_229_728_653;
    let inside = if count == 1 { 0.0 } else { (index as f64 + 0.5) / count as f64 };
    let (sin, cos) = libm::sincos(GOLDEN_ANGLE * index as f64);
    DiscSample { inside: inside as f32, cos: cos as f32, sin: sin as f32 }
}

impl Vectorized for Disc<'_> {
    type Output = ();

    #[inline(always)]
    fn run(self) {
        let n = self.row.x.len();
        let (x, y, z) = (&mut self.row.x[..n], &mut self.row.y[..n], &mut self.row.z[..n]);
        let (px, py, pz) = (&self.positions.x[..n], &self.positions.y[..n], &self.positions.z[..n]);
        let strength = &mut self.row.strength[..n];
        let [a, b, c] = self.lamp;
        let squared_radius = self.radius * self.radius;
        for i in 0..n {
            let (dx, dy, dz) = (a - px[i], b - py[i], c - pz[i]);
            let squared = dx * dx + dy * dy + dz * dz;
            // Within the sphere it is as at its surface: half of all directions.
            let sine2 = (squared_radius / squared.max(squared_radius)).min(1.0);
            let cosine = (1.0 - sine2).sqrt();
            // 1 - cosine without cancellation: sine^2 / (1 + cosine).
            let height = sine2 / (1.0 + cosine);
            let down = self.sample.inside * height;
            let along = 1.0 - down;
            let across = (down * (2.0 - down)).max(0.0).sqrt();
            // Source: Duff et al., *Building an Orthonormal Basis, Revisited*.
            let (u, v, w) = (x[i], y[i], z[i]);
            let sign = if w >= 0.0 { 1.0 } else { -1.0 };
            let p = -1.0 / (sign + w);
            let q = u * v * p;
            let (s, t) = (across * self.sample.cos, across * self.sample.sin);
            x[i] = along * u + s * (1.0 + sign * u * u * p) + t * q;
            y[i] = along * v + s * (sign * q) + t * (sign + v * v * p);
            z[i] = along * w + s * (-sign * u) + t * -v;
            // Radiance intensity / (pi r^2) over a solid angle of 2 pi (1 - cosine), in units of a light of
            // irradiance pi: at a distance that is intensity / d^2.
            strength[i] = match self.physical {
                Some(intensity) if strength[i] > 0.0 => {
                    intensity * (2.0 * PI * height / (PI * squared_radius)) * self.share
                }
                Some(_) => 0.0,
                None => strength[i] * self.share,
            };
        }
    }
}
