//! Values between the pixels of a panorama.

use relight_core::relighter::Picture;

/// Weights of the pixels around a place, before and after it.
#[derive(Clone, Copy)]
pub(crate) enum Kernel {
    Linear,
    /// Catmull and Rom's cubic, which goes through the pixels' values.
    CatmullRom,
}

/// Pixels that a kernel weighs, the first at `first`.
struct Taps {
    first: i64,
    weights: [f64; 4],
    count: usize,
}

impl Kernel {
    /// Taps at `place` in pixels from the picture's edge.
    fn taps(self, place: f64) -> Taps {
        let place = place - 0.5;
        let (first, t) = (place.floor(), place - place.floor());
        match self {
            Self::Linear => Taps { first: first as i64, weights: [1.0 - t, t, 0.0, 0.0], count: 2 },
            // Catmull & Rom, *A class of local interpolating splines*, 1974, with tension 1/2.
            Self::CatmullRom => {
                let (t2, t3) = (t * t, t * t * t);
                let weights = [
                    0.5 * (-t3 + 2.0 * t2 - t),
                    0.5 * (3.0 * t3 - 5.0 * t2 + 2.0),
                    0.5 * (-3.0 * t3 + 4.0 * t2 + t),
                    0.5 * (t3 - t2),
                ];
                Taps { first: first as i64 - 1, weights, count: 4 }
            }
        }
    }
}

/// R, G, B (grey in all three) of `panorama` at (x, y) in pixels from its upper left corner.
///
/// Columns go round. Beyond a pole (`has_poles`) rows come back half a turn away, where the meridian goes
/// on; rows of a panorama without poles end at its edges.
pub(crate) fn color_at(panorama: &Picture, has_poles: bool, kernel: Kernel, x: f64, y: f64) -> [f64; 3] {
    let Picture { width, height, channels, .. } = *panorama;
    let rows = kernel.taps(y);
    let mut color = [0.0; 3];
    for (row, row_weight) in (rows.first..).zip(&rows.weights[..rows.count]) {
        let last = height as i64 - 1;
        let turned = has_poles && !(0..=last).contains(&row);
        let row = match turned {
            false => row,
            true if row < 0 => -1 - row,
            true => 2 * last + 1 - row,
        };
        // Without poles, and where a panorama has fewer rows than the kernel, the edge goes on.
        let row = row.clamp(0, last) as usize;
        // Half a turn of an odd width ends between two pixels, so the row has taps of its own.
        let columns = kernel.taps(if turned { x + 0.5 * width as f64 } else { x });
        for (column, weight) in (columns.first..).zip(&columns.weights[..columns.count]) {
            let pixel = (row * width + column.rem_euclid(width as i64) as usize) * channels;
            for (channel, sum) in color.iter_mut().enumerate() {
                *sum += row_weight * weight * f64::from(panorama.samples[pixel + channel.min(channels - 1)]);
            }
        }
    }
    color
}
