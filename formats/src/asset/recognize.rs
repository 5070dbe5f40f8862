//! Which format a file or folder has.

use super::{ASSET_FORMATS, AssetFormat, open, textures_reader, web_info};
use crate::FormatError;
use std::io::Read;
use std::path::Path;

/// Whether a file that begins with `start` may be an asset, its manifest or its description.
pub(crate) fn is_asset(start: &[u8]) -> bool {
    ASSET_FORMATS.iter().any(|format| start.starts_with(format.magic))
}

/// The format whose magic bytes `path` begins with, or the first file that the manifest at `path` lists; or
/// that of the folder that `path` is or describes.
pub(super) fn format_of(path: &Path) -> Result<&'static AssetFormat, FormatError> {
    if web_info::is_web(path) {
        return Ok(folder_format());
    }
    if path.is_dir() {
        let problem = format!("is a folder without {}, so no asset; name a file in it", web_info::INFO);
        return Err(FormatError::unsupported(path, problem));
    }
    let start = start_of(path)?;
    let by_magic = |start: &[u8]| ASSET_FORMATS.iter().find(|format| start.starts_with(format.magic));
    let format = if start.starts_with(b"{") {
        let first = textures_reader::first_file(path)?;
        by_magic(&start_of(&first)?).filter(|format| format.textures)
    } else {
        by_magic(&start)
    };
    format.ok_or_else(|| {
        let known = known_extensions();
        FormatError::unsupported(path, format!("is no asset; relight reads those that it writes: {known}"))
    })
}

/// The one format that is a folder.
fn folder_format() -> &'static AssetFormat {
    ASSET_FORMATS.iter().find(|format| format.folder).unwrap_or(&ASSET_FORMATS[0])
}

/// The first bytes of a file, up to 16.
fn start_of(path: &Path) -> Result<Vec<u8>, FormatError> {
    let mut start = Vec::new();
    open(path)?.take(16).read_to_end(&mut start).map_err(|e| FormatError::io(path, "read", e))?;
    Ok(start)
}

/// What assets end in, for messages.
pub(super) fn known_extensions() -> String {
    let known: Vec<_> = ASSET_FORMATS.iter().map(|format| format!(".{}", format.extension)).collect();
    known.join(", ")
}
