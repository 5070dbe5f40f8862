//! PNG of 1 to 16 bits a sample, grey, RGB or palette, through the `image` crate. Gamma and
//! chromaticities aren't applied.

use super::{
    DecodedPicture, PictureInfo, SampleType, Samples, Source, check_memory, checked_size, error_from_image,
    icc, keep_channels,
};
use crate::FormatError;
use image::codecs::png::PngDecoder;
use image::{ImageDecoder, Limits};
use relight_core::CpuLevel;
use std::io::Cursor;
use std::path::Path;

const NAME: &str = "PNG";

/// Memory for what precedes the samples (text, profiles) when only the header is read.
const HEADER_BYTES: u64 = 64 << 20;

pub(super) fn is_magic(bytes: &[u8]) -> bool {
    bytes.starts_with(b"\x89PNG\r\n\x1a\n")
}

pub(super) fn probe(source: &mut dyn Source, path: &Path) -> Result<PictureInfo, FormatError> {
    let mut decoder = open(source, path, HEADER_BYTES)?;
    info_from_header(&mut decoder, path, HEADER_BYTES)
}

pub(super) fn decode(
    bytes: &[u8],
    path: &Path,
    _level: CpuLevel,
    memory_limit: u64,
) -> Result<DecodedPicture, FormatError> {
    let mut decoder = open(Cursor::new(bytes), path, memory_limit)?;
    let info = checked_size(info_from_header(&mut decoder, path, memory_limit)?, path)?;
    let stored = usize::from(decoder.color_type().channel_count());
    check_memory(decoder.total_bytes().saturating_add(bytes.len() as u64), memory_limit, path)?;
    let length = info.width * info.height * stored;
    let failed = |error| error_from_image(error, path, NAME, memory_limit);
    let samples = if info.sample_type == SampleType::U8 {
        let mut samples = vec![0u8; length];
        decoder.read_image(&mut samples).map_err(failed)?;
        keep_channels(&mut samples, stored, info.channels);
        Samples::U8(samples)
    } else {
        let mut samples = vec![0u16; length];
        decoder.read_image(bytemuck::cast_slice_mut(&mut samples)).map_err(failed)?;
        keep_channels(&mut samples, stored, info.channels);
        Samples::U16(samples)
    };
    Ok(DecodedPicture { info, samples })
}

fn open<R: Source>(source: R, path: &Path, memory_limit: u64) -> Result<PngDecoder<R>, FormatError> {
    let mut limits = Limits::no_limits();
    limits.max_alloc = Some(memory_limit);
    PngDecoder::with_limits(source, limits).map_err(|error| error_from_image(error, path, NAME, memory_limit))
}

fn info_from_header<R: Source>(
    decoder: &mut PngDecoder<R>,
    path: &Path,
    memory_limit: u64,
) -> Result<PictureInfo, FormatError> {
    let failed = |error| error_from_image(error, path, NAME, memory_limit);
    let (width, height) = decoder.dimensions();
    let color = decoder.color_type();
    let profile = decoder.icc_profile().map_err(failed)?;
    let orientation = decoder.orientation().map_err(failed)?.to_exif();
    Ok(PictureInfo {
        width: width as usize,
        height: height as usize,
        channels: if color.has_color() { 3 } else { 1 },
        sample_type: if color.bytes_per_pixel() == color.channel_count() {
            SampleType::U8
        } else {
            SampleType::U16
        },
        alpha: color.has_alpha(),
        color_profile: profile.and_then(|profile| icc::description_unless_srgb(&profile)),
        orientation: Some(orientation).filter(|orientation| *orientation != 1),
    })
}
