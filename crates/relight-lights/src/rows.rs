//! What happens to a row of pixels on its way from functions and coefficients to the picture.

use crate::elementary::linear_from_srgb;
use relight_core::{RelightingMap, Vectorized};

/// The planes of a channel, by function, what is added to their sum and what multiplies it.
pub(crate) struct Channel<'a> {
    pub(crate) planes: Vec<(&'a RelightingMap, usize)>,
    /// Indices of `planes` among the asset's coefficients.
    pub(crate) indices: Vec<usize>,
    pub(crate) factor: Option<&'a RelightingMap>,
    /// The function that counts without a plane.
    pub(crate) mean: Option<usize>,
}

impl Channel<'_> {
    /// Whether the same weights make the same sum of both.
    pub(crate) fn sums_like(&self, other: &Self) -> bool {
        let functions = self.planes.iter().map(|(_, function)| function);
        self.indices == other.indices
            && self.mean == other.mean
            && functions.eq(other.planes.iter().map(|(_, function)| function))
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

/// Channels one after another to channels side by side; gives the number of samples below 0.
pub(crate) struct Interleave<'a> {
    pub(crate) sums: &'a [f32],
    pub(crate) out: &'a mut [f32],
    pub(crate) channels: usize,
}

impl Vectorized for Interleave<'_> {
    type Output = usize;

    #[inline(always)]
    fn run(self) -> usize {
        let n = self.out.len() / self.channels;
        // Fewer than 2^32: a run of pixels.
        let mut negative = 0u32;
        for sample in &self.sums[..self.out.len()] {
            negative += u32::from(*sample < 0.0);
        }
        if self.channels == 1 {
            self.out.copy_from_slice(&self.sums[..n]);
            return negative as usize;
        }
        let (r, rest) = self.sums.split_at(n);
        let (g, b) = rest.split_at(n);
        for (((pixel, r), g), b) in self.out.chunks_exact_mut(3).zip(r).zip(g).zip(b) {
            pixel.copy_from_slice(&[*r, *g, *b]);
        }
        negative as usize
    }
}
