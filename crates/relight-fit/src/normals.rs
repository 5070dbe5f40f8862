//! Normals and albedo of every pixel of a stack.

use crate::photometric_stereo::{NormalMethod, PhotometricStereo, SurfaceNormal};
use crate::rebin::{SPAN, tile_pixels};
use crate::{FitError, median};
use rayon::prelude::*;
use relight_core::vectors::{dot, unit, wide};
use relight_core::{Direction, Stack};

/// Normals of a picture, and what colour it has where light falls straight on.
#[derive(Clone, Debug, PartialEq)]
pub struct NormalMap {
    /// Pixels in a row.
    pub width: usize,
    /// Rows.
    pub height: usize,
    /// Samples of the albedo a pixel: 1 or 3.
    pub channels: usize,
    /// Unit vectors, x right, y up, z out of the picture; (0, 0, 1) where none could be found. Rows from the top.
    pub normals: Vec<[f32; 3]>,
    /// Value in linear light under a light of strength 1 along the normal, at least 0; channels interleaved.
    pub albedo: Vec<f32>,
    /// Whether a pixel's normal was found.
    pub found: Vec<bool>,
}

/// How far normals are from others.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct NormalError {
    /// Mean angle in radians.
    pub mean: f64,
    /// Median angle in radians.
    pub median: f64,
    /// Pixels that were compared.
    pub pixels: usize,
}

/// Bytes that [`normal_map`] takes: its result for `pixels` pixels and, for each of `threads` threads, a span of `lights`
/// pictures as it is read back.
pub fn normal_map_bytes(pixels: u64, lights: u64, threads: u64) -> u64 {
    pixels * (12 + 12 + 1) + threads * (lights * 3 * SPAN as u64 * 4 + (1 << 20))
}

/// Finds the normal of every pixel of `stack`, whose values are linear light.
///
/// `full_scale` is the value at which each channel of each picture saturates, pictures one after another, empty for floats. `check` is called once a span, to call the work
/// off. The result has the same bits with any number of threads.
///
/// # Errors
/// Those of [`PhotometricStereo::new`], of reading the stack, and of `check`.
pub fn normal_map<E: From<FitError> + Send>(
    stack: &dyn Stack,
    directions: &[Direction],
    method: NormalMethod,
    full_scale: &[f32],
    check: impl Fn() -> Result<(), E> + Sync,
) -> Result<NormalMap, E> {
    let stereo = PhotometricStereo::new(directions, method)?;
    let (pixels, lights, channels) = (stack.pixels(), stack.lights(), stack.channels());
    let mut normals = vec![[0.0, 0.0, 1.0]; pixels];
    let mut albedo = vec![0.0; pixels * channels];
    let mut found = vec![false; pixels];
    let spans = normals
        .par_chunks_mut(SPAN)
        .zip(albedo.par_chunks_mut(SPAN * channels))
        .zip(found.par_chunks_mut(SPAN));
    spans.enumerate().try_for_each_init(
        || (stereo.clone(), Vec::new(), Vec::new()),
        |(stereo, tile, values), (span, ((normals, albedo), found))| -> Result<(), E> {
            check()?;
            let first = span * SPAN * channels;
            let rows = stack.rows(first..first + albedo.len()).map_err(FitError::from)?;
            let stride = tile_pixels(lights, channels) * channels;
            tile.resize(lights * stride, 0.0f32);
            values.resize(lights * channels, 0.0f32);
            for start in (0..albedo.len()).step_by(stride) {
                let width = stride.min(albedo.len() - start);
                for (light, row) in tile.chunks_exact_mut(stride).enumerate() {
                    rows.copy(light, start, &mut row[..width]);
                }
                for at in (0..width).step_by(channels) {
                    for (value, row) in values.chunks_exact_mut(channels).zip(tile.chunks_exact(stride)) {
                        value.copy_from_slice(&row[at..at + channels]);
                    }
                    let pixel = (start + at) / channels;
                    let Some(SurfaceNormal { normal, albedo: color }) =
                        stereo.surface_of(values, channels, full_scale)
                    else {
                        continue;
                    };
                    normals[pixel] = normal.map(|c| c as f32);
                    for (value, color) in albedo[start + at..].iter_mut().zip(&color[..channels]) {
                        *value = *color as f32;
                    }
                    found[pixel] = true;
                }
            }
            Ok(())
        },
    )?;
    Ok(NormalMap { width: stack.width(), height: stack.height(), channels, normals, albedo, found })
}

/// Angles between normals and the true ones at the same place; true ones that are 0 or not finite are passed over.
///
/// `None` when no pixel is left.
pub fn normal_error(normals: &[[f32; 3]], truth: &[[f32; 3]]) -> Option<NormalError> {
    let mut angles: Vec<f64> = normals
        .par_iter()
        .zip(truth)
        .filter_map(|(normal, truth)| {
            let (normal, truth) = (unit(wide(*normal))?, unit(wide(*truth))?);
            Some(libm::acos(dot(normal, truth).clamp(-1.0, 1.0)))
        })
        .collect();
    let pixels = angles.len();
    let mean = angles.iter().sum::<f64>() / pixels.max(1) as f64;
    median(&mut angles, f64::total_cmp).map(|median| NormalError { mean, median, pixels })
}
