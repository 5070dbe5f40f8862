//! Chosen channels of OpenEXR files, decoded block by block: half or float, scan lines or tiles
//! (largest level). The data window is the picture.

use crate::FormatError;
use crate::error::check_memory;
use exr::block::UncompressedBlock;
use exr::block::reader::{ChunksReader, Reader};
use exr::compression::Compression;
use exr::error::Error;
use exr::math::Vec2;
use exr::meta::BlockDescription;
use exr::meta::attribute::SampleType;
use exr::meta::header::Header;
use half::f16;
use std::collections::HashSet;
use std::fs::File;
use std::io::{BufReader, Read, Seek};
use std::panic::{AssertUnwindSafe, catch_unwind};
use std::path::Path;

/// The bytes with which files begin.
pub(crate) const MAGIC: &[u8] = &[0x76, 0x2f, 0x31, 0x01];

/// Opens a file and reads its headers.
///
/// # Errors
/// [`FormatError::Unsupported`] when it is no OpenEXR, [`FormatError::Invalid`] when it is damaged,
/// [`FormatError::Io`].
pub(crate) fn open(path: &Path) -> Result<Reader<BufReader<File>>, FormatError> {
    let file = File::open(path).map_err(|e| FormatError::io(path, "open", e))?;
    let mut file = BufReader::with_capacity(1 << 17, file);
    let mut start = Vec::new();
    (&mut file)
        .take(MAGIC.len() as u64)
        .read_to_end(&mut start)
        .and_then(|_| file.rewind())
        .map_err(|e| FormatError::io(path, "read", e))?;
    if start != MAGIC {
        return Err(FormatError::unsupported(path, "is no OpenEXR file; save it as .exr"));
    }
    Reader::read_from_buffered(file, false).map_err(|error| error_from_exr(error, path))
}

/// Which channels of which layer to read.
pub(crate) struct ChosenChannels {
    pub(crate) width: usize,
    pub(crate) height: usize,
    /// Index of the layer among the file's.
    pub(crate) layer: usize,
    /// How many channels are read.
    pub(crate) count: usize,
    /// Whether all of them are halves.
    pub(crate) half: bool,
    /// For each channel of the layer as stored, its place among the chosen ones.
    places: Vec<Option<usize>>,
    /// Bytes of a block in memory, compressed and not.
    pub(crate) block_bytes: u64,
}

impl ChosenChannels {
    /// Refuses pictures without pixels, and those that with `pixel_bytes` a pixel take more than `limit`.
    pub(crate) fn check_memory(&self, path: &Path, pixel_bytes: u64, limit: u64) -> Result<(), FormatError> {
        let Self { width, height, block_bytes, .. } = *self;
        if width == 0 || height == 0 {
            return Err(FormatError::invalid(path, format!("has {width} x {height} pixels, which are none")));
        }
        let pixels = (width as u64).saturating_mul(height as u64);
        let needed = pixels.saturating_mul(pixel_bytes).saturating_add(block_bytes);
        check_memory(needed, limit, path)
    }
}

/// The channels that `wanted` picks from the names of the first layer in which it finds some.
///
/// # Errors
/// [`FormatError::Unsupported`] with the words of `refusal`, which is given all names, when there is
/// no such layer, and for channels that can't be read.
pub(crate) fn choose(
    headers: &[Header],
    path: &Path,
    wanted: impl Fn(&[String]) -> Option<Vec<usize>>,
    refusal: impl FnOnce(&str) -> String,
) -> Result<ChosenChannels, FormatError> {
    let unsupported = |problem: String| Err(FormatError::unsupported(path, problem));
    let mut seen = Vec::new();
    for (layer, header) in headers.iter().enumerate() {
        let names = channel_names(header);
        if header.deep {
            seen.push("deep data".to_owned());
            continue;
        }
        let Some(found) = wanted(&names) else {
            seen.extend(names);
            continue;
        };
        if matches!(header.compression, Compression::DWAA(_) | Compression::DWAB(_)) {
            // exr 1.74 allocates what a DWA block says it will need: a damaged one aborts the process.
            let problem = "an EXR of DWA compression is not read; save it with ZIP or PIZ compression";
            return unsupported(problem.to_owned());
        }
        let channels = &header.channels.list;
        if channels.iter().any(|channel| channel.sampling != Vec2(1, 1)) {
            let problem = "an EXR with subsampled channels is not read; save it with full-resolution R, G, B";
            return unsupported(problem.to_owned());
        }
        if let Some(&at) = found.iter().find(|&&at| channels[at].sample_type == SampleType::U32) {
            let problem =
                format!("EXR channel {} holds 32-bit integers; save it as half or float", names[at]);
            return unsupported(problem);
        }
        let Vec2(width, height) = header.layer_size;
        let block = match header.blocks {
            BlockDescription::ScanLines => (width, header.compression.scan_lines_per_block()),
            BlockDescription::Tiles(tiles) => (tiles.tile_size.0, tiles.tile_size.1),
        };
        let pixels = |(width, height): (usize, usize)| (width as u64).saturating_mul(height as u64);
        let block =
            pixels(block).min(pixels((width, height))).saturating_mul(header.channels.bytes_per_pixel as u64);
        return Ok(ChosenChannels {
            width,
            height,
            layer,
            count: found.len(),
            half: found.iter().all(|&at| channels[at].sample_type == SampleType::F16),
            places: (0..channels.len()).map(|at| found.iter().position(|&f| f == at)).collect(),
            // The compressed bytes, the decoder's intermediate and the block itself.
            block_bytes: block.saturating_mul(3),
        });
    }
    let seen = if seen.is_empty() { "none".to_owned() } else { seen.join(", ") };
    unsupported(refusal(&seen))
}

/// The names of a layer's channels, in the order of the file.
pub(crate) fn channel_names(header: &Header) -> Vec<String> {
    header.channels.list.iter().map(|channel| channel.name.to_string()).collect()
}

/// Everything up to the last dot of each name, each once; names without one first.
pub(crate) fn prefixes(names: &[String]) -> Vec<String> {
    let mut prefixes = vec![String::new()];
    for name in names {
        let prefix = name.rfind('.').map_or(String::new(), |dot| name[..=dot].to_owned());
        if !prefixes.contains(&prefix) {
            prefixes.push(prefix);
        }
    }
    prefixes
}

/// The indices of the channels that `prefix` and each of `letters` name, when all are there.
pub(crate) fn lettered(names: &[String], prefix: &str, letters: &[&str]) -> Option<Vec<usize>> {
    let index = |letter: &&str| names.iter().position(|name| *name == format!("{prefix}{letter}"));
    letters.iter().map(index).collect()
}

/// Hands every sample of the chosen channels to `put`, with its index in the picture: pixel x count of
/// channels + place of the channel.
pub(crate) fn read_blocks<R: Read + Seek>(
    reader: Reader<R>,
    chosen: &ChosenChannels,
    path: &Path,
    mut put: impl FnMut(usize, SampleType, &[u8]),
) -> Result<(), FormatError> {
    let failed = |error| error_from_exr(error, path);
    let is_wanted = |layer: usize, level: Vec2<usize>| layer == chosen.layer && level == Vec2(0, 0);
    let mut chunks =
        reader.filter_chunks(false, |_, _, block| is_wanted(block.layer, block.level)).map_err(failed)?;
    let meta = chunks.meta_data().clone();
    let list = &meta.headers[chosen.layer].channels;
    let ChosenChannels { width, height, count, .. } = *chosen;
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
            let Some(place) = chosen.places[line.location.channel] else { continue };
            let channel = list.list[line.location.channel].sample_type;
            let start = line.location.position.1 * width + line.location.position.0;
            for (pixel, bytes) in line.value.chunks_exact(channel.bytes_per_sample()).enumerate() {
                put((start + pixel) * count + place, channel, bytes);
            }
        }
    }
    Ok(())
}

/// A sample of [`read_blocks`].
pub(crate) fn float_of(channel: SampleType, bytes: &[u8]) -> f32 {
    match (channel, bytes) {
        (SampleType::F32, &[a, b, c, d]) => f32::from_ne_bytes([a, b, c, d]),
        _ => f16::from_ne_bytes([bytes[0], bytes[1]]).to_f32(),
    }
}

/// The exr crate panics on some damaged files: to the caller that is a damaged file.
pub(crate) fn guarded<T>(
    path: &Path,
    work: impl FnOnce() -> Result<T, FormatError>,
) -> Result<T, FormatError> {
    catch_unwind(AssertUnwindSafe(work))
        .unwrap_or_else(|_| Err(FormatError::invalid(path, "damaged OpenEXR: its decoder gave up")))
}

fn damaged(path: &Path, cause: impl std::fmt::Display) -> FormatError {
    FormatError::invalid(path, format!("truncated or damaged EXR: {cause}; copy it again"))
}

/// The error of the exr crate as ours.
pub(crate) fn error_from_exr(error: Error, path: &Path) -> FormatError {
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
