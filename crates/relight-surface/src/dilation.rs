//! Carrying a lightmap's charts beyond their edges.

use rayon::prelude::*;
use relight_core::relighter::Picture;

/// `picture` with the texels around the charts filled from them, `texels` far, so that filters that reach beyond
/// a chart's edge find what lies at it.
///
/// `coverage` says which texels belong to a chart ([`crate::chart_coverage`]). In each of `texels` steps, every
/// texel beside a filled one, diagonals included, becomes the mean of the filled ones around it; covered texels keep
/// their value.
///
/// # Panics
/// When `coverage` or the samples are not as many as the picture's size says.
pub fn dilate(picture: &Picture, coverage: &[bool], texels: usize) -> Picture {
    let Picture { width, height, channels, .. } = *picture;
    assert_eq!(coverage.len(), width * height, "texels of the coverage");
    assert_eq!(picture.samples.len(), width * height * channels, "samples of the picture");
    let mut dilated = picture.clone();
    let mut filled = coverage.to_vec();
    for _ in 0..texels {
        // Collected before any is written: a step must not feed on itself.
        let grown: Vec<_> = (0..height)
            .into_par_iter()
            .flat_map_iter(|y| {
                let (dilated, filled) = (&dilated, &filled);
                (0..width).filter_map(move |x| Some((y * width + x, mean_around(dilated, filled, x, y)?)))
            })
            .collect();
        if grown.is_empty() {
            break;
        }
        for (texel, color) in grown {
            filled[texel] = true;
            dilated.samples[texel * channels..][..channels].copy_from_slice(&color[..channels]);
        }
    }
    dilated
}

/// The mean of the filled texels around an empty one; `None` where there is none, and for filled ones.
fn mean_around(picture: &Picture, filled: &[bool], x: usize, y: usize) -> Option<[f32; 3]> {
    let Picture { width, height, channels, .. } = *picture;
    if filled[y * width + x] {
        return None;
    }
    let (mut sum, mut count) = ([0.0f32; 3], 0);
    for row in y.saturating_sub(1)..(y + 2).min(height) {
        for column in x.saturating_sub(1)..(x + 2).min(width) {
            let texel = row * width + column;
            if filled[texel] {
                count += 1;
                for (sum, value) in sum.iter_mut().zip(&picture.samples[texel * channels..][..channels]) {
                    *sum += value;
                }
            }
        }
    }
    (count > 0).then(|| sum.map(|sum| sum / count as f32))
}
