//! A contact sheet: all pictures of a sequence, small, on one.

use relight_core::relighter::Picture;
use relight_core::{Space, linear_from_srgb};

/// Largest side of a thumbnail.
const SIDE: usize = 160;

/// Pixels between thumbnails.
const GAP: usize = 4;

/// A small picture of linear light, R, G, B.
pub(super) struct Thumbnail {
    width: usize,
    height: usize,
    samples: Vec<f32>,
}

/// The picture with means over the pixels of each of the thumbnail's, in linear light.
pub(super) fn thumbnail(picture: &Picture, is_linear: bool) -> Thumbnail {
    let step = picture.width.max(picture.height).div_ceil(SIDE).max(1);
    let (width, height) = (picture.width.div_ceil(step), picture.height.div_ceil(step));
    let mut samples = Vec::with_capacity(3 * width * height);
    for y in 0..height {
        for x in 0..width {
            let rows = y * step..((y + 1) * step).min(picture.height);
            let columns = x * step..((x + 1) * step).min(picture.width);
            let pixels = (rows.len() * columns.len()) as f32;
            for c in 0..3 {
                let c = c.min(picture.channels - 1);
                let sum: f32 = rows
                    .clone()
                    .flat_map(|y| {
                        columns.clone().map(move |x| (y * picture.width + x) * picture.channels + c)
                    })
                    .map(|i| match is_linear {
                        true => picture.samples[i].max(0.0),
                        false => linear_from_srgb(picture.samples[i].clamp(0.0, 1.0)),
                    })
                    .sum();
                samples.push(sum / pixels);
            }
        }
    }
    Thumbnail { width, height, samples }
}

/// The sheet, rows of thumbnails in order, about as wide as high.
pub(super) fn sheet(thumbnails: &[Thumbnail]) -> Picture {
    let largest = |side: fn(&Thumbnail) -> usize| thumbnails.iter().map(side).max().unwrap_or(1) + GAP;
    let (cell_width, cell_height) = (largest(|t| t.width), largest(|t| t.height));
    let columns = (1..=thumbnails.len().max(1))
        .find(|columns| columns * cell_width >= thumbnails.len().div_ceil(*columns) * cell_height)
        .unwrap_or(1);
    let rows = thumbnails.len().div_ceil(columns);
    let (width, height) = (columns * cell_width + GAP, rows * cell_height + GAP);
    let mut samples = vec![0.0; 3 * width * height];
    for (index, thumbnail) in thumbnails.iter().enumerate() {
        let (left, top) = (GAP + index % columns * cell_width, GAP + index / columns * cell_height);
        for (y, row) in thumbnail.samples.chunks_exact(3 * thumbnail.width).enumerate() {
            samples[3 * ((top + y) * width + left)..][..row.len()].copy_from_slice(row);
        }
    }
    Picture { width, height, channels: 3, samples }.encoded_from(Space::Linear)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn thumbnails_are_means_in_linear_light_in_reading_order() {
        let picture =
            |value: f32| Picture { width: 320, height: 161, channels: 1, samples: vec![value; 320 * 161] };
        let thumbnails: Vec<_> = [0.0, 0.25, 0.5, 0.75, 1.0].map(|v| thumbnail(&picture(v), false)).into();
        assert_eq!((thumbnails[0].width, thumbnails[0].height), (160, 81));
        let sheet = sheet(&thumbnails);
        let columns = (sheet.width - GAP) / (160 + GAP);
        for (index, value) in [0.0, 0.25, 0.5, 0.75, 1.0].into_iter().enumerate() {
            let (x, y) = (GAP + index % columns * 164 + 80, GAP + index / columns * 85 + 40);
            assert!((sheet.samples[3 * (y * sheet.width + x) + 1] - value).abs() < 1e-4, "{index}");
        }
        // Black and white in turns are half the light, not half the code.
        let mut turns = picture(0.0);
        turns.samples.iter_mut().step_by(2).for_each(|sample| *sample = 1.0);
        assert!((thumbnail(&turns, false).samples[0] - 0.5).abs() < 1e-6);
    }
}
