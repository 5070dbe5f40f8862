//! Tables of what the horizon leaves of a sphere, for shaders.
//!
//! Source: *Irradiance Rigs*, section 3.2, has one of 128 x 128 in cos and radius / distance; irradiance has a slope without
//! bound there where the sphere is touched. MATH.md section 1.4 measures 5.1 grey levels of 255 for it.

use super::sphere::Seen;
use std::f64::consts::{FRAC_PI_2, PI};

/// What a [`SphereTable`]'s axes are.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum TableAxes {
    /// Along a row asin(cos / sine), -pi/2 to pi/2, from row to row asin(sine), 0 to pi/2; holds irradiance / (pi sine^3), which
    /// is smooth there, balanced between nodes. Only where the horizon cuts the sphere: beyond, it is 0 or pi sine^2 cos.
    Angles,
    /// The paper's: along a row cos, -1 to 1, from row to row the sine, 0 to 1; holds irradiance / pi.
    Cosine,
}

/// Irradiance of a sphere of radiance 1 by the cosine at the receiver and the sine of half the angle that the sphere fills.
#[derive(Clone, Debug, PartialEq)]
pub struct SphereTable {
    /// What its axes are.
    pub axes: TableAxes,
    /// Nodes along each axis, the outer ones at the ends of its range.
    pub size: usize,
    /// size x size.
    pub values: Vec<f32>,
}

impl SphereTable {
    /// A table of size x size nodes.
    ///
    /// # Panics
    /// When `size` is below 3.
    pub fn new(axes: TableAxes, size: usize) -> Self {
        assert!(size >= 3, "a table has ends and a middle");
        let place = |i: usize| i as f64 / (size - 1) as f64;
        let value = |k: usize| {
            let (u, v) = (place(k % size), place(k / size));
            match axes {
                TableAxes::Angles => Self::cut(libm::sin(PI * (u - 0.5)), v),
                TableAxes::Cosine => irradiance(2.0 * u - 1.0, v) / PI,
            }
        };
        let exact: Vec<f64> = (0..size * size).map(value).collect();
        // Chords of a curve lie on one side of it, by an eighth of the second difference at most: half of that to either side.
        let bent = |k: usize, step: usize, place: usize| {
            let middle = k - place * step + place.clamp(1, size - 2) * step;
            exact[middle - step] - 2.0 * exact[middle] + exact[middle + step]
        };
        let balanced = |k: usize| match axes {
            TableAxes::Angles => exact[k] - (bent(k, 1, k % size) + bent(k, size, k / size)) / 16.0,
            TableAxes::Cosine => exact[k],
        };
        Self { axes, size, values: (0..size * size).map(|k| balanced(k) as f32).collect() }
    }

    /// Irradiance / (pi sine^3) at t = cos / sine and a row.
    fn cut(t: f64, row: f64) -> f64 {
        // Nothing is left of sine 0: a sine that is far less than any step is its limit.
        let sine = libm::sin(FRAC_PI_2 * row).max(1e-9);
        irradiance(t * sine, sine) / (PI * sine * sine * sine)
    }

    /// Irradiance / pi for radiance 1, bilinear; the sine is 0 to 1.
    pub fn lookup(&self, cosine: f64, sine: f64) -> f64 {
        match self.axes {
            TableAxes::Cosine => self.bilinear(0.5 * (cosine + 1.0), sine),
            TableAxes::Angles if cosine >= sine => sine * sine * cosine,
            TableAxes::Angles if cosine <= -sine => 0.0,
            TableAxes::Angles => {
                let (u, v) = (libm::asin(cosine / sine) / PI + 0.5, libm::asin(sine) / FRAC_PI_2);
                sine * sine * sine * self.bilinear(u, v)
            }
        }
    }

    fn bilinear(&self, u: f64, v: f64) -> f64 {
        let last = self.size - 1;
        let split = |place: f64| {
            let place = place.clamp(0.0, 1.0) * last as f64;
            let node = (place as usize).min(last - 1);
            (node, place - node as f64)
        };
        let ((i, x), (j, y)) = (split(u), split(v));
        let row = |j: usize| {
            let at = j * self.size + i;
            (1.0 - x) * f64::from(self.values[at]) + x * f64::from(self.values[at + 1])
        };
        (1.0 - y) * row(j) + y * row(j + 1)
    }

    /// The largest error between its nodes in grey levels, 255 x irradiance / pi, over a grid of 4 x 4 points a cell of a
    /// table of 256 x 256.
    pub fn largest_error(&self) -> f64 {
        const STEPS: u32 = 1024;
        let place = |i: u32| (f64::from(i) + 0.37) / f64::from(STEPS);
        let mut worst = 0.0f64;
        for row in 0..STEPS {
            let sine = libm::sin(FRAC_PI_2 * place(row));
            for column in 0..STEPS {
                // Where the horizon cuts, and as many points beyond.
                for cosine in [libm::sin(PI * (place(column) - 0.5)) * sine, 2.0 * place(column) - 1.0] {
                    let error = self.lookup(cosine, sine) - irradiance(cosine, sine) / PI;
                    worst = worst.max(255.0 * error.abs());
                }
            }
        }
        worst
    }
}

fn irradiance(cosine: f64, sine: f64) -> f64 {
    let seen = Seen { sine, cosine: ((1.0 - sine) * (1.0 + sine)).sqrt() };
    sine * sine * if sine > 0.0 { seen.irradiance(cosine) } else { 0.0 }
}
