//! What the URI of a buffer names.

use base64::Engine;
use base64::engine::general_purpose::STANDARD;
use percent_encoding::percent_decode_str;
use std::path::{Component, Path, PathBuf};

/// What the URI of a buffer names.
#[derive(Debug, PartialEq)]
pub(super) enum Named {
    /// Bytes that it holds itself.
    Bytes(Vec<u8>),
    /// A file below the folder of the glTF file.
    File(PathBuf),
}

/// `None` for damaged data, other schemes and files outside the folder.
pub(super) fn named_by(uri: &str) -> Option<Named> {
    if let Some(data) = uri.strip_prefix("data:") {
        let (kind, text) = data.split_once(',')?;
        return match kind.strip_suffix(";base64") {
            Some(_) => STANDARD.decode(text).ok().map(Named::Bytes),
            None => Some(Named::Bytes(percent_decode_str(text).collect())),
        };
    }
    let name = percent_decode_str(uri).decode_utf8().ok()?;
    // A drive or a backslash is a folder elsewhere on some system; so is a scheme.
    let is_plain = !name.is_empty() && !name.contains([':', '\\', '\0']);
    let path = Path::new(name.as_ref());
    let is_below = path.components().all(|part| matches!(part, Component::Normal(_) | Component::CurDir));
    (is_plain && is_below).then(|| Named::File(path.to_owned()))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn buffers_are_in_the_text_or_below_the_folder() {
        assert_eq!(named_by("data:;base64,AAEC/w=="), Some(Named::Bytes(vec![0, 1, 2, 255])));
        assert_eq!(named_by("data:application/gltf-buffer,a%00b"), Some(Named::Bytes(b"a\0b".to_vec())));
        assert_eq!(named_by("a%20b/c.bin"), Some(Named::File("a b/c.bin".into())));
        for refused in [
            "data:;base64,A",
            "data:nothing",
            "../a.bin",
            "a/../../b.bin",
            "/etc/passwd",
            "%2Fetc/passwd",
            "http://host/a.bin",
            "C:a.bin",
            "a\\b.bin",
            "%2E%2E/a.bin",
            "",
            "%ff%fe",
        ] {
            assert_eq!(named_by(refused), None, "{refused}");
        }
    }
}
