//! How far a drawn picture is from the reference.

use relight_core::metrics::psnr;
use relight_core::relighter::Picture;

/// The sample that differs most.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct WorstSample {
    /// Column.
    pub x: usize,
    /// Row from the top.
    pub y: usize,
    /// Channel.
    pub channel: usize,
    /// What was drawn there.
    pub drawn: f32,
    /// What the reference has there.
    pub reference: f32,
}

/// Differences of a drawn picture from the reference, not clipped.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Difference {
    /// The largest of a sample; infinite where one is NaN and the other is not.
    pub max: f64,
    /// The mean of all samples.
    pub mean: f64,
    /// Root mean square of all samples.
    pub rms: f64,
    /// Signal-to-noise ratio in dB, the peak being the full range; infinite for equal pictures.
    pub psnr: f64,
    /// The largest value of the reference, at least 1: what tolerances are relative to.
    pub full_range: f64,
    /// Where the largest is.
    pub worst: WorstSample,
}

impl Difference {
    /// Compares `drawn` with `reference`.
    ///
    /// # Panics
    /// When they differ in shape or have no samples.
    pub fn between(drawn: &Picture, reference: &Picture) -> Self {
        let shape = |picture: &Picture| (picture.width, picture.height, picture.channels);
        assert_eq!(shape(drawn), shape(reference), "pictures of different shapes");
        let (mut max, mut sum, mut squares, mut full_range, mut at) = (-1.0, 0.0, 0.0, 1.0f64, 0);
        for (i, (drawn, reference)) in drawn.samples.iter().zip(&reference.samples).enumerate() {
            let (drawn, reference) = (f64::from(*drawn), f64::from(*reference));
            let same = drawn == reference || drawn.is_nan() && reference.is_nan();
            let difference = if same { 0.0 } else { (drawn - reference).abs() };
            let difference = if difference.is_nan() { f64::INFINITY } else { difference };
            sum += difference;
            squares += difference * difference;
            // `max` skips NaN.
            full_range = full_range.max(reference.abs());
            if difference > max {
                (max, at) = (difference, i);
            }
        }
        let count = drawn.samples.len() as f64;
        let pixel = at / drawn.channels;
        let worst = WorstSample {
            x: pixel % drawn.width,
            y: pixel / drawn.width,
            channel: at % drawn.channels,
            drawn: drawn.samples[at],
            reference: reference.samples[at],
        };
        let rms = (squares / count).sqrt();
        Self { max, mean: sum / count, rms, psnr: psnr(rms / full_range), full_range, worst }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn picture(samples: &[f32]) -> Picture {
        Picture { width: 2, height: samples.len() / 6, channels: 3, samples: samples.to_vec() }
    }

    #[test]
    fn figures_by_hand() {
        let reference = picture(&[0.0, 0.25, 0.5, 1.0, -4.0, 2.0, 0.0, 0.0, 0.0, 0.5, 0.5, 0.5]);
        let mut drawn = reference.clone();
        (drawn.samples[4], drawn.samples[10]) = (-3.75, 1.0);
        let difference = Difference::between(&drawn, &reference);
        assert_eq!((difference.max, difference.mean, difference.full_range), (0.5, 0.0625, 4.0));
        let worst = WorstSample { x: 1, y: 1, channel: 1, drawn: 1.0, reference: 0.5 };
        assert_eq!(difference.worst, worst);
        // Mean square (0.0625 + 0.25) / 12 against the peak's 16.
        assert!((difference.rms - (0.3125f64 / 12.0).sqrt()).abs() < 1e-12);
        assert!((difference.psnr - 10.0 * libm::log10(16.0 * 12.0 / 0.3125)).abs() < 1e-9);
        assert_eq!(Difference::between(&reference, &reference).psnr, f64::INFINITY);
    }

    #[test]
    fn nan_is_as_wrong_as_can_be() {
        let reference = picture(&[0.0; 6]);
        let mut drawn = reference.clone();
        drawn.samples[5] = f32::NAN;
        let difference = Difference::between(&drawn, &reference);
        assert_eq!((difference.max, difference.worst.channel), (f64::INFINITY, 2));
    }
}
