//! The normal and the albedo of one pixel from its values under all lights.
//!
//! A matte surface of albedo a and normal n has the value a n.l under the light l: three unknowns, as many equations as
//! lights. Shadows and highlights break that for some lights of nearly every pixel; the robust method leaves them out.

use crate::singular_values::SingularValues;
use crate::{FitError, median};
use nalgebra::DMatrix;
use relight_core::Direction;
use relight_core::vectors::{dot, length, unit};

/// How a normal is found from a pixel's values.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum NormalMethod {
    /// Least squares over the lights that agree with each other: shadows and highlights don't count.
    Robust,
    /// Plain least squares over all lights.
    LeastSquares,
}

/// The surface at one pixel.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct SurfaceNormal {
    /// Unit vector out of the surface: x right, y up, z out of the picture.
    pub normal: [f64; 3],
    /// Value of each channel under a light of strength 1 along the normal; channels that a pixel lacks are 0.
    pub albedo: [f64; 3],
}

/// Lights whose smallest singular value is below this part of the largest lie in one plane: 0.06 degrees of it, which
/// is what three digits in a light file leave.
pub const COPLANAR: f64 = 1e-3;

/// The ranks of the values that the first estimate takes, in parts of all: below lie shadows, above highlights.
///
/// Source: MATH.md section 1.3 keeps 0.45..0.92; on relief256 0.45..0.80 starts better (2.12 degrees for 2.97).
const RANKS: [f64; 2] = [0.45, 0.80];

/// Steps of concentration; nearly all pixels stand still after five.
const MOST_STEPS: usize = 12;

/// Steps of reweighting.
const MOST_REWEIGHTINGS: usize = 15;

/// A step that moves a normal by less, in radians, is the last: 0.0006 degrees.
const SETTLED: f64 = 1e-5;

/// Deviations beyond this many standard deviations don't count. Tukey's 4.685 lets penumbras in: 1.66 degrees on
/// relief256 where 2.5 gives 1.12.
const TUKEY: f64 = 2.5;

/// Standard deviations of a normal distribution in its median absolute deviation.
const DEVIATIONS: f64 = 1.4826;

/// The least deviation that is believed, in parts of the surface's albedo: a quarter of a code of 8 bits.
const LEAST_DEVIATION: f64 = 1e-3;

/// Pivots below this part of the trace are 0: the lights that are left lie in one plane.
const LEAST_PIVOT: f64 = 1e-6;

/// Lights, and what a thread needs to find normals from values under them.
#[derive(Clone, Debug)]
pub struct PhotometricStereo {
    lights: Vec<[f64; 3]>,
    method: NormalMethod,
    /// Lights that count at this pixel, with their values.
    usable: Vec<(usize, f64)>,
    ranked: Vec<f64>,
    /// Deviations of the lights that face the surface, with their place in `usable`.
    deviations: Vec<(f64, usize)>,
    kept: Vec<bool>,
    kept_before: Vec<bool>,
    /// One for each of `usable`.
    weights: Vec<f64>,
}

impl PhotometricStereo {
    /// # Errors
    /// [`FitError::TooFewForNormals`] below 3 lights, [`FitError::CoplanarLights`] when they lie in one plane.
    pub fn new(directions: &[Direction], method: NormalMethod) -> Result<Self, FitError> {
        let count = directions.len();
        if count < 3 {
            return Err(FitError::TooFewForNormals { lights: count });
        }
        let lights: Vec<[f64; 3]> = directions.iter().map(|light| light.components()).collect();
        let SingularValues { values, .. } =
            SingularValues::of(DMatrix::from_fn(count, 3, |i, c| lights[i][c]));
        if values[2] < COPLANAR * values[0] {
            return Err(FitError::CoplanarLights { lights: count });
        }
        Ok(Self {
            lights,
            method,
            usable: Vec::with_capacity(count),
            ranked: Vec::with_capacity(count),
            deviations: Vec::with_capacity(count),
            kept: Vec::with_capacity(count),
            kept_before: Vec::with_capacity(count),
            weights: Vec::with_capacity(count),
        })
    }

    /// The surface at a pixel of `channels` values (linear light, interleaved) under each light; `None` where fewer than
    /// three lights that don't lie in one plane tell anything: all black, or all saturated.
    ///
    /// `full_scale` is the value at which each of `values` saturates, empty where none does; the robust method leaves out
    /// lights of which one reaches it.
    ///
    /// Source: Woodham, *Photometric method for determining surface orientation from multiple images*, 1980; ranks to start
    /// with as in MATH.md section 1.3; concentration steps of Rousseeuw and Van Driessen, *Computing LTS regression for large
    /// data sets*, 2006, keeping half of the lights; then Tukey's biweight.
    ///
    /// # Panics
    /// When `values` or limits are not those of all lights, or `channels` is not 1 or 3.
    pub fn surface_of(
        &mut self,
        values: &[f32],
        channels: usize,
        full_scale: &[f32],
    ) -> Option<SurfaceNormal> {
        assert!(matches!(channels, 1 | 3) && values.len() == self.lights.len() * channels, "a value a light");
        assert!(full_scale.is_empty() || full_scale.len() == values.len(), "a limit a value");
        let leaves_out = self.method == NormalMethod::Robust && !full_scale.is_empty();
        self.usable.clear();
        for (light, value) in values.chunks_exact(channels).enumerate() {
            let limits = || &full_scale[light * channels..(light + 1) * channels];
            if !leaves_out || value.iter().zip(limits()).all(|(v, limit)| v < limit) {
                self.usable.push((light, grey(value)));
            }
        }
        if self.usable.len() < 3 || self.usable.iter().all(|&(_, value)| value <= 0.0) {
            return None;
        }
        self.weights.clear();
        self.weights.resize(self.usable.len(), 1.0);
        let vector = match self.method {
            NormalMethod::LeastSquares => self.weighted()?,
            NormalMethod::Robust => {
                let start = self.middle_ranks()?;
                let concentrated = self.concentrate(start);
                self.reweight(concentrated)
            }
        };
        let normal = unit(vector)?;
        Some(SurfaceNormal { normal, albedo: self.albedo(normal, values, channels) })
    }

    /// Least squares with the present weights. The matrix of three columns has a condition below 1e3, so that its
    /// normal equations leave ten digits.
    fn weighted(&self) -> Option<[f64; 3]> {
        let mut matrix = [0.0; 6];
        let mut right = [0.0; 3];
        for (&(light, value), &weight) in self.usable.iter().zip(&self.weights) {
            if weight == 0.0 {
                continue;
            }
            let [x, y, z] = self.lights[light];
            let [wx, wy, wz] = [weight * x, weight * y, weight * z];
            for (sum, term) in matrix.iter_mut().zip([wx * x, wx * y, wx * z, wy * y, wy * z, wz * z]) {
                *sum += term;
            }
            for (sum, term) in right.iter_mut().zip([wx, wy, wz]) {
                *sum += term * value;
            }
        }
        solved(matrix, right)
    }

    /// Least squares over the lights whose values are neither among the darkest nor among the brightest.
    fn middle_ranks(&mut self) -> Option<[f64; 3]> {
        self.ranked.clear();
        self.ranked.extend(self.usable.iter().map(|&(_, value)| value));
        self.ranked.sort_unstable_by(f64::total_cmp);
        let last = (self.ranked.len() - 1) as f64;
        let low = self.ranked[(RANKS[0] * last).floor() as usize];
        let high = self.ranked[(RANKS[1] * last).ceil() as usize];
        for (weight, &(_, value)) in self.weights.iter_mut().zip(&self.usable) {
            *weight = f64::from(u8::from((low..=high).contains(&value)));
        }
        self.weighted().or_else(|| {
            self.weights.fill(1.0);
            self.weighted()
        })
    }

    /// Deviations from what `vector` says, of the lights that face it.
    fn deviate(&mut self, vector: [f64; 3]) {
        self.deviations.clear();
        for (place, &(light, value)) in self.usable.iter().enumerate() {
            let expected = dot(vector, self.lights[light]);
            if expected > 0.0 {
                self.deviations.push(((value - expected).abs(), place));
            }
        }
    }

    /// Least squares over the half of the lights that agrees best, again and again; no step makes the sum of the kept
    /// squares larger.
    fn concentrate(&mut self, start: [f64; 3]) -> [f64; 3] {
        let half = self.usable.len().div_ceil(2).max(4);
        let mut vector = start;
        self.kept_before.clear();
        for _ in 0..MOST_STEPS {
            self.deviate(vector);
            if self.deviations.len() > half {
                // Places break ties, so that the same lights are kept everywhere.
                self.deviations
                    .select_nth_unstable_by(half - 1, |a, b| a.0.total_cmp(&b.0).then(a.1.cmp(&b.1)));
                self.deviations.truncate(half);
            }
            self.kept.clear();
            self.kept.resize(self.usable.len(), false);
            for &(_, place) in &self.deviations {
                self.kept[place] = true;
            }
            if self.kept == self.kept_before {
                break;
            }
            for (weight, &kept) in self.weights.iter_mut().zip(&self.kept) {
                *weight = f64::from(u8::from(kept));
            }
            let Some(next) = self.weighted() else { break };
            vector = next;
            std::mem::swap(&mut self.kept, &mut self.kept_before);
        }
        vector
    }

    /// Least squares weighted by Tukey's biweight of the deviations, again and again.
    fn reweight(&mut self, start: [f64; 3]) -> [f64; 3] {
        let mut vector = start;
        for _ in 0..MOST_REWEIGHTINGS {
            self.deviate(vector);
            if self.deviations.len() < 3 {
                break;
            }
            let Some((usual, _)) = median(&mut self.deviations, |a, b| a.0.total_cmp(&b.0)) else { break };
            let spread = TUKEY * (DEVIATIONS * usual + LEAST_DEVIATION * length(vector));
            let before = std::mem::take(&mut self.weights);
            self.weights.resize(before.len(), 0.0);
            for &(deviation, place) in &self.deviations {
                let part = deviation / spread;
                if part < 1.0 {
                    self.weights[place] = (1.0 - part * part) * (1.0 - part * part);
                }
            }
            let Some(next) = self.weighted() else {
                self.weights = before;
                break;
            };
            let moved = (0..3).map(|c| (next[c] - vector[c]).abs()).fold(0.0, f64::max);
            vector = next;
            if moved <= SETTLED * length(vector) {
                break;
            }
        }
        vector
    }

    /// Least-squares factors of n.l in each channel, with the weights that the normal was found with.
    fn albedo(&self, normal: [f64; 3], values: &[f32], channels: usize) -> [f64; 3] {
        let (mut products, mut square) = ([0.0; 3], 0.0);
        for (&(light, _), &weight) in self.usable.iter().zip(&self.weights) {
            let cosine = dot(normal, self.lights[light]);
            if cosine <= 0.0 || weight == 0.0 {
                continue;
            }
            square += weight * cosine * cosine;
            for (product, &value) in products.iter_mut().zip(&values[light * channels..][..channels]) {
                *product += weight * cosine * f64::from(value);
            }
        }
        if square > 0.0 { products.map(|product| (product / square).max(0.0)) } else { [0.0; 3] }
    }
}

/// Luminance of a pixel of one or three channels.
fn grey(value: &[f32]) -> f64 {
    match value {
        [r, g, b] => f64::from(relight_core::luminance([*r, *g, *b])),
        _ => f64::from(value[0]),
    }
}

/// Solves `[[a, b, c], [b, d, e], [c, e, f]] x = right` by its factors L D L^T; `None` when a pivot is 0.
fn solved([a, b, c, d, e, f]: [f64; 6], right: [f64; 3]) -> Option<[f64; 3]> {
    let least = LEAST_PIVOT * (a + d + f);
    let (p, q) = (b / a, c / a);
    let second = d - p * b;
    let third = e - p * c;
    let r = third / second;
    let last = f - q * c - r * third;
    if !(a > least && second > least && last > least) {
        return None;
    }
    let y = right[1] - p * right[0];
    let z = (right[2] - q * right[0] - r * y) / last;
    let y = y / second - r * z;
    Some([right[0] / a - p * y - q * z, y, z])
}
