//! Windows: what each band counts, so that irradiance does not ring below 0.
//!
//! Source: Sloan, *Stupid Spherical Harmonics (SH) Tricks*, 2008 (Hanning's and Lanczos's windows). Sloan's *Deringing Spherical
//! Harmonics*, 2017, looks for the widest window of a family that leaves nothing below 0; for irradiance of three bands that halves
//! band 1, since less of band 2 alone rings more. Here the factors are free, and the least change of them all is taken.

use crate::{MOST_BANDS, Placement, RigPart, reflection};
use std::f64::consts::PI;

/// Irradiance below 0 by less than this part of the largest is rounding.
const ROUNDING: f64 = 1e-6;

/// Most rounds over all points, and the change of a factor at which they end.
const SWEEPS: usize = 2000;
const MOVED: f64 = 1e-9;

/// What the coefficients of each band are multiplied by; 1 for band 0.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Window {
    /// By band.
    pub factors: [f64; MOST_BANDS],
}

/// Bands of the harmonics that shade, and their window.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Bands {
    /// 1 to 7.
    pub count: usize,
    /// What each counts.
    pub window: Window,
}

/// How far below 0 irradiance rings at some points, in any channel.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Ringing {
    /// Points that were looked at.
    pub points: usize,
    /// Those below 0.
    pub negative: usize,
    /// The lowest value over the largest of all points; 0 where none is below 0.
    pub lowest: f64,
}

impl Window {
    /// All bands count in full.
    pub const NONE: Self = Self { factors: [1.0; MOST_BANDS] };

    /// `(1 + cos(pi l / width)) / 2`, 0 from `width` on.
    pub fn hanning(width: f64) -> Self {
        Self::of(|l| if l < width { 0.5 * (1.0 + libm::cos(PI * l / width)) } else { 0.0 })
    }

    /// `sin(pi l / width) / (pi l / width)`, 0 from `width` on; an infinite width is [`Self::NONE`].
    pub fn lanczos(width: f64) -> Self {
        Self::of(|l| match PI * l / width {
            0.0 => 1.0,
            angle if l < width => libm::sin(angle) / angle,
            _ => 0.0,
        })
    }

    fn of(factor: impl Fn(f64) -> f64) -> Self {
        Self { factors: std::array::from_fn(|l| factor(l as f64)) }
    }

    /// The factors, 0 to 1, that change the light of some points least (by the squares of what bands lose) and leave none below 0 in any
    /// channel, from what each band gives to each point.
    ///
    /// Points that band 0 itself leaves below 0, where a model extrapolates, are beyond help and not looked at.
    /// Source: Hildreth, *A quadratic programming procedure*, 1957: row after row, until nothing moves.
    pub fn least(points: &[Vec<[f64; 3]>]) -> Self {
        let bands = points.first().map_or(0, Vec::len);
        // What bands lose, band 0 nothing: the sum over bands of loss x row is at most the light there.
        let channels = points.iter().flat_map(|point| (0..3).map(move |c| (point, c)));
        let rows = channels.filter(|(point, c)| point[0][*c] >= 0.0).map(|(point, c)| {
            let mut row = [0.0; MOST_BANDS];
            for (row, band) in row.iter_mut().zip(point).skip(1) {
                *row = band[c];
            }
            (row, point.iter().map(|band| band[c]).sum::<f64>())
        });
        let mut rows: Vec<([f64; MOST_BANDS], f64)> = rows.collect();
        let mut weights = [0.0; MOST_BANDS];
        for (row, _) in &rows {
            weights = std::array::from_fn(|l| weights[l] + row[l] * row[l]);
        }
        for l in 1..bands {
            let unit = |size: f64| std::array::from_fn(|other| if other == l { size } else { 0.0 });
            rows.extend([(unit(1.0), 1.0), (unit(-1.0), 0.0)]);
        }
        let inverse = weights.map(|weight| if weight > 0.0 { 1.0 / weight } else { 0.0 });
        let product =
            |a: &[f64; MOST_BANDS], b: &[f64; MOST_BANDS]| -> f64 { (0..bands).map(|l| a[l] * b[l]).sum() };
        let mut losses = [0.0; MOST_BANDS];
        let mut multipliers = vec![0.0f64; rows.len()];
        for _ in 0..SWEEPS {
            let mut moved = 0.0f64;
            for ((row, light), multiplier) in rows.iter().zip(&mut multipliers) {
                let scaled: [f64; MOST_BANDS] = std::array::from_fn(|l| inverse[l] * row[l]);
                let size = product(row, &scaled);
                if size <= 0.0 {
                    continue;
                }
                let step = ((product(row, &losses) - light) / size).max(-*multiplier);
                *multiplier += step;
                for (loss, scaled) in losses.iter_mut().zip(&scaled) {
                    *loss -= step * scaled;
                    moved = moved.max((step * scaled).abs());
                }
            }
            if moved < MOVED {
                break;
            }
        }
        Self { factors: losses.map(|loss| (1.0 - loss).clamp(0.0, 1.0)) }
    }

    /// Multiplies coefficients, vectors of `bands`^2 one after the other.
    pub fn apply(&self, bands: usize, coefficients: &mut [[f64; 3]]) {
        for (i, value) in coefficients.iter_mut().enumerate() {
            *value = value.map(|v| v * self.factors[(i % (bands * bands)).isqrt()]);
        }
    }
}

impl From<usize> for Bands {
    fn from(count: usize) -> Self {
        Self { count, window: Window::NONE }
    }
}

impl Ringing {
    /// Of R, G, B at points.
    pub fn of(values: impl Iterator<Item = [f64; 3]> + Clone) -> Self {
        let largest = values.clone().flatten().fold(0.0, f64::max);
        let mut ringing = Self::default();
        for value in values {
            let lowest = value.into_iter().fold(f64::INFINITY, f64::min);
            ringing.points += 1;
            if lowest < -ROUNDING * largest && lowest < 0.0 {
                ringing.negative += 1;
                ringing.lowest = ringing.lowest.min(lowest / largest.max(f64::MIN_POSITIVE));
            }
        }
        ringing
    }

    /// Part of the points that are below 0.
    pub fn share(&self) -> f64 {
        self.negative as f64 / self.points.max(1) as f64
    }

    /// Of these points and others; each lowest value over its own largest.
    pub fn and(self, other: Self) -> Self {
        Self {
            points: self.points + other.points,
            negative: self.negative + other.negative,
            lowest: self.lowest.min(other.lowest),
        }
    }
}

impl RigPart {
    /// R, G, B of the light that points of the surface reflect under vectors of `bands`^2 coefficients in the scene's axes, by point
    /// and band: what each band adds.
    pub fn reflectance_by_band(
        &self,
        coefficients: &[[f64; 3]],
        placement: &Placement,
        bands: usize,
    ) -> Vec<Vec<[f64; 3]>> {
        let mut weights = vec![0.0; self.model.parameters().len()];
        let mut reflections = vec![0.0; bands * bands];
        let of_point = self.surface.iter().map(|point| {
            self.model.weights(self.frame.coordinates(point.position), &mut weights);
            reflection(placement.direction(point.normal), &mut reflections);
            let mut sums = vec![[0.0; 3]; bands];
            for (weight, vector) in weights.iter().zip(coefficients.chunks_exact(bands * bands)) {
                for (i, (reflection, value)) in reflections.iter().zip(vector).enumerate() {
                    let sum = &mut sums[i.isqrt()];
                    *sum = [0, 1, 2].map(|c| sum[c] + weight * reflection * value[c]);
                }
            }
            sums
        });
        of_point.collect()
    }
}

impl Window {
    /// R, G, B of points of which each band's light is given.
    pub fn of_points<'a>(
        &self,
        points: &'a [Vec<[f64; 3]>],
    ) -> impl Iterator<Item = [f64; 3]> + Clone + use<'a> {
        let factors = self.factors;
        points.iter().map(move |bands| {
            bands
                .iter()
                .zip(factors)
                .fold([0.0; 3], |sum, (band, factor)| [0, 1, 2].map(|c| sum[c] + factor * band[c]))
        })
    }
}
