//! Planes of a `.ptm` as grey JPEG files: each as it is, or what is left of it when an earlier one, inverted
//! or not, is taken off, whichever is smaller.
//!
//! What is left is taken modulo 256. JPEG changes it by a little, and where that carries a code beyond 0 or
//! 255 it comes back at the other end: such pixels are put right by side information of 5 bytes each.

use super::exact_jpeg::decode_planes;
use super::plane_prediction::{predict, residual, restore};
use crate::FormatError;
use jpeg_encoder::{ColorType, Encoder};
use rayon::prelude::*;
use std::path::Path;

/// Blocks of 8 x 8 pixels on which references are tried.
const TRIAL_BLOCKS: usize = 1024;

/// Trial blocks side by side.
const TRIAL_ROW: usize = 32;

/// Pixels along a block of JPEG.
const BLOCK: usize = 8;

/// Codes so near to 0 or 255 are put right even where our decoder gets them right: another may round the
/// plane and those that it was taken off the other way.
const MARGIN: u8 = 4;

/// Bytes of side information for a pixel.
const RECORD: usize = 5;

/// Bytes a pixel that encoding one plane takes: two tries at once, of each the codes left, the encoder's
/// 16-bit coefficients, its file, and what the decoder makes of it.
pub(super) const WORKING_PLANES: u64 = 2 * (1 + 2 + 1 + 2);

/// A plane as it is stored.
pub(super) struct CodedPlane {
    /// The plane that was taken off, if one was.
    pub(super) reference: Option<usize>,
    /// Whether it was inverted before.
    pub(super) inverted: bool,
    pub(super) jpeg: Vec<u8>,
    /// Records of a pixel (32 bits, most significant byte first) and its code.
    pub(super) side: Vec<u8>,
}

impl CodedPlane {
    fn bytes(&self) -> usize {
        self.jpeg.len() + self.side.len()
    }
}

/// Encodes `plane`; `earlier` are those before it as they are decoded. Gives also what a reader decodes.
pub(super) fn encode_plane(
    path: &Path,
    plane: &[u8],
    earlier: &[Vec<u8>],
    size: (usize, usize),
    quality: u8,
) -> Result<(CodedPlane, Vec<u8>), FormatError> {
    let plain = || encode(path, plane, None, size, quality);
    let Some((reference, inverted)) = promising_reference(plane, earlier, size, quality) else {
        return plain();
    };
    let predicted = || encode(path, plane, Some((reference, &earlier[reference], inverted)), size, quality);
    let (plain, predicted) = rayon::join(plain, predicted);
    let (plain, predicted) = (plain?, predicted?);
    Ok(if predicted.0.bytes() < plain.0.bytes() { predicted } else { plain })
}

/// Encodes `plane` less the reference, which has a number, codes and may be inverted.
fn encode(
    path: &Path,
    plane: &[u8],
    reference: Option<(usize, &Vec<u8>, bool)>,
    size: (usize, usize),
    quality: u8,
) -> Result<(CodedPlane, Vec<u8>), FormatError> {
    let refused = |error: jpeg_encoder::EncodingError| FormatError::invalid(path, error.to_string());
    let Some((number, of_reference, inverted)) = reference else {
        let jpeg = jpeg_of(plane, size, quality).map_err(refused)?;
        let decoded = decode_planes(&jpeg, size, 1, path, u64::MAX)?;
        return Ok((CodedPlane { reference: None, inverted: false, jpeg, side: Vec::new() }, decoded));
    };
    let left: Vec<u8> =
        plane.iter().zip(of_reference).map(|(&code, &r)| residual(code, predict(r, inverted))).collect();
    let jpeg = jpeg_of(&left, size, quality).map_err(refused)?;
    drop(left);
    let mut decoded = decode_planes(&jpeg, size, 1, path, u64::MAX)?;
    restore(&mut decoded, of_reference, inverted);
    let mut side = Vec::new();
    for (pixel, (decoded, &code)) in decoded.iter_mut().zip(plane).enumerate() {
        if endangered(*decoded, code) {
            // Sides are at most 65535, so that 32 bits hold every pixel.
            side.extend_from_slice(&(pixel as u32).to_be_bytes());
            side.push(code);
            *decoded = code;
        }
    }
    Ok((CodedPlane { reference: Some(number), inverted, jpeg, side }, decoded))
}

/// Whether a pixel that is decoded as `decoded` instead of `code` came back, or may come back, at the
/// other end of 0..255.
fn endangered(decoded: u8, code: u8) -> bool {
    !(MARGIN..=255 - MARGIN).contains(&decoded) || decoded.abs_diff(code) > 127
}

/// The earlier plane that, taken off `plane`, leaves least to encode, if less than `plane` itself: by the
/// size of a JPEG of some of their blocks.
fn promising_reference(
    plane: &[u8],
    earlier: &[Vec<u8>],
    size: (usize, usize),
    quality: u8,
) -> Option<(usize, bool)> {
    let of_plane = trial_blocks(plane, size);
    let trial_size = (TRIAL_ROW * BLOCK, of_plane.len() / (TRIAL_ROW * BLOCK));
    let bytes = |codes: &[u8]| jpeg_of(codes, trial_size, quality).map_or(usize::MAX, |jpeg| jpeg.len());
    let alone = bytes(&of_plane);
    // Pixels at the ends cost side information whatever the reference is.
    let at_ends = of_plane.iter().filter(|&&code| endangered(code, code)).count() * RECORD;
    let references: Vec<_> = earlier.par_iter().map(|earlier| trial_blocks(earlier, size)).collect();
    let tries: Vec<_> =
        (0..earlier.len()).flat_map(|reference| [(reference, false), (reference, true)]).collect();
    tries
        .into_par_iter()
        .map(|(reference, inverted)| {
            let pairs = of_plane.iter().zip(&references[reference]);
            let left: Vec<u8> = pairs.map(|(&code, &r)| residual(code, predict(r, inverted))).collect();
            (bytes(&left).saturating_add(at_ends), reference, inverted)
        })
        .min()
        .filter(|(bytes, ..)| *bytes < alone)
        .map(|(_, reference, inverted)| (reference, inverted))
}

/// Blocks of a plane, evenly scattered over it, as a picture [`TRIAL_ROW`] blocks wide; its last row is
/// filled up with the last block, blocks over the edge with the last column and row.
fn trial_blocks(plane: &[u8], (width, height): (usize, usize)) -> Vec<u8> {
    let across = width.div_ceil(BLOCK);
    let all = across * height.div_ceil(BLOCK);
    let count = all.min(TRIAL_BLOCKS);
    let rows = count.div_ceil(TRIAL_ROW);
    let mut picture = Vec::with_capacity(rows * TRIAL_ROW * BLOCK * BLOCK);
    for (row, line) in (0..rows).flat_map(|row| (0..BLOCK).map(move |line| (row, line))) {
        for column in 0..TRIAL_ROW {
            let block = (row * TRIAL_ROW + column).min(count - 1) * all / count;
            let y = (block / across * BLOCK + line).min(height - 1);
            let of_x = |x: usize| plane[y * width + (block % across * BLOCK + x).min(width - 1)];
            picture.extend((0..BLOCK).map(of_x));
        }
    }
    picture
}

/// A grey baseline JPEG; sides are at most 65535.
fn jpeg_of(
    codes: &[u8],
    (width, height): (usize, usize),
    quality: u8,
) -> Result<Vec<u8>, jpeg_encoder::EncodingError> {
    let mut bytes = Vec::new();
    let mut encoder = Encoder::new(&mut bytes, quality);
    encoder.set_optimized_huffman_tables(true);
    encoder.encode(codes, width as u16, height as u16, ColorType::Luma)?;
    Ok(bytes)
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A plane that JPEG keeps well, bows of parabolas, with ends of the range in it.
    fn slopes(size: (usize, usize), seed: usize) -> Vec<u8> {
        let bow = |at: usize, length: usize| {
            let t = (at % length) as f64 / length as f64;
            let sign = if (at / length).is_multiple_of(2) { 4.0 } else { -4.0 };
            sign * t * (1.0 - t)
        };
        let wave = |i: usize| {
            let (x, y) = (i % size.0, i / size.0);
            127.5 + 128.5 * bow(x + 5 * seed, 17 + 6 * seed) * bow(y + seed, 40)
        };
        (0..size.0 * size.1).map(|i| wave(i).clamp(0.0, 255.0) as u8).collect()
    }

    /// Inverse of what is stored, written apart: signed arithmetic.
    fn decoded_apart(coded: &CodedPlane, earlier: &[Vec<u8>], size: (usize, usize)) -> Vec<u8> {
        let mut codes = decode_planes(&coded.jpeg, size, 1, Path::new("p"), 1 << 30).unwrap();
        if let Some(reference) = coded.reference {
            for (code, &r) in codes.iter_mut().zip(&earlier[reference]) {
                let p = if coded.inverted { 255 - i32::from(r) } else { i32::from(r) };
                *code = (i32::from(*code) + p - 128).rem_euclid(256) as u8;
            }
        }
        for record in coded.side.chunks(5) {
            codes[u32::from_be_bytes(record[..4].try_into().unwrap()) as usize] = record[4];
        }
        codes
    }

    #[test]
    fn planes_alike_or_inverted_are_taken_off_and_come_back_without_wrapping() {
        let size = (203, 91);
        let first = slopes(size, 1);
        let mixed: Vec<u8> = first
            .iter()
            .zip(slopes(size, 4))
            .map(|(&a, b)| (u16::from(a) * 7 / 8 + u16::from(b) / 8) as u8)
            .collect();
        let inverted: Vec<u8> = mixed.iter().map(|code| 255 - code).collect();
        let path = Path::new("a.ptm");
        let (coded, decoded) = encode_plane(path, &first, &[], size, 85).unwrap();
        assert_eq!((coded.reference, coded.side.len()), (None, 0));
        let earlier = [slopes(size, 9), decoded];
        for (plane, is_inverted) in [(&mixed, false), (&inverted, true)] {
            let (coded, decoded) = encode_plane(path, plane, &earlier, size, 85).unwrap();
            assert_eq!((coded.reference, coded.inverted), (Some(1), is_inverted));
            let (alone, _) = encode_plane(path, plane, &[], size, 85).unwrap();
            assert!(coded.bytes() < alone.bytes(), "{} bytes, {} alone", coded.bytes(), alone.bytes());
            assert!(decoded == decoded_apart(&coded, &earlier, size), "the reader sees something else");
            let largest = decoded.iter().zip(plane).map(|(a, b)| a.abs_diff(*b)).max().unwrap();
            assert!(largest < 60, "a code is {largest} off: it came back at the other end");
            assert!(!coded.side.is_empty(), "nothing was in danger: this tests nothing");
            // Noise under coarse JPEG is carried further than the margin.
            let noisy: Vec<u8> = plane
                .iter()
                .enumerate()
                .map(|(i, &code)| code.saturating_add((i * 7919 % 83) as u8).saturating_sub(41))
                .collect();
            let reference = Some((1, &earlier[1], is_inverted));
            let (_, decoded) = encode(path, &noisy, reference, size, 5).unwrap();
            let largest = decoded.iter().zip(&noisy).map(|(a, b)| a.abs_diff(*b)).max().unwrap();
            assert!((20..128).contains(&largest), "a code is {largest} off");
        }
    }

    #[test]
    fn planes_that_have_nothing_in_common_and_those_at_the_ends_stay_alone() {
        let size = (64, 40);
        let earlier = [slopes(size, 2)];
        let (coded, _) = encode_plane(Path::new("a"), &slopes(size, 7), &earlier, size, 90).unwrap();
        assert_eq!(coded.reference, None);
        // Black throughout, like the reference: nothing is left, but every pixel would need a record.
        let black = vec![0; 64 * 40];
        let (coded, decoded) =
            encode_plane(Path::new("a"), &black, std::slice::from_ref(&black), size, 90).unwrap();
        assert_eq!(coded.reference, None);
        assert!(decoded == black);
    }

    #[test]
    fn blocks_on_trial_are_scattered_over_the_whole_plane() {
        // 100 x 80 blocks, each of the code of its row and column.
        let size = (800, 640);
        let plane: Vec<u8> = (0..size.0 * size.1).map(|i| (i / size.0 / 8 + i % size.0 / 8) as u8).collect();
        let blocks = trial_blocks(&plane, size);
        assert_eq!(blocks.len(), 1024 * 64);
        let (least, most) = (blocks.iter().min().unwrap(), blocks.iter().max().unwrap());
        assert!(*least == 0 && *most > 165, "{least}..{most}");
        for block in 0..32 {
            let code = blocks[8 * block];
            assert!((0..8).all(|y| blocks[y * 256 + 8 * block..][..8].iter().all(|&c| c == code)));
        }
        // A plane smaller than a block.
        assert!(trial_blocks(&[7, 9], (2, 1)).chunks(8).all(|line| line == [7, 9, 9, 9, 9, 9, 9, 9]));
    }
}
