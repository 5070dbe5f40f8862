//! What files hold, by a number that depends on nothing else.

use crate::FormatError;
use std::path::Path;

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
        let failed = |source| FormatError::io(path, "read", source);
        let file = std::fs::File::open(path).map_err(failed)?;
        // A hash of its own: where one file ends and the next begins is part of the key.
        let mut content = blake3::Hasher::new();
        content.update_reader(file).map_err(failed)?;
        key.update(content.finalize().as_bytes());
    }
    Ok(key.finalize().to_hex().to_string())
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
