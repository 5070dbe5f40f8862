//! `.ktx2`: the reader of assets that [`super::ktx2`] wrote.
//!
//! Nothing is allocated on a header's word: every count is held against the file's size first.

use super::document::{self, Layer};
use super::ktx2::TEXEL_FORMATS;
use super::{AssetHeader, Details, check_memory, open_measured};
use crate::FormatError;
use half::f16;
use ktx2::{Format, Header, KeyValueDataIterator, LevelIndex};
use relight_core::{RelightingMap, RelightingMaps, Texels};
use relight_texture::Precision;
use std::fs::File;
use std::io::{self, Read, Seek, SeekFrom};
use std::path::Path;

/// Texels that are read at a time.
const PIECE: usize = 1 << 16;

struct Ktx2File {
    file: File,
    header: AssetHeader,
    format: Format,
    channels: usize,
    layers: Vec<Layer>,
    level_offset: u64,
}

/// A component of a texel.
trait Component: Copy + Default {
    /// From its little-endian bytes, as many as it has.
    fn from_bytes(bytes: &[u8]) -> Self;
    fn texels(components: Vec<Self>) -> Texels;
}

impl Component for u8 {
    fn from_bytes(bytes: &[u8]) -> Self {
        bytes[0]
    }
    fn texels(components: Vec<Self>) -> Texels {
        Texels::U8(components)
    }
}

impl Component for f16 {
    fn from_bytes(bytes: &[u8]) -> Self {
        Self::from_le_bytes([bytes[0], bytes[1]])
    }
    fn texels(components: Vec<Self>) -> Texels {
        Texels::F16(components)
    }
}

impl Component for f32 {
    fn from_bytes(bytes: &[u8]) -> Self {
        Self::from_le_bytes([bytes[0], bytes[1], bytes[2], bytes[3]])
    }
    fn texels(components: Vec<Self>) -> Texels {
        Texels::F32(components)
    }
}

/// Reads a `.ktx2` asset; see [`super::read_asset`].
pub(super) fn read(path: &Path, memory_limit: u64) -> Result<RelightingMaps, FormatError> {
    let ktx2 = open(path)?;
    check_memory(path, &ktx2.header, memory_limit)?;
    let planes = match ktx2.header.precision {
        Precision::U8 => read_planes::<u8>(path, &ktx2)?,
        Precision::F16 => read_planes::<f16>(path, &ktx2)?,
        Precision::F32 => read_planes::<f32>(path, &ktx2)?,
    };
    let AssetHeader { width, height, model, .. } = ktx2.header;
    Ok(RelightingMaps { width, height, model, planes })
}

/// See [`super::summarize_asset`].
pub(super) fn summarize(path: &Path) -> Result<(AssetHeader, Details), FormatError> {
    let ktx2 = open(path)?;
    let details = vec![
        ("texel format".to_owned(), format!("{:?} (VkFormat {})", ktx2.format, ktx2.format.value())),
        ("layers".to_owned(), ktx2.layers.len().to_string()),
    ];
    Ok((ktx2.header, details))
}

/// Reads and checks everything but the texels.
fn open(path: &Path) -> Result<Ktx2File, FormatError> {
    let invalid = |problem: String| Err(FormatError::invalid(path, problem));
    let unsupported = |problem: String| Err(FormatError::unsupported(path, problem));
    let (mut file, file_bytes) = open_measured(path)?;
    let mut start = [0; Header::LENGTH];
    read_exact(path, &mut file, &mut start)?;
    let header =
        Header::from_bytes(&start).map_err(|e| FormatError::invalid(path, format!("KTX2 header: {e}")))?;
    let mut level = [0; LevelIndex::LENGTH];
    read_exact(path, &mut file, &mut level)?;
    let level = LevelIndex::from_bytes(&level);

    if let Some(scheme) = header.supercompression_scheme {
        return unsupported(format!(
            "is supercompressed with {scheme:?}; relight reads KTX2 without supercompression"
        ));
    }
    let text = read_document(path, &mut file, file_bytes, &header)?;
    let found = TEXEL_FORMATS.into_iter().find(|&(format, ..)| header.format == Some(format));
    let Some((format, precision, channels)) = found else {
        let found = header.format.map_or_else(|| "VK_FORMAT_UNDEFINED".to_owned(), |f| format!("{f:?}"));
        let known: Vec<_> = TEXEL_FORMATS.iter().map(|(format, ..)| format!("{format:?}")).collect();
        return unsupported(format!("has texels of {found}; relight reads {}", known.join(", ")));
    };
    let (model, layers) = document::parse(path, &text)?;
    let Some(layers) = layers else {
        return invalid(format!("its key '{}' lists no layers", document::KEY));
    };
    let (width, height) = (header.pixel_width, header.pixel_height);
    if height == 0 || header.pixel_depth != 0 || header.face_count != 1 || header.layer_count == 0 {
        return invalid("is not an array of 2D pictures, which is what an asset is".to_owned());
    }
    if header.layer_count as usize != layers.len() {
        let (count, listed) = (header.layer_count, layers.len());
        return invalid(format!("has {count} layers where its key '{}' lists {listed}", document::KEY));
    }
    check_layers(path, &layers, channels, model.plane_count())?;
    let expected = (u64::from(width) * u64::from(height))
        .checked_mul(u64::from(header.layer_count) * (channels * precision.bytes()) as u64);
    if expected != Some(level.byte_length) || expected != Some(level.uncompressed_byte_length) {
        let found = level.byte_length;
        return invalid(format!("has {found} bytes of texels where its size asks for {expected:?}"));
    }
    if level.byte_offset.checked_add(level.byte_length).is_none_or(|end| end > file_bytes) {
        let LevelIndex { byte_offset, byte_length, .. } = level;
        return invalid(format!(
            "is cut short: {byte_length} bytes of texels from {byte_offset} on in a file of {file_bytes}"
        ));
    }
    let header = AssetHeader { width: width as usize, height: height as usize, model, precision };
    Ok(Ktx2File { file, header, format, channels, layers, level_offset: level.byte_offset })
}

/// The value of our key.
fn read_document(
    path: &Path,
    file: &mut File,
    file_bytes: u64,
    header: &Header,
) -> Result<Vec<u8>, FormatError> {
    let (offset, length) = (u64::from(header.index.kvd_byte_offset), u64::from(header.index.kvd_byte_length));
    if offset + length > file_bytes || length > document::LONGEST + (1 << 20) {
        let problem = format!("its key/value section of {length} bytes at {offset} leaves the file");
        return Err(FormatError::invalid(path, problem));
    }
    let mut section = vec![0; length as usize];
    seek(path, file, offset)?;
    read_exact(path, file, &mut section)?;
    let value = KeyValueDataIterator::new(&section).find(|(key, _)| *key == document::KEY);
    let Some((_, value)) = value else {
        let problem = format!("has no key '{}': it is a texture, but no asset of relight", document::KEY);
        return Err(FormatError::unsupported(path, problem));
    };
    Ok(value.strip_suffix(&[0]).unwrap_or(value).to_vec())
}

/// Every plane once, no more of them in a layer than it has channels, and finite numbers.
fn check_layers(path: &Path, layers: &[Layer], channels: usize, planes: usize) -> Result<(), FormatError> {
    let invalid = |problem: String| Err(FormatError::invalid(path, problem));
    let mut seen = vec![false; planes];
    for (index, layer) in layers.iter().enumerate() {
        let count = layer.planes.len();
        if !(1..=channels).contains(&count) || layer.scale.len() != count || layer.bias.len() != count {
            return invalid(format!("layer {index} lists {count} planes in {channels} channels"));
        }
        if layer.scale.iter().chain(&layer.bias).any(|value| !value.is_finite()) {
            return invalid(format!("layer {index} has a scale or bias that is not finite"));
        }
        for &plane in &layer.planes {
            match seen.get_mut(plane) {
                Some(seen) if !*seen => *seen = true,
                _ => return invalid(format!("layer {index} lists plane {plane} of {planes} out of turn")),
            }
        }
    }
    if seen.contains(&false) {
        return invalid("its layers do not list every plane".to_owned());
    }
    Ok(())
}

/// Takes the planes out of the layers.
fn read_planes<T: Component>(path: &Path, ktx2: &Ktx2File) -> Result<Vec<RelightingMap>, FormatError> {
    let Ktx2File { header, channels, layers, level_offset, .. } = ktx2;
    let mut file = &ktx2.file;
    let (pixels, texel_bytes) = (header.width * header.height, channels * size_of::<T>());
    let mut planes: Vec<Option<RelightingMap>> = vec![None; header.model.plane_count()];
    let mut bytes = vec![0; PIECE.min(pixels) * texel_bytes];
    file.seek(SeekFrom::Start(*level_offset)).map_err(|e| FormatError::io(path, "read", e))?;
    for layer in layers {
        let mut components = vec![vec![T::default(); pixels]; layer.planes.len()];
        for first in (0..pixels).step_by(PIECE) {
            let count = PIECE.min(pixels - first);
            let bytes = &mut bytes[..count * texel_bytes];
            read_exact(path, &mut file, bytes)?;
            for (channel, plane) in components.iter_mut().enumerate() {
                let texels = bytes.chunks_exact(texel_bytes);
                for (component, texel) in plane[first..first + count].iter_mut().zip(texels) {
                    *component = T::from_bytes(&texel[channel * size_of::<T>()..]);
                }
            }
        }
        for (i, components) in components.into_iter().enumerate() {
            let (scale, bias) = (layer.scale[i], layer.bias[i]);
            planes[layer.planes[i]] = Some(RelightingMap { scale, bias, texels: T::texels(components) });
        }
    }
    // `check_layers` saw every plane once, so none is missing.
    Ok(planes.into_iter().flatten().collect())
}

fn seek(path: &Path, file: &mut File, offset: u64) -> Result<(), FormatError> {
    file.seek(SeekFrom::Start(offset)).map(|_| ()).map_err(|e| FormatError::io(path, "read", e))
}

fn read_exact(path: &Path, file: &mut impl Read, bytes: &mut [u8]) -> Result<(), FormatError> {
    file.read_exact(bytes).map_err(|e| match e.kind() {
        io::ErrorKind::UnexpectedEof => FormatError::invalid(path, "is cut short"),
        _ => FormatError::io(path, "read", e),
    })
}
