//! Values between texels.

use crate::Wrap;
use crate::relighter::Picture;

/// The four texels around a place and their weights, which add up to 1.
pub struct Taps {
    /// Index of each, row-major.
    pub texels: [usize; 4],
    /// Of each.
    pub weights: [f32; 4],
}

/// What bilinear filtering reads at texture coordinates (u, v): 0 to 1 from left to right and from top to
/// bottom over a picture of `width` x `height`, texel centres at (x + 0.5) / width.
pub fn bilinear_taps(width: usize, height: usize, wrap: Wrap, [u, v]: [f64; 2]) -> Taps {
    let ([x0, x1], fx) = pair(u, width, wrap);
    let ([y0, y1], fy) = pair(v, height, wrap);
    let (fx, fy) = (fx as f32, fy as f32);
    Taps {
        texels: [y0 * width + x0, y0 * width + x1, y1 * width + x0, y1 * width + x1],
        weights: [(1.0 - fx) * (1.0 - fy), fx * (1.0 - fy), (1.0 - fx) * fy, fx * fy],
    }
}

/// The texels on both sides of coordinate `t` along `size` texels, and how far it lies towards the second.
fn pair(t: f64, size: usize, wrap: Wrap) -> ([usize; 2], f64) {
    // Into the first period before it is scaled, so that coordinates of any size stay exact integers.
    let t = match wrap {
        Wrap::Clamp => t.clamp(-1.0, 2.0),
        Wrap::Repeat => t - t.floor(),
        Wrap::Mirror => t - 2.0 * (0.5 * t).floor(),
    };
    let place = t * size as f64 - 0.5;
    let first = place.floor();
    let size = size as i64;
    let texel = |i: i64| match wrap {
        Wrap::Clamp => i.clamp(0, size - 1),
        Wrap::Repeat => i.rem_euclid(size),
        Wrap::Mirror => {
            let i = i.rem_euclid(2 * size);
            i.min(2 * size - 1 - i)
        }
    } as usize;
    ([texel(first as i64), texel(first as i64 + 1)], place - first)
}

/// R, G, B of `picture` at `taps`; grey pictures have the same in all.
pub fn color_at(picture: &Picture, taps: &Taps) -> [f32; 3] {
    let channels = picture.channels;
    let sum = |channel: usize| {
        let value = |tap: usize| taps.weights[tap] * picture.samples[taps.texels[tap] * channels + channel];
        value(0) + value(1) + value(2) + value(3)
    };
    if channels == 1 { [sum(0); 3] } else { [sum(0), sum(1), sum(2)] }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// The value of `wrap` at texel `i` of 5, spelt out.
    fn texel(wrap: Wrap, i: i64) -> f32 {
        let row = [3.0, 10.0, -4.0, 7.0, 20.0];
        let at = match wrap {
            Wrap::Clamp => i.clamp(0, 4),
            Wrap::Repeat => (i + 1000) % 5,
            Wrap::Mirror => [0, 1, 2, 3, 4, 4, 3, 2, 1, 0][((i + 1000) % 10) as usize],
        };
        row[at as usize]
    }

    #[test]
    fn coordinates_far_outside_are_wrapped_and_blend_neighbours() {
        let samples = (0..5).map(|i| texel(Wrap::Clamp, i)).collect();
        let picture = Picture { width: 5, height: 1, channels: 1, samples };
        for wrap in [Wrap::Clamp, Wrap::Repeat, Wrap::Mirror] {
            for quarter in -120..120 {
                let place = f64::from(quarter) * 0.25;
                let expected = {
                    let (first, part) = (place.floor(), place - place.floor());
                    let part = part as f32;
                    texel(wrap, first as i64) * (1.0 - part) + texel(wrap, first as i64 + 1) * part
                };
                let taps = bilinear_taps(5, 1, wrap, [(place + 0.5) / 5.0, 0.3]);
                let found = color_at(&picture, &taps);
                assert!((found[0] - expected).abs() < 1e-4, "{wrap:?} {place}: {} {expected}", found[0]);
            }
            // Finite coordinates of any size are some texel.
            let taps = bilinear_taps(5, 3, wrap, [1e300, -1e300]);
            assert!(taps.texels.iter().all(|&texel| texel < 15));
        }
    }

    #[test]
    fn rows_and_channels_are_told_apart() {
        let samples = (0..2 * 3 * 3).map(|i| (i * i) as f32).collect();
        let picture = Picture { width: 2, height: 3, channels: 3, samples };
        let taps = bilinear_taps(2, 3, Wrap::Clamp, [0.75, 5.0 / 6.0]);
        assert_eq!(color_at(&picture, &taps), [15.0f32, 16.0, 17.0].map(|c| c * c));
    }
}
