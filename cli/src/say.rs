//! Standard output, which may close early (`relight info x | head -1`) or be full.
//!
//! Words for people go there too, unless a product does ([`give_way`]) or words are JSON: then standard error has them.

use crate::failure::{Exit, Failure};
use crate::log;
use std::fmt::Arguments;
use std::io::{Error, ErrorKind, Write};
use std::path::Path;
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::{Mutex, PoisonError};

static FAILED: Mutex<Option<Error>> = Mutex::new(None);

static IS_TAKEN: AtomicBool = AtomicBool::new(false);

/// Leaves standard output to a product.
pub(crate) fn give_way() {
    IS_TAKEN.store(true, Ordering::Relaxed);
}

/// Writes a line for people; after a failure nothing more is written.
pub(crate) fn line(arguments: Arguments<'_>) {
    if log::is_json() || IS_TAKEN.load(Ordering::Relaxed) {
        return log::result(&arguments.to_string());
    }
    write(format!("{arguments}\n").as_bytes());
}

/// Writes what was asked for on standard output: JSON, a shader, a picture.
pub(crate) fn product(bytes: &[u8]) {
    write(bytes);
}

/// Writes a value as JSON for programs.
pub(crate) fn json(value: &serde_json::Value) {
    product(format!("{value:#}\n").as_bytes());
}

/// Writes a product to its file, or to standard output where that is `-`.
///
/// # Errors
/// As of [`relight_formats::write_whole`].
pub(crate) fn write_product(path: &Path, bytes: &[u8]) -> Result<(), Failure> {
    if is_dash(path) {
        product(bytes);
        return Ok(());
    }
    Ok(relight_formats::write_whole(path, bytes)?)
}

/// Whether a path stands for standard input or output.
pub(crate) fn is_dash(path: &Path) -> bool {
    path == Path::new("-")
}

fn write(bytes: &[u8]) {
    let mut failed = FAILED.lock().unwrap_or_else(PoisonError::into_inner);
    if failed.is_none() {
        *failed = std::io::stdout().lock().write_all(bytes).err();
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
