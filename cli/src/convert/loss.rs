//! What a conversion loses, measured: two assets relit in the same directions.

use crate::evaluate::same_channels;
use crate::options::Machine;
use crate::{interrupt, progress};
use relight_core::metrics::{compare, psnr};
use relight_core::relighter::relight;
use relight_core::sphere::{Cap, fibonacci_in};
use relight_core::{Direction, RelightingMaps};
use relight_formats::FormatError;
use serde_json::{Value, json};

/// Directions in which assets are compared, evenly spread.
const DIRECTIONS: usize = 64;

/// Differences of encoded values, 0..1, clipped to black and white.
pub(super) struct Loss {
    /// Root mean square over all pixels, channels and directions.
    rmse: f64,
    /// The largest.
    max: f64,
    /// Root mean square in the direction where it is largest.
    worst_rmse: f64,
    worst: Direction,
}

impl Loss {
    /// Every pixel of `a` and `b` relit in directions of `domain`.
    pub(super) fn of(
        a: &RelightingMaps,
        b: &RelightingMaps,
        domain: Cap,
        machine: &Machine,
    ) -> Result<Self, FormatError> {
        let bar = progress::bar("comparing", DIRECTIONS);
        let mut loss = Self { rmse: 0.0, max: 0.0, worst_rmse: 0.0, worst: domain.axis };
        let mut squares = 0.0;
        for direction in fibonacci_in(domain, DIRECTIONS) {
            interrupt::check()?;
            let relit = |maps: &RelightingMaps| {
                relight(maps, direction, machine.level).encoded_from(maps.model.space)
            };
            let (before, after) = same_channels(relit(a), relit(b));
            let error = compare(&after.samples, &before.samples, after.width, after.channels);
            squares += error.rmse * error.rmse;
            loss.max = loss.max.max(error.max);
            if error.rmse > loss.worst_rmse {
                (loss.worst_rmse, loss.worst) = (error.rmse, direction);
            }
            bar.inc(1);
        }
        bar.finish_and_clear();
        loss.rmse = (squares / DIRECTIONS as f64).sqrt();
        Ok(loss)
    }

    /// In a line.
    pub(super) fn words(&self) -> String {
        let Self { rmse, max, worst_rmse, worst } = self;
        if *max == 0.0 {
            return format!("nothing lost: relit in {DIRECTIONS} directions, every value is the same");
        }
        let [x, y, z] = worst.components();
        format!(
            "lost, relit in {DIRECTIONS} directions: PSNR {:.2} dB, RMS {:.3} and largest {:.1} of 255; worst \
             {:.2} dB with light from {x:.2},{y:.2},{z:.2}",
            psnr(*rmse),
            rmse * 255.0,
            max * 255.0,
            psnr(*worst_rmse)
        )
    }

    /// The figures as JSON.
    pub(super) fn to_json(&self) -> Value {
        let finite = |value: f64| value.is_finite().then_some(value);
        json!({
            "directions": DIRECTIONS,
            "psnr": finite(psnr(self.rmse)),
            "rmse": self.rmse,
            "max": self.max,
            "worst": { "direction": self.worst, "psnr": finite(psnr(self.worst_rmse)) },
        })
    }
}
