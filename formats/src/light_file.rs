//! `.lp` light files: the number of pictures, then a line for each with its name and the
//! direction of its light (x right, y up, z out of the picture, from the surface to the light).
//!
//! [`read_light_file`] reads what is written, [`match_pictures`] finds the pictures: names decide,
//! never the order of lines alone.

mod intensities;
mod lamp_positions;
mod matching;
mod writing;

pub use intensities::{IntensityEntry, IntensityFile, parse_intensity_file, read_intensity_file};
pub use matching::{Capture, Unmatched, match_pictures, unmatched};
pub use writing::{pictures_in, write_light_file};

use crate::FormatError;
use relight_core::{Direction, DirectionError};
use std::fs;
use std::io::Read;
use std::path::{Path, PathBuf};

/// Largest light file that is read; 4096 lines of ordinary length take less than 1 MiB.
const LARGEST_FILE: u64 = 8 << 20;

/// Most lights of a capture.
const MOST_LIGHTS: usize = 4096;

/// Deviation from unit length that is worth a note: files round to three digits or so.
const LENGTH_TOLERANCE: f64 = 0.01;

/// How a line should look, for messages.
const FORM: &str = "write 'name x y z' with three numbers such as -0.25";

/// One line of a light file.
#[derive(Clone, Debug, PartialEq)]
pub struct LightEntry {
    /// The picture's name as written, without quotes; it may be a path of another machine.
    pub name: String,
    /// The line in the file, from 1.
    pub line: usize,
    /// The vector as written, of any length above 0.
    pub vector: [f64; 3],
    /// The vector normalised.
    pub direction: Direction,
}

/// A light file as written.
#[derive(Clone, Debug, PartialEq)]
pub struct LightFile {
    /// Where it was read.
    pub path: PathBuf,
    /// The number of pictures that its first line declares; `None` when that line is missing.
    pub declared: Option<usize>,
    /// Its lines in order, 1..4096 of them.
    pub entries: Vec<LightEntry>,
    /// What is odd but harmless, a sentence each.
    pub notes: Vec<String>,
}

/// The light file of `input`: `input` itself when it is an `.lp` file, or else the only one in the
/// folder `input` (in any case; hidden files don't count).
///
/// # Errors
/// [`FormatError::Io`] when `input` can't be read, [`FormatError::Invalid`] when it is another
/// file or a folder with no or with several `.lp` files.
pub fn light_file_in(input: &Path) -> Result<PathBuf, FormatError> {
    let metadata = fs::metadata(input).map_err(|source| FormatError::io(input, "open", source))?;
    if !metadata.is_dir() {
        if has_light_extension(input) {
            return Ok(input.to_owned());
        }
        let problem = "it is neither a folder nor an .lp file; give the capture's folder or its .lp file";
        return Err(FormatError::invalid(input, problem));
    }
    let mut names = matching::file_names(input)?;
    names.retain(|name| has_light_extension(Path::new(name)));
    match names.as_slice() {
        [name] => Ok(input.join(name)),
        [] => {
            let problem = "the folder holds no .lp file; add one (a line 'name x y z' for each picture) or give its path";
            Err(FormatError::invalid(input, problem))
        }
        _ => {
            let names: Vec<_> = names.iter().map(|name| name.to_string_lossy()).collect();
            let count = names.len();
            let problem = format!(
                "the folder holds {count} .lp files ({}); give the path of one of them",
                names.join(", ")
            );
            Err(FormatError::invalid(input, problem))
        }
    }
}

fn has_light_extension(path: &Path) -> bool {
    path.extension().is_some_and(|extension| extension.eq_ignore_ascii_case("lp"))
}

/// Reads a light file of at most 8 MiB; see [`parse_light_file`].
///
/// # Errors
/// [`FormatError::Io`] when it can't be read, [`FormatError::TooLarge`], and those of
/// [`parse_light_file`].
pub fn read_light_file(path: &Path) -> Result<LightFile, FormatError> {
    parse_light_file(&read_bytes(path)?, path)
}

/// The bytes of a text file, no more than one beyond what is allowed.
fn read_bytes(path: &Path) -> Result<Vec<u8>, FormatError> {
    let io = |source| FormatError::io(path, "read", source);
    let mut bytes = Vec::new();
    let file = fs::File::open(path).map_err(|source| FormatError::io(path, "open", source))?;
    file.take(LARGEST_FILE + 1).read_to_end(&mut bytes).map_err(io)?;
    Ok(bytes)
}

/// Reads a light file from memory; `path` is kept and used for messages.
///
/// Accepts, besides the plain form: CRLF and lone CR, tabs, blank lines, trailing blanks, a UTF-8
/// byte order mark, Latin-1 names, quotes, blanks inside names, fields separated by blanks, commas
/// or semicolons, decimal commas where they can't be separators, vectors of any length, a count
/// that is wrong or missing. What is noteworthy among these is in the notes.
///
/// # Errors
/// [`FormatError::Invalid`] naming the line, its value and the allowed form: a line without name
/// or without three finite numbers, a zero vector, no light or more than 4096;
/// [`FormatError::Unsupported`] for UTF-16 and binary files.
pub fn parse_light_file(bytes: &[u8], path: &Path) -> Result<LightFile, FormatError> {
    if bytes.len() as u64 > LARGEST_FILE {
        let problem =
            format!("is larger than {} MiB, so hardly a light file; name a .lp file", LARGEST_FILE >> 20);
        return Err(FormatError::invalid(path, problem));
    }
    let mut notes = Vec::new();
    let text = decode_text(bytes, path, &mut notes)?;
    let mut declared = None;
    let mut entries: Vec<LightEntry> = Vec::new();
    let mut is_first = true;
    for (index, line) in lines(&text).enumerate() {
        let (number, line) = (index + 1, line.trim());
        if line.is_empty() {
            continue;
        }
        if std::mem::take(&mut is_first)
            && let Ok(count) = line.parse()
        {
            declared = Some(count);
            continue;
        }
        if entries.len() == MOST_LIGHTS {
            let problem = format!("line {number}: more than {MOST_LIGHTS} lights; give 1..{MOST_LIGHTS}");
            return Err(FormatError::invalid(path, problem));
        }
        let entry = entry_from_line(line, number);
        entries.push(entry.map_err(|problem| FormatError::invalid(path, problem))?);
    }
    if entries.is_empty() {
        let problem = format!("it lists no light; give 1..{MOST_LIGHTS} lines 'name x y z'");
        return Err(FormatError::invalid(path, problem));
    }
    note_oddities(declared, &entries, &mut notes);
    Ok(LightFile { path: path.to_owned(), declared, entries, notes })
}

fn note_oddities(declared: Option<usize>, entries: &[LightEntry], notes: &mut Vec<String>) {
    let count = entries.len();
    match declared {
        None => notes.push(format!("the first line gives no number of pictures; the {count} lines are used")),
        Some(declared) if declared != count => {
            notes.push(format!(
                "the first line says {declared} pictures, {count} lines follow; those are used"
            ));
        }
        Some(_) => {}
    }
    let length = |v: [f64; 3]| (v[0] * v[0] + v[1] * v[1] + v[2] * v[2]).sqrt();
    let odd: Vec<_> = entries.iter().filter(|e| (length(e.vector) - 1.0).abs() > LENGTH_TOLERANCE).collect();
    if let Some(first) = odd.first() {
        notes.push(format!(
            "{} of {count} light vectors are not of unit length (line {}: {:.4}); they were normalised",
            odd.len(),
            first.line,
            length(first.vector)
        ));
    }
}

fn decode_text(bytes: &[u8], path: &Path, notes: &mut Vec<String>) -> Result<String, FormatError> {
    let is_utf16 = bytes.starts_with(&[0xff, 0xfe]) || bytes.starts_with(&[0xfe, 0xff]);
    if is_utf16 || bytes.contains(&0) {
        let what =
            if is_utf16 { "it is UTF-16 text" } else { "it holds zero bytes (UTF-16 text or no text)" };
        return Err(FormatError::unsupported(path, format!("{what}; save it as UTF-8")));
    }
    let bytes = bytes.strip_prefix(b"\xef\xbb\xbf").unwrap_or(bytes);
    match std::str::from_utf8(bytes) {
        Ok(text) => Ok(text.to_owned()),
        Err(_) => {
            notes.push("the file is not UTF-8; it was read as Latin-1".to_owned());
            Ok(bytes.iter().map(|&byte| char::from(byte)).collect())
        }
    }
}

/// Lines ended by LF, CRLF or a lone CR.
fn lines(text: &str) -> impl Iterator<Item = &str> {
    text.split('\n').flat_map(|line| line.strip_suffix('\r').unwrap_or(line).split('\r'))
}

fn entry_from_line(line: &str, number: usize) -> Result<LightEntry, String> {
    let Some((name, vector)) = fields_by_blanks(line).or_else(|| fields_by_commas(line)) else {
        return Err(format!("line {number}: '{}' {}; {FORM}", shortened(line), what_is_wrong(line)));
    };
    let name = unquoted(name.trim_end_matches(|c: char| c.is_whitespace() || c == ',' || c == ';'));
    if name.is_empty() {
        return Err(format!("line {number}: '{}' has no picture name; {FORM}", shortened(line)));
    }
    let [x, y, z] = vector;
    let direction = Direction::new(x, y, z).map_err(|error| match error {
        DirectionError::Zero => {
            format!("line {number}: light vector (0, 0, 0) of '{name}' points nowhere; give a length above 0")
        }
        _ => format!(
            "line {number}: light vector ({x}, {y}, {z}) of '{name}' is not finite; give finite numbers"
        ),
    })?;
    Ok(LightEntry { name: name.to_owned(), line: number, vector, direction })
}

/// Name and numbers when blanks or semicolons separate the last three fields; a comma at a field's
/// end separates too, one inside is a decimal point.
fn fields_by_blanks(line: &str) -> Option<(&str, [f64; 3])> {
    let mut rest = line;
    let mut vector = [0.0; 3];
    for value in vector.iter_mut().rev() {
        let (before, field) = split_last_field(rest)?;
        *value = number_from_field(field)?;
        rest = before;
    }
    Some((rest, vector))
}

/// The last field of `text` and what precedes it.
fn split_last_field(text: &str) -> Option<(&str, &str)> {
    let is_separator = |c: char| c.is_whitespace() || c == ';';
    let text = text.trim_end_matches(|c| is_separator(c) || c == ',');
    let start =
        text.char_indices().rev().find(|(_, c)| is_separator(*c)).map_or(0, |(at, c)| at + c.len_utf8());
    (!text.is_empty()).then(|| text.split_at(start))
}

fn number_from_field(field: &str) -> Option<f64> {
    let field = field.trim_matches('"');
    let mut commas = field.match_indices(',');
    match (commas.next(), commas.next()) {
        (None, _) => field.parse().ok(),
        (Some(_), None) if !field.contains('.') => field.replace(',', ".").parse().ok(),
        _ => None,
    }
}

/// Name and numbers when commas separate the last three fields. Decimal commas besides would be
/// ambiguous: then the remaining name ends in another number, and the line is refused.
fn fields_by_commas(line: &str) -> Option<(&str, [f64; 3])> {
    let line = line.trim_end_matches(|c: char| c.is_whitespace() || c == ',');
    let (rest, z) = line.rsplit_once(',')?;
    let (rest, y) = rest.rsplit_once(',')?;
    let number = |field: &str| field.trim().trim_matches('"').parse::<f64>().ok();
    // 'name, x' or 'name x'.
    let (name, x) = match rest.rsplit_once(',') {
        Some((name, x)) if number(x).is_some() => (name, x),
        _ => rest.trim_end().rsplit_once(char::is_whitespace)?,
    };
    let vector = [number(x)?, number(y)?, number(z)?];
    let last = name.rsplit(|c: char| c == ',' || c.is_whitespace()).find(|field| !field.is_empty());
    let is_ambiguous = name.contains(',') && last.and_then(number).is_some();
    (!is_ambiguous).then_some((name, vector))
}

/// What keeps `line` from being a name and three numbers.
fn what_is_wrong(line: &str) -> String {
    let mut numbers = 0;
    let mut rest = line;
    while let Some((before, field)) = split_last_field(rest) {
        if number_from_field(field).is_none() {
            if numbers == 0 && field.contains(',') {
                return "has commas that may separate fields or be decimal points".to_owned();
            }
            break;
        }
        numbers += 1;
        rest = before;
    }
    let plural = if numbers == 1 { "" } else { "s" };
    format!("ends in {numbers} number{plural} where 3 are needed")
}

fn unquoted(name: &str) -> &str {
    let name = name.trim();
    ['"', '\'']
        .into_iter()
        .find_map(|quote| name.strip_prefix(quote)?.strip_suffix(quote))
        .map_or(name, str::trim)
}

/// At most 80 characters of `line`.
fn shortened(line: &str) -> String {
    match line.char_indices().nth(80) {
        Some((at, _)) => format!("{}...", &line[..at]),
        None => line.to_owned(),
    }
}
