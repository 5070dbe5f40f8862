//! Facts about the machine and its folders.

use crate::FormatError;
use crate::error::check_memory;
use std::path::{Path, PathBuf};

/// Bytes of memory that this process may use: the machine's, or its container's limit when lower.
pub fn machine_memory() -> u64 {
    let mut system = sysinfo::System::new();
    system.refresh_memory();
    let limit = system.cgroup_limits().map_or(u64::MAX, |limits| limits.total_memory);
    // A platform that tells nothing gets a modest guess.
    let total = if system.total_memory() == 0 { 4 << 30 } else { system.total_memory() };
    total.min(limit)
}

/// Makes `folder` and those above it where they are missing.
///
/// # Errors
/// [`FormatError::Io`].
pub fn create_folder(folder: &Path) -> Result<(), FormatError> {
    std::fs::create_dir_all(folder).map_err(|source| FormatError::io(folder, "create folder", source))
}

/// Where `path` is, links followed, whether or not a file stands there; `None` without a folder.
pub fn place_of(path: &Path) -> Option<PathBuf> {
    path.canonicalize().ok().or_else(|| {
        let folder = path.parent().filter(|folder| !folder.as_os_str().is_empty()).unwrap_or(Path::new("."));
        match folder.canonicalize() {
            Ok(folder) => Some(folder.join(path.file_name()?)),
            // In a folder that is still to be made.
            Err(_) => std::path::absolute(path).ok(),
        }
    })
}

/// The text of a file of at most 1 MiB.
///
/// # Errors
/// [`FormatError`] when it can't be read, is larger or is not UTF-8.
pub fn read_text(path: &Path) -> Result<String, FormatError> {
    use std::io::Read;
    let limit = 1u64 << 20;
    let failed = |source| FormatError::io(path, "read", source);
    let file = std::fs::File::open(path).map_err(failed)?;
    let mut bytes = Vec::new();
    file.take(limit + 1).read_to_end(&mut bytes).map_err(failed)?;
    if bytes.len() as u64 > limit {
        return Err(FormatError::invalid(path, "is larger than 1 MiB, so hardly a job or camera file"));
    }
    String::from_utf8(bytes).map_err(|_| FormatError::invalid(path, "is not UTF-8 text; save it as UTF-8"))
}

/// A whole file of at most `limit` bytes.
pub(crate) fn bytes_of(path: &Path, limit: u64) -> Result<Vec<u8>, FormatError> {
    use std::io::Read;
    let mut bytes = Vec::new();
    let file = std::fs::File::open(path).map_err(|source| FormatError::io(path, "open", source))?;
    let read = file.take(limit.saturating_add(1)).read_to_end(&mut bytes);
    read.map_err(|source| FormatError::io(path, "read", source))?;
    check_memory(bytes.len() as u64, limit, path)?;
    Ok(bytes)
}

/// The line, 1 the first, that holds byte `at` of `text`.
pub(crate) fn line_of(text: &str, at: usize) -> usize {
    text.as_bytes()[..at.min(text.len())].iter().filter(|byte| **byte == b'\n').count() + 1
}
