//! `.ktx2`: what a file's header says, checked.
//!
//! Nothing is allocated on a header's word: every count is held against the file's size first.

use super::document::{self, Document};
use super::ktx2::{known_formats, texel_format};
use super::open_measured;
use super::texture::{LevelPlace, Shape, Storage, Texture, read_exact};
use crate::FormatError;
use ktx2::{Header, KeyValueDataIterator, LevelIndex, SupercompressionScheme};
use relight_texture::full_levels;
use std::fs::File;
use std::io::{Seek, SeekFrom};
use std::path::Path;

/// Reads and checks everything but the texels.
pub(super) fn open(path: &Path) -> Result<Texture, FormatError> {
    let invalid = |problem: String| Err(FormatError::invalid(path, problem));
    let unsupported = |problem: String| Err(FormatError::unsupported(path, problem));
    let (mut file, file_bytes) = open_measured(path)?;
    let mut start = [0; Header::LENGTH];
    read_exact(path, &mut file, &mut start)?;
    let header =
        Header::from_bytes(&start).map_err(|e| FormatError::invalid(path, format!("KTX2 header: {e}")))?;
    let compressed = header.supercompression_scheme == Some(SupercompressionScheme::Zstandard);
    if let Some(scheme) = header.supercompression_scheme.filter(|_| !compressed) {
        return unsupported(format!("is supercompressed with {scheme:?}; relight reads Zstandard and none"));
    }
    let Some(format) = texel_format(header.format) else {
        let found = header.format.map_or_else(|| "VK_FORMAT_UNDEFINED".to_owned(), |f| format!("{f:?}"));
        return unsupported(format!("has texels of {found}; relight reads {}", known_formats()));
    };
    let (width, height) = (header.pixel_width as usize, header.pixel_height as usize);
    if height == 0 || header.pixel_depth != 0 || header.face_count != 1 {
        return invalid("is neither a 2D picture nor an array of them, which is what an asset is".to_owned());
    }
    let (levels, most) = (header.level_count.max(1) as usize, full_levels(width, height));
    if levels > most {
        return invalid(format!("has {levels} mip levels; {width} x {height} texels have {most} at most"));
    }
    let shape = Shape {
        width,
        height,
        format,
        levels,
        layers: header.layer_count.max(1) as usize,
        array: header.layer_count > 0,
    };
    let index = read_index(path, &mut file, file_bytes, &shape, compressed)?;
    let storage = if compressed {
        Storage::Zstandard(index.iter().map(|level| (level.byte_offset, level.byte_length)).collect())
    } else {
        let places = index.iter().enumerate();
        Storage::Plain(
            places
                .map(|(l, level)| LevelPlace { offset: level.byte_offset, stride: shape.layer_bytes(l) })
                .collect(),
        )
    };
    let label = read_label(path, &mut file, file_bytes, &header)?;
    let format_name = header.format.map_or_else(String::new, |f| format!("{f:?} (VkFormat {})", f.value()));
    Ok(Texture { path: path.to_owned(), file, file_bytes, shape, format_name, label, storage })
}

/// The level index, held against the sizes that the header asks for and against the file's.
fn read_index(
    path: &Path,
    file: &mut File,
    file_bytes: u64,
    shape: &Shape,
    compressed: bool,
) -> Result<Vec<LevelIndex>, FormatError> {
    let mut index = Vec::new();
    for level in 0..shape.levels {
        let mut bytes = [0; LevelIndex::LENGTH];
        read_exact(path, file, &mut bytes)?;
        let found = LevelIndex::from_bytes(&bytes);
        let LevelIndex { byte_offset, byte_length, uncompressed_byte_length } = found;
        let expected = shape.level_bytes(level);
        if uncompressed_byte_length != expected || (!compressed && byte_length != expected) {
            let found = if compressed { uncompressed_byte_length } else { byte_length };
            let problem =
                format!("has {found} bytes of texels in level {level} where its size asks for {expected}");
            return Err(FormatError::invalid(path, problem));
        }
        if byte_offset.checked_add(byte_length).is_none_or(|end| end > file_bytes) {
            let problem = format!(
                "is cut short: level {level} has {byte_length} bytes from {byte_offset} on in a file of {file_bytes}"
            );
            return Err(FormatError::invalid(path, problem));
        }
        index.push(found);
    }
    Ok(index)
}

/// What our key says.
fn read_label(
    path: &Path,
    file: &mut File,
    file_bytes: u64,
    header: &Header,
) -> Result<Option<Document>, FormatError> {
    let (offset, length) = (u64::from(header.index.kvd_byte_offset), u64::from(header.index.kvd_byte_length));
    if offset + length > file_bytes || length > document::LONGEST + (1 << 20) {
        let problem = format!("its key/value section of {length} bytes at {offset} leaves the file");
        return Err(FormatError::invalid(path, problem));
    }
    let mut section = vec![0; length as usize];
    file.seek(SeekFrom::Start(offset)).map_err(|e| FormatError::io(path, "read", e))?;
    read_exact(path, file, &mut section)?;
    let value = KeyValueDataIterator::new(&section).find(|(key, _)| *key == document::KEY);
    value.map(|(_, value)| document::parse(path, value.strip_suffix(&[0]).unwrap_or(value))).transpose()
}
