//! Lamp positions: a light file whose vectors are places, as `relight calibrate --positions` writes it.

use super::LightFile;
use super::matching::lines_of_pictures;
use crate::FormatError;
use crate::capture_folder::OpenCapture;

/// The largest coordinate of a lamp, as in scene files.
const LARGEST_COORDINATE: f64 = 1e9;

impl LightFile {
    /// Where the lamp of every picture of `capture` is, in its order: the vectors of this file, taken as places.
    ///
    /// Names are those of the capture's light file, or are found as [`super::match_pictures`] finds them. Lines of pictures that
    /// the capture lacks are passed over.
    ///
    /// # Errors
    /// [`FormatError::Invalid`] naming pictures without a line, two lines of one picture, a name that several files match, or a
    /// coordinate beyond 1e9; [`FormatError::Io`] when the capture's folder can't be read.
    pub fn positions_of(&self, capture: &OpenCapture) -> Result<Vec<[f64; 3]>, FormatError> {
        let lines = self.entries.iter().map(|entry| (entry.name.as_str(), entry.line));
        let found = lines_of_pictures(&self.path, lines, capture, "name x y z")?;
        let position = |at: usize| {
            let entry = &self.entries[at];
            let beyond = entry.vector.into_iter().find(|c| c.abs() > LARGEST_COORDINATE);
            beyond.map_or(Ok(entry.vector), |c| {
                let problem = format!(
                    "line {}: coordinate {c} of '{}' is outside -1e9..1e9; give positions in a larger unit",
                    entry.line, entry.name
                );
                Err(FormatError::invalid(&self.path, problem))
            })
        };
        found.into_iter().map(position).collect()
    }
}
