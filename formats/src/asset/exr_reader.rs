//! `.exr`: the reader of assets that [`super::exr`] wrote.

use super::document::Document;
use super::exr::format_error;
use super::{AssetHeader, Details, document, open, planar, plane_bytes, plane_names};
use crate::FormatError;
use exr::block::lines::LineRef;
use exr::block::reader::{ChunksReader, Reader};
use exr::meta::BlockDescription;
use exr::meta::header::Header;
use exr::prelude::{AttributeValue, SampleType, Text, Vec2};
use half::f16;
use relight_core::{RelightingMap, RelightingMaps, Texels};
use relight_texture::{Precision, Quantizer, TexelFormat};
use std::fs::File;
use std::io::BufReader;
use std::panic::{AssertUnwindSafe, catch_unwind};
use std::path::Path;

struct ExrFile {
    reader: Reader<BufReader<File>>,
    header: AssetHeader,
    precision: Precision,
    compression: String,
    /// The plane of each channel in the order of the file.
    planes: Vec<usize>,
}

/// Reads an `.exr` asset; see [`super::read_asset`].
pub(super) fn read(path: &Path, memory_limit: u64) -> Result<RelightingMaps, FormatError> {
    guarded(path, || {
        let exr = open_exr(path)?;
        let AssetHeader { width, height, model, .. } = &exr.header;
        let format = TexelFormat::Plain { precision: exr.precision, channels: 1 };
        let needed = plane_bytes(*width, *height, model, format);
        if needed > memory_limit || usize::try_from(needed).is_err() {
            return Err(FormatError::too_large(path, needed, memory_limit));
        }
        read_planes(path, exr)
    })
}

/// See [`super::summarize_asset`].
pub(super) fn summarize(path: &Path) -> Result<(AssetHeader, Details), FormatError> {
    guarded(path, || {
        let exr = open_exr(path)?;
        let rows = vec![
            ("compression".to_owned(), exr.compression),
            ("channels".to_owned(), exr.planes.len().to_string()),
        ];
        Ok((exr.header, Details { rows, ..Details::default() }))
    })
}

/// The exr crate panics on some damaged files: to the caller that is a damaged file.
fn guarded<T>(path: &Path, work: impl FnOnce() -> Result<T, FormatError>) -> Result<T, FormatError> {
    catch_unwind(AssertUnwindSafe(work))
        .unwrap_or_else(|_| Err(FormatError::invalid(path, "damaged OpenEXR: its decoder gave up")))
}

/// Reads and checks everything but the pixels.
fn open_exr(path: &Path) -> Result<ExrFile, FormatError> {
    let unsupported = |problem: &str| Err(FormatError::unsupported(path, problem));
    let file = BufReader::with_capacity(1 << 20, open(path)?);
    let reader = Reader::read_from_buffered(file, false).map_err(|e| format_error(path, "read", e))?;
    let [exr] = reader.headers() else {
        return unsupported("has several parts; relight reads its own single-part OpenEXR");
    };
    let key = Text::from_slice_unchecked(document::KEY.as_bytes());
    let Some(AttributeValue::Text(text)) = exr.own_attributes.other.get(&key) else {
        return unsupported("has no attribute 'relight': it is a picture, but no asset of relight");
    };
    if exr.deep || exr.blocks != BlockDescription::ScanLines {
        return unsupported("is deep or tiled; relight reads OpenEXR in scan lines");
    }
    let Document::Asset(model, _) = document::parse(path, text.as_slice())? else {
        return unsupported("is part of an asset of textures, but is no texture");
    };
    let planes = planes_of_channels(path, exr, &plane_names(&model))?;
    let precision = match exr.channels.uniform_sample_type {
        Some(SampleType::F16) => Precision::F16,
        Some(SampleType::F32) => Precision::F32,
        _ => return unsupported("has channels that are not all half or all float"),
    };
    let Vec2(width, height) = exr.layer_size;
    if width == 0 || height == 0 {
        return Err(FormatError::invalid(path, "has no pixels"));
    }
    let compression = exr.compression.to_string();
    let plain = Quantizer { scale: 1.0, bias: 0.0 };
    let packing = planar::packing(precision, std::iter::repeat_n(plain, model.plane_count()));
    let header = AssetHeader { width, height, model: *model, packing };
    Ok(ExrFile { reader, header, precision, compression, planes })
}

/// Which plane each channel holds, when they are those of the asset, each once.
fn planes_of_channels(path: &Path, exr: &Header, names: &[String]) -> Result<Vec<usize>, FormatError> {
    let invalid = |problem: String| FormatError::invalid(path, problem);
    let channels = &exr.channels.list;
    if channels.iter().any(|channel| channel.sampling != Vec2(1, 1)) {
        return Err(FormatError::unsupported(path, "has subsampled channels; relight reads full ones"));
    }
    let mut planes = vec![0; channels.len()];
    for (plane, name) in names.iter().enumerate() {
        let channel = channels.iter().position(|channel| channel.name.as_slice() == name.as_bytes());
        planes[channel.ok_or_else(|| invalid(format!("has no channel {name}")))?] = plane;
    }
    if channels.len() != names.len() {
        let (found, expected) = (channels.len(), names.len());
        return Err(invalid(format!("has {found} channels where its asset has {expected}")));
    }
    Ok(planes)
}

fn read_planes(path: &Path, exr: ExrFile) -> Result<RelightingMaps, FormatError> {
    let ExrFile { reader, header, precision, planes: plane_of_channel, .. } = exr;
    let AssetHeader { width, height, model, .. } = header;
    let empty = || match precision {
        Precision::F32 => Texels::F32(vec![0.0; width * height]),
        Precision::U8 | Precision::F16 => Texels::F16(vec![f16::ZERO; width * height]),
    };
    let mut planes: Vec<RelightingMap> =
        (0..model.plane_count()).map(|_| RelightingMap { scale: 1.0, bias: 0.0, texels: empty() }).collect();
    let mut seen = vec![false; height];
    let exr_error = |e| format_error(path, "read", e);
    let chunks = reader.all_chunks(false).map_err(exr_error)?;
    let channels = chunks.headers()[0].channels.clone();
    chunks
        .decompress_sequential(false, |_, block| {
            for line in block.lines(&channels) {
                let plane = &mut planes[plane_of_channel[line.location.channel]];
                let y = line.location.position.y();
                copy_line(&mut plane.texels, y * width, line)?;
                seen[y] = true;
            }
            Ok(())
        })
        .map_err(exr_error)?;
    if let Some(row) = seen.iter().position(|seen| !seen) {
        return Err(FormatError::invalid(path, format!("damaged OpenEXR: row {row} is missing")));
    }
    Ok(RelightingMaps { width, height, model, planes })
}

fn copy_line(texels: &mut Texels, first: usize, line: LineRef<'_>) -> exr::error::UnitResult {
    let range = first..first + line.location.sample_count;
    match texels {
        Texels::F16(halves) => line.read_samples_into_slice(&mut halves[range]),
        Texels::F32(floats) => line.read_samples_into_slice(&mut floats[range]),
        // Never made by `read_planes`.
        Texels::U8(_) => Ok(()),
    }
}
