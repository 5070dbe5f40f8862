//! Coefficients of a run of pixels, taken out of memory together: planes lie far apart there, and a processor
//! follows only so many of them at a time, each after a while.

use crate::rows::Channel;
use crate::uniform::{Decode, Decoding, coefficients};
use relight_core::{CpuLevel, RelightingMap, Texels, Vectorized};

/// Pixels taken out of every plane at a time; of narrower pictures as many whole rows.
pub(crate) const STRIP: usize = 2048;

/// Values of a plane that go through the sums together.
const LANES: usize = 64;

/// Whole rows of that many pixels that a strip has; 1 where a row has several strips.
pub(crate) fn rows_at_once(width: usize) -> usize {
    (STRIP / width).max(1)
}

/// The coefficients of up to [`STRIP`] pixels.
pub(crate) struct Strip<'a> {
    planes: &'a [&'a RelightingMap],
    held: Held,
}

/// By plane, rows of [`STRIP`].
enum Held {
    /// Decoded.
    Values(Vec<f32>),
    /// As stored, and what makes coefficients of them: a quarter of the bytes, where none is used twice.
    Codes { codes: Vec<u8>, decoding: Vec<Decoding> },
}

impl<'a> Strip<'a> {
    /// For sums of so many terms, of all channels together.
    pub(crate) fn new(planes: &'a [&'a RelightingMap], terms: usize) -> Self {
        let decoding: Option<Vec<Decoding>> = planes
            .iter()
            .map(|plane| match plane.texels {
                Texels::U8(_) => Some(Decoding::of(plane)),
                Texels::F16(_) | Texels::F32(_) => None,
            })
            .collect();
        let held = match decoding {
            Some(decoding) if terms <= planes.len() => {
                Held::Codes { codes: vec![0; planes.len() * STRIP], decoding }
            }
            _ => Held::Values(vec![0.0; planes.len() * STRIP]),
        };
        Self { planes, held }
    }

    /// Takes `pixels` pixels from `first` on.
    pub(crate) fn load(&mut self, level: CpuLevel, first: usize, pixels: usize) {
        match &mut self.held {
            Held::Values(values) => {
                for (plane, row) in self.planes.iter().zip(values.chunks_exact_mut(STRIP)) {
                    coefficients(level, plane, first, &mut row[..pixels]);
                }
            }
            Held::Codes { codes, .. } => {
                for (plane, row) in self.planes.iter().zip(codes.chunks_exact_mut(STRIP)) {
                    if let Texels::U8(stored) = &plane.texels {
                        row[..pixels].copy_from_slice(&stored[first..first + pixels]);
                    }
                }
            }
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
        match &self.held {
            Held::Values(values) => {
                let coefficients = Values(&values[offset..]);
                level.run(Products { weights, coefficients, channel, sum });
            }
            Held::Codes { codes, decoding } => {
                let coefficients = Codes { codes: &codes[offset..], decoding };
                level.run(Products { weights, coefficients, channel, sum });
            }
        }
    }
}

/// Rows of coefficients, [`STRIP`] apart.
trait Coefficients {
    /// Those of a plane from pixel `first` on, at most [`LANES`], into the first of `out`.
    fn take(&self, plane: usize, first: usize, out: &mut [f32]);

    /// [`LANES`] of them.
    #[inline(always)]
    fn lanes(&self, plane: usize, first: usize) -> [f32; LANES] {
        let mut out = [0.0; LANES];
        self.take(plane, first, &mut out);
        out
    }
}

struct Values<'a>(&'a [f32]);

impl Coefficients for Values<'_> {
    #[inline(always)]
    fn take(&self, plane: usize, first: usize, out: &mut [f32]) {
        out.copy_from_slice(&self.0[plane * STRIP + first..][..out.len()]);
    }
}

struct Codes<'a> {
    codes: &'a [u8],
    decoding: &'a [Decoding],
}

impl Coefficients for Codes<'_> {
    #[inline(always)]
    fn take(&self, plane: usize, first: usize, out: &mut [f32]) {
        let codes = &self.codes[plane * STRIP + first..][..out.len()];
        Decode { codes, decoding: self.decoding[plane], out }.run();
    }
}

struct Products<'a, 'b, C> {
    weights: &'a [f32],
    coefficients: C,
    channel: &'a Channel<'b>,
    sum: &'a mut [f32],
}

impl<C: Coefficients> Vectorized for Products<'_, '_, C> {
    type Output = ();

    #[inline(always)]
    fn run(self) {
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
                let coefficients = self.coefficients.lanes(*plane, first);
                for i in 0..LANES {
                    sums[i] += weights[i] * coefficients[i];
                }
            }
            self.sum[first..first + LANES].copy_from_slice(&sums);
        }
        let rest = &mut self.sum[whole..];
        match self.channel.mean {
            Some(mean) => rest.copy_from_slice(&self.weights[mean * n + whole..][..n - whole]),
            None => rest.fill(0.0),
        }
        let mut coefficients = [0.0; LANES];
        for ((_, function), plane) in terms() {
            let coefficients = &mut coefficients[..rest.len()];
            self.coefficients.take(*plane, whole, coefficients);
            let weights = &self.weights[function * n + whole..];
            for ((sum, weight), coefficient) in rest.iter_mut().zip(weights).zip(coefficients) {
                *sum += weight * *coefficient;
            }
        }
    }
}
