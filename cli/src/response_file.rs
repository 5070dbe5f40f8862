//! `@FILE` among the arguments: a response file, whose words take its place.
//!
//! Words are separated by white space; `'..'` and `".."` keep white space within a word, and a backslash keeps the
//! character after it, in quotes too. These are the rules of GCC (`expandargv` of its documentation) and what Ninja and CMake
//! write for it. `@@name` is the argument `@name`.

use crate::failure::Failure;
use relight_formats::{place_of, read_text};
use std::ffi::OsString;
use std::path::{Path, PathBuf};

/// Response files within response files.
const DEPTH: usize = 10;

/// Words of a command, so that files that name one another by the dozen end.
const MOST_WORDS: usize = 1 << 20;

/// The arguments with those of response files in their places. The first, the program's name, is left alone.
///
/// # Errors
/// Exit code 2 for files that name themselves, lie too deep or leave a quote open; else as of [`read_text`].
pub(crate) fn expand(arguments: Vec<OsString>) -> Result<Vec<OsString>, Failure> {
    let mut expanded = Vec::with_capacity(arguments.len());
    let mut arguments = arguments.into_iter();
    expanded.extend(arguments.next());
    for argument in arguments {
        match argument.to_str().and_then(|text| text.strip_prefix('@')) {
            None => expanded.push(argument),
            Some(rest) if rest.starts_with('@') => expanded.push(rest.into()),
            Some("") => return Err(Failure::usage("@ names no file; write @FILE, or @@ for the argument @")),
            Some(name) => expand_file(Path::new(name), &mut Vec::new(), &mut expanded)?,
        }
    }
    Ok(expanded)
}

/// Appends the words of the file at `path`, which the files `within` name one after another.
fn expand_file(path: &Path, within: &mut Vec<PathBuf>, expanded: &mut Vec<OsString>) -> Result<(), Failure> {
    let text = read_text(path)?;
    within.push(place_of(path).unwrap_or_else(|| path.to_owned()));
    for Word { line, text } in words(&text).map_err(|line| {
        Failure::usage(format!(
            "{}: line {line}: a quote is not closed; close it, or write \\' for a quote",
            path.display()
        ))
    })? {
        let bad = |what: String| Failure::usage(format!("{}: line {line}: {what}", path.display()));
        if expanded.len() >= MOST_WORDS {
            return Err(bad(format!("the command has more than {MOST_WORDS} arguments")));
        }
        let Some(rest) = text.strip_prefix('@') else {
            expanded.push(text.into());
            continue;
        };
        if rest.is_empty() {
            return Err(bad("@ names no file; write @FILE, or @@ for the argument @".to_owned()));
        }
        if rest.starts_with('@') {
            expanded.push(rest.into());
            continue;
        }
        let next = Path::new(rest);
        if place_of(next).is_some_and(|place| within.contains(&place)) {
            return Err(bad(format!("@{rest} is a file that is being read; it can't hold itself")));
        }
        if within.len() >= DEPTH {
            return Err(bad(format!("@{rest} lies deeper than {DEPTH} response files in one another")));
        }
        expand_file(next, within, expanded)
            .map_err(|failure| failure.within(&format!("{}: line {line}", path.display())))?;
    }
    within.pop();
    Ok(())
}

/// A word and the line, 1 the first, that it begins in.
#[derive(Debug, PartialEq, Eq)]
struct Word {
    line: usize,
    text: String,
}

/// The words of a text; the line of a quote that is left open instead.
fn words(text: &str) -> Result<Vec<Word>, usize> {
    let mut words = Vec::new();
    let mut word: Option<Word> = None;
    let mut quote: Option<(char, usize)> = None;
    let mut line = 1;
    let mut characters = text.chars();
    while let Some(character) = characters.next() {
        let at = line;
        line += usize::from(character == '\n');
        if quote.is_none() && character.is_ascii_whitespace() {
            words.extend(word.take());
            continue;
        }
        let word = word.get_or_insert(Word { line: at, text: String::new() });
        match (character, quote) {
            ('\\', _) => {
                if let Some(kept) = characters.next() {
                    line += usize::from(kept == '\n');
                    word.text.push(kept);
                }
            }
            (_, Some((open, _))) if character == open => quote = None,
            ('\'' | '"', None) => quote = Some((character, at)),
            _ => word.text.push(character),
        }
    }
    words.extend(word);
    match quote {
        Some((_, line)) => Err(line),
        None => Ok(words),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Words as GCC 12 was seen to read them.
    #[test]
    fn words_are_those_of_gcc() {
        let of = |text: &str| words(text).map(|words| words.into_iter().map(|w| w.text).collect::<Vec<_>>());
        for (text, expected) in [
            ("", &[][..]),
            (" \n\t ", &[]),
            ("a b\nc", &["a", "b", "c"]),
            ("'a b' \"c d\"", &["a b", "c d"]),
            ("a' 'b\"c\"", &["a bc"]),
            (r"a\ b c\\d", &["a b", r"c\d"]),
            (r"'a\'b' x\'y", &["a'b", "x'y"]),
            ("'\"' \"'\"", &["\"", "'"]),
            ("'' a", &["", "a"]),
            ("# no comment", &["#", "no", "comment"]),
            ("'two\nlines'", &["two\nlines"]),
        ] {
            assert_eq!(of(text).unwrap(), expected, "{text}");
        }
        assert_eq!(words("a\n'b\nc"), Err(2));
        assert_eq!(
            words("a\n'b\nc' \\\nd e").unwrap().iter().map(|w| w.line).collect::<Vec<_>>(),
            [1, 2, 3, 4]
        );
    }
}
