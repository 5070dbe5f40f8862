//! Headers in ASCII, read word by word: lines may end in blanks or a carriage return, and numbers may
//! stand on any number of lines.

use crate::FormatError;
use std::path::Path;

/// The longest header that is read: twenty numbers for each of 18 planes are a third of it.
pub(super) const LONGEST_HEADER: u64 = 16384;

/// Words of a header, with the place after the last.
pub(super) struct HeaderWords<'a> {
    path: &'a Path,
    bytes: &'a [u8],
    at: usize,
}

impl<'a> HeaderWords<'a> {
    /// The words of `bytes`, the beginning of the file at `path`.
    pub(super) fn new(path: &'a Path, bytes: &'a [u8]) -> Self {
        Self { path, bytes, at: 0 }
    }

    /// The next word; `what` it is, for the message.
    pub(super) fn next(&mut self, what: &str) -> Result<&'a str, FormatError> {
        let rest = &self.bytes[self.at..];
        let start = rest.iter().position(|b| !b.is_ascii_whitespace()).unwrap_or(rest.len());
        let length = rest[start..].iter().position(u8::is_ascii_whitespace).unwrap_or(rest.len() - start);
        self.at += start + length;
        match std::str::from_utf8(&rest[start..start + length]) {
            Ok(word) if !word.is_empty() => Ok(word),
            _ => Err(FormatError::invalid(self.path, format!("its header ends before {what}"))),
        }
    }

    /// A finite number.
    pub(super) fn number(&mut self, what: &str) -> Result<f64, FormatError> {
        let word = self.next(what)?;
        word.parse().ok().filter(|value: &f64| value.is_finite()).ok_or_else(|| {
            FormatError::invalid(self.path, format!("{what} '{word}' in its header is not a finite number"))
        })
    }

    /// A whole number in `range`.
    pub(super) fn integer(
        &mut self,
        what: &str,
        range: std::ops::RangeInclusive<i64>,
    ) -> Result<i64, FormatError> {
        let word = self.next(what)?;
        word.parse().ok().filter(|value| range.contains(value)).ok_or_else(|| {
            let (least, most) = (range.start(), range.end());
            let problem = format!("{what} '{word}' in its header is outside {least}..{most}");
            FormatError::invalid(self.path, problem)
        })
    }

    /// A number of pixels, at least 1.
    pub(super) fn dimension(&mut self, what: &str) -> Result<usize, FormatError> {
        Ok(self.integer(what, 1..=i64::from(u32::MAX))? as usize)
    }

    /// Passes over lines that begin with '#'.
    pub(super) fn skip_comments(&mut self) {
        loop {
            let rest = &self.bytes[self.at..];
            let blanks = rest.iter().take_while(|b| b.is_ascii_whitespace()).count();
            if rest.get(blanks) != Some(&b'#') {
                return;
            }
            let line =
                rest.iter().skip(blanks).position(|&b| b == b'\n').map_or(rest.len(), |end| blanks + end);
            self.at += line;
        }
    }

    /// The place after the line's end, after which there are no more words but `last`.
    pub(super) fn end_of_line(&mut self, last: &str) -> Result<usize, FormatError> {
        let rest = &self.bytes[self.at..];
        let blanks = rest.iter().take_while(|b| matches!(b, b' ' | b'\t' | b'\r')).count();
        match rest.get(blanks) {
            Some(b'\n') => Ok(self.at + blanks + 1),
            _ => {
                Err(FormatError::invalid(self.path, format!("its header does not end with a line of {last}")))
            }
        }
    }
}
