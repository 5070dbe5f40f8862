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
    let mut failed = FAILED.lock().unwrap_or_else(PoisonError::into_inner);
    match failed.take().or_else(|| std::io::stdout().lock().flush().err()) {
        Some(error) if error.kind() != ErrorKind::BrokenPipe => {
            Err(Failure::new(Exit::InputOutput, format!("cannot write to standard output: {error}")))
        }
        _ => Ok(()),
    }
}

/// Like `println!`, without its panic.
macro_rules! say {
    ($($argument:tt)*) => { crate::say::line(format_args!($($argument)*)) };
}
pub(crate) use say;
