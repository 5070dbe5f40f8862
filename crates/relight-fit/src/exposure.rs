//! How much brighter or darker each picture is than its light's direction explains.
//!
//! Lamps and shutters vary from picture to picture. What the surface would give under lamps all alike is taken from the
//! surface itself: normal and albedo of a pixel by the lights that agree with each other, whatever the others say.

use crate::misfit::coarse_fit;
use crate::sample::interleaved;
use crate::{FitError, NormalMethod, PhotometricStereo, Sample, median};
use rayon::prelude::*;
use relight_core::vectors::dot;
use relight_core::{Direction, LightSet, Stack};

/// Pixels that are asked, at most.
const MOST_PIXELS: usize = 4096;

/// Rounds of normals and factors; a single wrong picture is found in the first, many wrong ones need more.
const MOST_ROUNDS: usize = 40;

/// A round that moves no factor by more than this part is the last.
const SETTLED: f64 = 2e-4;

/// Light that falls on a pixel at a cosine below this says little: shadows begin and ratios are of small numbers.
const LEAST_COSINE: f64 = 0.35;

/// Predicted values below this part of the brightest picture's mean are codes of few steps.
const LEAST_PART: f64 = 0.1;

/// The part of the square of what factors take away that must have been unpredictable from other pictures. Measured on made
/// flat surfaces of soft gloss: 0.1 under even lamps, 0.2 to 1.7 where lamps differ by 14 % (root mean square).
const UNPREDICTED: f64 = 0.25;

/// Pixels that a picture's factor must rest on.
const LEAST_PIXELS: usize = 32;

/// The exposure factor of each picture of `stack`, whose values are linear light: by how much it is brighter than if its lamp were
/// as strong as the others'; their mean is 1. `None` where too few pixels are lit to tell.
///
/// For each sampled pixel a normal and an albedo come from the lights that agree (as in [`PhotometricStereo`]); a picture's factor is
/// the median over pixels of its value for the predicted one. With the pictures divided by their factors that is done again, until
/// they stand still. What a surface cannot tell apart stays with the surface: on a flat one, factors that rise and fall linearly
/// with direction.
///
/// `full_scale` is as of [`crate::normal_map`].
///
/// # Errors
/// Those of [`PhotometricStereo::new`], and [`FitError::Stack`].
pub fn exposure_factors(
    stack: &dyn Stack,
    directions: &[Direction],
    full_scale: &[f32],
) -> Result<Vec<Option<f64>>, FitError> {
    let stereo = PhotometricStereo::new(directions, NormalMethod::Robust)?;
    let pixels = grey_pixels(stack, full_scale)?;
    let lights: Vec<[f64; 3]> = directions.iter().map(|direction| direction.components()).collect();
    let count = lights.len();
    let brightest =
        (0..count).map(|i| mean(pixels.iter().map(|pixel| f64::from(pixel[i])))).fold(0.0, f64::max);

    let mut factors = vec![1.0; count];
    let mut told = vec![false; count];
    for _ in 0..MOST_ROUNDS {
        // For each pixel the ratio under each light, NaN where it says nothing.
        let ratios: Vec<Vec<f64>> = pixels
            .par_iter()
            .map_init(
                || stereo.clone(),
                |stereo, pixel| {
                    let divided: Vec<f32> = pixel
                        .iter()
                        .zip(&factors)
                        .map(|(value, factor)| (f64::from(*value) / factor) as f32)
                        .collect();
                    // Saturated values are infinite, and left out so.
                    let limits = vec![f32::MAX; count];
                    let Some(surface) = stereo.surface_of(&divided, 1, &limits) else {
                        return vec![f64::NAN; count];
                    };
                    let ratio = |(value, light): (&f32, &[f64; 3])| {
                        let cosine = dot(surface.normal, *light);
                        let expected = surface.albedo[0] * cosine;
                        let tells =
                            value.is_finite() && cosine > LEAST_COSINE && expected > LEAST_PART * brightest;
                        if tells { f64::from(*value) / expected } else { f64::NAN }
                    };
                    divided.iter().zip(&lights).map(ratio).collect()
                },
            )
            .collect();
        let mut moved = 0.0f64;
        for (light, (factor, told)) in factors.iter_mut().zip(&mut told).enumerate() {
            let mut of_light: Vec<f64> =
                ratios.iter().map(|ratios| ratios[light]).filter(|ratio| !ratio.is_nan()).collect();
            *told = of_light.len() >= LEAST_PIXELS.min(pixels.len());
            if !*told {
                continue;
            }
            // A black picture has no factor that would mend it.
            match median(&mut of_light, f64::total_cmp) {
                Some(ratio) if ratio > 1e-4 => {
                    *factor *= ratio;
                    moved = moved.max((ratio - 1.0).abs());
                }
                _ => *told = false,
            }
        }
        let scale = mean(factors.iter().zip(&told).filter(|(_, told)| **told).map(|(factor, _)| *factor));
        if scale > 0.0 {
            factors.iter_mut().zip(&told).filter(|(_, told)| **told).for_each(|(factor, _)| *factor /= scale);
        }
        if moved < SETTLED {
            break;
        }
    }
    Ok(factors.into_iter().zip(told).map(|(factor, told)| told.then_some(factor)).collect())
}

/// How well pictures are predicted from the others as they are, and divided by factors.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct ExposureTrial {
    /// Root mean square error of predicting each picture as it is from the others, as a part of the pictures' own root
    /// mean square.
    pub stored: f64,
    /// The same of pictures divided by their factors.
    pub divided: f64,
    /// What division changes in the pictures, as a part of the same.
    pub variation: f64,
}

impl ExposureTrial {
    /// Whether lamps varied. Then what the factors take away could not be predicted from other pictures, and its square is
    /// missing from that of the error; where the surface made them, most of it could.
    pub fn is_accepted(self) -> bool {
        let Self { stored, divided, variation } = self;
        variation > SETTLED && stored * stored - divided * divided > UNPREDICTED * variation * variation
    }
}

/// Holds `factors` (one a picture) to the pictures, of whose linear light `sample` is.
///
/// Lamps vary from one picture to the next, while what a surface does, be it a highlight, varies with direction. The judge is
/// that of [`crate::misfits`], its error that of generalised cross-validation. `None` where lights carry no basis to judge by.
///
/// # Errors
/// [`FitError::NoLights`].
///
/// # Panics
/// When `sample` is of another number of lights.
pub fn exposure_trial(
    lights: &LightSet,
    sample: &Sample,
    factors: &[f64],
) -> Result<Option<ExposureTrial>, FitError> {
    let n = sample.lights;
    assert_eq!(factors.len(), n, "factors of other pictures");
    let product = |at: usize| sample.gram[at] / (factors[at / n] * factors[at % n]);
    let divided = Sample { lights: n, count: sample.count, gram: (0..n * n).map(product).collect() };
    let energy = |sample: &Sample| sample.gram.iter().step_by(n + 1).sum::<f64>().max(f64::MIN_POSITIVE);
    let error = |sample: &Sample| -> Result<Option<f64>, FitError> {
        let Some(fit) = coarse_fit(lights, sample)? else { return Ok(None) };
        let predicted = fit.leave_one_out.cross_validation(&fit.decomposition.weights);
        Ok(Some(predicted / (energy(sample) / n as f64).sqrt()))
    };
    let taken = |(square, factor): (&f64, &f64)| square * (1.0 - 1.0 / factor) * (1.0 - 1.0 / factor);
    let variation = sample.gram.iter().step_by(n + 1).zip(factors).map(taken).sum::<f64>() / energy(sample);
    let errors = error(sample)?.zip(error(&divided)?);
    Ok(errors.map(|(stored, divided)| ExposureTrial { stored, divided, variation: variation.sqrt() }))
}

/// Sampled pixels, each with its mean over channels under all lights; infinite where a channel is saturated.
fn grey_pixels(stack: &dyn Stack, full_scale: &[f32]) -> Result<Vec<Vec<f32>>, FitError> {
    let channels = stack.channels();
    let pictures = interleaved(stack)?;
    let count = pictures.first().map_or(0, Vec::len) / channels;
    let step = count.div_ceil(MOST_PIXELS).max(1);
    let value = |light: usize, pixel: usize| {
        let values = &pictures[light][pixel * channels..(pixel + 1) * channels];
        let mut limits = full_scale.iter().skip(light * channels);
        match values.iter().any(|value| limits.next().is_some_and(|limit| value >= limit)) {
            true => f32::INFINITY,
            false => values.iter().sum::<f32>() / channels as f32,
        }
    };
    let of_pixel = |pixel| (0..pictures.len()).map(|light| value(light, pixel)).collect();
    Ok((0..count).step_by(step).map(of_pixel).collect())
}

fn mean(values: impl Iterator<Item = f64>) -> f64 {
    let (mut sum, mut count) = (0.0, 0usize);
    for value in values.filter(|value| value.is_finite()) {
        sum += value;
        count += 1;
    }
    sum / count.max(1) as f64
}
