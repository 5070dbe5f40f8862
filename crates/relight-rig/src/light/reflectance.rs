//! What a white diffuser reflects, irradiance / pi, at many points of a surface at once, in f32.
//!
//! Lengths are divided by a power of two near the largest, and positions of lights are kept as two f32, so that neither
//! radii of 1e-30 or 1e30 nor far origins lose digits. Colours go with squared radii in f64 first.

use super::disc::View;
use super::lanes::{LANES, Lanes, MOST_LANE_BANDS, RECURSION, angle, arctangent_rest, lanes};
use super::{Light, Probe, Source, cosine_lobe};
use relight_core::{CpuLevel, Vectorized};
use std::f32::consts::{FRAC_1_PI, FRAC_PI_2};
use std::f64::consts::PI;

/// Points of a surface and its unit normals there, each coordinate in a row of its own, all of one length.
#[derive(Clone, Copy, Debug)]
#[allow(missing_docs, reason = "coordinates")]
pub struct SurfaceRows<'a> {
    pub x: &'a [f32],
    pub y: &'a [f32],
    pub z: &'a [f32],
    pub nx: &'a [f32],
    pub ny: &'a [f32],
    pub nz: &'a [f32],
}

/// Adds R, G, B of what a white diffuser reflects of a light, irradiance / pi, to the rows of `out`.
///
/// [`Light::irradiance`] within 1e-6 of what the light gives a surface that faces it. Discs that the horizon cuts are
/// evaluated one by one in f64. The bits are the same at every level and however points are split into rows.
///
/// # Panics
/// When rows are of different lengths.
pub fn add_reflectance(light: &Light, level: CpuLevel, points: &SurfaceRows<'_>, out: [&mut [f32]; 3]) {
    let n = points.x.len();
    let rows = [points.y, points.z, points.nx, points.ny, points.nz];
    assert!(
        rows.iter().all(|row| row.len() == n) && out.iter().all(|row| row.len() == n),
        "rows of a length"
    );
    let place = |centre: &[f64; 3], size: f64| Place::new(*centre, size, points);
    match &light.source {
        Source::Sphere { centre, radius } => {
            let place = place(centre, *radius);
            let size = radius * place.scale;
            let work =
                Sphere { radius: size as f32, color: light.color.map(|c| (c * size * size) as f32), place };
            level.run(Rows { points, out, work });
        }
        Source::Disc { centre, normal, radius } => {
            let place = place(centre, *radius);
            let size = radius * place.scale;
            let work = Disc {
                normal: normal.map(|c| c as f32),
                radius: size as f32,
                color: light.color.map(|c| (c * size * size) as f32),
                place,
                whole: (*centre, *normal, *radius),
                clipped_color: light.color.map(|c| c / PI),
            };
            level.run(Rows { points, out, work });
        }
        Source::Point { position, nearest } => {
            let place = place(position, *nearest);
            let size = nearest * place.scale;
            let factor = place.scale * place.scale / PI;
            let work = Point {
                nearest2: (size * size) as f32,
                color: light.color.map(|c| (c * factor) as f32),
                place,
            };
            level.run(Rows { points, out, work });
        }
        Source::Directional { direction } => {
            let work = Directional {
                direction: direction.map(|c| c as f32),
                color: light.color.map(|c| (c / PI) as f32),
            };
            level.run(Rows { points, out, work });
        }
        Source::Probe(probe) => level.run(Rows { points, out, work: Harmonics::new(probe, light.color) }),
    }
}

/// [`LANES`] points and normals.
struct Chunk {
    position: [Lanes; 3],
    normal: [Lanes; 3],
}

/// A light at a few points.
trait AtChunk {
    /// R, G, B of irradiance / pi; `count` points are asked for, those after them are repetitions.
    fn reflectance(&self, chunk: &Chunk, count: usize) -> [Lanes; 3];
}

struct Rows<'a, W> {
    points: &'a SurfaceRows<'a>,
    out: [&'a mut [f32]; 3],
    work: W,
}

impl<W: AtChunk> Vectorized for Rows<'_, W> {
    type Output = ();

    #[inline(always)]
    fn run(mut self) {
        let n = self.points.x.len();
        for first in (0..n).step_by(LANES) {
            let count = LANES.min(n - first);
            let load = |row: &[f32]| {
                let row = &row[first..first + count];
                match row.try_into() {
                    Ok(lanes) => lanes,
                    Err(_) => lanes!(|i| row[i.min(count - 1)]),
                }
            };
            let SurfaceRows { x, y, z, nx, ny, nz } = *self.points;
            let chunk = Chunk { position: [x, y, z].map(load), normal: [nx, ny, nz].map(load) };
            let added = self.work.reflectance(&chunk, count);
            for (out, added) in self.out.iter_mut().zip(&added) {
                for (out, added) in out[first..first + count].iter_mut().zip(added) {
                    *out += added;
                }
            }
        }
    }
}

#[inline(always)]
fn dot(a: &[Lanes; 3], b: &[Lanes; 3]) -> Lanes {
    lanes!(|i| a[0][i] * b[0][i] + a[1][i] * b[1][i] + a[2][i] * b[2][i])
}

#[inline(always)]
fn colored(color: [f32; 3], factor: &Lanes) -> [Lanes; 3] {
    color.map(|c| lanes!(|i| c * factor[i]))
}

/// Where a light stands, in units of a power of two.
struct Place {
    scale: f64,
    high: [f32; 3],
    low: [f32; 3],
}

/// Squared distances below it count as 0.
const TOUCHING: f32 = 1e-36;

impl Place {
    fn new(centre: [f64; 3], size: f64, points: &SurfaceRows<'_>) -> Self {
        let rows = [points.x, points.y, points.z];
        let far = rows.iter().flat_map(|row| row.iter()).fold(0.0f32, |a, c| a.max(c.abs()));
        let largest = centre.iter().fold(size.max(f64::from(far)), |a, c| a.max(c.abs()));
        let (_, exponent) = libm::frexp(largest);
        let scale = libm::ldexp(1.0, -exponent.clamp(-120, 120));
        let high = centre.map(|c| (c * scale) as f32);
        let low = [0, 1, 2].map(|i| (centre[i] * scale - f64::from(high[i])) as f32);
        Self { scale, high, low }
    }

    /// The vector to the light.
    #[inline(always)]
    fn towards(&self, position: &[Lanes; 3]) -> [Lanes; 3] {
        let scale = self.scale as f32;
        [0, 1, 2].map(|a| lanes!(|i| (self.high[a] - position[a][i] * scale) + self.low[a]))
    }

    /// The squared distance and the cosine at the surface.
    #[inline(always)]
    fn distance2_and_cosine(&self, chunk: &Chunk) -> (Lanes, Lanes) {
        let towards = self.towards(&chunk.position);
        let distance2 = dot(&towards, &towards);
        let along = dot(&towards, &chunk.normal);
        // In the light's middle it is seen towards +z.
        let cosine = lanes!(|i| {
            let cosine = along[i] / distance2[i].max(TOUCHING).sqrt();
            if distance2[i] > TOUCHING { cosine } else { chunk.normal[2][i] }
        });
        (distance2, cosine)
    }
}

struct Sphere {
    place: Place,
    radius: f32,
    /// Radiance times the squared radius.
    color: [f32; 3],
}

impl AtChunk for Sphere {
    #[inline(always)]
    fn reflectance(&self, chunk: &Chunk, _: usize) -> [Lanes; 3] {
        let r = self.radius;
        let (d2, cosine) = self.place.distance2_and_cosine(chunk);
        let d = lanes!(|i| d2[i].sqrt());
        let fall_off = lanes!(|i| 1.0 / d2[i].max(r * r).max(TOUCHING));
        let sine = lanes!(|i| if d[i] > r { r / d[i] } else { 1.0 });
        let c = lanes!(|i| (((d[i] - r) * (d[i] + r)).max(0.0) * fall_off[i]).sqrt());
        let clipped = clipped_sphere(&sine, &c, &cosine);
        let irradiance = lanes!(|i| {
            let whole = if cosine[i] <= -sine[i] { 0.0 } else { FRAC_1_PI * clipped[i] };
            let outside = if cosine[i] >= sine[i] { cosine[i] } else { whole };
            if c[i] > 0.0 { outside } else { 0.5 * (1.0 + cosine[i]) }
        });
        colored(self.color, &lanes!(|i| fall_off[i] * irradiance[i]))
    }
}

/// Irradiance / sine^2 where the horizon cuts the sphere; anything elsewhere. `c` is the cosine that goes with the sine.
///
/// As `Seen::irradiance`, whose two ways are one here: the arctangent less its argument is a polynomial up to 1.
#[inline(always)]
fn clipped_sphere(sine: &Lanes, c: &Lanes, cosine: &Lanes) -> Lanes {
    let t = lanes!(|i| (cosine[i] / sine[i]).clamp(-1.0, 1.0));
    let u = lanes!(|i| ((1.0 - t[i]) * (1.0 + t[i])).sqrt());
    let lit = angle(&u, &lanes!(|i| -c[i] * t[i]));
    let w = lanes!(|i| sine[i] * u[i]);
    let least = lanes!(|i| if w[i] < c[i] { w[i] } else { c[i] });
    let most = lanes!(|i| if w[i] < c[i] { c[i] } else { w[i] }.max(f32::MIN_POSITIVE));
    let x = lanes!(|i| least[i] / most[i]);
    let rest = arctangent_rest(&lanes!(|i| x[i] * x[i]));
    lanes!(|i| {
        let ratio = u[i] / c[i];
        let small = x[i] + x[i] * (ratio * ratio * rest[i]);
        let steep = FRAC_PI_2 - (x[i] + x[i] * (x[i] * x[i] * rest[i])) - c[i] * w[i];
        let tail = if w[i] < c[i] { small } else { steep / (sine[i] * sine[i]) };
        cosine[i] * lit[i] + tail
    })
}

struct Disc {
    place: Place,
    normal: [f32; 3],
    radius: f32,
    /// Radiance times the squared radius.
    color: [f32; 3],
    /// Centre, normal, radius as they are.
    whole: ([f64; 3], [f64; 3], f64),
    clipped_color: [f64; 3],
}

impl AtChunk for Disc {
    #[inline(always)]
    fn reflectance(&self, chunk: &Chunk, count: usize) -> [Lanes; 3] {
        let (m, r) = (self.normal, self.radius);
        let v = self.place.towards(&chunk.position);
        let h = lanes!(|i| -(v[0][i] * m[0] + v[1][i] * m[1] + v[2][i] * m[2]));
        let across = [0, 1, 2].map(|a| lanes!(|i| v[a][i] + h[i] * m[a]));
        let a2 = dot(&across, &across);
        let a = lanes!(|i| a2[i].sqrt());
        let near2 = lanes!(|i| h[i] * h[i] + (a[i] - r) * (a[i] - r));
        let far2 = lanes!(|i| h[i] * h[i] + (a[i] + r) * (a[i] + r));
        let delta = lanes!(|i| (near2[i].sqrt() * far2[i].sqrt()).max(TOUCHING));
        let outside = lanes!(|i| h[i] * h[i] + (a[i] - r) * (a[i] + r));
        let ratio = lanes!(|i| h[i] / delta[i]);
        // Vector irradiance / (pi radius^2), along -m and across.
        let along = lanes!(|i| {
            let beyond = 2.0 * ratio[i] * (h[i] / (delta[i] + outside[i]));
            if outside[i] > 0.0 { beyond } else { 0.5 * (1.0 - outside[i] / delta[i]) / (r * r) }
        });
        let share = lanes!(|i| 2.0 * ratio[i] / (h[i] * h[i] + a2[i] + r * r + delta[i]));
        let facing = lanes!(|i| {
            -(chunk.normal[0][i] * m[0] + chunk.normal[1][i] * m[1] + chunk.normal[2][i] * m[2])
        });
        let sideways = dot(&chunk.normal, &across);
        let middle = dot(&chunk.normal, &v);
        let tilt = lanes!(|i| r * ((1.0 - facing[i]) * (1.0 + facing[i])).max(0.0).sqrt());
        let irradiance = lanes!(|i| {
            let seen = h[i] > 0.0 && middle[i] >= tilt[i];
            if seen { (along[i] * facing[i] + share[i] * sideways[i]).max(0.0) } else { 0.0 }
        });
        let mut out = colored(self.color, &irradiance);
        let cut = lanes!(|i| if h[i] > 0.0 && middle[i].abs() < tilt[i] { 1.0 } else { 0.0 });
        if cut.iter().any(|&cut| cut > 0.0) {
            self.add_cut(chunk, &cut[..count], &mut out);
        }
        out
    }
}

impl Disc {
    /// What the horizon leaves, where `cut` says that it cuts.
    #[inline(never)]
    fn add_cut(&self, chunk: &Chunk, cut: &[f32], out: &mut [Lanes; 3]) {
        let (centre, normal, radius) = self.whole;
        for i in (0..cut.len()).filter(|&i| cut[i] > 0.0) {
            let [point, facing] =
                [&chunk.position, &chunk.normal].map(|v| [0, 1, 2].map(|a| f64::from(v[a][i])));
            let irradiance =
                View::new(centre, normal, radius, point).map_or(0.0, |view| view.irradiance(facing));
            for (out, color) in out.iter_mut().zip(self.clipped_color) {
                out[i] = (color * irradiance) as f32;
            }
        }
    }
}

struct Point {
    place: Place,
    nearest2: f32,
    /// Intensity / pi, in the place's units.
    color: [f32; 3],
}

impl AtChunk for Point {
    #[inline(always)]
    fn reflectance(&self, chunk: &Chunk, _: usize) -> [Lanes; 3] {
        let (d2, cosine) = self.place.distance2_and_cosine(chunk);
        let factor = lanes!(|i| cosine[i].max(0.0) / d2[i].max(self.nearest2).max(TOUCHING));
        colored(self.color, &factor)
    }
}

struct Directional {
    direction: [f32; 3],
    /// Irradiance / pi.
    color: [f32; 3],
}

impl AtChunk for Directional {
    #[inline(always)]
    fn reflectance(&self, chunk: &Chunk, _: usize) -> [Lanes; 3] {
        let cosine = dot(&chunk.normal, &self.direction.map(|c| [c; LANES]));
        colored(self.color, &lanes!(|i| cosine[i].max(0.0)))
    }
}

/// Harmonics of reflectance.
struct Harmonics {
    bands: usize,
    coefficients: Vec<[f32; 3]>,
}

impl Harmonics {
    fn new(probe: &Probe, color: [f64; 3]) -> Self {
        let reflected = |(i, c): (usize, &[f64; 3])| {
            let factor = cosine_lobe(i.isqrt()) / PI;
            [0, 1, 2].map(|channel| (color[channel] * c[channel] * factor) as f32)
        };
        let coefficients: Vec<_> = probe.coefficients.iter().enumerate().map(reflected).collect();
        Self { bands: coefficients.len().isqrt(), coefficients }
    }
}

impl AtChunk for Harmonics {
    #[inline(always)]
    fn reflectance(&self, chunk: &Chunk, _: usize) -> [Lanes; 3] {
        let mut functions = [[0.0f32; LANES]; MOST_LANE_BANDS * MOST_LANE_BANDS];
        let [x, y, z] = &chunk.normal;
        RECURSION.evaluate(self.bands, [x, y, z], &mut functions);
        let mut out = [[0.0f32; LANES]; 3];
        for (coefficient, function) in self.coefficients.iter().zip(&functions) {
            for (out, c) in out.iter_mut().zip(coefficient) {
                *out = lanes!(|i| out[i] + c * function[i]);
            }
        }
        out
    }
}
