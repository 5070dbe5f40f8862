//! OpenEXR through the `exr` crate: the first layer that has R, G and B, or else Y, as half or
//! float. Halves stay halves.

use super::{DecodedPicture, PictureInfo, SampleType, Samples, Source, check_memory, checked_size};
use crate::FormatError;
use crate::exr_channels::{
    self, ChosenChannels, channel_names, error_from_exr, float_of, lettered, prefixes, read_blocks,
};
use exr::meta::header::Header;
use half::f16;
use relight_core::CpuLevel;
use std::io::Cursor;
use std::path::Path;

pub(super) fn is_magic(bytes: &[u8]) -> bool {
    bytes.starts_with(exr_channels::MAGIC)
}

pub(super) fn probe(source: &mut dyn Source, path: &Path) -> Result<PictureInfo, FormatError> {
    let reader = exr::block::read(source, false).map_err(|error| error_from_exr(error, path))?;
    Ok(choose(reader.headers(), path)?.0)
}

pub(super) fn decode(
    bytes: &[u8],
    path: &Path,
    _level: CpuLevel,
    memory_limit: u64,
) -> Result<DecodedPicture, FormatError> {
    let failed = |error| error_from_exr(error, path);
    let reader = exr::block::read(Cursor::new(bytes), false).map_err(failed)?;
    let (info, chosen) = choose(reader.headers(), path)?;
    let info = checked_size(info, path)?;
    let needed = info.bytes().saturating_add(chosen.block_bytes).saturating_add(bytes.len() as u64);
    check_memory(needed, memory_limit, path)?;
    let length = info.width * info.height * info.channels;
    let samples = if info.sample_type == SampleType::F16 {
        let mut samples = vec![f16::ZERO; length];
        read_blocks(reader, &chosen, path, |at, _, bytes| {
            samples[at] = f16::from_ne_bytes([bytes[0], bytes[1]]);
        })?;
        Samples::F16(samples)
    } else {
        let mut samples = vec![0.0f32; length];
        read_blocks(reader, &chosen, path, |at, channel, bytes| samples[at] = float_of(channel, bytes))?;
        Samples::F32(samples)
    };
    Ok(DecodedPicture { info, samples })
}

fn choose(headers: &[Header], path: &Path) -> Result<(PictureInfo, ChosenChannels), FormatError> {
    let chosen = exr_channels::choose(
        headers,
        path,
        |names| color_channels(names).map(|(_, found)| found),
        |seen| format!("no layer has channels R, G and B or Y (found: {seen}); save the picture as RGB"),
    )?;
    let names = channel_names(&headers[chosen.layer]);
    let alpha = color_channels(&names).is_some_and(|(prefix, _)| names.contains(&format!("{prefix}A")));
    let info = PictureInfo {
        width: chosen.width,
        height: chosen.height,
        channels: chosen.count,
        sample_type: if chosen.half { SampleType::F16 } else { SampleType::F32 },
        alpha,
        color_profile: None,
        orientation: None,
    };
    Ok((info, chosen))
}

/// The prefix ("" or "layer.") and the indices of R, G, B, or else of Y; names without prefix first.
fn color_channels(names: &[String]) -> Option<(String, Vec<usize>)> {
    prefixes(names).into_iter().find_map(|prefix| {
        let found =
            lettered(names, &prefix, &["R", "G", "B"]).or_else(|| lettered(names, &prefix, &["Y"]))?;
        Some((prefix, found))
    })
}
