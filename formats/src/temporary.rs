//! Hidden temporaries beside outputs, and what is left of those whose writer was killed.
//!
//! A writer holds the system's advisory lock of its temporary, which goes with the process however that ends. The next
//! run that writes the same output removes the temporaries of that output whose lock nobody holds.

use std::collections::HashMap;
use std::ffi::{OsStr, OsString};
use std::fs::{self, File, TryLockError};
use std::io;
use std::path::{Path, PathBuf};
use std::sync::{LazyLock, Mutex, PoisonError};
use tempfile::{Builder, NamedTempFile, TempDir};

/// Names longer than this are left out of the temporary's own: systems end at 255 bytes.
const LONGEST_NAME: usize = 200;

/// Random characters in the name.
const RANDOM: usize = 6;

const SUFFIX: &str = ".tmp";

/// A new temporary can be taken for a stray before it is locked; so often in a row only by ill will.
const ATTEMPTS: usize = 16;

/// What a folder that gives way is called within its temporary until the new one stands.
pub(crate) const REPLACED: &str = "old";

/// A file `.name.relight-XXXXXX.tmp` in `folder`, gone when it is dropped.
pub(crate) fn hidden_file(name: &OsStr, folder: &Path) -> io::Result<NamedTempFile> {
    let prefix = prefix_of(name);
    for _ in 0..ATTEMPTS {
        let temporary = hidden(&prefix, 0o666).tempfile_in(folder)?;
        if is_locked(temporary.as_file(), temporary.path()) {
            return Ok(temporary);
        }
    }
    Err(io::ErrorKind::WouldBlock.into())
}

/// A folder for a while, gone when it is dropped.
#[derive(Debug)]
pub(crate) struct HiddenFolder {
    folder: TempDir,
    /// Its lock, let go after it was removed.
    lock: Option<File>,
}

impl HiddenFolder {
    /// `.name.relight-XXXXXX.tmp` in `around`.
    pub(crate) fn create(name: &OsStr, around: &Path) -> io::Result<Self> {
        let prefix = prefix_of(name);
        for _ in 0..ATTEMPTS {
            let folder = hidden(&prefix, 0o777).tempdir_in(around)?;
            let lock = open_folder(folder.path());
            if lock.as_ref().is_none_or(|lock| is_locked(lock, folder.path())) {
                return Ok(Self { folder, lock });
            }
        }
        Err(io::ErrorKind::WouldBlock.into())
    }

    pub(crate) fn path(&self) -> &Path {
        self.folder.path()
    }

    /// Leaves the folder where it is now.
    pub(crate) fn keep(self) {
        let Self { folder, lock } = self;
        let _ = folder.keep();
        drop(lock);
    }
}

/// How temporaries are made, with the permissions `mode` that the system gives what is new: it takes the umask off these.
fn hidden(prefix: &OsStr, mode: u32) -> Builder<'_, 'static> {
    let mut builder = Builder::new();
    builder.prefix(prefix).suffix(SUFFIX).rand_bytes(RANDOM);
    // Elsewhere there is no such mode.
    let _ = mode;
    #[cfg(unix)]
    builder.permissions(std::os::unix::fs::PermissionsExt::from_mode(mode));
    builder
}

fn prefix_of(name: &OsStr) -> OsString {
    let mut prefix = OsString::from(".");
    if name.len() <= LONGEST_NAME {
        prefix.push(name);
    }
    prefix.push(".relight-");
    prefix
}

/// Takes the lock of a new temporary; false where it was removed for a stray meanwhile. File systems without locks
/// have no strays removed either.
fn is_locked(file: &File, path: &Path) -> bool {
    match file.try_lock() {
        Err(TryLockError::WouldBlock) => false,
        Ok(()) | Err(TryLockError::Error(_)) => is_same(file, path),
    }
}

/// Whether `path` names `file`.
#[cfg(unix)]
fn is_same(file: &File, path: &Path) -> bool {
    use std::os::unix::fs::MetadataExt;
    let place = |about: fs::Metadata| (about.dev(), about.ino());
    file.metadata().map(place).ok().is_some_and(|open| fs::metadata(path).map(place).ok() == Some(open))
}

/// Whether `path` still stands: there, what is open isn't removed.
#[cfg(not(unix))]
fn is_same(_: &File, path: &Path) -> bool {
    path.exists()
}

/// A handle that can be locked; systems that have none for folders leave stray ones.
fn open_folder(path: &Path) -> Option<File> {
    if cfg!(unix) { File::open(path).ok() } else { None }
}

/// Removes what killed runs left of the output `name` in `folder`. A folder that one of them had moved aside and
/// not replaced stands at `name` again.
pub(crate) fn remove_strays(name: &OsStr, folder: &Path) {
    let prefix = prefix_of(name);
    for stray in temporaries_in(folder).iter().filter(|stray| is_temporary(stray, &prefix)) {
        remove_stray(&folder.join(stray), &folder.join(name));
    }
}

/// Removes what killed runs left of any output in `folder`, which holds nothing but ours.
pub(crate) fn remove_all_strays(folder: &Path) {
    let entries = fs::read_dir(folder).into_iter().flatten().flatten();
    for entry in entries.filter(|entry| is_temporary(&entry.file_name(), OsStr::new("."))) {
        remove_stray(&entry.path(), &entry.path());
    }
}

/// Removes the temporary at `path`, unless its writer lives; it was to stand at `target`.
fn remove_stray(path: &Path, target: &Path) {
    let Ok(about) = fs::symlink_metadata(path) else { return };
    let handle = match (about.is_file(), about.is_dir()) {
        (true, _) => fs::OpenOptions::new().read(true).write(true).open(path).ok(),
        (_, true) => open_folder(path),
        _ => None,
    };
    let Some(_handle) = handle.filter(|handle| handle.try_lock().is_ok()) else { return };
    // What can't be removed now is the next run's.
    let _ = match about.is_file() {
        true => fs::remove_file(path),
        false => {
            let replaced = path.join(REPLACED);
            if replaced.is_dir() && !target.exists() {
                let _ = fs::rename(&replaced, target);
            }
            fs::remove_dir_all(path)
        }
    };
}

/// The temporaries of any output that stood in `folder` when this process first asked: strays are older than it, and a
/// folder of ten thousand pictures is not read ten thousand times.
fn temporaries_in(folder: &Path) -> Vec<OsString> {
    static FOUND: LazyLock<Mutex<HashMap<PathBuf, Vec<OsString>>>> = LazyLock::new(Mutex::default);
    let mut found = FOUND.lock().unwrap_or_else(PoisonError::into_inner);
    let list = found.entry(folder.to_owned()).or_insert_with(|| {
        let entries = fs::read_dir(folder).into_iter().flatten().flatten();
        entries.map(|entry| entry.file_name()).filter(|name| is_temporary(name, OsStr::new("."))).collect()
    });
    list.clone()
}

/// Whether a name is one of ours that begins with `prefix`.
fn is_temporary(name: &OsStr, prefix: &OsStr) -> bool {
    let (name, prefix) = (name.as_encoded_bytes(), prefix.as_encoded_bytes());
    let Some(before) = name.strip_suffix(SUFFIX.as_bytes()) else { return false };
    let Some((before, random)) = before.len().checked_sub(RANDOM).map(|at| before.split_at(at)) else {
        return false;
    };
    let is_whole = prefix == b"." || before == prefix;
    is_whole
        && before.starts_with(prefix)
        && before.ends_with(b".relight-")
        && random.iter().all(u8::is_ascii_alphanumeric)
}

#[cfg(test)]
pub(crate) mod tests {
    use super::*;

    /// Names in `folder`, hidden ones too, sorted.
    pub(crate) fn names_in(folder: &Path) -> Vec<String> {
        let names = fs::read_dir(folder).unwrap();
        let mut names: Vec<_> = names.map(|e| e.unwrap().file_name().into_string().unwrap()).collect();
        names.sort();
        names
    }

    #[test]
    fn only_an_outputs_own_temporaries_that_nobody_holds_are_removed() {
        let folder = tempfile::tempdir().unwrap();
        let here = folder.path();
        let kept = [
            ".a.ktx2.relight-ABC123.tmp.txt",
            ".a.ktx2.relight-ABC12.tmp",
            ".b.a.ktx2.relight-ABC123.tmp",
            "a.ktx2",
            ".a.relight-b.relight-ABC123.tmp",
        ];
        kept.iter().for_each(|name| fs::write(here.join(name), "").unwrap());
        fs::write(here.join(".a.ktx2.relight-ABC123.tmp"), "half").unwrap();
        #[cfg(unix)]
        {
            fs::create_dir_all(here.join(".a.ktx2.relight-xyz789.tmp/deep")).unwrap();
            fs::write(here.join(".a.ktx2.relight-xyz789.tmp/deep/x"), "").unwrap();
        }
        let name = OsStr::new("a.ktx2");
        let held = (hidden_file(name, here).unwrap(), HiddenFolder::create(name, here).unwrap());
        let held_names: Vec<String> = [held.0.path(), held.1.path()]
            .map(|path| path.file_name().unwrap().to_str().unwrap().to_owned())
            .to_vec();
        remove_strays(name, here);
        let mut expected: Vec<String> = kept.map(str::to_owned).into_iter().chain(held_names).collect();
        expected.sort();
        assert_eq!(names_in(here), expected);
        drop(held);
        let mut expected = kept.to_vec();
        expected.sort_unstable();
        assert_eq!(names_in(here), expected);
    }

    #[cfg(unix)]
    #[test]
    fn a_folder_that_was_moved_aside_and_not_replaced_comes_back() {
        for stands in [false, true] {
            let folder = tempfile::tempdir().unwrap();
            let here = folder.path();
            let aside = here.join(".x.web.relight-ABC123.tmp").join(REPLACED);
            fs::create_dir_all(&aside).unwrap();
            fs::write(aside.join("a"), "old").unwrap();
            if stands {
                fs::create_dir(here.join("x.web")).unwrap();
                fs::write(here.join("x.web/a"), "new").unwrap();
            }
            remove_strays(OsStr::new("x.web"), here);
            assert_eq!(names_in(here), ["x.web"]);
            assert_eq!(fs::read(here.join("x.web/a")).unwrap(), if stands { b"new" } else { b"old" });
        }
    }
}
