//! Pictures under light that has the same direction at every pixel: one weight a plane.

use relight_core::weighted_sums::{Rows, weighted_sums};
use relight_core::{CpuLevel, RelightingMap, Texels, Vectorized};

/// Writes `mean` + the sum over `planes` of weight x coefficient to `out`, for the pixels from `first` on.
///
/// Of 8-bit planes the scale and 1 / 255 go into the weights and the biases into one constant, so that a
/// code costs a conversion, a multiplication and an addition: the sum is that of
/// [`relighter`](relight_core::relighter) but for rounding.
pub(crate) fn weighted_planes(
    level: CpuLevel,
    planes: &[(&RelightingMap, f32)],
    mean: f32,
    first: usize,
    out: &mut [f32],
) {
    let pixels = out.len();
    let codes: Option<Vec<&[u8]>> = planes
        .iter()
        .map(|(plane, _)| match &plane.texels {
            Texels::U8(codes) => Some(&codes[first..first + pixels]),
            Texels::F16(_) | Texels::F32(_) => None,
        })
        .collect();
    match codes {
        Some(codes) => {
            let weights: Vec<f32> =
                planes.iter().map(|(plane, weight)| weight * (plane.scale / 255.0)).collect();
            let constant = planes.iter().fold(mean, |sum, (plane, weight)| sum + weight * plane.bias);
            level.run(WeightedCodes { codes: &codes, weights: &weights, constant, out });
        }
        None => {
            let mut rows = vec![0.0f32; planes.len() * pixels];
            for ((plane, _), row) in planes.iter().zip(rows.chunks_exact_mut(pixels)) {
                plane.coefficients(first, row);
            }
            let weights: Vec<f32> = planes.iter().map(|(_, weight)| *weight).collect();
            let input = Rows { samples: &rows[..], stride: pixels };
            let output = Rows { samples: &mut out[..], stride: pixels };
            weighted_sums(level, &weights, planes.len(), input, output, pixels);
            if mean != 0.0 {
                out.iter_mut().for_each(|sum| *sum += mean);
            }
        }
    }
}

/// Writes the coefficients of a plane's texels from `first` on to `out`, of 8-bit planes by one
/// multiplication and one addition each.
pub(crate) fn coefficients(level: CpuLevel, plane: &RelightingMap, first: usize, out: &mut [f32]) {
    match &plane.texels {
        Texels::U8(codes) => {
            let codes = &codes[first..first + out.len()];
            level.run(Decode { codes, decoding: Decoding::of(plane), out });
        }
        Texels::F16(_) | Texels::F32(_) => plane.coefficients(first, out),
    }
}

/// Coefficient = step x code + bias.
#[derive(Clone, Copy)]
pub(crate) struct Decoding {
    step: f32,
    bias: f32,
}

impl Decoding {
    /// Of a plane of 8-bit codes.
    pub(crate) fn of(plane: &RelightingMap) -> Self {
        Self { step: plane.scale / 255.0, bias: plane.bias }
    }
}

/// Codes to as many coefficients.
pub(crate) struct Decode<'a> {
    pub(crate) codes: &'a [u8],
    pub(crate) decoding: Decoding,
    pub(crate) out: &'a mut [f32],
}

impl Vectorized for Decode<'_> {
    type Output = ();

    #[inline(always)]
    fn run(self) {
        let Decoding { step, bias } = self.decoding;
        for (out, code) in self.out.iter_mut().zip(self.codes) {
            *out = step * f32::from(*code) + bias;
        }
    }
}

struct WeightedCodes<'a> {
    /// Of each plane, as many as `out` has samples.
    codes: &'a [&'a [u8]],
    weights: &'a [f32],
    constant: f32,
    out: &'a mut [f32],
}

impl Vectorized for WeightedCodes<'_> {
    type Output = ();

    /// Four planes at a time along the whole run: few enough streams for the processor to see them coming, and
    /// the sums come back to registers once for four terms.
    #[inline(always)]
    fn run(self) {
        let n = self.out.len();
        self.out.fill(self.constant);
        let (codes, rest) = self.codes.as_chunks::<4>();
        let (weights, of_rest) = self.weights.as_chunks::<4>();
        for (codes, [a, b, c, d]) in codes.iter().zip(weights) {
            let [p, q, r, s] = codes.map(|codes| &codes[..n]);
            for i in 0..n {
                let sum = self.out[i] + a * f32::from(p[i]);
                let sum = sum + b * f32::from(q[i]);
                let sum = sum + c * f32::from(r[i]);
                self.out[i] = sum + d * f32::from(s[i]);
            }
        }
        for (codes, weight) in rest.iter().zip(of_rest) {
            for (sum, code) in self.out.iter_mut().zip(*codes) {
                *sum += weight * f32::from(*code);
            }
        }
    }
}
