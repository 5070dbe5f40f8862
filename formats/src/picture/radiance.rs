//! Radiance HDR: RGBE, run-length encoded or flat, through the `image` crate. Values are as
//! stored: the header's EXPOSURE isn't divided out.

use super::{
    DecodedPicture, PictureInfo, SampleType, Samples, Source, check_memory, checked_size, error_from_image,
};
use crate::FormatError;
use image::ImageDecoder;
use image::codecs::hdr::HdrDecoder;
use relight_core::CpuLevel;
use std::io::{BufRead, Cursor, Read};
use std::path::Path;

const NAME: &str = "Radiance HDR";

/// The signature of RADIANCE itself; some writers use the other.
const STRICT: &[u8] = b"#?RADIANCE";
const LOOSE: &[u8] = b"#?RGBE";

/// Headers are a few lines; the decoder itself reads on without bound.
const LONGEST_HEADER: u64 = 1 << 16;

pub(super) fn is_magic(bytes: &[u8]) -> bool {
    bytes.starts_with(STRICT) || bytes.starts_with(LOOSE)
}

pub(super) fn probe(source: &mut dyn Source, path: &Path) -> Result<PictureInfo, FormatError> {
    let magic = source.fill_buf().map_err(|error| FormatError::io(path, "read", error))?;
    let strict = magic.starts_with(STRICT);
    Ok(info_from_header(&open(Read::take(source, LONGEST_HEADER), strict, path)?))
}

pub(super) fn decode(
    bytes: &[u8],
    path: &Path,
    _level: CpuLevel,
    memory_limit: u64,
) -> Result<DecodedPicture, FormatError> {
    let decoder = open(Cursor::new(bytes), bytes.starts_with(STRICT), path)?;
    let info = checked_size(info_from_header(&decoder), path)?;
    let row = info.width as u64 * 4;
    check_memory(info.bytes().saturating_add(row).saturating_add(bytes.len() as u64), memory_limit, path)?;
    let mut samples = vec![0.0f32; info.width * info.height * info.channels];
    decoder
        .read_image(bytemuck::cast_slice_mut(&mut samples))
        .map_err(|error| error_from_image(error, path, NAME, memory_limit))?;
    Ok(DecodedPicture { info, samples: Samples::F32(samples) })
}

fn open<R: BufRead>(source: R, strict: bool, path: &Path) -> Result<HdrDecoder<R>, FormatError> {
    HdrDecoder::with_strictness(source, strict)
        .map_err(|error| error_from_image(error, path, NAME, LONGEST_HEADER))
}

fn info_from_header<R: BufRead>(decoder: &HdrDecoder<R>) -> PictureInfo {
    let (width, height) = decoder.dimensions();
    PictureInfo {
        width: width as usize,
        height: height as usize,
        channels: 3,
        sample_type: SampleType::F32,
        alpha: false,
        color_profile: None,
        orientation: None,
    }
}
