//! Finding the pictures that a light file names.

use super::{LightEntry, LightFile};
use crate::FormatError;
use crate::capture_folder::OpenCapture;
use crate::picture::has_picture_extension;
use relight_core::{Light, LightSet};
use std::cmp::Ordering;
use std::collections::HashMap;
use std::ffi::OsString;
use std::fs;
use std::path::{Path, PathBuf};

/// Most missing names that a message lists.
const MOST_LISTED: usize = 5;

/// Likeness of two names, 0..1, from which one is proposed for the other.
const SIMILAR: f64 = 0.7;

/// A light file and the pictures it belongs to, in the order of its lines.
#[derive(Clone, Debug, PartialEq)]
pub struct Capture {
    /// The light file.
    pub light_file: PathBuf,
    /// Names as written and directions of all lights.
    pub lights: LightSet,
    /// One path per light.
    pub pictures: Vec<PathBuf>,
    /// One vector per light, as written.
    pub vectors: Vec<[f64; 3]>,
    /// Notes of the light file, then those of finding the pictures.
    pub notes: Vec<String>,
}

/// What a light file and its folder don't have in common.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Unmatched {
    /// Lines whose name no file bears.
    pub entries: Vec<LightEntry>,
    /// Pictures in the folder that no line names, sorted.
    pub pictures: Vec<PathBuf>,
}

/// Finds the picture of every line of `file`.
///
/// A relative path with folders counts as written when it exists. Otherwise the base name (after
/// the last `/` or `\`) is looked for in the light file's folder: exactly, then in any case, then
/// with another picture extension, which is noted. Only when no name at all matches and the folder
/// holds as many pictures as the file has lines are they paired in order of their names (numbers
/// by value), with a note.
///
/// # Errors
/// [`FormatError::Invalid`] naming up to five missing names with the most similar existing one,
/// two lines that name the same picture, or a name that several files match;
/// [`FormatError::Io`] when the folder can't be read.
pub fn match_pictures(file: &LightFile) -> Result<Capture, FormatError> {
    let folder = Folder::read(&file.path)?;
    let found = folder.find_all(file)?;
    let mut notes = file.notes.clone();
    let missing: Vec<&LightEntry> = file
        .entries
        .iter()
        .zip(&found)
        .filter(|(_, found)| found.is_none())
        .map(|(entry, _)| entry)
        .collect();
    let pictures = if missing.is_empty() {
        note_other_extensions(file, &found, &mut notes);
        found.into_iter().flatten().map(|found| found.path).collect()
    } else {
        let pictures = folder.pictures();
        if missing.len() < file.entries.len() || pictures.len() != file.entries.len() {
            return Err(FormatError::invalid(&file.path, folder.missing_problem(file, &missing)));
        }
        notes.push(format!(
            "none of the {0} names matches a file; as the folder holds {0} pictures, they were taken in order of \
             their names ('{1}' is line {2}): check that this is the order of the lines",
            pictures.len(),
            pictures[0].file_name().unwrap_or_default().to_string_lossy(),
            file.entries[0].line
        ));
        pictures
    };
    check_distinct(file, &pictures)?;
    let lights =
        file.entries.iter().map(|e| Light { name: e.name.clone(), direction: e.direction }).collect();
    Ok(Capture {
        light_file: file.path.clone(),
        lights: LightSet { lights },
        pictures,
        vectors: file.entries.iter().map(|entry| entry.vector).collect(),
        notes,
    })
}

/// Lines of `file` that no file matches and pictures in its folder that no line matches; both are
/// empty for a capture in order.
///
/// # Errors
/// [`FormatError::Io`] when the folder can't be read, [`FormatError::Invalid`] when several files
/// match one name.
pub fn unmatched(file: &LightFile) -> Result<Unmatched, FormatError> {
    let folder = Folder::read(&file.path)?;
    let found = folder.find_all(file)?;
    let mut pictures = folder.pictures();
    pictures.retain(|picture| !found.iter().flatten().any(|found| found.path == *picture));
    let entries = file.entries.iter().zip(&found).filter(|(_, found)| found.is_none());
    Ok(Unmatched { entries: entries.map(|(entry, _)| entry.clone()).collect(), pictures })
}

/// The line of every picture of `capture`, in its order: indices into `lines`, which are names and line numbers of another
/// file. Lines of pictures that the capture lacks are passed over.
///
/// Names are those of the capture's light file, or are found as [`match_pictures`] finds them. `path` is that of the lines, `form`
/// how a line that is missing should look.
///
/// # Errors
/// [`FormatError::Invalid`] naming pictures without a line, two lines of one picture, or a name that several files match;
/// [`FormatError::Io`] when the capture's folder can't be read.
pub(super) fn lines_of_pictures<'a>(
    path: &Path,
    lines: impl Iterator<Item = (&'a str, usize)>,
    capture: &OpenCapture,
    form: &str,
) -> Result<Vec<usize>, FormatError> {
    let invalid = |problem: String| FormatError::invalid(path, problem);
    let capture = &capture.capture;
    let folder = Folder::read(&capture.light_file)?;
    let lights = capture.lights.lights.iter().enumerate();
    let by_name: HashMap<&str, usize> = lights.map(|(i, light)| (light.name.as_str(), i)).collect();
    let pictures = capture.pictures.iter().enumerate();
    let by_path: HashMap<&Path, usize> = pictures.map(|(i, path)| (path.as_path(), i)).collect();
    let mut found: Vec<Option<(usize, usize)>> = vec![None; capture.pictures.len()];
    for (at, (name, line)) in lines.enumerate() {
        let index = match by_name.get(name) {
            Some(index) => Some(*index),
            None => {
                let file = folder.find(name, line).map_err(invalid)?;
                file.and_then(|file| by_path.get(file.path.as_path()).copied())
            }
        };
        let Some(index) = index else { continue };
        if let Some((_, first)) = found[index].replace((at, line)) {
            return Err(invalid(format!(
                "lines {first} and {line} both name '{}'; remove one of them",
                capture.lights.lights[index].name
            )));
        }
    }
    let missing: Vec<&str> = found
        .iter()
        .zip(&capture.lights.lights)
        .filter(|(entry, _)| entry.is_none())
        .map(|(_, light)| light.name.as_str())
        .collect();
    if !missing.is_empty() {
        let listed = missing[..missing.len().min(MOST_LISTED)].join("', '");
        let more = if missing.len() > MOST_LISTED { " and more" } else { "" };
        return Err(invalid(format!(
            "{} of {} pictures have no line: '{listed}'{more}; add '{form}' for each",
            missing.len(),
            found.len()
        )));
    }
    Ok(found.into_iter().flatten().map(|(at, _)| at).collect())
}

/// A picture that a line names.
struct Found {
    path: PathBuf,
    /// Whether the line gives it another extension.
    is_other_extension: bool,
}

/// The folder of a light file, with its files under the forms of name that are looked for.
struct Folder {
    path: PathBuf,
    /// Sorted by name, numbers by value.
    names: Vec<OsString>,
    by_lower_name: HashMap<String, Vec<usize>>,
    /// Pictures only.
    by_lower_stem: HashMap<String, Vec<usize>>,
}

impl Folder {
    /// The folder that `light_file` is in.
    fn read(light_file: &Path) -> Result<Self, FormatError> {
        let path = match light_file.parent() {
            Some(parent) if !parent.as_os_str().is_empty() => parent.to_owned(),
            _ => PathBuf::from("."),
        };
        let names = file_names(&path)?;
        let mut by_lower_name: HashMap<String, Vec<usize>> = HashMap::new();
        let mut by_lower_stem: HashMap<String, Vec<usize>> = HashMap::new();
        for (index, name) in names.iter().enumerate() {
            let lower = name.to_string_lossy().to_lowercase();
            if has_picture_extension(Path::new(name)) {
                by_lower_stem.entry(stem(&lower).to_owned()).or_default().push(index);
            }
            by_lower_name.entry(lower).or_default().push(index);
        }
        Ok(Self { path, names, by_lower_name, by_lower_stem })
    }

    fn pictures(&self) -> Vec<PathBuf> {
        let pictures = self.names.iter().filter(|name| has_picture_extension(Path::new(name)));
        pictures.map(|name| self.path.join(name)).collect()
    }

    fn find_all(&self, file: &LightFile) -> Result<Vec<Option<Found>>, FormatError> {
        let find = |entry: &LightEntry| {
            self.find(&entry.name, entry.line).map_err(|problem| FormatError::invalid(&file.path, problem))
        };
        file.entries.iter().map(find).collect()
    }

    /// The file that line `line` means by `name`.
    fn find(&self, name: &str, line: usize) -> Result<Option<Found>, String> {
        let found = |path| Ok(Some(Found { path, is_other_extension: false }));
        let relative = PathBuf::from(name.replace('\\', "/"));
        if relative.components().count() > 1 && relative.is_relative() && self.path.join(&relative).is_file()
        {
            return found(self.path.join(relative));
        }
        let base = base_name(name);
        // A name with a backslash may be a file's whole name where that is no separator.
        if let Some(file) = self.names.iter().find(|file| **file == *name) {
            return found(self.path.join(file));
        }
        if let Some(file) = self.names.iter().find(|file| **file == *base) {
            return found(self.path.join(file));
        }
        let lower = base.to_lowercase();
        if let Some(index) = self.only(&self.by_lower_name, &lower, (name, line))? {
            return found(self.path.join(&self.names[index]));
        }
        let index = self.only(&self.by_lower_stem, stem(&lower), (name, line))?;
        Ok(index.map(|index| Found { path: self.path.join(&self.names[index]), is_other_extension: true }))
    }

    fn only(
        &self,
        index: &HashMap<String, Vec<usize>>,
        key: &str,
        (name, line): (&str, usize),
    ) -> Result<Option<usize>, String> {
        match index.get(key).map_or(&[][..], Vec::as_slice) {
            [] => Ok(None),
            [only] => Ok(Some(*only)),
            several => {
                let names: Vec<_> = several.iter().map(|&at| self.names[at].to_string_lossy()).collect();
                Err(format!(
                    "line {line}: '{name}' may be any of {}; write the name of one of them",
                    names.join(", ")
                ))
            }
        }
    }

    fn missing_problem(&self, file: &LightFile, missing: &[&LightEntry]) -> String {
        let pictures = self.pictures();
        let names: Vec<_> =
            pictures.iter().filter_map(|path| path.file_name()).map(|name| name.to_string_lossy()).collect();
        let describe = |entry: &&LightEntry| {
            let base = base_name(&entry.name).to_lowercase();
            let likeness = |name: &str| strsim::normalized_damerau_levenshtein(&base, &name.to_lowercase());
            let similar = names.iter().map(|name| (likeness(name), name)).max_by(|a, b| a.0.total_cmp(&b.0));
            match similar.filter(|(likeness, _)| *likeness >= SIMILAR) {
                Some((_, name)) => format!("line {}: '{}' (similar: '{name}')", entry.line, entry.name),
                None => format!("line {}: '{}'", entry.line, entry.name),
            }
        };
        let mut listed: Vec<_> = missing.iter().take(MOST_LISTED).map(describe).collect();
        if missing.len() > MOST_LISTED {
            listed.push(format!("and {} more", missing.len() - MOST_LISTED));
        }
        format!(
            "{} of {} pictures are not in {}, which holds {} pictures: {}; correct the names or add the files",
            missing.len(),
            file.entries.len(),
            self.path.display(),
            names.len(),
            listed.join(", ")
        )
    }
}

fn note_other_extensions(file: &LightFile, found: &[Option<Found>], notes: &mut Vec<String>) {
    let mut others =
        file.entries.iter().zip(found.iter().flatten()).filter(|(_, found)| found.is_other_extension);
    if let Some((entry, first)) = others.next() {
        notes.push(format!(
            "{} pictures have another extension than the light file gives them (line {}: '{}' is '{}')",
            1 + others.count(),
            entry.line,
            entry.name,
            first.path.file_name().unwrap_or_default().to_string_lossy()
        ));
    }
}

fn check_distinct(file: &LightFile, pictures: &[PathBuf]) -> Result<(), FormatError> {
    let mut lines: HashMap<&Path, usize> = HashMap::new();
    for (entry, picture) in file.entries.iter().zip(pictures) {
        if let Some(first) = lines.insert(picture, entry.line) {
            let problem = format!(
                "lines {first} and {} both name '{}'; remove one of them",
                entry.line,
                picture.file_name().unwrap_or_default().to_string_lossy()
            );
            return Err(FormatError::invalid(&file.path, problem));
        }
    }
    Ok(())
}

/// Names of the files in `folder` that aren't hidden, sorted with numbers by value.
pub(super) fn file_names(folder: &Path) -> Result<Vec<OsString>, FormatError> {
    let io = |source| FormatError::io(folder, "list", source);
    let mut names = Vec::new();
    for entry in fs::read_dir(folder).map_err(io)? {
        let entry = entry.map_err(io)?;
        let name = entry.file_name();
        if entry.path().is_file() && !name.as_encoded_bytes().starts_with(b".") {
            names.push(name);
        }
    }
    names.sort_by(|a, b| compare_names(&a.to_string_lossy(), &b.to_string_lossy()).then_with(|| a.cmp(b)));
    Ok(names)
}

/// Compares by characters, but runs of digits by value: `b2` before `b10`.
fn compare_names(a: &str, b: &str) -> Ordering {
    let (mut a, mut b) = (a, b);
    loop {
        let (run_a, rest_a) = a.split_at(a.find(|c: char| !c.is_ascii_digit()).unwrap_or(a.len()));
        let (run_b, rest_b) = b.split_at(b.find(|c: char| !c.is_ascii_digit()).unwrap_or(b.len()));
        if !run_a.is_empty() && !run_b.is_empty() {
            let (digits_a, digits_b) = (run_a.trim_start_matches('0'), run_b.trim_start_matches('0'));
            let order = digits_a.len().cmp(&digits_b.len()).then_with(|| digits_a.cmp(digits_b));
            if order != Ordering::Equal {
                return order;
            }
            (a, b) = (rest_a, rest_b);
            continue;
        }
        let (mut chars_a, mut chars_b) = (a.chars(), b.chars());
        match (chars_a.next(), chars_b.next()) {
            (Some(x), Some(y)) if x == y => (a, b) = (chars_a.as_str(), chars_b.as_str()),
            (x, y) => return x.cmp(&y),
        }
    }
}

/// What follows the last `/` or `\`.
fn base_name(name: &str) -> &str {
    name.rsplit(['/', '\\']).next().unwrap_or(name)
}

/// What precedes the last dot.
fn stem(name: &str) -> &str {
    name.rsplit_once('.').map_or(name, |(stem, _)| stem)
}
