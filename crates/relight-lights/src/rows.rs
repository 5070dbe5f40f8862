//! What happens to a row of pixels on its way from functions and coefficients to the picture.

use crate::elementary::linear_from_srgb;
use relight_core::{RelightingMap, Vectorized};

/// Pixels whose coefficients are decoded at a time for local lights.
pub(crate) const STRIP: usize = 2048;

/// The planes of a channel, by function, what is added to their sum and what multiplies it.
pub(crate) struct Channel<'a> {
    pub(crate) planes: Vec<(&'a RelightingMap, usize)>,
    /// Indices of `planes` among all.
    pub(crate) indices: Vec<usize>,
    pub(crate) factor: Option<usize>,
    /// The function that counts without a plane.
    pub(crate) mean: Option<usize>,
}

impl Channel<'_> {
    /// Whether the same weights make the same sum of both.
    pub(crate) fn sums_like(&self, other: &Self) -> bool {
        let functions = |channel: &Self| channel.planes.iter().map(|(_, f)| *f).collect::<Vec<_>>();
        self.indices == other.indices && self.mean == other.mean && functions(self) == functions(other)
    }
}

/// Functions times a light's strength, added to those of the lights before it.
pub(crate) struct Gather<'a> {
    pub(crate) functions: &'a [f32],
    pub(crate) strength: &'a [f32],
    pub(crate) weights: &'a mut [f32],
    pub(crate) fresh: bool,
}

impl Vectorized for Gather<'_> {
    type Output = ();

    #[inline(always)]
    fn run(self) {
        let n = self.strength.len();
        let rows = self.weights.chunks_exact_mut(n).zip(self.functions.chunks_exact(n));
        for (weights, functions) in rows {
            if self.fresh {
                for i in 0..n {
                    weights[i] = functions[i] * self.strength[i];
                }
            } else {
                for i in 0..n {
                    weights[i] += functions[i] * self.strength[i];
                }
            }
        }
    }
}

/// The sum over a channel's planes of weight x coefficient, at each pixel.
pub(crate) struct Products<'a, 'b> {
    /// By function.
    pub(crate) weights: &'a [f32],
    /// By plane, rows of [`STRIP`].
    pub(crate) planes: &'a [f32],
    pub(crate) channel: &'a Channel<'b>,
    pub(crate) sum: &'a mut [f32],
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
                let coefficients = &self.planes[plane * STRIP + first..][..LANES];
                for i in 0..LANES {
                    sums[i] += weights[i] * coefficients[i];
                }
            }
            self.sum[first..first + LANES].copy_from_slice(&sums);
        }
        for i in whole..n {
            let mean = self.channel.mean.map_or(0.0, |mean| self.weights[mean * n + i]);
            self.sum[i] = terms().fold(mean, |sum, ((_, function), plane)| {
                sum + self.weights[function * n + i] * self.planes[plane * STRIP + i]
            });
        }
    }
}

/// A channel of a light on its way into the sum.
pub(crate) struct AddChannel<'a> {
    pub(crate) sum: &'a [f32],
    /// Base colour.
    pub(crate) factor: Option<&'a [f32]>,
    /// Whether the product is encoded.
    pub(crate) decode: bool,
    /// Strength of the light at each pixel, and of a picture in its way.
    pub(crate) strength: Option<(&'a [f32], Option<&'a [f32]>)>,
    pub(crate) color: f32,
    pub(crate) total: &'a mut [f32],
}

impl Vectorized for AddChannel<'_> {
    type Output = ();

    #[inline(always)]
    fn run(self) {
        const LANES: usize = 32;
        let Self { sum, factor, decode, strength, color, total } = self;
        for (first, total) in (0..).step_by(LANES).zip(total.chunks_mut(LANES)) {
            let lanes = first..first + total.len();
            let mut values = [0.0f32; LANES];
            values[..total.len()].copy_from_slice(&sum[lanes.clone()]);
            if let Some(factor) = factor {
                values.iter_mut().zip(&factor[lanes.clone()]).for_each(|(value, factor)| *value *= factor);
            }
            if decode {
                values.iter_mut().for_each(|value| *value = linear_from_srgb(*value));
            }
            if let Some((strength, gobo)) = strength {
                values.iter_mut().zip(&strength[lanes.clone()]).for_each(|(value, s)| *value *= s);
                if let Some(gobo) = gobo {
                    values.iter_mut().zip(&gobo[lanes]).for_each(|(value, g)| *value *= g);
                }
            }
            total.iter_mut().zip(&values).for_each(|(total, value)| *total += color * value);
        }
    }
}

/// Channels one after another to channels side by side.
pub(crate) struct Interleave<'a> {
    pub(crate) sums: &'a [f32],
    pub(crate) out: &'a mut [f32],
    pub(crate) channels: usize,
}

impl Vectorized for Interleave<'_> {
    type Output = ();

    #[inline(always)]
    fn run(self) {
        let n = self.out.len() / self.channels;
        if self.channels == 1 {
            self.out.copy_from_slice(&self.sums[..n]);
            return;
        }
        let (r, rest) = self.sums.split_at(n);
        let (g, b) = rest.split_at(n);
        for (((pixel, r), g), b) in self.out.chunks_exact_mut(3).zip(r).zip(g).zip(b) {
            pixel.copy_from_slice(&[*r, *g, *b]);
        }
    }
}
