//! Pictures as tests see them: written and read by other code than the program's.

use exr::prelude::*;
use std::path::Path;

/// A decoded picture: rows from the top, samples 0..1 as stored.
#[derive(Clone, Debug, PartialEq)]
pub(crate) struct Pixels {
    pub(crate) width: usize,
    pub(crate) height: usize,
    /// R, G, B of each pixel; grey files give R = G = B.
    pub(crate) samples: Vec<f64>,
}

/// The sRGB curve of IEC 61966-2-1.
pub(crate) fn encoded(linear: f64) -> f64 {
    if linear <= 0.003_130_8 { 12.92 * linear } else { 1.055 * libm::pow(linear, 1.0 / 2.4) - 0.055 }
}

/// Its inverse.
pub(crate) fn decoded(encoded: f64) -> f64 {
    if encoded <= 0.04045 { encoded / 12.92 } else { libm::pow((encoded + 0.055) / 1.055, 2.4) }
}

/// Writes a made picture as 8-bit PNG.
pub(crate) fn write_made(path: &Path, light: [f64; 3], width: usize, height: usize) {
    let color = |x: u32, y: u32| {
        let linear = super::radiance(x as usize, y as usize, light);
        image::Rgb(linear.map(|value| (encoded(value) * 255.0).round() as u8))
    };
    image::RgbImage::from_fn(width as u32, height as u32, color).save(path).unwrap();
}

/// Writes a made picture as linear float OpenEXR; `bad` is a pixel that holds NaN.
pub(crate) fn write_made_exr(path: &Path, light: [f64; 3], bad: Option<(usize, usize)>) {
    write_rgb_file(path, super::WIDTH, super::HEIGHT, |x, y| {
        let [r, g, b] = super::radiance(x, y, light).map(|value| value as f32);
        (r, if bad == Some((x, y)) { f32::NAN } else { g }, b)
    })
    .unwrap();
}

/// Reads a PNG of 8 or 16 bits; also gives its bits.
pub(crate) fn read_png(path: &Path) -> (Pixels, u16) {
    let image = image::open(path).unwrap_or_else(|e| panic!("{}: {e}", path.display()));
    let bits = image.color().bits_per_pixel() / u16::from(image.color().channel_count());
    let (width, height) = (image.width() as usize, image.height() as usize);
    let samples = image.into_rgb16().into_raw().into_iter().map(|code| f64::from(code) / 65535.0).collect();
    (Pixels { width, height, samples }, bits)
}

/// Reads the R, G, B of an OpenEXR file; also whether its channels are half.
pub(crate) fn read_exr(path: &Path) -> (Pixels, bool) {
    let layer = read_first_flat_layer_from_file(path).unwrap().layer_data;
    let channel = |name: &str| {
        let found = layer.channel_data.list.iter().find(|channel| channel.name.eq(name));
        &found.unwrap_or_else(|| panic!("no channel {name}")).sample_data
    };
    let half = matches!(channel("R"), FlatSamples::F16(_));
    let planes = ["R", "G", "B"].map(|name| channel(name).values_as_f32().map(f64::from).collect::<Vec<_>>());
    let samples = (0..planes[0].len()).flat_map(|i| [planes[0][i], planes[1][i], planes[2][i]]).collect();
    (Pixels { width: layer.size.width(), height: layer.size.height(), samples }, half)
}

/// Peak signal to noise ratio in dB of two pictures clipped to 0..1.
pub(crate) fn psnr(a: &[f64], b: &[f64]) -> f64 {
    assert_eq!(a.len(), b.len());
    let square = |(a, b): (&f64, &f64)| {
        (a.clamp(0.0, 1.0) - b.clamp(0.0, 1.0)) * (a.clamp(0.0, 1.0) - b.clamp(0.0, 1.0))
    };
    let mean = a.iter().zip(b).map(square).sum::<f64>() / a.len() as f64;
    -10.0 * libm::log10(mean)
}
