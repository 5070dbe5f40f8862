//! Progress on a terminal; nothing elsewhere.

use indicatif::{ProgressBar, ProgressDrawTarget, ProgressStyle};

/// A bar of `steps` steps that names the phase; hidden when standard error is no terminal.
pub(crate) fn bar(phase: &'static str, steps: usize) -> ProgressBar {
    let bar = ProgressBar::with_draw_target(Some(steps as u64), ProgressDrawTarget::stderr());
    let style = ProgressStyle::with_template("{msg:>10} {wide_bar} {percent:>3}% {eta} left");
    if let Ok(style) = style {
        bar.set_style(style);
    }
    bar.set_message(phase);
    bar
}
