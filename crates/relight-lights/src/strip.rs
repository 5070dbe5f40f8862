//! Coefficients of a run of pixels, decoded together: planes lie far apart in memory, and a processor follows
//! only so many of them at a time, each after a while.

use crate::rows::Channel;
use crate::uniform::coefficients;
use relight_core::{CpuLevel, RelightingMap, Vectorized};

/// Pixels taken out of every plane at a time; of narrower pictures as many whole rows.
pub(crate) const STRIP: usize = 2048;

/// Whole rows of that many pixels that a strip has; 1 where a row has several strips.
pub(crate) fn rows_at_once(width: usize) -> usize {
    (STRIP / width).max(1)
}

/// The coefficients of up to [`STRIP`] pixels.
pub(crate) struct Strip<'a> {
    planes: &'a [&'a RelightingMap],
    /// By plane, rows of [`STRIP`].
    coefficients: Vec<f32>,
}

impl<'a> Strip<'a> {
    pub(crate) fn new(planes: &'a [&'a RelightingMap]) -> Self {
        Self { planes, coefficients: vec![0.0; planes.len() * STRIP] }
    }

    /// Decodes `pixels` pixels from `first` on.
    pub(crate) fn load(&mut self, level: CpuLevel, first: usize, pixels: usize) {
        for (plane, row) in self.planes.iter().zip(self.coefficients.chunks_exact_mut(STRIP)) {
            coefficients(level, plane, first, &mut row[..pixels]);
        }
    }

    /// Writes the sum over a channel's planes of weight x coefficient, for the pixels from `offset` on.
    ///
    /// `weights` are by function, as many as `sum` has pixels each.
    pub(crate) fn products(
        &self,
        level: CpuLevel,
        offset: usize,
        weights: &[f32],
        channel: &Channel<'_>,
        sum: &mut [f32],
    ) {
        let coefficients = &self.coefficients[offset..];
        level.run(Products { weights, coefficients, channel, sum });
    }
}

struct Products<'a, 'b> {
    weights: &'a [f32],
    /// By plane, rows of [`STRIP`].
    coefficients: &'a [f32],
    channel: &'a Channel<'b>,
    sum: &'a mut [f32],
}

impl Vectorized for Products<'_, '_> {
    type Output = ();

    #[inline(always)]
    fn run(self) {
        const LANES: usize = 64;
        let n = self.sum.len();
        let terms = || self.channel.planes.iter().zip(&self.channel.indices);
        let whole = n / LANES * LANES;
        for first in (0..whole).step_by(LANES) {
            let mut sums = [0.0f32; LANES];
            if let Some(mean) = self.channel.mean {
                sums.copy_from_slice(&self.weights[mean * n + first..][..LANES]);
            }
            for ((_, function), plane) in terms() {
                let weights = &self.weights[function * n + first..][..LANES];
                let coefficients = &self.coefficients[plane * STRIP + first..][..LANES];
                for i in 0..LANES {
                    sums[i] += weights[i] * coefficients[i];
                }
            }
            self.sum[first..first + LANES].copy_from_slice(&sums);
        }
        for i in whole..n {
            let mean = self.channel.mean.map_or(0.0, |mean| self.weights[mean * n + i]);
            self.sum[i] = terms().fold(mean, |sum, ((_, function), plane)| {
                sum + self.weights[function * n + i] * self.coefficients[plane * STRIP + i]
            });
        }
    }
}
