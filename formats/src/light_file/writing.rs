//! Light files out, and the pictures of a folder that they are made for.

use super::MOST_LIGHTS;
use super::matching::file_names;
use crate::picture::has_picture_extension;
use crate::{FormatError, write_whole};
use std::fmt::Write as _;
use std::path::{Path, PathBuf};

/// The pictures in `folder` by their extensions, 1..4096 of them, in the order of their names (numbers by value).
///
/// # Errors
/// [`FormatError::Io`] when the folder can't be read, [`FormatError::Invalid`] when it holds none or too many.
pub fn pictures_in(folder: &Path) -> Result<Vec<PathBuf>, FormatError> {
    let names = file_names(folder)?;
    let pictures: Vec<PathBuf> =
        names.into_iter().map(|name| folder.join(name)).filter(|path| has_picture_extension(path)).collect();
    if !(1..=MOST_LIGHTS).contains(&pictures.len()) {
        let problem = format!("the folder holds {} pictures; give one with 1..{MOST_LIGHTS}", pictures.len());
        return Err(FormatError::invalid(folder, problem));
    }
    Ok(pictures)
}

/// Writes a light file: the number of lines, then `name x y z` for each, with `decimals` decimals.
///
/// The vectors are directions of unit length, or positions of lamps, which every reader of light files takes for
/// the directions from the origin that they also are. Names with blanks are quoted.
///
/// # Errors
/// [`FormatError::Invalid`] for names that a line can't hold, [`FormatError::Io`].
pub fn write_light_file(
    path: &Path,
    lines: &[(String, [f64; 3])],
    decimals: usize,
) -> Result<(), FormatError> {
    let mut text = format!("{}\n", lines.len());
    for (name, [x, y, z]) in lines {
        if name.is_empty() || name.contains(['"', '\n', '\r', '\0']) {
            let problem = format!(
                "a line can't hold the picture name '{}'; rename it without quotes and line breaks",
                name.escape_debug()
            );
            return Err(FormatError::invalid(path, problem));
        }
        let quote = if name.contains(char::is_whitespace) { "\"" } else { "" };
        let _ = writeln!(text, "{quote}{name}{quote} {x:.decimals$} {y:.decimals$} {z:.decimals$}");
    }
    write_whole(path, text.as_bytes())
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::read_light_file;

    #[test]
    fn lines_come_back_as_they_were_written() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("a.lp");
        let lines = [
            ("a.png".to_owned(), [0.6, -0.8, 0.0]),
            ("my picture, 2.png".to_owned(), [-1200.25, 3.5, 900.125]),
            ("'7'.jpg".to_owned(), [0.0, 0.25, 1.0]),
        ];
        write_light_file(&path, &lines, 6).unwrap();
        let file = read_light_file(&path).unwrap();
        assert_eq!(file.declared, Some(3));
        for (entry, (name, vector)) in file.entries.iter().zip(&lines) {
            assert_eq!((&entry.name, entry.vector), (name, *vector));
        }
        for name in ["", "a\nb.png", "a\".png"] {
            assert!(write_light_file(&path, &[(name.to_owned(), [0.0, 0.0, 1.0])], 6).is_err(), "{name:?}");
        }
    }

    #[test]
    fn pictures_come_in_the_order_of_their_numbers() {
        let folder = tempfile::tempdir().unwrap();
        assert!(pictures_in(folder.path()).is_err());
        for name in ["b10.png", "b9.JPG", "a.lp", ".b1.png", "b010x.tif"] {
            std::fs::write(folder.path().join(name), "").unwrap();
        }
        let names: Vec<_> =
            pictures_in(folder.path()).unwrap().iter().map(|p| p.file_name().unwrap().to_owned()).collect();
        assert_eq!(names, ["b9.JPG", "b10.png", "b010x.tif"]);
    }
}
