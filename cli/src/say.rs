//! Standard output, which may close early (`relight info x | head -1`) or be full.

use crate::failure::{Exit, Failure};
use std::fmt::Arguments;
use std::io::{Error, ErrorKind, Write};
use std::sync::{Mutex, PoisonError};

static FAILED: Mutex<Option<Error>> = Mutex::new(None);

/// Writes a line; after a failure nothing more is written.
pub(crate) fn line(arguments: Arguments<'_>) {
    let mut failed = FAILED.lock().unwrap_or_else(PoisonError::into_inner);
    if failed.is_none() {
        *failed = writeln!(std::io::stdout().lock(), "{arguments}").err();
    }
}

/// Fails when lines were lost, unless it was the reader that closed.
pub(crate) fn finish() -> Result<(), Failure> {
    line_buffer_out();
    match FAILED.lock().unwrap_or_else(PoisonError::into_inner).take() {
        Some(error) if error.kind() != ErrorKind::BrokenPipe => {
            Err(Failure::new(Exit::InputOutput, format!("cannot write to standard output: {error}")))
        }
        _ => Ok(()),
    }
}

/// Writes out what standard output still holds.
fn line_buffer_out() {
    if let Err(error) = std::io::stdout().lock().flush() {
        FAILED.lock().unwrap_or_else(PoisonError::into_inner).get_or_insert(error);
    }
}

/// Like `println!`, without its panic.
macro_rules! say {
    ($($argument:tt)*) => { crate::say::line(format_args!($($argument)*)) };
}
pub(crate) use say;
