//! Tables of learned functions as textures of their own, for shaders that work out weights on the GPU.

use super::texture::Shape;
use super::{dds, ktx2};
use crate::{FormatError, write_whole};
use relight_core::basis::Learned;
use relight_texture::{Precision, TexelFormat, function_texels};
use std::path::Path;

/// Writes the table of learned functions as an array texture of RGBA halves, four functions a layer, as the
/// source of `relight shader` reads it; `path` ends in .ktx2 or .dds.
///
/// # Errors
/// [`FormatError::Unsupported`] for another extension, [`FormatError::Io`].
pub fn write_function_table(path: &Path, learned: &Learned) -> Result<(), FormatError> {
    let nodes = learned.square().nodes;
    let texels = function_texels(learned);
    let shape = Shape {
        width: nodes,
        height: nodes,
        format: TexelFormat::Plain { precision: Precision::F16, channels: 4 },
        levels: 1,
        layers: texels.len() / (nodes * nodes),
        array: true,
    };
    let extension = path.extension().and_then(|e| e.to_str()).unwrap_or_default().to_lowercase();
    let mut bytes = match extension.as_str() {
        "ktx2" => {
            let mut bytes = ktx2::head(path, &shape, None, None)?;
            let start = ktx2::places(&shape, bytes.len() as u64)[0].offset as usize;
            bytes.resize(start, 0);
            bytes
        }
        "dds" => dds::head(path, &shape, 0, 0)?,
        _ => return Err(FormatError::unsupported(path, "a table of functions is written as .ktx2 or .dds")),
    };
    bytes.extend(texels.iter().flatten().flat_map(|half| half.to_le_bytes()));
    write_whole(path, &bytes)
}
