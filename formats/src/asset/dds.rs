//! `.dds`: the header of a DX10 array texture, written and read.
//!
//! A DDS file has no room for metadata: what its layers are stands in a manifest beside it. Its
//! reserved words tell to which asset it belongs.
//! Source: Microsoft, *Programming Guide for DDS*.

use super::document::{Document, Part};
use super::open_measured;
use super::texture::{LevelPlace, Shape, Storage, Texture, read_exact};
use crate::FormatError;
use ddsfile::{AlphaMode, D3D10ResourceDimension, DxgiFormat, Header, Header10, PixelFormatFlags};
use relight_texture::{BlockFormat, Precision, TexelFormat, full_levels};
use std::path::Path;

/// The bytes with which files begin.
pub(super) const MAGIC: &[u8] = b"DDS ";

/// Bytes before the texels: magic, header and DX10 header.
const HEAD: usize = 4 + 124 + 20;

/// Where the eleven reserved words begin: ours are [`MARK`], the file's number and the asset's id.
const RESERVED: usize = 32;

/// Tells our reserved words from another program's.
const MARK: &[u8; 8] = b"relight\0";

/// The formats of textures that are written and read.
const FORMATS: [(DxgiFormat, TexelFormat); 15] = [
    (DxgiFormat::R8_UNorm, plain(Precision::U8, 1)),
    (DxgiFormat::R16_Float, plain(Precision::F16, 1)),
    (DxgiFormat::R32_Float, plain(Precision::F32, 1)),
    (DxgiFormat::R8G8B8A8_UNorm, plain(Precision::U8, 4)),
    (DxgiFormat::R16G16B16A16_Float, plain(Precision::F16, 4)),
    (DxgiFormat::R32G32B32A32_Float, plain(Precision::F32, 4)),
    (DxgiFormat::BC1_UNorm, TexelFormat::Block(BlockFormat::Bc1)),
    (DxgiFormat::BC3_UNorm, TexelFormat::Block(BlockFormat::Bc3)),
    (DxgiFormat::BC4_UNorm, TexelFormat::Block(BlockFormat::Bc4)),
    (DxgiFormat::BC4_SNorm, TexelFormat::Block(BlockFormat::Bc4Signed)),
    (DxgiFormat::BC5_UNorm, TexelFormat::Block(BlockFormat::Bc5)),
    (DxgiFormat::BC5_SNorm, TexelFormat::Block(BlockFormat::Bc5Signed)),
    (DxgiFormat::BC6H_UF16, TexelFormat::Block(BlockFormat::Bc6h)),
    (DxgiFormat::BC6H_SF16, TexelFormat::Block(BlockFormat::Bc6hSigned)),
    (DxgiFormat::BC7_UNorm, TexelFormat::Block(BlockFormat::Bc7)),
];

const fn plain(precision: Precision, channels: usize) -> TexelFormat {
    TexelFormat::Plain { precision, channels }
}

/// Everything before the texels of file number `file` of the asset `id`.
///
/// # Errors
/// [`FormatError::Invalid`] for sizes beyond what DDS can count.
pub(super) fn head(path: &Path, shape: &Shape, file: usize, id: u64) -> Result<Vec<u8>, FormatError> {
    let invalid = |problem: String| FormatError::invalid(path, problem);
    let (format, _) = FORMATS
        .into_iter()
        .find(|&(_, ours)| ours == shape.format)
        .ok_or_else(|| invalid(format!("DDS has no texel format for {:?}", shape.format)))?;
    // Rows are counted in bits on the way to the header's word for bytes.
    let counted = [shape.format.row_bytes(shape.width).saturating_mul(32), shape.layer_bytes(0)];
    if counted.iter().any(|&bytes| bytes > u64::from(u32::MAX)) || shape.bytes() > u64::MAX / 4 {
        let Shape { width, height, .. } = shape;
        return Err(invalid(format!("{width} x {height} texels exceed what DDS can count; write .ktx2")));
    }
    let words = [shape.height, shape.width, shape.levels, shape.layers].map(|value| value as u32);
    let [height, width, levels, layers] = words;
    let mut header = Header::new_dxgi(height, width, None, format, Some(levels), Some(layers), None)
        .map_err(|e| invalid(e.to_string()))?;
    // The crate also marks plain texels as RGB of no masks, which other readers take at its word.
    header.spf.flags = PixelFormatFlags::FOURCC;
    header.spf.rgb_bit_count = None;
    // The fourth channel is a plane or nothing, and nothing in between: no blending.
    let dimension = D3D10ResourceDimension::Texture2D;
    let header10 = Header10::new(format, false, dimension, layers, AlphaMode::Custom);
    let mut bytes = MAGIC.to_vec();
    header.write(&mut bytes).and_then(|()| header10.write(&mut bytes)).map_err(|e| invalid(e.to_string()))?;
    let mark = MARK.iter().copied().chain((file as u32).to_le_bytes()).chain(id.to_le_bytes());
    bytes.iter_mut().skip(RESERVED).zip(mark).for_each(|(byte, mark)| *byte = mark);
    Ok(bytes)
}

/// Where the layers of each level lie: all levels of a layer, then those of the next.
pub(super) fn places(shape: &Shape) -> Vec<LevelPlace> {
    let stride = (0..shape.levels).map(|level| shape.layer_bytes(level)).sum();
    let mut offset = HEAD as u64;
    (0..shape.levels)
        .map(|level| {
            let place = LevelPlace { offset, stride };
            offset += shape.layer_bytes(level);
            place
        })
        .collect()
}

/// Reads and checks everything but the texels.
pub(super) fn open(path: &Path) -> Result<Texture, FormatError> {
    let invalid = |problem: String| FormatError::invalid(path, problem);
    let unsupported = |problem: String| Err(FormatError::unsupported(path, problem));
    let (mut file, file_bytes) = open_measured(path)?;
    let mut start = [0; HEAD];
    read_exact(path, &mut file, &mut start[..128])?;
    if &start[84..88] != b"DX10" {
        return unsupported("is a DDS file without the DX10 header that those of relight have".to_owned());
    }
    read_exact(path, &mut file, &mut start[128..])?;
    let header = Header::read(&start[4..128]).map_err(|e| invalid(format!("DDS header: {e}")))?;
    let header10 = Header10::read(&start[128..]).map_err(|e| invalid(format!("DDS header: {e}")))?;
    let dxgi = header10.dxgi_format;
    let Some((_, format)) = FORMATS.into_iter().find(|&(theirs, _)| theirs == dxgi) else {
        let known = FORMATS.map(|(format, _)| format!("{format:?}")).join(", ");
        return unsupported(format!("has texels of {dxgi:?}; relight reads {known}"));
    };
    let (width, height) = (header.width as usize, header.height as usize);
    let layers = header10.array_size as usize;
    let picture = header10.resource_dimension == D3D10ResourceDimension::Texture2D
        && header10.misc_flag.is_empty()
        && width.min(height).min(layers) > 0;
    if !picture {
        return Err(invalid("is no array of 2D pictures, which is what an asset is".to_owned()));
    }
    let (levels, most) = (header.mip_map_count.unwrap_or(1).max(1) as usize, full_levels(width, height));
    if levels > most {
        return Err(invalid(format!(
            "has {levels} mip levels; {width} x {height} texels have {most} at most"
        )));
    }
    let shape = Shape { width, height, format, levels, layers, array: layers > 1 };
    let expected = shape.bytes().saturating_add(HEAD as u64);
    if expected > file_bytes {
        return Err(invalid(format!("is cut short: {file_bytes} bytes where its size asks for {expected}")));
    }
    let words = |at: usize| u32::from_le_bytes([start[at], start[at + 1], start[at + 2], start[at + 3]]);
    let ours = start[RESERVED..].starts_with(MARK);
    let label = ours.then(|| {
        let id = u64::from(words(RESERVED + 12)) | u64::from(words(RESERVED + 16)) << 32;
        Document::Part(Part { of: None, file: words(RESERVED + 8) as usize, id: Some(id) })
    });
    let format_name = format!("{dxgi:?} (DXGI {})", dxgi as u32);
    let storage = Storage::Plain(places(&shape));
    Ok(Texture { path: path.to_owned(), file, file_bytes, shape, format_name, label, storage })
}
