//! Progress on a terminal; nothing elsewhere.

use indicatif::{MultiProgress, ProgressBar, ProgressStyle};
use std::sync::LazyLock;

/// All bars, one beneath the other: that of a step stands under that of the whole.
static BARS: LazyLock<MultiProgress> = LazyLock::new(MultiProgress::new);

/// A bar of `steps` steps that names the phase, the share that is done and the time that is left; hidden when
/// standard error is no terminal.
pub(crate) fn bar(phase: &'static str, steps: usize) -> ProgressBar {
    let bar = BARS.add(ProgressBar::new(steps as u64));
    let style = ProgressStyle::with_template("{msg:>10} {wide_bar} {percent:>3}% {eta} left");
    if let Ok(style) = style {
        bar.set_style(style);
    }
    bar.set_message(phase);
    bar
}
