//! `.exr`: the writer of OpenEXR files with a layer for each function.
//!
//! One part, channels `layer.R`, `layer.G`, `layer.B` or `layer.Y`, then `position.X`, `position.Y`,
//! `position.Z` where positions are known, ZIP compression. Each block of
//! 16 rows is compressed by the thread that completes it; the file is written when all are there.

use super::document;
use super::planar::{coefficients, precision};
use super::positions::{POINT, POSITION_CHANNELS};
use super::{
    AssetHeader, AssetPositions, AssetWriter, Created, WriteSettings, assert_shape, plane_bytes, plane_names,
};
use crate::{FormatError, OutputFile};
use exr::block::chunk::Chunk;
use exr::block::writer::ChunksWriter;
use exr::block::{BlockIndex, UncompressedBlock};
use exr::meta::BlockDescription;
use exr::meta::header::Header;
use exr::prelude::{AttributeValue, ChannelDescription, Compression, LineOrder, SampleType, Text, Vec2};
use half::f16;
use relight_core::CoefficientSpan;
use relight_texture::{PackReport, PlaneErrors, Precision, StoringErrors, TexelFormat};
use std::io::{BufWriter, Write};
use std::path::Path;
use std::sync::{Mutex, PoisonError};

/// The largest width and height: OpenEXR counts in i32.
const LARGEST_SIZE: usize = i32::MAX as usize;

/// One block of rows on its way to the file.
enum Block {
    /// Rows of channels in the file's order, and the number of pixels that are still to come.
    Filling { bytes: Vec<u8>, missing: usize },
    /// Compressed.
    Done(Chunk),
}

struct ExrWriter {
    header: AssetHeader,
    exr: Header,
    /// The plane of each channel in the order of the file, which sorts channels by name.
    planes: Vec<usize>,
    names: Vec<String>,
    precision: Precision,
    /// Every pixel's, where they are known.
    points: Option<Vec<[f32; 3]>>,
    blocks: Vec<Mutex<Block>>,
    errors: StoringErrors,
    file: OutputFile,
}

/// Starts an `.exr` asset; see [`super::AssetFormat::create`].
pub(super) fn create(
    path: &Path,
    header: AssetHeader,
    settings: &WriteSettings,
    positions: Option<AssetPositions>,
) -> Created {
    let (width, height) = (header.width, header.height);
    if width > LARGEST_SIZE || height > LARGEST_SIZE {
        let problem = format!("{width} x {height} is outside 1..{LARGEST_SIZE} of OpenEXR; write .ktx2");
        return Err(FormatError::invalid(path, problem));
    }
    let precision = precision(&header.packing);
    let limit = settings.memory_limit;
    let planes = plane_bytes(width, height, &header.model, TexelFormat::Plain { precision, channels: 1 });
    let points = positions.map(|positions| positions.map.points);
    let needed = planes.saturating_add(points.as_ref().map_or(0, |points| points.len() as u64 * POINT));
    if needed > limit || usize::try_from(needed).is_err() {
        let remedy = "raise --memory, or write .ktx2, which is streamed";
        return Err(FormatError::TooLarge { path: path.to_owned(), needed, limit, remedy });
    }
    let names = plane_names(&header.model);
    let mut planes: Vec<usize> = (0..names.len()).collect();
    planes.sort_by(|&a, &b| names[a].as_bytes().cmp(names[b].as_bytes()));
    let text = document::text_of(path, &header.model, None, None)?.line;
    let names_of_planes = planes.iter().map(|&plane| names[plane].as_str());
    let exr = exr_header(&header, precision, names_of_planes, points.is_some(), &text);
    let file = OutputFile::create(path)?;
    let rows = exr.compression.scan_lines_per_block();
    let block = |first: usize| {
        let missing = rows.min(height - first) * width;
        Mutex::new(Block::Filling { bytes: Vec::new(), missing })
    };
    let blocks = (0..height).step_by(rows).map(block).collect();
    let errors = StoringErrors::new(&header.model);
    Ok(Box::new(ExrWriter { header, exr, planes, names, precision, points, blocks, errors, file }))
}

fn exr_header<'a>(
    asset: &AssetHeader,
    precision: Precision,
    names: impl Iterator<Item = &'a str>,
    positions: bool,
    text: &str,
) -> Header {
    let sample = match precision {
        Precision::F32 => SampleType::F32,
        Precision::U8 | Precision::F16 => SampleType::F16,
    };
    let ascii = |text: &str| Text::from_slice_unchecked(text.as_bytes());
    // Coefficients are no perceived brightness: lossy compressors are told so.
    let channel = |name: &str| ChannelDescription::new(ascii(name), sample, true);
    let position = |name: &str| ChannelDescription::new(ascii(name), SampleType::F32, true);
    // OpenEXR sorts channels by name: p comes after the b with which those of planes begin.
    let channels =
        names.map(channel).chain(POSITION_CHANNELS.iter().filter(|_| positions).map(|name| position(name)));
    let size = Vec2(asset.width, asset.height);
    let mut header = Header::new(Text::default(), size, channels.collect()).with_encoding(
        Compression::ZIP16,
        BlockDescription::ScanLines,
        LineOrder::Increasing,
    );
    let attributes = &mut header.own_attributes;
    attributes.layer_name = None;
    attributes.software_name = Some(ascii(concat!("relight ", env!("CARGO_PKG_VERSION"))));
    attributes.other.insert(ascii(document::KEY), AttributeValue::Text(ascii(text)));
    header
}

/// The error of the exr crate as ours.
pub(super) fn format_error(path: &Path, action: &'static str, error: exr::error::Error) -> FormatError {
    match error {
        exr::error::Error::Aborted => FormatError::Cancelled,
        exr::error::Error::NotSupported(what) => {
            FormatError::unsupported(path, format!("OpenEXR feature that relight does not read: {what}"))
        }
        exr::error::Error::Invalid(what) => FormatError::invalid(path, format!("damaged OpenEXR: {what}")),
        exr::error::Error::Io(source) => FormatError::io(path, action, source),
    }
}

impl ExrWriter {
    fn rows_per_block(&self) -> usize {
        self.exr.compression.scan_lines_per_block()
    }

    /// Copies pixels `start..end` of `span`, which lie in the block that begins at row `top`, to
    /// that block's bytes, and adds what rounding them costs to the `errors` of their planes.
    fn fill(
        &self,
        span: &CoefficientSpan<'_>,
        (start, end): (usize, usize),
        top: usize,
        bytes: &mut [u8],
        errors: &mut [PlaneErrors],
    ) -> Result<(), FormatError> {
        let AssetHeader { width, model, .. } = &self.header;
        let sample_bytes = self.precision.bytes();
        let mut from = start;
        while from < end {
            let (x, y) = ((span.first + from) % width, (span.first + from) / width);
            let count = (width - x).min(end - from);
            for (channel, &plane) in self.planes.iter().enumerate() {
                let samples = coefficients(span, model, plane, from..from + count);
                let place = (((y - top) * self.planes.len() + channel) * width + x) * sample_bytes;
                let out = bytes[place..][..count * sample_bytes].chunks_exact_mut(sample_bytes);
                if self.precision == Precision::F32 {
                    out.zip(samples).for_each(|(out, c)| out.copy_from_slice(&c.to_ne_bytes()));
                    continue;
                }
                for (out, c) in out.zip(samples.clone()) {
                    let half = f16::from_f32(*c);
                    if half.is_infinite() {
                        return Err(self.too_large_for_half(plane, *c));
                    }
                    out.copy_from_slice(&half.to_ne_bytes());
                }
                let of_row = samples.map(|c| f16::from_f32(*c).to_f32() - c);
                errors[plane].add(span.first + from, of_row);
            }
            from += count;
        }
        Ok(())
    }

    fn too_large_for_half(&self, plane: usize, coefficient: f32) -> FormatError {
        let problem = format!(
            "coefficient {coefficient} in channel {} exceeds the 65504 of halves; use precision f32, or \
             write .ktx2, which scales them",
            self.names[plane]
        );
        FormatError::invalid(self.file.path(), problem)
    }

    fn compress(&self, block: usize, bytes: Vec<u8>) -> Result<Chunk, FormatError> {
        let (width, top) = (self.header.width, block * self.rows_per_block());
        let rows = self.rows_per_block().min(self.header.height - top);
        let bytes = match &self.points {
            Some(points) => with_positions(&bytes, &points[top * width..][..rows * width], width),
            None => bytes,
        };
        let index = BlockIndex {
            layer: 0,
            pixel_position: Vec2(0, top),
            pixel_size: Vec2(width, rows),
            level: Vec2(0, 0),
        };
        UncompressedBlock { index, data: bytes }
            .compress_to_chunk(std::slice::from_ref(&self.exr))
            .map_err(|e| format_error(self.file.path(), "write", e))
    }
}

/// Rows of a block with the channels of positions after those of the planes.
fn with_positions(planes: &[u8], points: &[[f32; 3]], width: usize) -> Vec<u8> {
    let rows = points.len() / width;
    let mut bytes = Vec::with_capacity(planes.len() + size_of_val(points));
    for (row, points) in planes.chunks_exact(planes.len() / rows).zip(points.chunks_exact(width)) {
        bytes.extend_from_slice(row);
        for axis in 0..3 {
            bytes.extend(points.iter().flat_map(|point| point[axis].to_ne_bytes()));
        }
    }
    bytes
}

impl AssetWriter for ExrWriter {
    fn write(&self, span: &CoefficientSpan<'_>) -> Result<(), FormatError> {
        assert_shape(&self.header, span);
        let (rows, height) = (self.rows_per_block(), self.header.height);
        let block_pixels = rows * self.header.width;
        let sample_bytes = self.precision.bytes();
        let (mut start, mut errors) = (0, vec![PlaneErrors::default(); self.planes.len()]);
        while start < span.pixels {
            let index = (span.first + start) / block_pixels;
            let end = ((index + 1) * block_pixels - span.first).min(span.pixels);
            let mut block = self.blocks[index].lock().unwrap_or_else(PoisonError::into_inner);
            if let Block::Filling { bytes, missing } = &mut *block {
                if bytes.is_empty() {
                    let pixels = rows.min(height - index * rows) * self.header.width;
                    bytes.resize(pixels * self.planes.len() * sample_bytes, 0);
                }
                self.fill(span, (start, end), index * rows, bytes, &mut errors)?;
                *missing = missing.saturating_sub(end - start);
                if *missing == 0 {
                    let bytes = std::mem::take(bytes);
                    *block = Block::Done(self.compress(index, bytes)?);
                }
            }
            start = end;
        }
        self.errors.add(span.first, errors);
        Ok(())
    }

    fn finish(self: Box<Self>) -> Result<PackReport, FormatError> {
        let Self { header, exr, blocks, errors, file, .. } = *self;
        let mut chunks = Vec::with_capacity(blocks.len());
        for (index, block) in blocks.into_iter().enumerate() {
            match block.into_inner().unwrap_or_else(PoisonError::into_inner) {
                Block::Done(chunk) => chunks.push(chunk),
                Block::Filling { missing, .. } => {
                    let problem = format!("{missing} pixels of block {index} were never written");
                    return Err(FormatError::invalid(file.path(), problem));
                }
            }
        }
        let mut out = BufWriter::with_capacity(1 << 20, file.file());
        exr::block::write(&mut out, [exr].into_iter().collect(), true, |_, writer| {
            chunks.into_iter().enumerate().try_for_each(|(index, chunk)| writer.write_chunk(index, chunk))
        })
        .map_err(|e| format_error(file.path(), "write", e))?;
        out.flush().map_err(|e| FormatError::io(file.path(), "write", e))?;
        drop(out);
        file.finish()?;
        Ok(errors.report(header.width * header.height))
    }
}
