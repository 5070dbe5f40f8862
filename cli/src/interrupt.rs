//! Ctrl-C: the work in hand stops at the next picture or span and cleans up after itself; a second
//! signal ends the program at once.

use std::sync::atomic::{AtomicBool, Ordering};

static CANCEL: AtomicBool = AtomicBool::new(false);

/// Sets the flag on the first signal (SIGINT, SIGTERM, SIGHUP).
pub(crate) fn watch() {
    // Without a handler the system's default ends the process, which is as good as it gets then.
    let _ = ctrlc::set_handler(|| {
        if CANCEL.swap(true, Ordering::Relaxed) {
            crate::thread_tokens::release();
            std::process::exit(crate::failure::Exit::Interrupted as i32);
        }
    });
}

/// The flag that long work looks at.
pub(crate) fn flag() -> &'static AtomicBool {
    &CANCEL
}

/// Fails once a signal came.
pub(crate) fn check() -> Result<(), relight_formats::FormatError> {
    if CANCEL.load(Ordering::Relaxed) { Err(relight_formats::FormatError::Cancelled) } else { Ok(()) }
}
