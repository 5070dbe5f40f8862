//! Lights as a point sees them: harmonics of what arrives, their slopes, and irradiance.
//!
//! In f64, and exact but for rounding: what judges the fast ones. Colours multiply squares of sines, one factor after the
//! other, so that a radius of 1e-30 with a radiance of 1e60 is a light as any other.

mod disc;
mod disc_harmonics;
mod disc_nodes;
mod disc_pairs;
mod disc_segments;
mod harmonics;
pub(crate) mod lanes;
mod projector;
mod quadrature;
mod reflectance;
pub(crate) mod rows;
mod sphere;
mod sphere_table;

pub use harmonics::{MOST_BANDS, cosine_lobe};
pub use projector::Projector;
pub use reflectance::{CutDiscs, SurfaceRows, add_reflectance};
pub use sphere_table::{SphereTable, TableAxes};

use disc::View;
use disc_harmonics::Projection;
use harmonics::{MOST_FUNCTIONS, Zonal};
use relight_core::Direction;
use relight_core::basis::evaluate_sh;
use relight_core::vectors::{difference, dot, length, unit};
use sphere::Seen;
use std::f64::consts::PI;

/// A light of a scene, in the scene's axes.
#[derive(Clone, Debug, PartialEq)]
pub struct Light {
    /// For people.
    pub name: String,
    /// What it is and where.
    pub source: Source,
    /// Linear R, G, B, not negative: radiance of spheres and discs; radiant intensity of points; irradiance at normal
    /// incidence of directional lights; factor of a probe's coefficients.
    pub color: [f64; 3],
}

/// Kinds of lights.
#[derive(Clone, Debug, PartialEq)]
pub enum Source {
    /// A sphere that shines alike all over. Points inside see what points on it see: half of all directions shine.
    Sphere {
        /// Its middle.
        centre: [f64; 3],
        /// Above 0.
        radius: f64,
    },
    /// A disc that shines on one side, alike in all directions (Lambertian).
    Disc {
        /// Its middle.
        centre: [f64; 3],
        /// Unit vector out of the side that shines.
        normal: [f64; 3],
        /// Above 0.
        radius: f64,
    },
    /// A point that shines alike in all directions.
    Point {
        /// Where it stands.
        position: [f64; 3],
        /// Above 0: points closer than this are lit as from this distance.
        nearest: f64,
    },
    /// From one direction everywhere.
    Directional {
        /// Unit vector towards the light.
        direction: [f64; 3],
    },
    /// From all around, alike everywhere.
    Probe(Probe),
}

/// Radiance from all around, in spherical harmonics.
#[derive(Clone, Debug, PartialEq)]
pub struct Probe {
    /// R, G, B of the radiance's coefficients (not of irradiance) by l * l + l + m with Condon-Shortley phase: 1, 4, 9 ..
    /// 121 of them.
    pub coefficients: Vec<[f64; 3]>,
}

/// Where a light without a middle is looked for: of no consequence, but always the same.
const UP: [f64; 3] = [0.0, 0.0, 1.0];

impl Light {
    /// Adds R, G, B of the coefficients L_lm of the radiance that arrives at `point`, by l * l + l + m, of `bands` bands.
    ///
    /// They hold all of the light, also what a surface there has below its horizon. From a sphere's or a point's middle the
    /// light is seen towards +z; from the plane of a disc and from behind it is not seen. Discs are within 1e-12 of their
    /// largest coefficient, all others exact.
    ///
    /// # Panics
    /// When `bands` is not 1 to [`MOST_BANDS`], or `out` not bands^2 long.
    pub fn add_projection(&self, point: [f64; 3], bands: usize, out: &mut [[f64; 3]]) {
        check(bands, out.len());
        let mut functions = [0.0; MOST_FUNCTIONS];
        match &self.source {
            Source::Directional { direction } => {
                harmonics::harmonics(bands, *direction, &mut functions);
                Zonal { values: [1.0; MOST_BANDS], slopes: [0.0; MOST_BANDS] }
                    .add(&functions, self.color, out);
            }
            Source::Probe(probe) => {
                for (out, coefficient) in out.iter_mut().zip(&probe.coefficients) {
                    *out = [0, 1, 2].map(|i| out[i] + self.color[i] * coefficient[i]);
                }
            }
            Source::Disc { centre, normal, radius } => {
                if let Some(view) = View::new(*centre, *normal, *radius, point) {
                    let projection = Projection::new(&view, bands);
                    for (out, value) in out.iter_mut().zip(&projection.values) {
                        *out = [0, 1, 2].map(|i| out[i] + self.color[i] * value);
                    }
                }
            }
            Source::Sphere { centre, .. } | Source::Point { position: centre, .. } => {
                let towards = difference(*centre, point);
                let (zonal, color) = self.zonal(length(towards));
                harmonics::harmonics(bands, towards, &mut functions);
                zonal.add(&functions, color, out);
            }
        }
    }

    /// Adds what [`Self::add_projection`] does to `values`, and the slopes of coefficient i along the axis a to `gradients[i][a]`.
    ///
    /// The slope on a sphere's surface and within is that of the light seen there, of the same size wherever the point is;
    /// a point's likewise within `nearest`. In their very middle it is 0.
    ///
    /// # Panics
    /// As [`Self::add_projection`]; `gradients` is as long as `values`.
    pub fn add_projection_with_gradient(
        &self,
        point: [f64; 3],
        bands: usize,
        values: &mut [[f64; 3]],
        gradients: &mut [[[f64; 3]; 3]],
    ) {
        check(bands, values.len());
        check(bands, gradients.len());
        match &self.source {
            Source::Directional { .. } | Source::Probe(_) => self.add_projection(point, bands, values),
            Source::Disc { centre, normal, radius } => {
                let Some(view) = View::new(*centre, *normal, *radius, point) else { return };
                let projection = Projection::new(&view, bands);
                for (i, (value, gradient)) in values.iter_mut().zip(gradients).enumerate() {
                    *value = [0, 1, 2].map(|c| value[c] + self.color[c] * projection.values[i]);
                    for (gradient, slope) in gradient.iter_mut().zip(projection.slopes[i]) {
                        *gradient = [0, 1, 2].map(|c| gradient[c] + self.color[c] / radius * slope);
                    }
                }
            }
            Source::Sphere { centre, .. } | Source::Point { position: centre, .. } => {
                let towards = difference(*centre, point);
                let distance = length(towards);
                let (zonal, color) = self.zonal(distance);
                let mut functions = [0.0; MOST_FUNCTIONS];
                harmonics::harmonics(bands + 1, towards, &mut functions);
                zonal.add(&functions, color, values);
                if distance > 0.0 {
                    zonal.add_gradient(&functions, color.map(|c| c / distance), gradients);
                }
            }
        }
    }

    /// R, G, B of the irradiance at a point of a surface of unit normal `normal`, of what is above its horizon.
    ///
    /// Exact but for a probe's, which is that of its harmonics and may be below 0 where they ring.
    pub fn irradiance(&self, point: [f64; 3], normal: [f64; 3]) -> [f64; 3] {
        match &self.source {
            Source::Sphere { centre, radius } => {
                let towards = difference(*centre, point);
                let seen = Seen::new(*radius, length(towards));
                let cosine = dot(unit(towards).unwrap_or(UP), normal);
                let irradiance = seen.irradiance(cosine);
                self.color.map(|c| c * seen.sine * seen.sine * irradiance)
            }
            Source::Disc { centre, normal: axis, radius } => {
                let view = View::new(*centre, *axis, *radius, point);
                let irradiance = view.map_or(0.0, |view| view.irradiance(normal));
                self.color.map(|c| c * irradiance)
            }
            Source::Point { position, nearest } => {
                let towards = difference(*position, point);
                let distance = length(towards).max(*nearest);
                let cosine = dot(unit(towards).unwrap_or(UP), normal).max(0.0);
                self.color.map(|c| c / distance / distance * cosine)
            }
            Source::Directional { direction } => self.color.map(|c| c * dot(*direction, normal).max(0.0)),
            Source::Probe(probe) => {
                let irradiance = probe.irradiance(normal);
                [0, 1, 2].map(|i| self.color[i] * irradiance[i])
            }
        }
    }

    /// A bound on irradiance / pi, in the brightest channel, over all points of a ball and all normals.
    pub fn largest_reflectance(&self, centre: [f64; 3], radius: f64) -> f64 {
        let brightest = self.color.iter().fold(0.0f64, |a, c| a.max(c.abs()));
        let distance = |place: [f64; 3]| (length(difference(place, centre)) - radius).max(0.0);
        match &self.source {
            Source::Sphere { centre: middle, radius: size } => {
                let sine = (size / distance(*middle)).min(1.0);
                brightest * sine * sine
            }
            Source::Disc { centre: middle, normal, radius: size } => {
                let height = dot(difference(centre, *middle), *normal) + radius;
                if height <= 0.0 {
                    return 0.0;
                }
                // No point of the disc is nearer, and no cosine at it larger.
                let nearest = (distance(*middle) - size).max(0.0);
                let ratio = size / nearest;
                let bound = brightest * ratio * ratio * (height / nearest).min(1.0);
                if ratio < 1e150 { bound.min(brightest) } else { brightest }
            }
            Source::Point { position, nearest } => {
                let distance = distance(*position).max(*nearest);
                brightest / distance / distance / PI
            }
            Source::Directional { .. } => brightest / PI,
            Source::Probe(probe) => {
                let bound = probe.largest_irradiance();
                [0, 1, 2].iter().fold(0.0, |a: f64, &i| a.max(self.color[i].abs() * bound[i])) / PI
            }
        }
    }

    /// Coefficients of a sphere's or a point's light by band, and the colour that they go with.
    fn zonal(&self, distance: f64) -> (Zonal, [f64; 3]) {
        match &self.source {
            Source::Sphere { radius, .. } => {
                let seen = Seen::new(*radius, distance);
                (seen.zonal(), self.color.map(|c| c * seen.sine * seen.sine))
            }
            Source::Point { nearest, .. } => {
                let slope = if distance > *nearest { 2.0 } else { 0.0 };
                let distance = distance.max(*nearest);
                let zonal = Zonal { values: [1.0; MOST_BANDS], slopes: [slope; MOST_BANDS] };
                (zonal, self.color.map(|c| c / distance / distance))
            }
            _ => (Zonal { values: [0.0; MOST_BANDS], slopes: [0.0; MOST_BANDS] }, [0.0; 3]),
        }
    }
}

impl Probe {
    /// R, G, B of the irradiance on a surface of unit normal `normal`: the sum of A_l L_lm Y_lm(normal).
    pub fn irradiance(&self, normal: [f64; 3]) -> [f64; 3] {
        let order = self.coefficients.len().isqrt().max(1) - 1;
        let direction = Direction::new(normal[0], normal[1], normal[2]).unwrap_or(Direction::OUT);
        let mut functions = vec![0.0; (order + 1) * (order + 1)];
        evaluate_sh(order, direction, &mut functions);
        let mut sum = [0.0; 3];
        for (i, (coefficient, function)) in self.coefficients.iter().zip(&functions).enumerate() {
            let weight = cosine_lobe(i.isqrt()) * function;
            sum = [0, 1, 2].map(|c| sum[c] + coefficient[c] * weight);
        }
        sum
    }

    /// A bound on the absolute irradiance over all normals, by channel.
    fn largest_irradiance(&self) -> [f64; 3] {
        // The squares of a band's functions add up to (2l + 1) / 4 pi everywhere.
        let mut bound = [0.0; 3];
        for l in 0..self.coefficients.len().isqrt() {
            let band = &self.coefficients[l * l..(l + 1) * (l + 1)];
            let factor = cosine_lobe(l).abs() * ((2 * l + 1) as f64 / (4.0 * PI)).sqrt();
            for (channel, bound) in bound.iter_mut().enumerate() {
                *bound += factor * band.iter().map(|c| c[channel] * c[channel]).sum::<f64>().sqrt();
            }
        }
        bound
    }
}

fn check(bands: usize, count: usize) {
    assert!((1..=MOST_BANDS).contains(&bands), "1 to {MOST_BANDS} bands");
    assert_eq!(count, bands * bands, "a coefficient a function");
}
