//! What files hold, by a number that depends on nothing else.

use crate::FormatError;
use std::path::{Path, PathBuf};
use std::time::SystemTime;

/// The BLAKE3 hash of the contents of `files`, in their order, and of `settings`, in hexadecimal digits. Names, places
/// and times of the files don't count.
///
/// # Errors
/// [`FormatError::Io`] for a file that can't be read.
pub fn content_key<'a>(
    settings: &str,
    files: impl IntoIterator<Item = &'a Path>,
) -> Result<String, FormatError> {
    let mut key = blake3::Hasher::new();
    key.update(&(settings.len() as u64).to_le_bytes());
    key.update(settings.as_bytes());
    for path in files {
        // A hash of its own: where one file ends and the next begins is part of the key.
        key.update(&content_hash(path)?);
    }
    Ok(key.finalize().to_hex().to_string())
}

/// Length and time of change of some files, by which it is told that they are still the same.
#[derive(Clone, Debug)]
pub struct Stamps(Vec<(PathBuf, Stamp)>);

/// Length and time of change of a file, where it is there.
pub type Stamp = Option<(u64, Option<SystemTime>)>;

impl Stamps {
    /// Those of `files`.
    pub fn of<'a>(files: impl IntoIterator<Item = &'a PathBuf>) -> Self {
        Self(files.into_iter().map(|path| (path.clone(), stamp_of(path))).collect())
    }

    /// Fails where one has changed since.
    ///
    /// # Errors
    /// [`FormatError::Invalid`] naming the file.
    pub fn check(&self) -> Result<(), FormatError> {
        match self.0.iter().find(|(path, before)| stamp_of(path) != *before) {
            Some((path, _)) => Err(FormatError::changed(path)),
            None => Ok(()),
        }
    }
}

/// The stamp of the file at `path`, links followed.
pub fn stamp_of(path: &Path) -> Stamp {
    let about = std::fs::metadata(path).ok()?;
    Some((about.len(), about.modified().ok()))
}

/// The BLAKE3 hash of a file's bytes.
///
/// # Errors
/// [`FormatError::Io`] for a file that can't be read.
pub fn content_hash(path: &Path) -> Result<[u8; 32], FormatError> {
    let failed = |source| FormatError::io(path, "read", source);
    let mut content = blake3::Hasher::new();
    content.update_reader(std::fs::File::open(path).map_err(failed)?).map_err(failed)?;
    Ok(*content.finalize().as_bytes())
}

/// [`content_hash`] of a file; of a folder, that of the names and hashes of all in it.
///
/// # Errors
/// [`FormatError::Io`] for what can't be read.
pub fn tree_hash(path: &Path) -> Result<[u8; 32], FormatError> {
    if !path.is_dir() {
        return content_hash(path);
    }
    let failed = |source| FormatError::io(path, "read", source);
    let entries = std::fs::read_dir(path).map_err(failed)?.collect::<Result<Vec<_>, _>>().map_err(failed)?;
    let mut hashes = entries
        .iter()
        .map(|entry| Ok((entry.file_name().to_string_lossy().into_owned(), tree_hash(&entry.path())?)))
        .collect::<Result<Vec<_>, FormatError>>()?;
    hashes.sort();
    Ok(record_key(&hashes))
}

/// The BLAKE3 hash of what `value` is as JSON, whose maps must be in order.
pub fn record_key(value: &impl serde::Serialize) -> [u8; 32] {
    let mut key = blake3::Hasher::new();
    // Numbers and text alone: there is nothing that can't be written.
    let written = serde_json::to_writer(&mut key, value);
    debug_assert!(written.is_ok(), "{written:?}");
    *key.finalize().as_bytes()
}

/// The lower-case hexadecimal digits of `bytes`.
pub fn hexadecimal(bytes: &[u8]) -> String {
    bytes.iter().map(|byte| format!("{byte:02x}")).collect()
}

/// Removes a file of ours that is no longer wanted; one that isn't there is as good as removed.
///
/// # Errors
/// [`FormatError::Io`] when the system refuses.
pub fn remove_file(path: &Path) -> Result<(), FormatError> {
    match std::fs::remove_file(path) {
        Err(error) if error.kind() != std::io::ErrorKind::NotFound => {
            Err(FormatError::io(path, "remove", error))
        }
        _ => Ok(()),
    }
}

/// Bytes of a file, or of all files in a folder; 0 where there is none.
pub fn bytes_on_disk(path: &Path) -> u64 {
    let Ok(about) = std::fs::metadata(path) else { return 0 };
    if about.is_file() {
        return about.len();
    }
    let entries = std::fs::read_dir(path).into_iter().flatten().flatten();
    entries
        .filter_map(|entry| entry.metadata().ok())
        .filter(|about| about.is_file())
        .map(|about| about.len())
        .sum()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn files_that_change_are_told() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("a");
        std::fs::write(&path, "one").unwrap();
        let stamps = Stamps::of([&path]);
        stamps.check().unwrap();
        std::fs::write(&path, "longer").unwrap();
        assert!(stamps.check().unwrap_err().to_string().contains("changed"));
        std::fs::remove_file(&path).unwrap();
        assert!(stamps.check().is_err());
    }

    #[test]
    fn keys_are_of_contents_and_their_order_alone() {
        let folder = tempfile::tempdir().unwrap();
        let file = |name: &str, bytes: &[u8]| {
            let path = folder.path().join(name);
            std::fs::write(&path, bytes).unwrap();
            path
        };
        let (a, b, other) = (file("a", b"one"), file("b", b"two"), file("c d", b"one"));
        let key = |settings: &str, files: &[&Path]| content_key(settings, files.iter().copied()).unwrap();
        let whole = key("s", &[&a, &b]);
        assert_eq!(whole, key("s", &[&other, &b]));
        let (ab, empty) = (file("ab", b"onetwo"), file("e", b""));
        for unlike in [key("s", &[&b, &a]), key("t", &[&a, &b]), key("s", &[&ab, &empty]), key("s", &[&a])] {
            assert_ne!(whole, unlike);
        }
        assert!(content_key("s", [folder.path().join("none").as_path()]).is_err());
    }
}
