//! Ordered dithering: a fixed pattern of thresholds, so that a slow gradient becomes a mixture of two
//! codes rather than a step.

/// What is added to the code of texel (`x`, `y`) of plane `plane` before it is rounded: one of 64
/// values in -0.5..0.5, evenly spaced, with a mean of 0 over every 8 x 8 texels.
///
/// A coefficient that is a code exactly stays that code, so constant maps stay exact. Every plane
/// starts elsewhere in the order of thresholds: planes that add up in the relit picture would
/// otherwise be rounded up at the same texels and show the pattern.
///
/// Source: Bayer, *An optimum method for two-level rendition of continuous-tone pictures*, 1973; the
/// rank is the bits of x xor y and of y, interleaved and reversed.
pub(crate) fn ordered(x: usize, y: usize, plane: usize) -> f32 {
    let diagonal = x ^ y;
    let rank = (0..3).fold(0, |rank, bit| rank << 2 | (diagonal >> bit & 1) << 1 | (y >> bit & 1));
    // 39 / 64 is near the golden ratio: the next planes are as far from one another as can be.
    let rank = (rank + 39 * (plane % 64)) % 64;
    (rank as f32 + 0.5) / 64.0 - 0.5
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::Quantizer;

    #[test]
    fn the_first_plane_is_bayers_matrix() {
        // Ranks of the classic 8 x 8 matrix, first two rows.
        let rows = [[0, 32, 8, 40, 2, 34, 10, 42], [48, 16, 56, 24, 50, 18, 58, 26]];
        for (y, row) in rows.iter().enumerate() {
            for (x, rank) in row.iter().enumerate() {
                assert_eq!(ordered(x + 8, y + 16, 0), (*rank as f32 + 0.5) / 64.0 - 0.5, "{x} {y}");
            }
        }
    }

    #[test]
    fn every_plane_has_all_thresholds_and_is_unlike_the_next_ones() {
        for plane in 0..70 {
            let mut seen = [false; 64];
            let mut products = [0.0; 3];
            for (x, y) in (0..64).map(|i| (i % 8, i / 8)) {
                let threshold = ordered(x, y, plane);
                seen[((threshold + 0.5) * 64.0) as usize] = true;
                for (ahead, product) in products.iter_mut().enumerate() {
                    *product += threshold * ordered(x, y, plane + 1 + ahead) * 12.0 / 64.0;
                }
            }
            assert!(seen.iter().all(|seen| *seen), "plane {plane}");
            assert!(products.iter().all(|correlation| *correlation < 0.2), "plane {plane}: {products:?}");
        }
    }

    #[test]
    fn a_gradient_keeps_its_mean_and_codes_stay_themselves() {
        let quantizer = Quantizer { scale: 2.0, bias: -0.5 };
        for (code, part) in [(17, 0.25), (200, 0.7), (0, 0.5), (254, 0.9)] {
            let coefficient = 2.0 * ((code as f32 + part) / 255.0) - 0.5;
            let dithered = |i: usize| quantizer.dithered_code(coefficient, ordered(i % 8, i / 8, 5));
            let mean = (0..64).map(|i| f32::from(dithered(i))).sum::<f32>() / 64.0;
            assert!((mean - code as f32 - part).abs() <= 0.5 / 64.0 + 1e-4, "{code} {part}: {mean}");
        }
        for code in 0..=255 {
            let coefficient = 2.0 * (code as f32 / 255.0) - 0.5;
            for i in 0..64 {
                let dither = ordered(i % 8, i / 8, 2);
                assert_eq!(quantizer.dithered_code(coefficient, dither), code as u8);
                let constant = Quantizer { scale: 0.0, bias: coefficient };
                assert_eq!(constant.dithered_code(coefficient, dither), 0);
            }
        }
    }
}
