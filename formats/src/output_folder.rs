//! Folders that appear whole or not at all: written under a hidden name beside the target, then renamed, unless the
//! same files stand there already.

use crate::FormatError;
use crate::output_file::{folder_around, holds_same};
use crate::temporary::{HiddenFolder, REPLACED, remove_strays};
use std::fs;
use std::io;
use std::path::{Path, PathBuf};

/// A folder for what is only needed for a while, hidden beside an output; gone when it is dropped.
#[derive(Debug)]
pub struct ScratchFolder(HiddenFolder);

impl ScratchFolder {
    /// Makes it in the folder in which `output` is to stand.
    ///
    /// # Errors
    /// [`FormatError::Io`] when that is missing or can't be written to.
    pub fn beside(output: &Path) -> Result<Self, FormatError> {
        let around = folder_around(output, output)?;
        let name = output.file_name().unwrap_or_default();
        remove_strays(name, around);
        let folder = HiddenFolder::create(name, around);
        Ok(Self(folder.map_err(|e| FormatError::io(output, "create", e.kind().into()))?))
    }

    /// Where it is.
    pub fn path(&self) -> &Path {
        self.0.path()
    }
}

/// A folder of files on its way to `path`.
///
/// Files go to `.name.relight-XXXXXX.tmp` beside the target; [`Self::finish`] renames that. Dropping it without
/// `finish` removes the temporary and leaves the target as it was.
#[derive(Debug)]
pub(crate) struct OutputFolder {
    path: PathBuf,
    /// Where a symbolic link at `path` leads, otherwise `path` itself.
    target: PathBuf,
    temporary: HiddenFolder,
}

impl OutputFolder {
    /// Starts a folder that will stand at `path`. A folder that stands there is replaced where it is empty, or
    /// where it has one of each of `marks` and nothing but files whose names `is_own` accepts, those in folders
    /// as `folder/file`.
    ///
    /// # Errors
    /// [`FormatError::Io`] when the folder around it is missing or can't be written to, [`FormatError::Invalid`]
    /// when something else stands at `path`.
    pub(crate) fn create(
        path: &Path,
        marks: &[&[&str]],
        is_own: fn(&str) -> bool,
    ) -> Result<Self, FormatError> {
        let target = path.canonicalize().unwrap_or_else(|_| path.to_owned());
        let Some(name) = target.file_name() else {
            return Err(FormatError::invalid(path, "is not the name of a folder; name one to write"));
        };
        // First, for one that was moved aside may come back.
        let around = folder_around(path, &target)?;
        remove_strays(name, around);
        check_replaceable(path, &target, marks, is_own)?;
        let temporary = HiddenFolder::create(name, around)
            .map_err(|e| FormatError::io(path, "create", e.kind().into()))?;
        Ok(Self { path: path.to_owned(), target, temporary })
    }

    /// The path at which the folder will stand.
    pub(crate) fn path(&self) -> &Path {
        &self.path
    }

    /// Writes a file of the folder, whole.
    ///
    /// # Errors
    /// [`FormatError::Io`], for instance on a full disk.
    pub(crate) fn write(&self, name: &str, bytes: &[u8]) -> Result<(), FormatError> {
        fs::write(self.temporary.path().join(name), bytes).map_err(|e| self.write_error(e))
    }

    /// Writes a file in a folder below, whole; folders are made.
    ///
    /// # Errors
    /// As of [`Self::write`].
    pub(crate) fn write_below(&self, name: &Path, bytes: &[u8]) -> Result<(), FormatError> {
        let path = self.temporary.path().join(name);
        let folder = path.parent().unwrap_or(Path::new("."));
        fs::create_dir_all(folder).and_then(|()| fs::write(&path, bytes)).map_err(|e| self.write_error(e))
    }

    /// Puts the folder in its place. What stood there is moved aside before and removed afterwards; where that has
    /// the same files, it stays as it is, with its times.
    ///
    /// # Errors
    /// [`FormatError::Io`] when it can't be renamed; what stood at the target stands there again.
    pub(crate) fn finish(self) -> Result<(), FormatError> {
        let new = self.temporary.path();
        if holds_same_files(new, &self.target) {
            return Ok(());
        }
        if !self.target.exists() {
            fs::rename(new, &self.target).map_err(|e| self.write_error(e))?;
        } else {
            let (around, name) = (new.parent().unwrap_or(Path::new(".")), self.target.file_name());
            let aside =
                HiddenFolder::create(name.unwrap_or_default(), around).map_err(|e| self.write_error(e))?;
            let old = aside.path().join(REPLACED);
            fs::rename(&self.target, &old).map_err(|e| self.write_error(e))?;
            if let Err(error) = fs::rename(new, &self.target) {
                // The error that matters is the one above.
                drop(fs::rename(&old, &self.target));
                return Err(self.write_error(error));
            }
        }
        // Its name is another one now: there is nothing to remove.
        self.temporary.keep();
        Ok(())
    }

    fn write_error(&self, source: io::Error) -> FormatError {
        FormatError::io(&self.path, "write", source)
    }
}

/// Whether `old` has the files of `new` and nothing else.
fn holds_same_files(new: &Path, old: &Path) -> bool {
    let (Ok(names), Ok(others)) = (names_below(new, "", 0), names_below(old, "", 0)) else { return false };
    let is_same = |name: &String| {
        !name.ends_with('/')
            && fs::File::open(new.join(name)).is_ok_and(|file| holds_same(&file, &old.join(name)))
    };
    names == others && names.iter().all(is_same)
}

/// Folders in folders that are looked into.
const DEPTH: usize = 3;

/// The names of all files below `folder`, with their folders before them; what is neither file nor folder, too
/// deep or an empty folder counts by its own name.
fn names_below(folder: &Path, before: &str, depth: usize) -> io::Result<Vec<String>> {
    let mut names = Vec::new();
    for entry in fs::read_dir(folder)? {
        let entry = entry?;
        let name = format!("{before}{}", entry.file_name().to_string_lossy());
        if entry.file_type()?.is_file() {
            names.push(name);
            continue;
        }
        let within = format!("{name}/");
        let inner = match entry.file_type()?.is_dir() && depth < DEPTH {
            true => names_below(&entry.path(), &within, depth + 1)?,
            false => Vec::new(),
        };
        names.extend(if inner.is_empty() { vec![within] } else { inner });
    }
    names.sort();
    Ok(names)
}

fn check_replaceable(
    path: &Path,
    target: &Path,
    marks: &[&[&str]],
    is_own: fn(&str) -> bool,
) -> Result<(), FormatError> {
    let Ok(metadata) = fs::metadata(target) else { return Ok(()) };
    if !metadata.is_dir() {
        return Err(FormatError::invalid(path, "is a file; name a folder to write, or remove the file"));
    }
    let names = names_below(target, "", 0).map_err(|e| FormatError::io(path, "read", e))?;
    if let Some(name) = names.iter().find(|name| !is_own(name)) {
        let problem =
            format!("would be replaced, but holds {name}, which is no part of an asset; name another folder");
        return Err(FormatError::invalid(path, problem));
    }
    match marks.iter().find(|mark| !names.iter().any(|name| mark.contains(&name.as_str()))) {
        Some(mark) if !names.is_empty() => {
            let mark = mark.join(" or ");
            let problem =
                format!("would be replaced, but is no asset, for it has no {mark}; name another folder");
            Err(FormatError::invalid(path, problem))
        }
        _ => Ok(()),
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::temporary::tests::names_in;

    const MARKS: [&[&str]; 2] = [&["a"], &["b", "B"]];

    fn create(path: &Path) -> Result<OutputFolder, FormatError> {
        OutputFolder::create(path, &MARKS, |name| name.len() == 1)
    }

    #[test]
    fn a_folder_appears_whole_and_replaces_its_like() {
        let around = tempfile::tempdir().unwrap();
        let path = around.path().join("x");
        let first = create(&path).unwrap();
        first.write("a", b"1").unwrap();
        assert!(!path.exists());
        first.write("b", b"2").unwrap();
        first.write("c", b"3").unwrap();
        first.finish().unwrap();
        assert_eq!(names_in(&path), ["a", "b", "c"]);
        let second = create(&path).unwrap();
        second.write("a", b"4").unwrap();
        drop(create(&path).unwrap());
        assert_eq!(fs::read(path.join("a")).unwrap(), b"1");
        second.finish().unwrap();
        assert_eq!(
            (names_in(&path), fs::read(path.join("a")).unwrap()),
            (vec!["a".to_owned()], b"4".to_vec())
        );
        assert_eq!(names_in(around.path()), ["x"]);
    }

    #[test]
    fn the_same_files_stay_with_their_times_and_any_other_replace_all() {
        let around = tempfile::tempdir().unwrap();
        let path = around.path().join("x");
        let write = |files: &[(&str, &str)]| {
            let folder = OutputFolder::create(&path, &[], |_| true).unwrap();
            files.iter().for_each(|(name, text)| {
                folder.write_below(Path::new(name), text.as_bytes()).unwrap();
            });
            folder.finish().unwrap();
        };
        let old = std::time::UNIX_EPOCH + std::time::Duration::from_secs(1_000_000_000);
        let first = [("a", "1"), ("d/b", "22")];
        for (files, stay) in [
            (&first[..], true),
            (&[("a", "1"), ("d/b", "23")], false),
            (&[("a", "1")], false),
            (&[("a", "1"), ("d/b", "22"), ("d/c", "")], false),
            (&[("a", "1"), ("d/c", "22")], false),
        ] {
            write(&first);
            fs::File::options().write(true).open(path.join("a")).unwrap().set_modified(old).unwrap();
            write(files);
            let time = fs::metadata(path.join("a")).unwrap().modified().unwrap();
            assert_eq!(time == old, stay, "{files:?}");
            for (name, text) in files {
                assert_eq!(fs::read(path.join(name)).unwrap(), text.as_bytes());
            }
            assert_eq!(names_below(&path, "", 0).unwrap().len(), files.len());
            assert_eq!(names_in(around.path()), ["x"]);
        }
    }

    #[test]
    fn what_is_not_its_like_stays_as_it_was() {
        let around = tempfile::tempdir().unwrap();
        let path = around.path().join("x");
        fs::create_dir(&path).unwrap();
        drop(create(&path).unwrap());
        let refused = |words: &str| {
            let error = create(&path).unwrap_err().to_string();
            assert!(error.contains(words), "{error}");
        };
        fs::write(path.join("a"), "").unwrap();
        refused("it has no b or B");
        fs::write(path.join("b"), "").unwrap();
        create(&path).unwrap();
        fs::write(path.join("photo.jpg"), "").unwrap();
        refused("holds photo.jpg");
        fs::remove_file(path.join("photo.jpg")).unwrap();
        fs::create_dir(path.join("d")).unwrap();
        refused("holds d/");
        fs::write(path.join("d/long"), "").unwrap();
        refused("holds d/long");
        fs::remove_dir_all(&path).unwrap();
        fs::write(&path, "").unwrap();
        refused("is a file");
        assert!(matches!(create(&path.join("y")), Err(FormatError::Io { .. })));
        assert_eq!(names_in(around.path()), ["x"]);
    }
}
