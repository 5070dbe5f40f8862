//! An asset's planes as pictures of bytes, of which the page makes coefficients again.

use super::shrink::{shrunk, shrunk_length};
use crate::failure::Failure;
use crate::interrupt;
use rayon::prelude::*;
use relight_core::{RelightingMap, RelightingMaps, Texels};
use relight_formats::PagePicture;
use std::path::Path;

/// The longest side of the page's picture in pixels.
const LONGEST: usize = 512;

/// Bytes of planes that a page unpacks in memory.
const MOST_BYTES: usize = 16 << 20;

/// Characters of planes in a page.
const MOST_TEXT: usize = 8 << 20;

/// Codes of planes that 8 bits are not enough for.
const STEPS: f32 = 65535.0;

/// A run of bytes of a plane, one a pixel: coefficient = bias + sum over its runs of gain x byte.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct ByteRun {
    pub(super) plane: usize,
    pub(super) gain: f64,
}

/// Planes as a page holds them.
#[derive(Debug)]
pub(super) struct PagePlanes {
    /// Width and height in pixels.
    pub(super) size: (usize, usize),
    /// Pixels of the asset along a side of one of the page's.
    pub(super) factor: usize,
    /// By plane.
    pub(super) bias: Vec<f64>,
    /// By channel of all images, one after another.
    pub(super) runs: Vec<ByteRun>,
    /// PNG of three runs each; what the last one lacks is 0.
    pub(super) images: Vec<String>,
}

/// Whether a plane is of 8-bit codes, which the page takes as they are.
fn is_coded(plane: &RelightingMap) -> bool {
    matches!(plane.texels, Texels::U8(_))
}

/// The planes of `maps` for `page`, as large as its bounds allow.
pub(super) fn page_planes(maps: &RelightingMaps, page: &Path) -> Result<PagePlanes, Failure> {
    let runs = maps.planes.iter().map(|plane| if is_coded(plane) { 1 } else { 2 }).sum::<usize>();
    let fits = |factor: usize| {
        let (width, height) = (shrunk_length(maps.width, factor), shrunk_length(maps.height, factor));
        width.max(height) <= LONGEST && runs * width * height <= MOST_BYTES
    };
    let mut factor = (1..).find(|&factor| fits(factor)).unwrap_or(1);
    loop {
        let planes = planes_at(maps, factor, page)?;
        let text: usize = planes.images.iter().map(String::len).sum();
        if text <= MOST_TEXT || planes.size.0.max(planes.size.1) <= 1 {
            return Ok(planes);
        }
        let ratio = (text as f64 / MOST_TEXT as f64).sqrt();
        factor = (factor + 1).max((factor as f64 * ratio).ceil() as usize);
    }
}

/// A plane as runs of bytes with their gains, the high one first.
#[derive(Debug, PartialEq)]
struct CodedPlane {
    parts: Vec<(Vec<u8>, f64)>,
    bias: f64,
}

fn coded(plane: &RelightingMap, size: (usize, usize), factor: usize) -> CodedPlane {
    let (scale, bias) = (f64::from(plane.scale), f64::from(plane.bias));
    if let Texels::U8(codes) = &plane.texels {
        let row = |y: usize, out: &mut [f32]| {
            out.iter_mut().zip(&codes[y * size.0..]).for_each(|(value, code)| *value = f32::from(*code));
        };
        let codes = shrunk(size, 1, factor, row).into_iter().map(|code| (code + 0.5) as u8).collect();
        return CodedPlane { parts: vec![(codes, scale / 255.0)], bias };
    }
    let coefficients = shrunk(size, 1, factor, |y, out| plane.coefficients(y * size.0, out));
    let (least, most) =
        coefficients.iter().fold((f32::INFINITY, f32::NEG_INFINITY), |(a, b), &v| (a.min(v), b.max(v)));
    let step = (most - least) / STEPS;
    let code =
        |value: &f32| if step > 0.0 { ((value - least) / step + 0.5).clamp(0.0, STEPS) as u16 } else { 0 };
    let codes: Vec<u16> = coefficients.iter().map(code).collect();
    let step = f64::from(step);
    let bytes = |shift: u32| codes.iter().map(|code| (code >> shift) as u8).collect::<Vec<u8>>();
    CodedPlane { parts: vec![(bytes(8), 256.0 * step), (bytes(0), step)], bias: f64::from(least) }
}

fn planes_at(maps: &RelightingMaps, factor: usize, page: &Path) -> Result<PagePlanes, Failure> {
    let whole = (maps.width, maps.height);
    let size = (shrunk_length(maps.width, factor), shrunk_length(maps.height, factor));
    let all: Vec<CodedPlane> = maps
        .planes
        .par_iter()
        .map(|plane| {
            interrupt::check()?;
            Ok(coded(plane, whole, factor))
        })
        .collect::<Result<_, Failure>>()?;
    let bias = all.iter().map(|plane| plane.bias).collect();
    // High bytes of all planes before low ones: the three channels of a function are alike and lie in one image.
    let mut runs = Vec::new();
    let mut bytes: Vec<&[u8]> = Vec::new();
    for part in 0..2 {
        for (plane, CodedPlane { parts, .. }) in all.iter().enumerate() {
            if let Some((codes, gain)) = parts.get(part) {
                runs.push(ByteRun { plane, gain: *gain });
                bytes.push(codes);
            }
        }
    }
    let image = |of: &[&[u8]]| {
        interrupt::check()?;
        let mut codes = vec![0; size.0 * size.1 * 3];
        for (channel, run) in of.iter().enumerate() {
            codes[channel..].iter_mut().step_by(3).zip(*run).for_each(|(code, byte)| *code = *byte);
        }
        Ok(PagePicture { size, channels: 3, codes: &codes }.png_uri(page)?)
    };
    let images = bytes.par_chunks(3).map(image).collect::<Result<_, Failure>>()?;
    Ok(PagePlanes { size, factor, bias, runs, images })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn codes_stay_as_they_are_and_floats_take_two_bytes() {
        let codes: Vec<u8> = (0..12).map(|i| i * 20).collect();
        let plane = RelightingMap { scale: 3.0, bias: -1.5, texels: Texels::U8(codes.clone()) };
        let CodedPlane { parts, bias } = coded(&plane, (4, 3), 1);
        assert_eq!((parts, bias), (vec![(codes, 3.0 / 255.0)], -1.5));

        let floats: Vec<f32> = (0..12).map(|i| (i * i) as f32 * 0.37 - 9.0).collect();
        let plane = RelightingMap { scale: 2.0, bias: 0.25, texels: Texels::F32(floats.clone()) };
        let CodedPlane { parts, bias } = coded(&plane, (4, 3), 1);
        assert_eq!(parts.len(), 2);
        let range = 2.0 * 0.37 * 121.0;
        for (i, value) in floats.iter().enumerate() {
            let made = bias + parts.iter().map(|(bytes, gain)| gain * f64::from(bytes[i])).sum::<f64>();
            assert!(
                (made - (2.0 * f64::from(*value) + 0.25)).abs() <= 0.51 * range / 65535.0,
                "{i}: {made} {value}"
            );
        }
    }

    #[test]
    fn a_flat_plane_is_its_bias() {
        let plane = RelightingMap { scale: 1.0, bias: 0.0, texels: Texels::F32(vec![0.7; 6]) };
        let CodedPlane { parts, bias } = coded(&plane, (3, 2), 2);
        assert_eq!(bias, f64::from(0.7f32));
        assert!(parts.iter().all(|(bytes, _)| bytes == &[0, 0]));
    }
}
