//! How far a relit picture is from the photograph.

/// Errors of one picture, on stored values clipped to 0..1.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct PictureError {
    /// Root mean square over all samples.
    pub rmse: f64,
    /// Peak signal-to-noise ratio in dB with peak 1; infinite for equal pictures.
    pub psnr: f64,
    /// Largest absolute difference of a sample.
    pub max: f64,
    /// Pixel (x, y) where it is.
    pub worst_pixel: (usize, usize),
    /// Mean of (relit - picture) for R, G, B; grey pictures repeat their one value.
    pub mean_shift: [f64; 3],
    /// Mean of the relit picture's colourfulness (largest - smallest channel) minus the picture's:
    /// below 0 the bake washes colours out.
    pub saturation_shift: f64,
}

/// PSNR in dB of a root mean square error against peak 1.
pub fn psnr(rmse: f64) -> f64 {
    -20.0 * libm::log10(rmse)
}

/// Compares two pictures of the same shape sample by sample, both clipped to 0..1 first.
///
/// # Panics
/// When the slices differ in length or `channels` is 0.
pub fn compare(relit: &[f32], picture: &[f32], width: usize, channels: usize) -> PictureError {
    assert_eq!(relit.len(), picture.len(), "pictures of different shapes");
    let mut error = PictureError::default();
    let mut squares = 0.0;
    let mut saturation = 0.0;
    let mut shift = [0.0; 3];
    for (pixel, (a, b)) in relit.chunks_exact(channels).zip(picture.chunks_exact(channels)).enumerate() {
        let colorfulness = |p: &[f32]| {
            let clipped = p.iter().map(|v| f64::from(v.clamp(0.0, 1.0)));
            clipped.clone().fold(f64::MIN, f64::max) - clipped.fold(f64::MAX, f64::min)
        };
        saturation += colorfulness(a) - colorfulness(b);
        for (channel, (a, b)) in a.iter().zip(b).enumerate() {
            let difference = f64::from(a.clamp(0.0, 1.0)) - f64::from(b.clamp(0.0, 1.0));
            squares += difference * difference;
            shift[channel % 3] += difference;
            if difference.abs() > error.max {
                error.max = difference.abs();
                error.worst_pixel = (pixel % width.max(1), pixel / width.max(1));
            }
        }
    }
    let samples = relit.len().max(1) as f64;
    let pixels = samples / channels as f64;
    error.rmse = (squares / samples).sqrt();
    error.psnr = psnr(error.rmse);
    error.mean_shift = if channels == 1 { [shift[0] / pixels; 3] } else { shift.map(|s| s / pixels) };
    error.saturation_shift = saturation / pixels;
    error
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn figures_by_hand() {
        // Two RGB pixels; the second differs by 0.5 in G and by a clipped 1.0 -> 0.75 in B.
        let picture = [0.2, 0.4, 0.6, 0.0, 0.0, 0.25];
        let relit = [0.2, 0.4, 0.6, 0.0, 0.5, 7.0];
        let error = compare(&relit, &picture, 1, 3);
        assert!((error.rmse - ((0.25f64 + 0.5625) / 6.0).sqrt()).abs() < 1e-7);
        assert!((error.psnr + 10.0 * libm::log10((0.25 + 0.5625) / 6.0)).abs() < 1e-5);
        assert_eq!((error.max, error.worst_pixel), (0.75, (0, 1)));
        assert!((error.mean_shift[1] - 0.25).abs() < 1e-7);
        assert!((error.saturation_shift - (1.0 - 0.25) / 2.0).abs() < 1e-7);
        assert_eq!(compare(&picture, &picture, 1, 3).psnr, f64::INFINITY);
    }
}
