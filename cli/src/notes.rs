//! What is worth saying but not fatal.

/// Prints notes on standard error, one a line.
pub(crate) fn print(notes: &[String]) {
    notes.iter().for_each(|note| crate::log::note(note));
}
