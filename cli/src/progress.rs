//! Progress on a terminal; nothing elsewhere.

use crate::log;
use indicatif::{MultiProgress, ProgressBar, ProgressDrawTarget, ProgressStyle};
use std::sync::LazyLock;

/// All bars, one beneath the other: that of a step stands under that of the whole.
static BARS: LazyLock<MultiProgress> = LazyLock::new(|| match log::is_json() || is_on_ci() {
    true => MultiProgress::with_draw_target(ProgressDrawTarget::hidden()),
    false => MultiProgress::new(),
});

/// Whether a machine keeps what is shown: services set CI, some of them beside something like a terminal.
fn is_on_ci() -> bool {
    std::env::var_os("CI").is_some_and(|value| !["", "0", "false"].iter().any(|no| value == *no))
}

/// A bar of `steps` steps that names the phase, the share that is done and the time that is left; hidden when
/// standard error is no terminal.
pub(crate) fn bar(phase: &'static str, steps: usize) -> ProgressBar {
    log::phase(phase, steps);
    let bar = BARS.add(ProgressBar::new(steps as u64));
    let style = ProgressStyle::with_template("{msg:>10} {wide_bar} {percent:>3}% {eta} left");
    if let Ok(style) = style {
        bar.set_style(style);
    }
    bar.set_message(phase);
    bar
}
