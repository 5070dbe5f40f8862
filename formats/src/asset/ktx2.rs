//! `.ktx2`: how maps lie in the layers of an array texture, and the writer.
//!
//! Source: KTX File Format Specification 2.0; docs/formats.md for the key of our own.

use super::document::{self, Layer};
use super::texels::TexelBuffer;
use super::{AssetHeader, AssetWriter, assert_shape, check_complete, quantizers};
use crate::{FormatError, OutputFile};
use ktx2::{Format, Header, Index, LevelIndex};
use relight_core::CoefficientRange;
use relight_core::{CoefficientSpan, Layout, Model};
use relight_texture::{Precision, Quantizer};
use std::path::Path;
use std::sync::atomic::{AtomicUsize, Ordering};

/// Pixels that are turned into texels at a time: their texels stay in the L2 cache.
const PIECE: usize = 4096;

/// The texel formats of assets, with their precision and channels.
pub(super) const TEXEL_FORMATS: [(Format, Precision, usize); 6] = [
    (Format::R8G8B8A8_UNORM, Precision::U8, 4),
    (Format::R16G16B16A16_SFLOAT, Precision::F16, 4),
    (Format::R32G32B32A32_SFLOAT, Precision::F32, 4),
    (Format::R8_UNORM, Precision::U8, 1),
    (Format::R16_SFLOAT, Precision::F16, 1),
    (Format::R32_SFLOAT, Precision::F32, 1),
];

/// The planes in the channels of each layer.
///
/// RGB: the three planes of a function. Grey: its one. LRGB: luminance planes four to a layer, then
/// the base colour in a layer of its own.
fn planes_of_layers(model: &Model) -> Vec<Vec<usize>> {
    let functions: Vec<usize> = (0..model.basis.count()).collect();
    match model.layout {
        Layout::Grey => functions.iter().map(|&j| vec![j]).collect(),
        Layout::Rgb => functions.iter().map(|&j| (3 * j..3 * j + 3).collect()).collect(),
        Layout::Lrgb => {
            let base = functions.len()..functions.len() + 3;
            functions.chunks(4).map(<[usize]>::to_vec).chain([base.collect()]).collect()
        }
    }
}

struct LayerPlan {
    planes: Vec<usize>,
    quantizers: Vec<Quantizer>,
    /// Where its texels begin in the file.
    offset: u64,
}

struct Ktx2Writer {
    header: AssetHeader,
    channels: usize,
    layers: Vec<LayerPlan>,
    written: AtomicUsize,
    file: OutputFile,
}

/// Starts a `.ktx2` asset; see [`super::AssetFormat::create`].
pub(super) fn create(
    path: &Path,
    header: AssetHeader,
    ranges: &[CoefficientRange],
    _memory_limit: u64,
) -> Result<Box<dyn AssetWriter>, FormatError> {
    let too_large = |what| FormatError::invalid(path, format!("{what} exceed what KTX2 can count"));
    let quantizers = match header.precision {
        // Floats are stored as they are, whatever range a caller may know.
        Precision::F32 => quantizers(path, &header, &[])?,
        Precision::U8 | Precision::F16 => quantizers(path, &header, ranges)?,
    };
    let channels = if header.model.layout == Layout::Grey { 1 } else { 4 };
    let planes = planes_of_layers(&header.model);
    let records = planes
        .iter()
        .map(|planes| Layer {
            planes: planes.clone(),
            scale: planes.iter().map(|&plane| quantizers[plane].scale).collect(),
            bias: planes.iter().map(|&plane| quantizers[plane].bias).collect(),
        })
        .collect();
    let text = document::text_of(path, &header.model, Some(records))?;
    let texel_bytes = (channels * header.precision.bytes()) as u64;
    let layer_bytes = (header.width as u64)
        .checked_mul(header.height as u64)
        .and_then(|pixels| pixels.checked_mul(texel_bytes))
        .ok_or_else(|| too_large("the pixels"))?;
    let level_bytes = layer_bytes.checked_mul(planes.len() as u64).ok_or_else(|| too_large("the layers"))?;
    let head = head(path, &header, channels, planes.len(), level_bytes, &text)?;

    let file = OutputFile::create(path)?;
    file.write_at(0, &head)?;
    let layers = planes
        .into_iter()
        .enumerate()
        .map(|(layer, planes)| LayerPlan {
            quantizers: planes.iter().map(|&plane| quantizers[plane]).collect(),
            planes,
            offset: head.len() as u64 + layer as u64 * layer_bytes,
        })
        .collect();
    Ok(Box::new(Ktx2Writer { header, channels, layers, written: AtomicUsize::new(0), file }))
}

/// Everything before the texels: header, indices, data format descriptor, keys and padding.
fn head(
    path: &Path,
    asset: &AssetHeader,
    channels: usize,
    layers: usize,
    level_bytes: u64,
    text: &str,
) -> Result<Vec<u8>, FormatError> {
    let dimension = |value: usize, name: &str| {
        u32::try_from(value).map_err(|_| {
            FormatError::invalid(path, format!("{name} {value} is outside 1..4294967295 of KTX2"))
        })
    };
    let invalid = |e: &dyn std::fmt::Display| FormatError::invalid(path, e.to_string());
    let (format, ..) = TEXEL_FORMATS
        .into_iter()
        .find(|&(_, precision, count)| (precision, count) == (asset.precision, channels))
        .ok_or_else(|| invalid(&"no texel format for these channels"))?;
    let (descriptor, type_size) = ktx2::dfd::Basic::from_format(format).map_err(|e| invalid(&e))?;
    let descriptor = ktx2::dfd::Block::Basic(descriptor).to_vec();
    let descriptor_length = 4 + descriptor.len() as u32;
    let keys = key_values(&[
        ("KTXorientation", "rd"),
        ("KTXwriter", concat!("relight ", env!("CARGO_PKG_VERSION"))),
        (document::KEY, text),
    ]);

    let descriptor_offset = (Header::LENGTH + LevelIndex::LENGTH) as u32;
    let keys_offset = descriptor_offset + descriptor_length;
    // Levels begin at a multiple of the texel size and of 4.
    let alignment = (channels * asset.precision.bytes()).max(4) as u64;
    let level_offset = (u64::from(keys_offset) + keys.len() as u64).next_multiple_of(alignment);
    let header = Header {
        format: Some(format),
        type_size,
        pixel_width: dimension(asset.width, "width")?,
        pixel_height: dimension(asset.height, "height")?,
        pixel_depth: 0,
        layer_count: layers as u32,
        face_count: 1,
        level_count: 1,
        supercompression_scheme: None,
        index: Index {
            dfd_byte_offset: descriptor_offset,
            dfd_byte_length: descriptor_length,
            kvd_byte_offset: keys_offset,
            kvd_byte_length: keys.len() as u32,
            sgd_byte_offset: 0,
            sgd_byte_length: 0,
        },
    };
    let level = LevelIndex {
        byte_offset: level_offset,
        byte_length: level_bytes,
        uncompressed_byte_length: level_bytes,
    };
    let mut bytes = header.as_bytes().to_vec();
    bytes.extend(level.as_bytes());
    bytes.extend(descriptor_length.to_le_bytes());
    bytes.extend(descriptor);
    bytes.extend(keys);
    bytes.resize(level_offset as usize, 0);
    Ok(bytes)
}

/// The key/value section of pairs that are sorted by key; values are text and end with NUL.
fn key_values(pairs: &[(&str, &str)]) -> Vec<u8> {
    let mut bytes = Vec::new();
    for (key, value) in pairs {
        let length = key.len() + value.len() + 2;
        bytes.extend((length as u32).to_le_bytes());
        bytes.extend(key.as_bytes());
        bytes.push(0);
        bytes.extend(value.as_bytes());
        bytes.push(0);
        bytes.resize(bytes.len().next_multiple_of(4), 0);
    }
    bytes
}

impl AssetWriter for Ktx2Writer {
    fn write(&self, span: &CoefficientSpan<'_>) -> Result<(), FormatError> {
        assert_shape(&self.header, span);
        let AssetHeader { model, precision, .. } = &self.header;
        let (functions, channels) = (model.basis.count(), self.channels);
        let texel_bytes = (channels * precision.bytes()) as u64;
        let mut buffer = TexelBuffer::default();
        for layer in &self.layers {
            for start in (0..span.pixels).step_by(PIECE) {
                let end = (start + PIECE).min(span.pixels);
                let row = |j: usize| &span.functions[j * span.pixels..][start..end];
                let first = layer.planes[0];
                let bytes = match model.layout {
                    Layout::Rgb => {
                        let rgb = &span.functions[first * span.pixels..][3 * start..3 * end];
                        buffer.rgba_from_rgb(*precision, rgb, &layer.quantizers)
                    }
                    Layout::Lrgb if first == functions => {
                        let rgb = &span.base_color[3 * start..3 * end];
                        buffer.rgba_from_rgb(*precision, rgb, &layer.quantizers)
                    }
                    Layout::Lrgb | Layout::Grey => {
                        let rows: Vec<_> = layer.planes.iter().map(|&plane| row(plane)).collect();
                        buffer.texels_from_rows(*precision, &rows, &layer.quantizers, channels)
                    }
                };
                self.file.write_at(layer.offset + (span.first + start) as u64 * texel_bytes, bytes)?;
            }
        }
        self.written.fetch_add(span.pixels, Ordering::Relaxed);
        Ok(())
    }

    fn finish(self: Box<Self>) -> Result<(), FormatError> {
        check_complete(self.file.path(), &self.header, self.written.load(Ordering::Relaxed))?;
        self.file.finish()
    }
}
