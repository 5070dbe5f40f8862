//! Three planes as one JPEG of three components at full size, without a colour profile: browsers would
//! convert what has one.

use super::web::OF_A_FILE;
use jpeg_encoder::{
    Encoder, EncodingError, ImageBuffer, JpegColorType, QuantizationTableType, SamplingFactor, rgb_to_ycbcr,
};

/// Bytes a pixel that making a file takes: the encoder's 16-bit coefficients, the file, and the samples that the
/// decoder makes of it.
pub(super) const WORKING_BYTES: u64 = (2 + 1 + 1) * OF_A_FILE as u64;

/// Adobe's segment: version 100, no flags, no transform: components are R, G, B.
/// Source: Adobe Technical Note 5116.
const NO_TRANSFORM: &[u8; 12] = b"Adobe\0\x64\0\0\0\0\0";

/// Where the JFIF segment lies, which the encoder always writes, and whose presence says YCbCr to decoders
/// whatever Adobe's says.
const JFIF: std::ops::Range<usize> = 2..20;

struct Planes<'a> {
    planes: &'a [Vec<u8>],
    width: u16,
    height: u16,
    in_common: bool,
}

impl ImageBuffer for Planes<'_> {
    fn get_jpeg_color_type(&self) -> JpegColorType {
        // Three components, whatever they are.
        JpegColorType::Ycbcr
    }

    fn width(&self) -> u16 {
        self.width
    }

    fn height(&self) -> u16 {
        self.height
    }

    fn fill_buffers(&self, y: u16, buffers: &mut [Vec<u8>; 4]) {
        let width = usize::from(self.width);
        let row = usize::from(y) * width..(usize::from(y) + 1) * width;
        if !self.in_common {
            for (buffer, plane) in buffers.iter_mut().zip(self.planes) {
                buffer.extend_from_slice(&plane[row.clone()]);
            }
            return;
        }
        for pixel in row {
            let [r, g, b] = [0, 1, 2].map(|i| self.planes[i][pixel]);
            let (y, cb, cr) = rgb_to_ycbcr(r, g, b);
            buffers[0].push(y);
            buffers[1].push(cb);
            buffers[2].push(cr);
        }
    }
}

/// A baseline JPEG of three planes of `width` x `height` pixels, sides at most 65535: as YCbCr where they
/// have much `in_common`, else as they are.
///
/// All components have the same steps: none of them is colour, to which eyes are blunt.
pub(super) fn encode_planes(
    planes: &[Vec<u8>],
    (width, height): (usize, usize),
    quality: u8,
    in_common: bool,
) -> Result<Vec<u8>, EncodingError> {
    let mut bytes = Vec::new();
    let mut encoder = Encoder::new(&mut bytes, quality);
    encoder.set_optimized_huffman_tables(true);
    encoder.set_sampling_factor(SamplingFactor::F_1_1);
    encoder.set_quantization_tables(QuantizationTableType::Flat, QuantizationTableType::Flat);
    if !in_common {
        encoder.add_app_segment(14, NO_TRANSFORM.to_vec())?;
    }
    encoder.encode_image(Planes { planes, width: width as u16, height: height as u16, in_common })?;
    if !in_common {
        bytes.drain(JFIF);
    }
    Ok(bytes)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::asset::exact_jpeg::decode_planes;
    use std::path::Path;

    /// Tables of a file's own come with a scan a component, whose last row of blocks may take a few bits only.
    #[test]
    fn constant_planes_come_back_at_every_width() {
        for (width, height) in [(1, 1), (40, 24), (250, 17), (256, 40), (257, 40), (300, 33)] {
            for constant in [0, 1, 2] {
                let plane = |p: usize| -> Vec<u8> {
                    let code =
                        |x: usize| if p == constant { 255 } else { (100 + 9 * p + x % width / 8) as u8 };
                    (0..width * height).map(code).collect()
                };
                let planes = [0, 1, 2].map(plane);
                let jpeg = encode_planes(&planes, (width, height), 95, false).unwrap();
                let back = decode_planes(&jpeg, (width, height), 3, Path::new("a.jpg"), 1 << 30).unwrap();
                for (i, code) in back.into_iter().enumerate() {
                    let error = code.abs_diff(planes[i % 3][i / 3]);
                    assert!(error <= 4, "{width} x {height}, plane {}, pixel {}: {error}", i % 3, i / 3);
                }
            }
        }
    }
}
