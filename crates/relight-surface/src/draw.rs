//! From fragments to a picture.

use crate::rasterizer::{Fragment, rasterize};
use crate::{Mesh, SurfaceError};
use rayon::prelude::*;
use relight_core::relighter::Picture;
use relight_core::{Camera, Wrap};

/// Most samples along a pixel's side.
const MOST_SAMPLES: usize = 16;

/// How meshes are drawn.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct DrawSettings {
    /// Samples along each side of a pixel, 1 to 16; a pixel is their mean in linear light.
    pub supersampling: usize,
    /// Linear light where no triangle is.
    pub background: [f32; 3],
    /// Beyond the edge of textures; lightmaps end there.
    pub wrap: Wrap,
}

impl Default for DrawSettings {
    /// Two samples each way, black, textures repeated as glTF has it.
    fn default() -> Self {
        Self { supersampling: 2, background: [0.0; 3], wrap: Wrap::Repeat }
    }
}

/// The picture of `mesh`, R, G, B: `shade` gives the linear light of what a sample sees, with the `scratch` of
/// its thread.
pub(crate) fn drawn<S>(
    mesh: &Mesh,
    camera: &Camera,
    settings: &DrawSettings,
    scratch: impl Fn() -> S + Sync + Send,
    shade: impl Fn(&Fragment, &mut S) -> [f32; 3] + Sync + Send,
) -> Result<Picture, SurfaceError> {
    let samples = settings.supersampling;
    if !(1..=MOST_SAMPLES).contains(&samples) {
        return Err(SurfaceError::Supersampling { samples });
    }
    let (width, height) = (camera.width, camera.height);
    let fine = Camera { width: width * samples, height: height * samples, ..*camera };
    let seen = rasterize(mesh, &fine)?;
    let mut picture = vec![0.0f32; width * height * 3];
    picture.par_chunks_mut(width * 3).enumerate().for_each_init(scratch, |scratch, (y, row)| {
        for (x, pixel) in row.chunks_exact_mut(3).enumerate() {
            for j in 0..samples {
                let first = (y * samples + j) * fine.width + x * samples;
                for fragment in &seen.fragments[first..first + samples] {
                    let is_mesh = fragment.triangle != Fragment::NOTHING;
                    let color = if is_mesh { shade(fragment, scratch) } else { settings.background };
                    for (sum, value) in pixel.iter_mut().zip(color) {
                        *sum += value;
                    }
                }
            }
            for sum in pixel {
                *sum /= (samples * samples) as f32;
            }
        }
    });
    Ok(Picture { width, height, channels: 3, samples: picture })
}

/// An attribute where a fragment is.
pub(crate) fn interpolated<const N: usize>(
    values: &[[f32; N]],
    corners: [u32; 3],
    fragment: &Fragment,
) -> [f64; N] {
    let mut sum = [0.0; N];
    for (vertex, weight) in corners.into_iter().zip(fragment.weights) {
        for (sum, value) in sum.iter_mut().zip(values[vertex as usize]) {
            *sum += f64::from(weight) * f64::from(value);
        }
    }
    sum
}
