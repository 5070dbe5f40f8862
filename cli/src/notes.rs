//! What is worth saying but not fatal.

/// Prints notes on standard error, one a line.
pub(crate) fn print(notes: &[String]) {
    for note in notes {
        eprintln!("relight: note: {note}");
    }
}
