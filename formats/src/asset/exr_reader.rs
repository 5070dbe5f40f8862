//! `.exr`: the reader of assets that [`super::exr`] wrote.

use super::document::Document;
use super::exr::format_error;
use super::positions::{POINT, POSITION_CHANNELS};
use super::{AssetHeader, Details, document, open, planar, plane_bytes, plane_names};
use crate::FormatError;
use crate::exr_channels::guarded;
use exr::block::lines::LineRef;
use exr::block::reader::{ChunksReader, Reader};
use exr::meta::BlockDescription;
use exr::meta::header::Header;
use exr::prelude::{AttributeValue, SampleType, Text, Vec2};
use half::f16;
use relight_core::{NO_SURFACE, PointKind, PositionMap, RelightingMap, RelightingMaps, Texels};
use relight_texture::{PositionPlan, Precision, Quantizer, TexelFormat};
use std::fs::File;
use std::io::BufReader;
use std::path::Path;

struct ExrFile {
    reader: Reader<BufReader<File>>,
    header: AssetHeader,
    precision: Precision,
    compression: String,
    /// What each channel holds, in the order of the file.
    contents: Vec<Content>,
}

/// What a channel holds.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Content {
    /// A plane of the model.
    Plane(usize),
    /// x, y or z of positions.
    Axis(usize),
}

impl ExrFile {
    fn has_positions(&self) -> bool {
        self.contents.contains(&Content::Axis(0))
    }
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

/// Reads the positions; see [`super::read_positions`].
pub(super) fn read_positions(path: &Path, memory_limit: u64) -> Result<Option<PositionMap>, FormatError> {
    guarded(path, || {
        let exr = open_exr(path)?;
        let AssetHeader { width, height, .. } = exr.header;
        if !exr.has_positions() {
            return Ok(None);
        }
        let needed = (width as u64).saturating_mul(height as u64).saturating_mul(POINT);
        if needed > memory_limit || usize::try_from(needed).is_err() {
            return Err(FormatError::too_large(path, needed, memory_limit));
        }
        let mut points = vec![NO_SURFACE; width * height];
        let mut row = vec![0.0; width];
        for_each_line(path, exr, |content, line| {
            let Content::Axis(axis) = content else { return Ok(()) };
            let count = line.location.sample_count;
            let first = line.location.position.y() * width + line.location.position.x();
            line.read_samples_into_slice(&mut row[..count])?;
            for (point, value) in points[first..first + count].iter_mut().zip(&row) {
                point[axis] = *value;
            }
            Ok(())
        })?;
        for point in points.iter_mut().filter(|point| PointKind::of(**point) == PointKind::Missing) {
            *point = NO_SURFACE;
        }
        Ok(Some(PositionMap { width, height, points }))
    })
}

/// See [`super::summarize_asset`].
pub(super) fn summarize(path: &Path) -> Result<(AssetHeader, Details), FormatError> {
    guarded(path, || {
        let exr = open_exr(path)?;
        let rows = vec![
            ("compression".to_owned(), exr.compression.clone()),
            ("channels".to_owned(), exr.contents.len().to_string()),
        ];
        let plan = PositionPlan { precision: Precision::F32, scale: [1.0; 3], bias: [0.0; 3] };
        let positions = exr.has_positions().then_some(plan);
        Ok((exr.header, Details { rows, positions, ..Details::default() }))
    })
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
    let contents = contents_of_channels(path, exr, &plane_names(&model))?;
    let samples = |wanted: fn(&Content) -> bool| {
        let channels = exr.channels.list.iter().zip(&contents);
        let mut samples =
            channels.filter(move |(_, content)| wanted(content)).map(|(channel, _)| channel.sample_type);
        let first = samples.next();
        first.filter(|first| samples.all(|sample| sample == *first))
    };
    let precision = match samples(|content| matches!(content, Content::Plane(_))) {
        Some(SampleType::F16) => Precision::F16,
        Some(SampleType::F32) => Precision::F32,
        _ => return unsupported("has channels that are not all half or all float"),
    };
    if contents.contains(&Content::Axis(0))
        && samples(|content| matches!(content, Content::Axis(_))) != Some(SampleType::F32)
    {
        return unsupported("has positions that are not float");
    }
    let Vec2(width, height) = exr.layer_size;
    if width == 0 || height == 0 {
        return Err(FormatError::invalid(path, "has no pixels"));
    }
    let compression = exr.compression.to_string();
    let plain = Quantizer { scale: 1.0, bias: 0.0 };
    let packing = planar::packing(precision, std::iter::repeat_n(plain, model.plane_count()));
    let header = AssetHeader { width, height, model: *model, packing };
    Ok(ExrFile { reader, header, precision, compression, contents })
}

/// What each channel holds, when they are those of the asset, each once, and perhaps positions.
fn contents_of_channels(path: &Path, exr: &Header, names: &[String]) -> Result<Vec<Content>, FormatError> {
    let invalid = |problem: String| FormatError::invalid(path, problem);
    let channels = &exr.channels.list;
    if channels.iter().any(|channel| channel.sampling != Vec2(1, 1)) {
        return Err(FormatError::unsupported(path, "has subsampled channels; relight reads full ones"));
    }
    let find = |name: &str| channels.iter().position(|channel| channel.name.as_slice() == name.as_bytes());
    let mut contents = vec![None; channels.len()];
    for (plane, name) in names.iter().enumerate() {
        let channel = find(name).ok_or_else(|| invalid(format!("has no channel {name}")))?;
        contents[channel] = Some(Content::Plane(plane));
    }
    let axes = POSITION_CHANNELS.map(find);
    if let [Some(x), Some(y), Some(z)] = axes {
        [x, y, z].into_iter().enumerate().for_each(|(axis, at)| contents[at] = Some(Content::Axis(axis)));
    }
    let (found, known) = (channels.len(), contents.iter().flatten().count());
    let contents: Option<Vec<Content>> = contents.into_iter().collect();
    contents.ok_or_else(|| invalid(format!("has {found} channels where its asset has {known}")))
}

fn read_planes(path: &Path, exr: ExrFile) -> Result<RelightingMaps, FormatError> {
    let AssetHeader { width, height, ref model, .. } = exr.header;
    let (model, precision) = (model.clone(), exr.precision);
    let empty = || match precision {
        Precision::F32 => Texels::F32(vec![0.0; width * height]),
        Precision::U8 | Precision::F16 => Texels::F16(vec![f16::ZERO; width * height]),
    };
    let mut planes: Vec<RelightingMap> =
        (0..model.plane_count()).map(|_| RelightingMap { scale: 1.0, bias: 0.0, texels: empty() }).collect();
    for_each_line(path, exr, |content, line| match content {
        Content::Plane(plane) => {
            let first = line.location.position.y() * width;
            copy_line(&mut planes[plane].texels, first, line)
        }
        Content::Axis(_) => Ok(()),
    })?;
    Ok(RelightingMaps { width, height, model, planes })
}

/// Hands on a row of each channel at a time; all rows come.
fn for_each_line(
    path: &Path,
    exr: ExrFile,
    mut take: impl FnMut(Content, LineRef<'_>) -> exr::error::UnitResult,
) -> Result<(), FormatError> {
    let ExrFile { reader, header, contents, .. } = exr;
    let mut seen = vec![false; header.height];
    let exr_error = |e| format_error(path, "read", e);
    let chunks = reader.all_chunks(false).map_err(exr_error)?;
    let channels = chunks.headers()[0].channels.clone();
    chunks
        .decompress_sequential(false, |_, block| {
            for line in block.lines(&channels) {
                seen[line.location.position.y()] = true;
                take(contents[line.location.channel], line)?;
            }
            Ok(())
        })
        .map_err(exr_error)?;
    match seen.iter().position(|seen| !seen) {
        Some(row) => Err(FormatError::invalid(path, format!("damaged OpenEXR: row {row} is missing"))),
        None => Ok(()),
    }
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
