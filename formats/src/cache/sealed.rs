//! The one place of bincode: a head with magic, version, kind, key and checksum before what is kept.

use bincode::Options;
use serde::de::DeserializeOwned;
use serde::{Deserialize, Serialize};

/// With it begins every file of a cache.
const MAGIC: [u8; 8] = *b"relightC";

/// Rises with every change of what follows a head.
const VERSION: u32 = 1;

/// Bytes of a head.
pub(super) const HEAD_BYTES: usize = 96;

/// What a file is to be: of another it is none.
#[derive(Clone, Copy, Debug)]
pub(super) struct Seal {
    pub(super) kind: [u8; 4],
    /// Which of several, such as the number of a tile.
    pub(super) part: u64,
    pub(super) key: [u8; 32],
}

#[derive(Serialize, Deserialize)]
struct Head {
    magic: [u8; 8],
    version: u32,
    kind: [u8; 4],
    part: u64,
    key: [u8; 32],
    bytes: u64,
    hash: [u8; 32],
}

fn options(limit: u64) -> impl Options {
    bincode::options().with_fixint_encoding().with_little_endian().with_limit(limit).reject_trailing_bytes()
}

impl Seal {
    /// The head before `bytes` bytes of that hash.
    pub(super) fn head(&self, bytes: u64, hash: [u8; 32]) -> Vec<u8> {
        let Self { kind, part, key } = *self;
        let head = Head { magic: MAGIC, version: VERSION, kind, part, key, bytes, hash };
        // Arrays and numbers of a fixed length: there is nothing that can't be written.
        options(HEAD_BYTES as u64).serialize(&head).unwrap_or_default()
    }

    /// The hash that what follows `head` must have, where that is `bytes` long; `None` where the head is of something else.
    pub(super) fn hash_after(&self, head: &[u8], bytes: u64) -> Option<[u8; 32]> {
        let head: Head = options(HEAD_BYTES as u64).deserialize(head).ok()?;
        let ours = head.magic == MAGIC && head.version == VERSION;
        let wanted = (head.kind, head.part, head.key, head.bytes) == (self.kind, self.part, self.key, bytes);
        (ours && wanted).then_some(head.hash)
    }

    /// The key in `head`, whatever else it says; `None` where it is no head of this version.
    pub(super) fn key_in(head: &[u8]) -> Option<[u8; 32]> {
        let head: Head = options(HEAD_BYTES as u64).deserialize(head.get(..HEAD_BYTES)?).ok()?;
        (head.magic == MAGIC && head.version == VERSION).then_some(head.key)
    }

    /// A file that holds `value`.
    pub(super) fn close(&self, value: &impl Serialize) -> Vec<u8> {
        let body = options(u64::MAX).serialize(value).unwrap_or_default();
        let mut file = self.head(body.len() as u64, *blake3::hash(&body).as_bytes());
        file.extend(body);
        file
    }

    /// What such a file holds, of at most `limit` bytes; `None` where anything about it is odd.
    pub(super) fn open<T: DeserializeOwned>(&self, file: &[u8], limit: u64) -> Option<T> {
        let (head, body) = file.split_at_checked(HEAD_BYTES)?;
        let hash = self.hash_after(head, body.len() as u64)?;
        // Of slices, bincode itself takes the length for the limit.
        if body.len() as u64 > limit || blake3::hash(body) != hash {
            return None;
        }
        options(limit).deserialize(body).ok()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const SEAL: Seal = Seal { kind: *b"test", part: 3, key: [9; 32] };

    #[test]
    fn a_head_is_as_long_as_it_says() {
        assert_eq!(SEAL.head(5, [1; 32]).len(), HEAD_BYTES);
        assert_eq!(SEAL.hash_after(&SEAL.head(5, [1; 32]), 5), Some([1; 32]));
        assert_eq!(SEAL.hash_after(&SEAL.head(5, [1; 32]), 6), None);
    }

    #[test]
    fn values_come_back_and_nothing_else_does() {
        let value = (vec![f64::INFINITY, 0.1], "text".to_owned());
        let file = SEAL.close(&value);
        assert_eq!(SEAL.open::<(Vec<f64>, String)>(&file, 1000), Some(value));
        assert_eq!(SEAL.open::<(Vec<f64>, String)>(&file, 10), None);
        for other in
            [Seal { part: 4, ..SEAL }, Seal { kind: *b"else", ..SEAL }, Seal { key: [8; 32], ..SEAL }]
        {
            assert_eq!(other.open::<(Vec<f64>, String)>(&file, 1000), None);
        }
        for end in 0..file.len() {
            assert_eq!(SEAL.open::<(Vec<f64>, String)>(&file[..end], 1000), None);
        }
        assert_eq!(SEAL.open::<(Vec<f64>, String)>(&[&file[..], &[0]].concat(), 1000), None);
    }
}
