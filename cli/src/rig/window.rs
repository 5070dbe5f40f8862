//! What rings below 0, and `--window` against it.

use super::bake::label;
use super::digits;
use clap::ValueEnum;
use relight_rig::{Ringing, Window};
use serde_json::{Value, json};

/// Windows by name.
#[derive(Clone, Copy, Debug, PartialEq, Eq, ValueEnum)]
pub(super) enum WindowChoice {
    /// (1 + cos(pi l / bands)) / 2
    Hanning,
    /// sin(pi l / bands) / (pi l / bands)
    Lanczos,
    /// The least change that leaves no point of the surface below 0
    Least,
}

impl WindowChoice {
    /// The window for a part, whose points by band are looked at if it depends on them.
    pub(super) fn window(self, bands: usize, points: impl FnOnce() -> Vec<Vec<[f64; 3]>>) -> Window {
        match self {
            Self::Hanning => Window::hanning(bands as f64),
            Self::Lanczos => Window::lanczos(bands as f64),
            Self::Least => Window::least(&points()),
        }
    }
}

/// A part's ringing in words: of pixels or points.
pub(super) fn ringing_words(part: &str, ringing: &Ringing, places: &str) -> String {
    match ringing.negative {
        0 => format!("{}: no {places} below 0", label(part)),
        _ => format!(
            "{}: {} % of {places} below 0, down to {} of the brightest",
            label(part),
            digits(100.0 * ringing.share()),
            digits(ringing.lowest)
        ),
    }
}

/// The same in numbers.
pub(super) fn ringing_record(ringing: &Ringing) -> Value {
    json!({ "points": ringing.points, "negative_share": ringing.share(), "lowest_over_brightest": ringing.lowest })
}
