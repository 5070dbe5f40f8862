//! Files that appear whole or not at all: written under a hidden name beside the target, then
//! renamed over it, unless the same bytes stand there already.

use crate::FormatError;
use crate::positioned::{read_exact_at, write_all_at};
use crate::temporary::{hidden_file, remove_strays};
use std::fs::{self, File};
use std::io::{self, Write};
use std::path::{Path, PathBuf};
use tempfile::NamedTempFile;

/// Bytes of two files that are compared at once.
const COMPARED: usize = 1 << 18;

/// A file on its way to `path`.
///
/// Bytes go to `.name.relight-XXXXXX.tmp` in the same folder; [`Self::finish`] renames that over
/// the target. Dropping it without `finish` removes the temporary and leaves the target as it was.
/// Temporaries that killed runs left of the same target are removed when it is created.
#[derive(Debug)]
pub struct OutputFile {
    path: PathBuf,
    /// Where a symbolic link at `path` leads, otherwise `path` itself.
    target: PathBuf,
    temporary: NamedTempFile,
}

impl OutputFile {
    /// Starts a file that will stand at `path`.
    ///
    /// # Errors
    /// [`FormatError::Io`] when the folder is missing or can't be written to,
    /// [`FormatError::Invalid`] when `path` is a folder or a device.
    pub fn create(path: &Path) -> Result<Self, FormatError> {
        let Some(name) = path.file_name() else {
            return Err(FormatError::invalid(path, "is not the name of a file; name one to write"));
        };
        let target = match fs::canonicalize(path) {
            Ok(target) => target,
            Err(_) => path.to_owned(),
        };
        if let Ok(metadata) = fs::metadata(&target)
            && !metadata.is_file()
        {
            let kind = if metadata.is_dir() { "a folder" } else { "not a regular file" };
            return Err(FormatError::invalid(path, format!("is {kind}; name a file to write")));
        }
        let folder = folder_around(path, &target)?;
        remove_strays(name, folder);
        // The crate's error names the temporary, which would puzzle: keep the kind alone.
        let temporary =
            hidden_file(name, folder).map_err(|e| FormatError::io(path, "create", e.kind().into()))?;
        Ok(Self { path: path.to_owned(), target, temporary })
    }

    /// The path at which the file will stand.
    pub fn path(&self) -> &Path {
        &self.path
    }

    /// A nameless file on the same disk, gone when it is closed.
    pub(crate) fn spool(&self) -> Result<File, FormatError> {
        let folder = self.temporary.path().parent().unwrap_or(Path::new("."));
        tempfile::tempfile_in(folder).map_err(|e| FormatError::io(&self.path, "create", e.kind().into()))
    }

    pub(crate) fn file(&self) -> &File {
        self.temporary.as_file()
    }

    /// Writes `bytes` at `offset` bytes from the start; any number of threads may, at places of
    /// their own. Don't mix with [`Self::write_all`]: where that goes on afterwards differs
    /// between systems.
    ///
    /// # Errors
    /// [`FormatError::Io`], for instance on a full disk.
    pub fn write_at(&self, offset: u64, bytes: &[u8]) -> Result<(), FormatError> {
        write_all_at(self.file(), offset, bytes).map_err(|e| self.write_error(e))
    }

    /// Writes `bytes` after those written before.
    ///
    /// # Errors
    /// [`FormatError::Io`], for instance on a full disk.
    pub fn write_all(&mut self, bytes: &[u8]) -> Result<(), FormatError> {
        self.file().write_all(bytes).map_err(|e| self.write_error(e))
    }

    /// Puts the file in its place, with the permissions of the file that stood there or else those
    /// of any new file. A file of the same bytes stays as it is, with its time: what was made of it need
    /// not be made again.
    ///
    /// # Errors
    /// [`FormatError::Io`] when it can't be renamed; the temporary is removed and what stood at
    /// the target still stands.
    pub fn finish(self) -> Result<(), FormatError> {
        if holds_same(self.file(), &self.target) {
            return Ok(());
        }
        #[cfg(unix)]
        if let Ok(metadata) = fs::metadata(&self.target) {
            self.file().set_permissions(metadata.permissions()).map_err(|e| self.write_error(e))?;
        }
        let Self { path, target, temporary } = self;
        temporary.persist(&target).map_err(|e| FormatError::io(&path, "write", e.error))?;
        Ok(())
    }

    fn write_error(&self, source: io::Error) -> FormatError {
        FormatError::io(&self.path, "write", source)
    }
}

/// The folder in which `target` is to stand; `path` is what the user called that.
///
/// # Errors
/// [`FormatError::Io`] when there is none.
pub(crate) fn folder_around<'a>(path: &Path, target: &'a Path) -> Result<&'a Path, FormatError> {
    let folder = match target.parent() {
        Some(folder) if !folder.as_os_str().is_empty() => folder,
        _ => Path::new("."),
    };
    if folder.is_dir() {
        return Ok(folder);
    }
    let words = format!("there is no folder {}; make it first", folder.display());
    Err(FormatError::io(path, "create", io::Error::new(io::ErrorKind::NotFound, words)))
}

/// Whether the regular file at `path` has the bytes of `new`; one that can't be read has not.
pub(crate) fn holds_same(new: &File, path: &Path) -> bool {
    let same = || -> io::Result<bool> {
        let length = new.metadata()?.len();
        let about = fs::metadata(path)?;
        if !about.is_file() || about.len() != length {
            return Ok(false);
        }
        let old = File::open(path)?;
        let (mut a, mut b) = (vec![0; COMPARED], vec![0; COMPARED]);
        let mut at = 0;
        while at < length {
            let count = COMPARED.min(usize::try_from(length - at).unwrap_or(COMPARED));
            read_exact_at(new, at, &mut a[..count])?;
            read_exact_at(&old, at, &mut b[..count])?;
            if a[..count] != b[..count] {
                return Ok(false);
            }
            at += count as u64;
        }
        Ok(true)
    };
    same().unwrap_or(false)
}

/// Puts all files in their places, in order. When one can't be, those before it that replaced
/// nothing are taken away again.
///
/// # Errors
/// As of [`OutputFile::finish`].
pub(crate) fn finish_all(files: impl IntoIterator<Item = OutputFile>) -> Result<(), FormatError> {
    let mut added = Vec::new();
    for file in files {
        let target = file.target.clone();
        let is_new = !target.exists();
        if let Err(error) = file.finish() {
            // The error that matters is the one above.
            added.iter().for_each(|target| drop(fs::remove_file(target)));
            return Err(error);
        }
        if is_new {
            added.push(target);
        }
    }
    Ok(())
}

/// Writes a whole file at once, by way of an [`OutputFile`].
///
/// # Errors
/// As of [`OutputFile::create`], [`OutputFile::write_all`] and [`OutputFile::finish`].
pub fn write_whole(path: &Path, bytes: &[u8]) -> Result<(), FormatError> {
    let mut file = OutputFile::create(path)?;
    file.write_all(bytes)?;
    file.finish()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::temporary::tests::names_in;

    #[test]
    fn a_dropped_file_leaves_nothing_behind_and_harms_nothing() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("a.ktx2");
        fs::write(&path, "old").unwrap();
        let mut file = OutputFile::create(&path).unwrap();
        file.write_all(b"new bytes").unwrap();
        assert!(names_in(folder.path())[0].starts_with(".a.ktx2.relight-"));
        drop(file);
        assert_eq!(names_in(folder.path()), ["a.ktx2"]);
        assert_eq!(fs::read(&path).unwrap(), b"old");
    }

    #[test]
    fn pieces_written_out_of_order_by_threads_form_one_file() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("pieces");
        let file = OutputFile::create(&path).unwrap();
        std::thread::scope(|scope| {
            for piece in (0..8u8).rev() {
                let file = &file;
                scope.spawn(move || file.write_at(u64::from(piece) * 1000, &[piece; 1000]).unwrap());
            }
        });
        assert!(!path.exists());
        file.finish().unwrap();
        let expected: Vec<u8> = (0..8000u32).map(|i| (i / 1000) as u8).collect();
        assert_eq!(fs::read(&path).unwrap(), expected);
        assert_eq!(names_in(folder.path()), ["pieces"]);
    }

    #[cfg(unix)]
    #[test]
    fn the_mode_is_a_new_files_or_that_of_the_file_replaced() {
        use std::os::unix::fs::PermissionsExt;
        let folder = tempfile::tempdir().unwrap();
        let mode = |path: &Path| fs::metadata(path).unwrap().permissions().mode() & 0o777;
        let (plain, ours) = (folder.path().join("plain"), folder.path().join("ours"));
        fs::write(&plain, "").unwrap();
        write_whole(&ours, b"1").unwrap();
        assert_eq!(mode(&ours), mode(&plain));
        fs::set_permissions(&ours, fs::Permissions::from_mode(0o751)).unwrap();
        write_whole(&ours, b"2").unwrap();
        assert_eq!((mode(&ours), fs::read(&ours).unwrap()), (0o751, b"2".to_vec()));
    }

    /// Sets the time of a file to the year 2001.
    fn age(path: &Path) -> std::time::SystemTime {
        let time = std::time::UNIX_EPOCH + std::time::Duration::from_secs(1_000_000_000);
        File::options().write(true).open(path).unwrap().set_modified(time).unwrap();
        time
    }

    #[test]
    fn the_same_bytes_keep_the_time_and_any_other_replace_it() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("a");
        let long = vec![7u8; 2 * COMPARED + 5];
        let mut last_differs = long.clone();
        last_differs[2 * COMPARED + 4] = 8;
        let mut first_differs = long.clone();
        first_differs[0] = 8;
        let shorter = &long[..2 * COMPARED];
        for (old, new) in [
            (&long[..], &long[..]),
            (&long, &last_differs),
            (&long, &first_differs),
            (&long, shorter),
            (shorter, &long),
            (b"", b""),
            (b"", b"a"),
        ] {
            fs::write(&path, old).unwrap();
            let time = age(&path);
            write_whole(&path, new).unwrap();
            assert!(fs::read(&path).unwrap() == new);
            assert_eq!(fs::metadata(&path).unwrap().modified().unwrap() == time, old == new);
            assert_eq!(names_in(folder.path()), ["a"]);
        }
    }

    #[cfg(unix)]
    #[test]
    fn the_same_bytes_leave_links_and_modes_alone() {
        use std::os::unix::fs::PermissionsExt;
        let folder = tempfile::tempdir().unwrap();
        let (real, link) = (folder.path().join("real"), folder.path().join("link"));
        fs::write(&real, "same").unwrap();
        fs::set_permissions(&real, fs::Permissions::from_mode(0o640)).unwrap();
        std::os::unix::fs::symlink(&real, &link).unwrap();
        let time = age(&real);
        write_whole(&link, b"same").unwrap();
        let about = fs::metadata(&real).unwrap();
        assert_eq!((about.permissions().mode() & 0o777, about.modified().unwrap()), (0o640, time));
        assert!(fs::symlink_metadata(&link).unwrap().is_symlink());
    }

    #[cfg(unix)]
    #[test]
    fn a_link_stays_a_link_and_what_it_names_is_replaced() {
        let folder = tempfile::tempdir().unwrap();
        let (real, link) = (folder.path().join("real"), folder.path().join("link"));
        fs::write(&real, "old").unwrap();
        std::os::unix::fs::symlink(&real, &link).unwrap();
        write_whole(&link, b"new").unwrap();
        assert!(fs::symlink_metadata(&link).unwrap().is_symlink());
        assert_eq!(fs::read(&real).unwrap(), b"new");
    }

    #[test]
    fn folders_devices_and_missing_parents_are_refused_in_words() {
        let folder = tempfile::tempdir().unwrap();
        let refused = OutputFile::create(folder.path()).unwrap_err();
        assert!(refused.to_string().contains("is a folder"), "{refused}");
        let missing = folder.path().join("no").join("a.ktx2");
        let refused = OutputFile::create(&missing).unwrap_err();
        assert!(refused.to_string().contains("a.ktx2"), "{refused}");
        let FormatError::Io { source, .. } = refused else { panic!("{refused}") };
        assert!(source.to_string().contains("there is no folder"), "{source}");
        #[cfg(unix)]
        assert!(OutputFile::create(Path::new("/dev/null")).is_err());
        let long = folder.path().join("x".repeat(250));
        write_whole(&long, b"long").unwrap();
    }
}
