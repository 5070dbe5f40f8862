//! What a white diffuser reflects, irradiance / pi, at many points of a surface at once, in f32.
//!
//! Lengths are divided by a power of two near the largest, and positions of lights are kept as two f32, so that neither
//! radii of 1e-30 or 1e30 nor far origins lose digits. Colours go with squared radii in f64 first.

use super::disc::View;
use super::disc_segments::{Rim, SEGMENT_RULES, SEGMENTS, Segments};
use super::lanes::{LANES, MOST_LANE_BANDS, RECURSION, angle, arctangent_rest, lanes, three};
use super::{Light, Probe, Source, cosine_lobe};
use relight_core::vectors::wide;
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

/// How a disc is evaluated at points whose horizon cuts it.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum CutDiscs {
    /// Point by point in f64, as [`Light::irradiance`]: what judges.
    Exact,
    /// Many points at once in f32, from 2 radii on: within 2e-4 of what the disc gives at most from there.
    Fast,
}

/// Adds R, G, B of what a white diffuser reflects of a light, irradiance / pi, to the rows of `out`.
///
/// [`Light::irradiance`] within 1e-6 of what the light gives at most from there (discs turned towards the point), but for discs that are cut, which are
/// as `cut` says. The bits are the same at every level and however points are split into rows.
///
/// # Panics
/// When rows are of different lengths.
pub fn add_reflectance(
    light: &Light,
    cut: CutDiscs,
    level: CpuLevel,
    points: &SurfaceRows<'_>,
    out: [&mut [f32]; 3],
) {
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
                area: PI * size * size,
                cut,
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
        Source::Probe(probe) => level.run(Harmonics::new(probe, light.color, points, out)),
    }
}

/// A point and the normal there.
#[derive(Clone, Copy)]
struct Facing {
    point: [f32; 3],
    normal: [f32; 3],
}

/// A light that gives all channels of a point the same, but for its colour.
trait AtPoint {
    /// Reflectance over [`Self::color`].
    fn factor(&self, facing: Facing) -> f32;

    fn color(&self) -> [f32; 3];

    /// Puts in what [`Self::factor`] could not give.
    #[inline(always)]
    fn mend(&self, _factors: &mut [f32], _points: &Strip) {}
}

/// Points whose factors are kept before they become colours.
const STRIP: usize = 64;

struct Rows<'a, W> {
    points: &'a SurfaceRows<'a>,
    out: [&'a mut [f32]; 3],
    work: W,
}

impl<W: AtPoint> Vectorized for Rows<'_, W> {
    type Output = ();

    #[inline(always)]
    fn run(self) {
        let [r, g, b] = self.out;
        let color = self.work.color();
        for first in (0..self.points.x.len()).step_by(STRIP) {
            let (strip, count) = Strip::new(self.points, first);
            let mut factors = [0.0f32; STRIP];
            for (i, factor) in factors.iter_mut().enumerate() {
                *factor = self.work.factor(strip.facing(i));
            }
            self.work.mend(&mut factors[..count], &strip);
            let [r, g, b] = [&mut r[first..][..count], &mut g[first..][..count], &mut b[first..][..count]];
            for i in 0..count {
                r[i] += color[0] * factors[i];
                g[i] += color[1] * factors[i];
                b[i] += color[2] * factors[i];
            }
        }
    }
}

/// [`STRIP`] points, by coordinate: of known length, so that loops over it have no checks in the way.
struct Strip {
    point: [[f32; STRIP]; 3],
    normal: [[f32; STRIP]; 3],
}

impl Strip {
    /// The points from `first` on, and how many there are; zeros follow.
    #[inline(always)]
    fn new(points: &SurfaceRows<'_>, first: usize) -> (Self, usize) {
        let count = STRIP.min(points.x.len() - first);
        let mut strip = Self { point: [[0.0; STRIP]; 3], normal: [[0.0; STRIP]; 3] };
        let [x, y, z] = &mut strip.point;
        let [nx, ny, nz] = &mut strip.normal;
        x[..count].copy_from_slice(&points.x[first..][..count]);
        y[..count].copy_from_slice(&points.y[first..][..count]);
        z[..count].copy_from_slice(&points.z[first..][..count]);
        nx[..count].copy_from_slice(&points.nx[first..][..count]);
        ny[..count].copy_from_slice(&points.ny[first..][..count]);
        nz[..count].copy_from_slice(&points.nz[first..][..count]);
        (strip, count)
    }

    #[inline(always)]
    fn facing(&self, i: usize) -> Facing {
        Facing { point: three!(|a| self.point[a][i]), normal: three!(|a| self.normal[a][i]) }
    }
}

#[inline(always)]
fn dot(a: [f32; 3], b: [f32; 3]) -> f32 {
    a[0] * b[0] + a[1] * b[1] + a[2] * b[2]
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
    fn towards(&self, point: [f32; 3]) -> [f32; 3] {
        let scale = self.scale as f32;
        three!(|a| (self.high[a] - point[a] * scale) + self.low[a])
    }

    /// The squared distance and the cosine at the surface.
    #[inline(always)]
    fn distance2_and_cosine(&self, facing: Facing) -> (f32, f32) {
        let towards = self.towards(facing.point);
        let distance2 = dot(towards, towards);
        let cosine = dot(towards, facing.normal) / distance2.max(TOUCHING).sqrt();
        // In the light's middle it is seen towards +z.
        (distance2, if distance2 > TOUCHING { cosine } else { facing.normal[2] })
    }
}

struct Sphere {
    place: Place,
    radius: f32,
    /// Radiance times the squared radius.
    color: [f32; 3],
}

impl AtPoint for Sphere {
    #[inline(always)]
    fn factor(&self, facing: Facing) -> f32 {
        let r = self.radius;
        let (d2, cosine) = self.place.distance2_and_cosine(facing);
        let d = d2.sqrt();
        let fall_off = 1.0 / d2.max(r * r).max(TOUCHING);
        let sine = if d > r { r / d } else { 1.0 };
        let c = (((d - r) * (d + r)).max(0.0) * fall_off).sqrt();
        let cut = FRAC_1_PI * cut_sphere(sine, c, cosine);
        let whole = if cosine <= -sine { 0.0 } else { cut };
        let outside = if cosine >= sine { cosine } else { whole };
        fall_off * if c > 0.0 { outside } else { 0.5 * (1.0 + cosine) }
    }

    #[inline(always)]
    fn color(&self) -> [f32; 3] {
        self.color
    }
}

/// Irradiance / sine^2 where the horizon cuts the sphere; anything elsewhere. `c` is the cosine that goes with the sine.
///
/// As `Seen::irradiance`, whose two ways are one here: the arctangent less its argument is a polynomial up to 1.
#[inline(always)]
pub(super) fn cut_sphere(sine: f32, c: f32, cosine: f32) -> f32 {
    let t = (cosine / sine).clamp(-1.0, 1.0);
    let u = ((1.0 - t) * (1.0 + t)).sqrt();
    let w = sine * u;
    let (least, most) = if w < c { (w, c) } else { (c, w) };
    let x = least / most.max(f32::MIN_POSITIVE);
    let rest = arctangent_rest(x * x);
    let ratio = u / c;
    let small = x + x * (ratio * ratio * rest);
    let steep = FRAC_PI_2 - (x + x * (x * x * rest)) - c * w;
    cosine * angle(u, -c * t) + if w < c { small } else { steep / (sine * sine) }
}

struct Disc {
    place: Place,
    normal: [f32; 3],
    radius: f32,
    /// Radiance times the squared radius.
    color: [f32; 3],
    /// Centre, normal, radius as they are.
    whole: ([f64; 3], [f64; 3], f64),
    /// In the place's units.
    area: f64,
    cut: CutDiscs,
}

/// What a disc's factor is where the horizon cuts it: those points are mended.
const CUT: f32 = -1.0;

impl AtPoint for Disc {
    #[inline(always)]
    fn factor(&self, facing: Facing) -> f32 {
        let (m, r, n) = (self.normal, self.radius, facing.normal);
        let v = self.place.towards(facing.point);
        let h = -dot(v, m);
        let across = three!(|a| v[a] + h * m[a]);
        let a2 = dot(across, across);
        let a = a2.sqrt();
        let near2 = h * h + (a - r) * (a - r);
        let far2 = h * h + (a + r) * (a + r);
        let delta = (near2.sqrt() * far2.sqrt()).max(TOUCHING);
        let outside = h * h + (a - r) * (a + r);
        let ratio = h / delta;
        // Vector irradiance / (pi radius^2), along -m and across.
        let beyond = 2.0 * ratio * (h / (delta + outside));
        let within = 0.5 * (1.0 - outside / delta) / (r * r);
        let along = if outside > 0.0 { beyond } else { within };
        let share = 2.0 * ratio / (h * h + a2 + r * r + delta);
        let towards = -dot(n, m);
        let middle = dot(n, v);
        let tilt = r * ((1.0 - towards) * (1.0 + towards)).max(0.0).sqrt();
        let whole = (along * towards + share * dot(n, across)).max(0.0);
        let above = if middle >= tilt { whole } else { CUT };
        let seen = if middle <= -tilt { 0.0 } else { above };
        if h > 0.0 { seen } else { 0.0 }
    }

    #[inline(always)]
    fn color(&self) -> [f32; 3] {
        self.color
    }

    #[inline(always)]
    fn mend(&self, factors: &mut [f32], points: &Strip) {
        // By rule: points that are evaluated together.
        let mut places = [[0; STRIP]; SEGMENT_RULES];
        let mut counts = [0; SEGMENT_RULES];
        for (i, factor) in factors.iter_mut().enumerate() {
            if *factor != CUT {
                continue;
            }
            let facing = points.facing(i);
            let towards = self.place.towards(facing.point);
            let rule = Segments::index(dot(towards, towards), self.radius * self.radius);
            match rule.filter(|_| self.cut == CutDiscs::Fast) {
                Some(rule) => {
                    places[rule][counts[rule]] = i;
                    counts[rule] += 1;
                }
                None => *factor = self.exact(facing),
            }
        }
        for (rule, (places, count)) in SEGMENTS.iter().zip(places.iter().zip(counts)) {
            for places in places[..count].chunks(LANES) {
                self.put_segments(rule, places, factors, points);
            }
        }
    }
}

impl Disc {
    #[inline(never)]
    fn exact(&self, Facing { point, normal }: Facing) -> f32 {
        let (centre, axis, radius) = self.whole;
        let view = View::new(centre, axis, radius, wide(point));
        view.map_or(0.0, |view| (view.irradiance(wide(normal)) / self.area) as f32)
    }

    /// The factors of up to [`LANES`] points that the disc is cut for.
    #[inline(always)]
    fn put_segments(&self, rule: &Segments, places: &[usize], factors: &mut [f32], points: &Strip) {
        let (mut towards, mut normal) = ([[1.0; LANES]; 3], [[1.0; LANES]; 3]);
        for (lane, &i) in places.iter().enumerate() {
            let facing = points.facing(i);
            let v = self.place.towards(facing.point);
            for axis in 0..3 {
                towards[axis][lane] = v[axis];
                normal[axis][lane] = facing.normal[axis];
            }
        }
        let rim = Rim { normal: self.normal, radius: self.radius };
        let segments = rim.segments(rule, &towards, &normal);
        for (&i, segment) in places.iter().zip(segments) {
            factors[i] = segment;
        }
    }
}

struct Point {
    place: Place,
    nearest2: f32,
    /// Intensity / pi, in the place's units.
    color: [f32; 3],
}

impl AtPoint for Point {
    #[inline(always)]
    fn factor(&self, facing: Facing) -> f32 {
        let (d2, cosine) = self.place.distance2_and_cosine(facing);
        cosine.max(0.0) / d2.max(self.nearest2).max(TOUCHING)
    }

    #[inline(always)]
    fn color(&self) -> [f32; 3] {
        self.color
    }
}

struct Directional {
    direction: [f32; 3],
    /// Irradiance / pi.
    color: [f32; 3],
}

impl AtPoint for Directional {
    #[inline(always)]
    fn factor(&self, facing: Facing) -> f32 {
        dot(facing.normal, self.direction).max(0.0)
    }

    #[inline(always)]
    fn color(&self) -> [f32; 3] {
        self.color
    }
}

/// Harmonics of reflectance.
struct Harmonics<'a> {
    bands: usize,
    coefficients: Vec<[f32; 3]>,
    points: &'a SurfaceRows<'a>,
    out: [&'a mut [f32]; 3],
}

impl<'a> Harmonics<'a> {
    fn new(probe: &Probe, color: [f64; 3], points: &'a SurfaceRows<'a>, out: [&'a mut [f32]; 3]) -> Self {
        let reflected = |(i, c): (usize, &[f64; 3])| {
            let factor = cosine_lobe(i.isqrt()) / PI;
            [0, 1, 2].map(|channel| (color[channel] * c[channel] * factor) as f32)
        };
        let coefficients: Vec<_> = probe.coefficients.iter().enumerate().map(reflected).collect();
        Self { bands: coefficients.len().isqrt(), coefficients, points, out }
    }
}

impl Vectorized for Harmonics<'_> {
    type Output = ();

    #[inline(always)]
    fn run(self) {
        let mut functions = [[0.0f32; LANES]; MOST_LANE_BANDS * MOST_LANE_BANDS];
        let [r, g, b] = self.out;
        let SurfaceRows { nx, ny, nz, .. } = *self.points;
        for first in (0..nx.len()).step_by(LANES) {
            let count = LANES.min(nx.len() - first);
            let mut normal = [[0.0f32; LANES]; 3];
            normal[0][..count].copy_from_slice(&nx[first..first + count]);
            normal[1][..count].copy_from_slice(&ny[first..first + count]);
            normal[2][..count].copy_from_slice(&nz[first..first + count]);
            RECURSION.evaluate(self.bands, &normal, &mut functions);
            let mut sums = [[0.0f32; LANES]; 3];
            for (coefficient, function) in self.coefficients.iter().zip(&functions) {
                sums = three!(|c| lanes!(|i| sums[c][i] + coefficient[c] * function[i]));
            }
            for i in 0..count {
                r[first + i] += sums[0][i];
                g[first + i] += sums[1][i];
                b[first + i] += sums[2][i];
            }
        }
    }
}
