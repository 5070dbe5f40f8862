//! OpenEXR through the `exr` crate: the first layer that has R, G and B, or else Y, as half or
//! float, scan lines or tiles (largest level). The data window is the picture; halves stay halves.

use super::{DecodedPicture, PictureInfo, SampleType, Samples, Source, check_memory, checked_size, pixels};
use crate::FormatError;
use exr::block::UncompressedBlock;
use exr::block::reader::{ChunksReader, Reader};
use exr::compression::Compression;
use exr::error::Error;
use exr::math::Vec2;
use exr::meta::BlockDescription;
use exr::meta::attribute::SampleType as ChannelType;
use exr::meta::header::Header;
use half::f16;
use relight_core::CpuLevel;
use std::collections::HashSet;
use std::io::Cursor;
use std::path::Path;

pub(super) fn is_magic(bytes: &[u8]) -> bool {
    bytes.starts_with(&[0x76, 0x2f, 0x31, 0x01])
}

pub(super) fn probe(source: &mut dyn Source, path: &Path) -> Result<PictureInfo, FormatError> {
    let reader = exr::block::read(source, false).map_err(|error| error_from_exr(error, path))?;
    Ok(choose(reader.headers(), path)?.info)
}

pub(super) fn decode(
    bytes: &[u8],
    path: &Path,
    _level: CpuLevel,
    memory_limit: u64,
) -> Result<DecodedPicture, FormatError> {
    let failed = |error| error_from_exr(error, path);
    let reader = exr::block::read(Cursor::new(bytes), false).map_err(failed)?;
    let choice = choose(reader.headers(), path)?;
    let info = checked_size(choice.info.clone(), path)?;
    let needed = info.bytes().saturating_add(choice.block_bytes).saturating_add(bytes.len() as u64);
    check_memory(needed, memory_limit, path)?;
    let length = info.width * info.height * info.channels;
    let samples = if info.sample_type == SampleType::F16 {
        let mut samples = vec![f16::ZERO; length];
        read_blocks(reader, &choice, path, |at, _, bytes| {
            samples[at] = f16::from_ne_bytes([bytes[0], bytes[1]]);
        })?;
        Samples::F16(samples)
    } else {
        let mut samples = vec![0.0f32; length];
        read_blocks(reader, &choice, path, |at, channel, bytes| {
            samples[at] = match (channel, bytes) {
                (ChannelType::F32, &[a, b, c, d]) => f32::from_ne_bytes([a, b, c, d]),
                _ => f16::from_ne_bytes([bytes[0], bytes[1]]).to_f32(),
            };
        })?;
        Samples::F32(samples)
    };
    Ok(DecodedPicture { info, samples })
}

/// The layer to read.
struct Choice {
    info: PictureInfo,
    layer: usize,
    /// For each channel of the layer as stored, its place among R, G, B (or Y).
    places: Vec<Option<usize>>,
    /// Bytes of a block in memory, compressed and not.
    block_bytes: u64,
}

fn choose(headers: &[Header], path: &Path) -> Result<Choice, FormatError> {
    let unsupported = |problem: String| FormatError::unsupported(path, problem);
    let mut seen = Vec::new();
    for (layer, header) in headers.iter().enumerate() {
        let names: Vec<String> =
            header.channels.list.iter().map(|channel| channel.name.to_string()).collect();
        if header.deep {
            seen.push("deep data".to_owned());
            continue;
        }
        let Some((prefix, found)) = color_channels(&names) else {
            seen.extend(names);
            continue;
        };
        if matches!(header.compression, Compression::DWAA(_) | Compression::DWAB(_)) {
            // exr 1.74 allocates what a DWA block says it will need: a damaged one aborts the process.
            let problem = "an EXR of DWA compression is not read; save it with ZIP or PIZ compression";
            return Err(unsupported(problem.to_owned()));
        }
        let channels = &header.channels.list;
        if channels.iter().any(|channel| channel.sampling != Vec2(1, 1)) {
            let problem = "an EXR with subsampled channels is not read; save it with full-resolution R, G, B";
            return Err(unsupported(problem.to_owned()));
        }
        if let Some(&at) = found.iter().find(|&&at| channels[at].sample_type == ChannelType::U32) {
            let problem =
                format!("EXR channel {} holds 32-bit integers; save it as half or float", names[at]);
            return Err(unsupported(problem));
        }
        let is_half = found.iter().all(|&at| channels[at].sample_type == ChannelType::F16);
        let Vec2(width, height) = header.layer_size;
        let block = match header.blocks {
            BlockDescription::ScanLines => pixels(width, header.compression.scan_lines_per_block()),
            BlockDescription::Tiles(tiles) => pixels(tiles.tile_size.0, tiles.tile_size.1),
        };
        let block = block.min(pixels(width, height)).saturating_mul(header.channels.bytes_per_pixel as u64);
        let alpha = format!("{prefix}A");
        return Ok(Choice {
            info: PictureInfo {
                width,
                height,
                channels: found.len(),
                sample_type: if is_half { SampleType::F16 } else { SampleType::F32 },
                alpha: names.contains(&alpha),
                color_profile: None,
                orientation: None,
            },
            layer,
            places: (0..channels.len()).map(|at| found.iter().position(|&f| f == at)).collect(),
            // The compressed bytes, the decoder's intermediate and the block itself.
            block_bytes: block.saturating_mul(3),
        });
    }
    Err(unsupported(format!(
        "no layer has channels R, G and B or Y (found: {}); save the picture as RGB",
        if seen.is_empty() { "none".to_owned() } else { seen.join(", ") }
    )))
}

/// The prefix ("" or "layer.") and the indices of R, G, B, or else of Y; names without prefix first.
fn color_channels(names: &[String]) -> Option<(String, Vec<usize>)> {
    let mut prefixes = vec![String::new()];
    for name in names {
        let prefix = name.rfind('.').map_or(String::new(), |dot| name[..=dot].to_owned());
        if !prefixes.contains(&prefix) {
            prefixes.push(prefix);
        }
    }
    prefixes.into_iter().find_map(|prefix| {
        let index = |letter: &str| names.iter().position(|name| *name == format!("{prefix}{letter}"));
        let rgb: Option<Vec<usize>> = ["R", "G", "B"].into_iter().map(index).collect();
        let found = rgb.or_else(|| index("Y").map(|y| vec![y]))?;
        Some((prefix, found))
    })
}

/// Hands every sample of the chosen channels to `put`, with its index in the picture.
fn read_blocks<R: std::io::Read + std::io::Seek>(
    reader: Reader<R>,
    choice: &Choice,
    path: &Path,
    mut put: impl FnMut(usize, ChannelType, &[u8]),
) -> Result<(), FormatError> {
    let failed = |error| error_from_exr(error, path);
    let is_wanted = |layer: usize, level: Vec2<usize>| layer == choice.layer && level == Vec2(0, 0);
    let mut chunks =
        reader.filter_chunks(false, |_, _, block| is_wanted(block.layer, block.level)).map_err(failed)?;
    let meta = chunks.meta_data().clone();
    let list = &meta.headers[choice.layer].channels;
    let PictureInfo { width, height, channels, .. } = choice.info;
    // As many blocks are read as the picture has: when none comes twice, none is missing.
    let mut positions = HashSet::new();
    while let Some(chunk) = chunks.read_next_chunk() {
        let block = chunk.and_then(|chunk| UncompressedBlock::decompress_chunk(chunk, &meta, false));
        let block = block.map_err(failed)?;
        let index = block.index;
        let (Vec2(x, y), Vec2(across, down)) = (index.pixel_position, index.pixel_size);
        let is_inside = x + across <= width && y + down <= height;
        if !is_wanted(index.layer, index.level) || !is_inside || !positions.insert((x, y)) {
            return Err(damaged(path, "its table of blocks is wrong"));
        }
        for line in block.lines(list) {
            let Some(place) = choice.places[line.location.channel] else { continue };
            let channel = list.list[line.location.channel].sample_type;
            let start = line.location.position.1 * width + line.location.position.0;
            for (pixel, bytes) in line.value.chunks_exact(channel.bytes_per_sample()).enumerate() {
                put((start + pixel) * channels + place, channel, bytes);
            }
        }
    }
    Ok(())
}

fn damaged(path: &Path, cause: impl std::fmt::Display) -> FormatError {
    FormatError::invalid(path, format!("truncated or damaged EXR: {cause}; copy it again"))
}

fn error_from_exr(error: Error, path: &Path) -> FormatError {
    match error {
        Error::NotSupported(what) => FormatError::unsupported(
            path,
            format!(
                "an EXR of a kind that is not read: {what}; save it as flat RGB with ZIP or PIZ compression"
            ),
        ),
        Error::Io(source) if source.kind() != std::io::ErrorKind::UnexpectedEof => {
            FormatError::io(path, "read", source)
        }
        error => damaged(path, error),
    }
}
