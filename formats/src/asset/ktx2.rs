//! `.ktx2`: the bytes around the texels of an array texture or a single one.
//!
//! Source: KTX File Format Specification 2.0; docs/formats.md for the key of our own.

use super::document;
use super::texture::{LevelPlace, Shape};
use crate::FormatError;
use ktx2::{Format, Header, Index, LevelIndex, SupercompressionScheme};
use relight_texture::{BlockFormat, Precision, TexelFormat};
use std::path::Path;

/// The formats of textures that are written and read.
const FORMATS: [(Format, TexelFormat); 15] = [
    (Format::R8_UNORM, plain(Precision::U8, 1)),
    (Format::R16_SFLOAT, plain(Precision::F16, 1)),
    (Format::R32_SFLOAT, plain(Precision::F32, 1)),
    (Format::R8G8B8A8_UNORM, plain(Precision::U8, 4)),
    (Format::R16G16B16A16_SFLOAT, plain(Precision::F16, 4)),
    (Format::R32G32B32A32_SFLOAT, plain(Precision::F32, 4)),
    // Without alpha: its three-colour blocks are opaque.
    (Format::BC1_RGB_UNORM_BLOCK, TexelFormat::Block(BlockFormat::Bc1)),
    (Format::BC3_UNORM_BLOCK, TexelFormat::Block(BlockFormat::Bc3)),
    (Format::BC4_UNORM_BLOCK, TexelFormat::Block(BlockFormat::Bc4)),
    (Format::BC4_SNORM_BLOCK, TexelFormat::Block(BlockFormat::Bc4Signed)),
    (Format::BC5_UNORM_BLOCK, TexelFormat::Block(BlockFormat::Bc5)),
    (Format::BC5_SNORM_BLOCK, TexelFormat::Block(BlockFormat::Bc5Signed)),
    (Format::BC6H_UFLOAT_BLOCK, TexelFormat::Block(BlockFormat::Bc6h)),
    (Format::BC6H_SFLOAT_BLOCK, TexelFormat::Block(BlockFormat::Bc6hSigned)),
    (Format::BC7_UNORM_BLOCK, TexelFormat::Block(BlockFormat::Bc7)),
];

const fn plain(precision: Precision, channels: usize) -> TexelFormat {
    TexelFormat::Plain { precision, channels }
}

/// Our name of a format of KTX2's.
pub(super) fn texel_format(format: Option<Format>) -> Option<TexelFormat> {
    FORMATS.into_iter().find(|&(theirs, _)| Some(theirs) == format).map(|(_, ours)| ours)
}

/// The names of the formats that are read.
pub(super) fn known_formats() -> String {
    FORMATS.map(|(format, _)| format!("{format:?}")).join(", ")
}

/// A level's place and lengths in the file.
pub(super) type Level = LevelIndex;

/// Everything before the texels: header, level index, data format descriptor and keys, `text` among
/// them where there is one. With `compressed`, the levels are Zstandard and lie as it says; otherwise they lie one
/// after another, the smallest first, as [`places`] says.
///
/// # Errors
/// [`FormatError::Invalid`] for sizes beyond what KTX2 can count.
pub(super) fn head(
    path: &Path,
    shape: &Shape,
    text: Option<&str>,
    compressed: Option<&[Level]>,
) -> Result<Vec<u8>, FormatError> {
    let count = |value: usize, name: &str| {
        u32::try_from(value).map_err(|_| {
            FormatError::invalid(path, format!("{name} {value} is outside 1..4294967295 of KTX2"))
        })
    };
    if shape.bytes() > u64::MAX / 4 {
        return Err(FormatError::invalid(path, "its texels exceed what KTX2 can count"));
    }
    let invalid = |e: &dyn std::fmt::Display| FormatError::invalid(path, e.to_string());
    let (format, _) = FORMATS
        .into_iter()
        .find(|&(_, ours)| ours == shape.format)
        .ok_or_else(|| invalid(&format!("KTX2 has no texel format for {:?}", shape.format)))?;
    let (descriptor, type_size) = ktx2::dfd::Basic::from_format(format).map_err(|e| invalid(&e))?;
    let descriptor = ktx2::dfd::Block::Basic(descriptor).to_vec();
    let descriptor_length = 4 + descriptor.len() as u32;
    let pairs = [
        ("KTXorientation", Some("rd")),
        ("KTXwriter", Some(concat!("relight ", env!("CARGO_PKG_VERSION")))),
        (document::KEY, text),
    ];
    let keys =
        key_values(&pairs.into_iter().filter_map(|(key, value)| Some((key, value?))).collect::<Vec<_>>());
    let descriptor_offset = (Header::LENGTH + shape.levels * LevelIndex::LENGTH) as u32;
    let keys_offset = descriptor_offset + descriptor_length;
    let header = Header {
        format: Some(format),
        type_size,
        pixel_width: count(shape.width, "width")?,
        pixel_height: count(shape.height, "height")?,
        pixel_depth: 0,
        layer_count: if shape.array { count(shape.layers, "layers")? } else { 0 },
        face_count: 1,
        level_count: shape.levels as u32,
        supercompression_scheme: compressed.map(|_| SupercompressionScheme::Zstandard),
        index: Index {
            dfd_byte_offset: descriptor_offset,
            dfd_byte_length: descriptor_length,
            kvd_byte_offset: keys_offset,
            kvd_byte_length: keys.len() as u32,
            sgd_byte_offset: 0,
            sgd_byte_length: 0,
        },
    };
    let end = keys_offset as usize + keys.len();
    let levels = match compressed {
        Some(levels) => levels.to_vec(),
        None => plain_levels(shape, end as u64),
    };
    let mut bytes = header.as_bytes().to_vec();
    bytes.extend(levels.iter().flat_map(LevelIndex::as_bytes));
    bytes.extend(descriptor_length.to_le_bytes());
    bytes.extend(descriptor);
    bytes.extend(keys);
    Ok(bytes)
}

/// The index of levels that lie as they are after a head of `head` bytes.
fn plain_levels(shape: &Shape, head: u64) -> Vec<Level> {
    // The least common multiple of 4 and the bytes of a texel or block, which is a power of two.
    let alignment = shape.format.unit_bytes().max(4) as u64;
    let mut levels = Vec::new();
    let mut end = head;
    for level in (0..shape.levels).rev() {
        let (byte_offset, bytes) = (end.next_multiple_of(alignment), shape.level_bytes(level));
        levels.push(Level { byte_offset, byte_length: bytes, uncompressed_byte_length: bytes });
        end = byte_offset + bytes;
    }
    levels.reverse();
    levels
}

/// Where the layers of each level lie after a head of `head` bytes.
pub(super) fn places(shape: &Shape, head: u64) -> Vec<LevelPlace> {
    let levels = plain_levels(shape, head).into_iter().enumerate();
    levels.map(|(l, level)| LevelPlace { offset: level.byte_offset, stride: shape.layer_bytes(l) }).collect()
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
