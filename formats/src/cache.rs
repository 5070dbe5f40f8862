//! What bakes keep for the bakes after them: fits in tiles, and which files a provenance was made into.
//!
//! A folder `fits/KEY` holds what a fit found ([`FitFolder`]) and its coefficients tile by tile; a file `made/KEY` the hashes
//! of an asset's files. Everything is written under another name and renamed, is named by what it was computed from, and is
//! the same whoever computed it, so that any number of processes may share a cache. Whatever is odd is removed and computed anew.

mod sealed;
mod tiles;

pub use tiles::{FitFolder, Odd, TileGrid, TileStack, TileWriter, Tiles};

use crate::content::hexadecimal;
use crate::temporary::remove_all_strays;
use crate::{FormatError, create_folder, write_whole};
use sealed::Seal;
use serde::{Deserialize, Serialize};
use std::fs;
use std::io::{Read, Write};
use std::path::{Path, PathBuf};
use std::time::SystemTime;

/// The file by which backup programs know that a folder can be made again (bford.info/cachedir).
const TAG: &str = "CACHEDIR.TAG";

/// What stands in it.
const TAG_TEXT: &str =
    "Signature: 8a477f597d28d172789f06886806bc55\n# Fits of relight. Anything here may be deleted.\n";

/// The file of what was added since the folder was looked through: bytes in 8 bytes each, little-endian, the first what was there then.
const SIZES: &str = "sizes";

/// Most numbers in it: then the folder is looked through anew, once for so many fits rather than for each of thousands.
const MOST_SIZES: u64 = 1024;

/// The largest record of a made asset that is read.
const LARGEST_MADE: u64 = 16 << 20;

/// A folder of what can be computed again.
#[derive(Clone, Debug)]
pub struct Cache {
    folder: PathBuf,
    limit: u64,
}

/// An asset that was made.
#[derive(Clone, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
pub struct Made {
    /// What it was made of, as JSON.
    pub provenance: String,
    /// The key of the pictures that judged it.
    pub judges: [u8; 32],
    /// What it was made into.
    pub files: Vec<MadeFile>,
}

/// A file that an asset was made into.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub struct MadeFile {
    /// What its name has beyond that of the asset without its extension: `.ktx2`, `_1.ktx2`.
    pub suffix: String,
    /// BLAKE3 of its bytes; of a folder, of all files in it.
    pub hash: [u8; 32],
}

impl Cache {
    /// The cache in `folder`, which is made where it is missing; it is kept within `limit` bytes.
    ///
    /// # Errors
    /// [`FormatError::Io`] where it can't be made or written to.
    pub fn open(folder: &Path, limit: u64) -> Result<Self, FormatError> {
        for part in ["fits", "made"] {
            create_folder(&folder.join(part))?;
        }
        let tag = folder.join(TAG);
        if !tag.exists() {
            write_whole(&tag, TAG_TEXT.as_bytes())?;
        }
        remove_all_strays(folder);
        Ok(Self { folder: folder.to_owned(), limit })
    }

    /// The folder of the fit of `key`, which may be empty as yet.
    pub fn fit(&self, key: [u8; 32]) -> FitFolder {
        FitFolder::new(self.folder.join("fits").join(hexadecimal(&key[..16])), key)
    }

    /// Whether a fit of `bytes` bytes is within what the cache may hold.
    pub fn has_room_for(&self, bytes: u64) -> bool {
        bytes <= self.limit
    }

    /// What was made of the provenance `key`; `None` where that isn't known.
    pub fn made(&self, key: &[u8; 32]) -> Option<Made> {
        let path = self.made_path(key);
        let bytes = read_within(&path, LARGEST_MADE)?;
        let seal = Seal { kind: *b"made", part: 0, key: *key };
        let found = seal.open(&bytes, LARGEST_MADE);
        match &found {
            Some(_) => touch(&path),
            None => drop(fs::remove_file(&path)),
        }
        found
    }

    /// Keeps what [`Self::made`] gives.
    ///
    /// # Errors
    /// [`FormatError::Io`], for instance on a full disk.
    pub fn keep_made(&self, key: &[u8; 32], made: &Made) -> Result<(), FormatError> {
        let seal = Seal { kind: *b"made", part: 0, key: *key };
        write_whole(&self.made_path(key), &seal.close(made))
    }

    /// Says that `bytes` were added; where that may be more than the limit, [evicts](Self::evict). Gives the bytes that went.
    ///
    /// Sizes that other processes add at the same moment may be forgotten, until the folder is looked through again.
    pub fn grown_by(&self, bytes: u64) -> u64 {
        let path = self.folder.join(SIZES);
        let known = read_within(&path, 8 * MOST_SIZES).filter(|sizes| !sizes.is_empty());
        let (sizes, odd) = known.as_deref().unwrap_or_default().as_chunks::<8>();
        let total = sizes.iter().fold(bytes, |sum, size| sum.saturating_add(u64::from_le_bytes(*size)));
        let added = || {
            let file = fs::File::options().append(true).open(&path);
            file.and_then(|mut file| file.write_all(&bytes.to_le_bytes())).is_ok()
        };
        let is_known = !sizes.is_empty() && odd.is_empty();
        if is_known && total <= self.limit && added() { 0 } else { self.evict() }
    }

    /// Removes what was not used for longest until the cache is within its limit; gives the bytes that it removed.
    /// What can't be removed stays. What killed runs left goes too.
    pub fn evict(&self) -> u64 {
        let fits = fs::read_dir(self.folder.join("fits")).into_iter().flatten().flatten();
        fits.map(|fit| fit.path())
            .chain([self.folder.join("made")])
            .for_each(|folder| remove_all_strays(&folder));
        let mut entries: Vec<Entry> =
            ["fits", "made"].iter().flat_map(|part| entries(&self.folder.join(part))).collect();
        entries.sort_by(|a, b| (a.used, &a.path).cmp(&(b.used, &b.path)));
        let total: u64 = entries.iter().map(|entry| entry.bytes).sum();
        let mut removed = 0;
        for entry in &entries {
            if total - removed <= self.limit {
                break;
            }
            let gone = if entry.path.is_dir() {
                fs::remove_dir_all(&entry.path)
            } else {
                fs::remove_file(&entry.path)
            };
            removed += if gone.is_ok() { entry.bytes } else { 0 };
        }
        // Where it can't be written the next fit looks again.
        drop(write_whole(&self.folder.join(SIZES), &(total - removed).to_le_bytes()));
        removed
    }

    fn made_path(&self, key: &[u8; 32]) -> PathBuf {
        self.folder.join("made").join(hexadecimal(&key[..16]))
    }
}

/// Something that may be evicted.
struct Entry {
    path: PathBuf,
    bytes: u64,
    used: SystemTime,
}

fn entries(folder: &Path) -> Vec<Entry> {
    let found = fs::read_dir(folder).into_iter().flatten().flatten();
    found
        .filter_map(|entry| {
            let (path, about) = (entry.path(), entry.metadata().ok()?);
            let used = match about.is_dir() {
                true => fs::metadata(path.join(tiles::FACTS)).and_then(|about| about.modified()),
                false => about.modified(),
            };
            let bytes = crate::bytes_on_disk(&path);
            Some(Entry { path, bytes, used: used.or_else(|_| about.modified()).ok()? })
        })
        .collect()
}

/// The bytes of a kept file of at most `limit` bytes; `None` where it isn't there or is longer.
fn read_within(path: &Path, limit: u64) -> Option<Vec<u8>> {
    let mut bytes = Vec::new();
    let whole = fs::File::open(path).ok()?.take(limit + 1).read_to_end(&mut bytes);
    (whole.ok()? as u64 <= limit).then_some(bytes)
}

/// Marks a file as used now.
fn touch(path: &Path) {
    // Where the system refuses, it is evicted sooner.
    let file = fs::File::options().write(true).open(path);
    drop(file.and_then(|file| file.set_modified(SystemTime::now())));
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn made_files_come_back_unless_a_bit_is_another() {
        let folder = tempfile::tempdir().unwrap();
        let cache = Cache::open(&folder.path().join("a cache"), 1 << 30).unwrap();
        let file = MadeFile { suffix: "_1.ktx2".to_owned(), hash: [7; 32] };
        let files = Made { provenance: "{}".to_owned(), judges: [3; 32], files: vec![file] };
        assert_eq!(cache.made(&[1; 32]), None);
        cache.keep_made(&[1; 32], &files).unwrap();
        assert_eq!(cache.made(&[1; 32]), Some(files.clone()));
        // Another key whose file would have the same name.
        let mut alike = [1; 32];
        alike[31] = 2;
        assert_eq!(cache.made(&alike), None);
        for at in 0.. {
            cache.keep_made(&[1; 32], &files).unwrap();
            let path = cache.made_path(&[1; 32]);
            let mut bytes = fs::read(&path).unwrap();
            let Some(byte) = bytes.get_mut(at) else { break };
            *byte ^= 1 << (at % 8);
            fs::write(&path, &bytes).unwrap();
            assert_eq!(cache.made(&[1; 32]), None, "byte {at}");
            assert!(!path.exists());
        }
    }

    #[test]
    fn what_was_not_used_for_longest_goes_first() {
        let folder = tempfile::tempdir().unwrap();
        let cache = Cache::open(folder.path(), 2500).unwrap();
        let keys = [[1u8; 32], [2; 32], [3; 32]];
        for (age, key) in [30, 20, 10].into_iter().zip(&keys) {
            cache.keep_made(key, &Made::default()).unwrap();
            let path = cache.made_path(key);
            let file = fs::File::options().append(true).open(&path).unwrap();
            file.set_len(1000).unwrap();
            file.set_modified(SystemTime::now() - std::time::Duration::from_secs(age)).unwrap();
        }
        assert_eq!(cache.evict(), 1000);
        assert_eq!(keys.map(|key| cache.made_path(&key).exists()), [false, true, true]);
        assert_eq!(cache.evict(), 0);
    }

    #[test]
    fn a_cache_is_looked_through_where_it_may_have_outgrown_its_limit() {
        let folder = tempfile::tempdir().unwrap();
        let cache = Cache::open(folder.path(), 2500).unwrap();
        let keep = |key: u8, bytes: u64| {
            cache.keep_made(&[key; 32], &Made::default()).unwrap();
            let path = cache.made_path(&[key; 32]);
            let file = fs::File::options().append(true).open(&path).unwrap();
            file.set_len(bytes).unwrap();
            file.set_modified(SystemTime::UNIX_EPOCH + std::time::Duration::from_secs(key.into())).unwrap();
        };
        let sizes = folder.path().join(SIZES);
        let numbers = || -> Vec<u64> {
            let bytes = fs::read(&sizes).unwrap();
            bytes.as_chunks::<8>().0.iter().map(|size| u64::from_le_bytes(*size)).collect()
        };
        keep(1, 1000);
        assert_eq!((cache.grown_by(1000), numbers()), (0, vec![1000]));
        keep(2, 1000);
        assert_eq!((cache.grown_by(1000), numbers()), (0, vec![1000, 1000]));
        keep(3, 1000);
        assert_eq!((cache.grown_by(1000), numbers()), (1000, vec![2000]));
        // Odd sizes, none, more than are read, a size that is too large: looked through and written anew.
        for odd in [&[1, 2, 3][..], &[], &[0; 8 * 1025], &[255; 8]] {
            fs::write(&sizes, odd).unwrap();
            assert_eq!((cache.grown_by(0), numbers()), (0, vec![2000]));
        }
        fs::remove_file(&sizes).unwrap();
        assert_eq!((cache.grown_by(0), numbers()), (0, vec![2000]));
    }
}
