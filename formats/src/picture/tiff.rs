//! TIFF and BigTIFF: grey or RGB of 8 or 16 bits, half or single float, chunky or planar, through
//! the `tiff` crate (the `image` crate's reader lacks grey float, half and grey with alpha).

use super::{
    DecodedPicture, PictureInfo, SampleType, Samples, Source, check_memory, checked_size, icc, keep_channels,
};
use crate::FormatError;
use ::tiff::decoder::{Decoder, DecodingResult, Limits};
use ::tiff::tags::Tag;
use ::tiff::{ColorType, TiffError};
use relight_core::CpuLevel;
use std::io::{Cursor, Read, Seek};
use std::path::Path;

/// `SampleFormat` tag values.
const UNSIGNED: u16 = 1;
const FLOAT: u16 = 3;

/// Memory for the directory when only the header is read.
const HEADER_BYTES: u64 = 64 << 20;

pub(super) fn is_magic(bytes: &[u8]) -> bool {
    [&b"II*\0"[..], b"MM\0*", b"II+\0", b"MM\0+"].iter().any(|magic| bytes.starts_with(magic))
}

pub(super) fn probe(source: &mut dyn Source, path: &Path) -> Result<PictureInfo, FormatError> {
    let limits = limits(HEADER_BYTES);
    let read = || Ok(Decoder::new(source)?.with_limits(limits));
    let mut decoder = read().map_err(|error| error_from_tiff(error, path, HEADER_BYTES))?;
    Ok(info_from_header(&mut decoder, path, HEADER_BYTES)?.0)
}

pub(super) fn decode(
    bytes: &[u8],
    path: &Path,
    _level: CpuLevel,
    memory_limit: u64,
) -> Result<DecodedPicture, FormatError> {
    let failed = |error| error_from_tiff(error, path, memory_limit);
    let mut decoder = Decoder::new(Cursor::new(bytes)).map_err(failed)?.with_limits(limits(memory_limit));
    let (info, stored) = info_from_header(&mut decoder, path, memory_limit)?;
    let info = checked_size(info, path)?;
    let stored_bytes = info.bytes() / info.channels as u64 * stored as u64;
    check_memory(stored_bytes.saturating_add(bytes.len() as u64), memory_limit, path)?;
    let mut result = DecodingResult::U8(Vec::new());
    let layout = decoder.read_image_to_buffer(&mut result).map_err(failed)?;
    let planes = layout.planes.max(1);
    if planes > 1 {
        // Two copies while the planes are interleaved.
        check_memory(stored_bytes.saturating_mul(2).saturating_add(bytes.len() as u64), memory_limit, path)?;
    }
    let samples = match (result, info.sample_type) {
        (DecodingResult::U8(samples), SampleType::U8) => interleaved(samples, planes, &info).map(Samples::U8),
        (DecodingResult::U16(samples), SampleType::U16) => {
            interleaved(samples, planes, &info).map(Samples::U16)
        }
        (DecodingResult::F16(samples), SampleType::F16) => {
            interleaved(samples, planes, &info).map(Samples::F16)
        }
        (DecodingResult::F32(samples), SampleType::F32) => {
            interleaved(samples, planes, &info).map(Samples::F32)
        }
        _ => None,
    };
    let samples = samples.ok_or_else(|| damaged(path, "its directory contradicts its samples"))?;
    Ok(DecodedPicture { info, samples })
}

/// Samples in the order of [`DecodedPicture`], from `planes` planes one after another or, for 1,
/// interleaved; `None` when there are too few.
fn interleaved<T: Copy + Default>(mut samples: Vec<T>, planes: usize, info: &PictureInfo) -> Option<Vec<T>> {
    let pixels = info.width * info.height;
    let stored = samples.len() / pixels;
    if stored < info.channels || samples.len() != stored * pixels || (planes > 1 && stored != planes) {
        return None;
    }
    if planes > 1 {
        let mut out = vec![T::default(); pixels * info.channels];
        for (channel, plane) in samples.chunks_exact(pixels).take(info.channels).enumerate() {
            for (pixel, sample) in plane.iter().enumerate() {
                out[pixel * info.channels + channel] = *sample;
            }
        }
        return Some(out);
    }
    keep_channels(&mut samples, stored, info.channels);
    Some(samples)
}

fn limits(memory_limit: u64) -> Limits {
    let bytes = usize::try_from(memory_limit).unwrap_or(usize::MAX);
    let mut limits = Limits::default();
    limits.decoding_buffer_size = bytes;
    limits.intermediate_buffer_size = bytes;
    limits.ifd_value_size = bytes.min(HEADER_BYTES as usize);
    limits
}

/// What the picture is, and how many samples a pixel has in the file.
fn info_from_header<R: Read + Seek>(
    decoder: &mut Decoder<R>,
    path: &Path,
    memory_limit: u64,
) -> Result<(PictureInfo, usize), FormatError> {
    let failed = |error| error_from_tiff(error, path, memory_limit);
    let (width, height) = decoder.dimensions().map_err(failed)?;
    let color = decoder.colortype().map_err(failed)?;
    let extra = decoder.find_tag_unsigned_vec::<u16>(Tag::ExtraSamples).map_err(failed)?.unwrap_or_default();
    let is_alpha = matches!(extra.first(), Some(1 | 2));
    let unsupported = |what: String, remedy: &str| {
        FormatError::unsupported(path, format!("a TIFF of {what} is not read; convert it to {remedy}"))
    };
    let (channels, bits, stored, alpha) = match color {
        ColorType::Gray(bits) => (1, bits, 1, false),
        ColorType::GrayA(bits) => (1, bits, 2, true),
        // What the decoder calls grey with extra samples.
        ColorType::Multiband { bit_depth, num_samples } => (1, bit_depth, usize::from(num_samples), is_alpha),
        ColorType::RGB(bits) => (3, bits, 3 + extra.len(), is_alpha),
        ColorType::RGBA(bits) => (3, bits, 4.max(3 + extra.len()), true),
        ColorType::CMYK(_) | ColorType::CMYKA(_) => {
            return Err(unsupported("CMYK colours".to_owned(), "RGB"));
        }
        ColorType::YCbCr(_) => return Err(unsupported("YCbCr colours".to_owned(), "RGB")),
        ColorType::Lab(_) => return Err(unsupported("CIE Lab colours".to_owned(), "RGB")),
        ColorType::Palette(_) => return Err(unsupported("palette colours".to_owned(), "RGB")),
        other => return Err(unsupported(format!("{other:?} samples"), "RGB")),
    };
    let formats =
        decoder.find_tag_unsigned_vec::<u16>(Tag::SampleFormat).map_err(failed)?.unwrap_or_default();
    let format = formats.first().copied().unwrap_or(UNSIGNED);
    let sample_type = match (bits, format) {
        (8, UNSIGNED) => SampleType::U8,
        (16, UNSIGNED) => SampleType::U16,
        (16, FLOAT) => SampleType::F16,
        (32, FLOAT) => SampleType::F32,
        (bits, format) => {
            let kind = match format {
                UNSIGNED => "unsigned",
                2 => "signed",
                FLOAT => "floating-point",
                _ => "unknown",
            };
            let what = format!("{bits}-bit {kind} samples");
            return Err(unsupported(what, "8 or 16 unsigned bits or to 32-bit floats"));
        }
    };
    if formats.iter().any(|other| *other != format) {
        return Err(unsupported("mixed sample formats".to_owned(), "one format for all channels"));
    }
    let orientation = decoder.find_tag_unsigned::<u16>(Tag::Orientation).map_err(failed)?;
    let profile = decoder.get_tag_u8_vec(Tag::IccProfile).ok();
    let info = PictureInfo {
        width: width as usize,
        height: height as usize,
        channels,
        sample_type,
        alpha,
        color_profile: profile.and_then(|profile| icc::description_unless_srgb(&profile)),
        orientation: orientation.filter(|value| (2..=8).contains(value)).map(|value| value as u8),
    };
    Ok((info, stored))
}

fn damaged(path: &Path, cause: impl std::fmt::Display) -> FormatError {
    FormatError::invalid(path, format!("truncated or damaged TIFF: {cause}; copy it again"))
}

fn error_from_tiff(error: TiffError, path: &Path, memory_limit: u64) -> FormatError {
    match error {
        TiffError::UnsupportedError(what) => FormatError::unsupported(
            path,
            format!("a TIFF of a kind that is not read: {what}; convert it to RGB"),
        ),
        TiffError::LimitsExceeded => {
            FormatError::too_large(path, memory_limit.saturating_add(1), memory_limit)
        }
        error => damaged(path, error),
    }
}
