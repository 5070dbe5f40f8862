//! Where Chromium is, and what its absence means.

use std::ffi::OsString;

/// The program: what `CHROMIUM` names, or `chromium`.
pub(crate) fn program() -> OsString {
    std::env::var_os("CHROMIUM").unwrap_or_else(|| "chromium".into())
}

/// Prints that a test skips; with `RELIGHT_REQUIRE_CHROMIUM=1` fails.
pub(crate) fn skip(reason: &str) {
    assert!(std::env::var_os("RELIGHT_REQUIRE_CHROMIUM").is_none_or(|v| v != "1"), "{reason}");
    println!("skipped: {reason}");
}
