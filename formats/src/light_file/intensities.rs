//! Intensity files: how bright the lamp of each picture was, a line `name factor` or `name r g b` for each, or numbers alone
//! in the order of the light file.

use super::matching::lines_of_pictures;
use super::{
    LARGEST_FILE, MOST_LIGHTS, decode_text, lines, number_from_field, read_bytes, shortened,
    split_last_field, unquoted,
};
use crate::FormatError;
use crate::capture_folder::OpenCapture;
use std::ops::RangeInclusive;
use std::path::{Path, PathBuf};

/// Intensities that a lamp may have; beyond lie slips of the pen, and pictures without light.
const ALLOWED: RangeInclusive<f64> = 1e-4..=1e4;

/// How a line should look, for messages.
const FORM: &str = "write 'name factor' or 'name r g b', or a number a picture alone";

/// One line of an intensity file.
#[derive(Clone, Debug, PartialEq)]
pub struct IntensityEntry {
    /// The picture's name as written, without quotes; `None` where the line has numbers alone.
    pub name: Option<String>,
    /// The line in the file, from 1.
    pub line: usize,
    /// Intensity in linear light of red, green and blue, 1e-4 to 1e4; three alike where the line gives one.
    pub factors: [f64; 3],
    /// Whether the line gives three.
    pub is_colored: bool,
}

/// An intensity file as written.
#[derive(Clone, Debug, PartialEq)]
pub struct IntensityFile {
    /// Where it was read.
    pub path: PathBuf,
    /// Its lines in order, 1..4097 of them: all with names or all without. Without, the first may be the number of pictures.
    pub entries: Vec<IntensityEntry>,
}

/// Reads an intensity file of at most 8 MiB; see [`parse_intensity_file`].
///
/// # Errors
/// [`FormatError::Io`] when it can't be read, and those of [`parse_intensity_file`].
pub fn read_intensity_file(path: &Path) -> Result<IntensityFile, FormatError> {
    parse_intensity_file(&read_bytes(path)?, path)
}

/// Reads an intensity file from memory; `path` is kept and used for messages.
///
/// What is accepted beside the plain form is as in light files: line ends of any kind, blank lines, quotes, blanks in names,
/// decimal commas, a first line with the number of pictures.
///
/// # Errors
/// [`FormatError::Invalid`] naming the line, its value and the allowed range or form; [`FormatError::Unsupported`] for
/// UTF-16 and binary files.
pub fn parse_intensity_file(bytes: &[u8], path: &Path) -> Result<IntensityFile, FormatError> {
    let invalid = |problem: String| FormatError::invalid(path, problem);
    if bytes.len() as u64 > LARGEST_FILE {
        return Err(invalid(format!(
            "is larger than {} MiB, so hardly an intensity file",
            LARGEST_FILE >> 20
        )));
    }
    let text = decode_text(bytes, path, &mut Vec::new())?;
    let filled = lines(&text).enumerate().map(|(index, line)| (index + 1, line.trim()));
    let filled: Vec<(usize, &str)> =
        filled.filter(|(_, line)| !line.is_empty()).take(MOST_LIGHTS + 2).collect();
    let is_named = |(number, line): &(usize, &str)| {
        entry_from_line(line, *number).is_ok_and(|entry| entry.name.is_some())
    };
    // With names a first number alone is how many there are, as in light files.
    let skipped = match filled.split_first() {
        Some(((_, first), rest)) if first.parse::<u64>().is_ok() && rest.first().is_some_and(is_named) => 1,
        _ => 0,
    };
    let mut entries: Vec<IntensityEntry> = Vec::new();
    for &(number, line) in &filled[skipped..] {
        let is_count = skipped == 0 && entries.is_empty() && line.parse::<u64>().is_ok();
        let entry = entry_from_line(line, number).map_err(invalid)?;
        if let Some(first) = entries.first()
            && first.name.is_some() != entry.name.is_some()
        {
            let words = |entry: &IntensityEntry| if entry.name.is_some() { "a name" } else { "no name" };
            return Err(invalid(format!(
                "line {number}: '{}' has {} where line {} has {}; give every line a name or none",
                shortened(line),
                words(&entry),
                first.line,
                words(first)
            )));
        }
        if !is_count {
            check_range(&entry).map_err(invalid)?;
        }
        entries.push(entry);
    }
    if entries.is_empty() {
        return Err(invalid(format!("it lists no intensity; {FORM}")));
    }
    if entries.len() > MOST_LIGHTS + 1 {
        return Err(invalid(format!("has more than {MOST_LIGHTS} lines; give 1..{MOST_LIGHTS}")));
    }
    Ok(IntensityFile { path: path.to_owned(), entries })
}

fn check_range(entry: &IntensityEntry) -> Result<(), String> {
    let outside = entry.factors.into_iter().find(|factor| !ALLOWED.contains(factor));
    outside.map_or(Ok(()), |factor| {
        Err(format!(
            "line {}: intensity {factor} is outside {:e}..{:e}; give the lamp's brightness as a factor, 1 for the usual one",
            entry.line,
            ALLOWED.start(),
            ALLOWED.end()
        ))
    })
}

fn entry_from_line(line: &str, number: usize) -> Result<IntensityEntry, String> {
    // The last fields that are numbers, the last first, each with what precedes it.
    let mut fields: Vec<(&str, f64)> = Vec::new();
    let mut rest = line;
    while fields.len() < 4
        && let Some((before, field)) = split_last_field(rest)
        && let Some(value) = number_from_field(field)
    {
        fields.push((before, value));
        rest = before;
    }
    let has_text = !rest.trim().is_empty();
    // A name may end in a number, or be one: 'image 01 1.5', '01 1.5', '01 1.5 1.4 1.2'.
    let count = match (has_text, fields.len()) {
        (_, 0) => return Err(format!("line {number}: '{}' ends in no number; {FORM}", shortened(line))),
        (_, 1 | 2) => 1,
        (_, _) => 3,
    };
    let is_named = has_text || matches!(fields.len(), 2 | 4);
    let name =
        is_named.then(|| unquoted(fields[count - 1].0.trim_end_matches([' ', '\t', ',', ';'])).to_owned());
    let value = |channel: usize| if count == 1 { fields[0].1 } else { fields[2 - channel].1 };
    Ok(IntensityEntry { name, line: number, factors: [0, 1, 2].map(value), is_colored: count == 3 })
}

impl IntensityFile {
    /// The intensity of every picture of `capture`, in its order, each R, G, B.
    ///
    /// Names are those of the capture's light file, or are found as [`super::match_pictures`] finds them. Lines of pictures that
    /// the capture lacks are passed over; numbers without names are taken in its order.
    ///
    /// # Errors
    /// [`FormatError::Invalid`] naming pictures without a line, two lines of one picture, a name that several files match,
    /// three numbers for a grey picture, or how many numbers there are for how many pictures; [`FormatError::Io`] when the
    /// capture's folder can't be read.
    pub fn factors_of(&self, capture: &OpenCapture) -> Result<Vec<[f64; 3]>, FormatError> {
        let invalid = |problem: String| FormatError::invalid(&self.path, problem);
        let pictures = capture.infos.len();
        let entries = match self.entries.iter().all(|entry| entry.name.is_some()) {
            true => {
                let lines =
                    self.entries.iter().map(|entry| (entry.name.as_deref().unwrap_or_default(), entry.line));
                let found = lines_of_pictures(&self.path, lines, capture, "name factor")?;
                found.into_iter().map(|at| &self.entries[at]).collect()
            }
            false => {
                let first = &self.entries[0];
                // The first is the number of pictures where that leaves as many as there are.
                let counts = self.entries.len() == pictures + 1 && first.factors == [pictures as f64; 3];
                let entries: Vec<_> = self.entries.iter().skip(usize::from(counts)).collect();
                if entries.len() != pictures {
                    return Err(invalid(format!(
                        "has {} numbers for {pictures} pictures; give each line the name of its picture, or as many numbers as \
                         pictures",
                        entries.len()
                    )));
                }
                // In the order of the light file, whatever that of the capture is.
                let mut of_pictures = entries.clone();
                capture
                    .as_listed()
                    .into_iter()
                    .zip(entries)
                    .for_each(|(picture, entry)| of_pictures[picture] = entry);
                of_pictures
            }
        };
        // A first number was let pass as a count.
        entries.iter().try_for_each(|entry| check_range(entry)).map_err(invalid)?;
        if let Some(entry) = entries.iter().find(|entry| entry.is_colored && capture.is_grey()) {
            return Err(invalid(format!(
                "line {}: three intensities for pictures of one channel; give one",
                entry.line
            )));
        }
        Ok(entries.into_iter().map(|entry| entry.factors).collect())
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn parsed(text: &str) -> Result<IntensityFile, String> {
        parse_intensity_file(text.as_bytes(), Path::new("i.txt")).map_err(|error| error.to_string())
    }

    #[test]
    fn names_may_have_blanks_and_numbers() {
        let text = "5\r\n\"my pic 1.png\" 1,5\r\n\nb 2.jpg\t0.5;0.25;2\n03 4\n04 1 2 3\nc, 7\n";
        let entries = parsed(text).unwrap().entries;
        let expected: [(&str, usize, [f64; 3], bool); 5] = [
            ("my pic 1.png", 2, [1.5; 3], false),
            ("b 2.jpg", 4, [0.5, 0.25, 2.0], true),
            ("03", 5, [4.0; 3], false),
            ("04", 6, [1.0, 2.0, 3.0], true),
            ("c", 7, [7.0; 3], false),
        ];
        let found: Vec<_> =
            entries.iter().map(|e| (e.name.as_deref().unwrap(), e.line, e.factors, e.is_colored)).collect();
        assert_eq!(found, expected);
        let alone = parsed("1.5\n0.25 0.5 2\n").unwrap().entries;
        assert!(alone.iter().all(|entry| entry.name.is_none()));
        assert_eq!([alone[0].factors, alone[1].factors], [[1.5; 3], [0.25, 0.5, 2.0]]);
    }

    #[test]
    fn what_is_no_intensity_is_named_with_its_line() {
        for (text, words) in [
            ("a 1\n\nb 0\n", "line 3: intensity 0 is outside 1e-4..1e4"),
            ("a -2\n", "line 1: intensity -2 is outside"),
            ("a 1\nb nan\n", "line 2: intensity NaN"),
            ("a 1\nb 1 2 inf\n", "line 2: intensity inf"),
            ("a 1\nb\n", "line 2: 'b' ends in no number"),
            ("1.5\nb 2\n", "line 2: 'b 2' has a name where line 1 has no name"),
            ("\n\n", "lists no intensity"),
        ] {
            let error = parsed(text).unwrap_err();
            assert!(error.contains(words), "{text:?}: {error}");
        }
        let many = "1\n".repeat(MOST_LIGHTS + 5);
        assert!(parsed(&many).unwrap_err().contains("more than 4096 lines"));
    }

    #[test]
    fn mangled_bytes_are_entries_or_errors() {
        let valid = b"3\nname one.png 1.5\n\"b\" 0.5 0.25 2\nc;7\n".to_vec();
        let mut state = 7u64;
        let mut random = |below: usize| {
            state = state.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
            (state >> 33) as usize % below
        };
        for _ in 0..2000 {
            let mut bytes = valid.clone();
            bytes.truncate(random(valid.len()) + 1);
            for _ in 0..random(4) {
                let at = random(bytes.len());
                bytes[at] = random(256) as u8;
            }
            if let Ok(file) = parse_intensity_file(&bytes, Path::new("i.txt")) {
                let named = file.entries.iter().filter(|entry| entry.name.is_some()).count();
                assert!(named == 0 || named == file.entries.len());
                let inner = file.entries.iter().skip(1).flat_map(|entry| entry.factors);
                assert!(inner.into_iter().all(|factor| ALLOWED.contains(&factor)));
            }
        }
    }
}
