//! Mip levels of coefficients: each texel the mean of the part of the picture that it covers.
//!
//! The bases are linear in their coefficients, so the filtered maps relit are the filtered relit
//! picture (for [`Layout::Lrgb`](relight_core::Layout), whose base colour multiplies the sum, that
//! holds where either is constant). Level l is max(1, size >> l) texels wide, as in KTX and OpenGL;
//! where a size is odd, a texel covers two and a bit, and each of the three counts by its part.
//!
//! Source: Guthe, Heckbert, *Non-Power-of-Two Mipmap Creation*, 2005 (polyphase box filter): of 2n + 1
//! texels, the three under texel j of n weigh (n - j), n and (j + 1) of 2n + 1.

use crate::level_size;
use std::ops::Range;

/// The filter from a level of a picture to the next.
#[derive(Clone, Debug)]
pub struct MipFilter {
    /// Texels in a row of the finer level.
    pub width: usize,
    /// Rows of the finer level.
    pub height: usize,
    /// Samples of a texel, interleaved.
    pub channels: usize,
    columns: Vec<Taps>,
    rows: Vec<Taps>,
}

/// Weights of the texels 2j, 2j + 1, 2j + 2 in texel j; 0 where there is none.
type Taps = [f32; 3];

/// The taps of every texel of the level below one of `size` texels.
fn taps(size: usize) -> Vec<Taps> {
    let n = size / 2;
    let part = |weight: usize| (weight as f64 / size as f64) as f32;
    match size {
        1 => vec![[1.0, 0.0, 0.0]],
        _ if size.is_multiple_of(2) => vec![[0.5, 0.5, 0.0]; n],
        _ => (0..n).map(|j| [part(n - j), part(n), part(j + 1)]).collect(),
    }
}

/// How many texels of the finer level's `size` a texel of the next covers, at most.
fn tap_count(size: usize) -> usize {
    match size {
        1 => 1,
        _ => 2 + size % 2,
    }
}

impl MipFilter {
    /// The filter from a level of `width` x `height` texels of `channels` samples.
    ///
    /// # Panics
    /// When one of them is 0.
    pub fn new(width: usize, height: usize, channels: usize) -> Self {
        assert!(width > 0 && height > 0 && channels > 0, "a picture of {width} x {height} x {channels}");
        Self { width, height, channels, columns: taps(width), rows: taps(height) }
    }

    /// Rows of the next level to which rows `source` of this one contribute.
    pub fn rows_from(&self, source: Range<usize>) -> Range<usize> {
        let last = level_size(self.height, 1);
        // Row 2j + 2 reaches up to texel j where the height is odd.
        let first = if self.height % 2 == 1 { source.start.saturating_sub(1) / 2 } else { source.start / 2 };
        first.min(last)..source.end.div_ceil(2).min(last)
    }

    /// Adds what rows `first_row ..` of this level, `source`, contribute to the next to `next`, the rows
    /// [`Self::rows_from`] gives, which were 0 at the beginning.
    ///
    /// Each row of `next` is the sum of what two strips of rows add at most, when strips are of two rows
    /// or more (the last may have one). So the order of strips does not change a bit; and where they
    /// begin at even rows, strips give the bits of the whole level at once.
    ///
    /// # Panics
    /// When `source` is no whole number of rows, leaves the picture, or `next` has the wrong size.
    pub fn add_rows(&self, first_row: usize, source: &[f32], next: &mut [f32]) {
        let (stride, next_stride) = (self.width * self.channels, self.columns.len() * self.channels);
        assert!(source.len().is_multiple_of(stride), "whole rows");
        let source_rows = first_row..first_row + source.len() / stride;
        assert!(source_rows.end <= self.height, "rows {source_rows:?} of {}", self.height);
        let next_rows = self.rows_from(source_rows.clone());
        assert_eq!(next.len(), next_rows.len() * next_stride, "samples of rows {next_rows:?}");
        let mut narrow = vec![0.0; next_stride];
        let mut sum = vec![0.0; next_stride];
        for (j, next) in next_rows.zip(next.chunks_exact_mut(next_stride)) {
            sum.fill(0.0);
            let weights = self.rows[j][..tap_count(self.height)].iter();
            for (row, weight) in (2 * j..).zip(weights).filter(|(row, _)| source_rows.contains(row)) {
                self.narrow(&source[(row - first_row) * stride..][..stride], &mut narrow);
                for (sum, value) in sum.iter_mut().zip(&narrow) {
                    *sum += weight * value;
                }
            }
            for (next, sum) in next.iter_mut().zip(&sum) {
                *next += sum;
            }
        }
    }

    /// Filters a row.
    fn narrow(&self, row: &[f32], out: &mut [f32]) {
        let channels = self.channels;
        match tap_count(self.width) {
            1 => out.copy_from_slice(row),
            2 => {
                for (pair, out) in row.chunks_exact(2 * channels).zip(out.chunks_exact_mut(channels)) {
                    for (channel, out) in out.iter_mut().enumerate() {
                        *out = 0.5 * pair[channel] + 0.5 * pair[channels + channel];
                    }
                }
            }
            _ => {
                for (j, [a, b, c]) in self.columns.iter().enumerate() {
                    let texels = &row[2 * j * channels..][..3 * channels];
                    for channel in 0..channels {
                        out[j * channels + channel] = a * texels[channel]
                            + b * texels[channels + channel]
                            + c * texels[2 * channels + channel];
                    }
                }
            }
        }
    }
}

/// The level below `plane`, which is `width` x `height` texels.
///
/// # Panics
/// When `plane` has another size.
pub fn halve(plane: &[f32], width: usize, height: usize) -> Vec<f32> {
    assert_eq!(plane.len(), width * height, "a plane of {width} x {height}");
    let mut next = vec![0.0; level_size(width, 1) * level_size(height, 1)];
    MipFilter::new(width, height, 1).add_rows(0, plane, &mut next);
    next
}
