//! What verifying found, as a table, as JSON and as a verdict.

use crate::failure::{Exit, Failure};
use crate::say::say;
use relight_core::Direction;
use relight_gpu::{DecodingDifference, Difference, TextureMode};
use relight_texture::TexelFormat;
use serde_json::{Value, json};

/// Figures of one light.
pub(super) struct LightFigures {
    pub(super) light: Direction,
    pub(super) difference: Difference,
    /// The largest difference that passes.
    pub(super) allowed: f64,
}

/// Figures of all lights in one mode.
pub(super) struct ModeFigures {
    pub(super) mode: TextureMode,
    pub(super) lights: Vec<LightFigures>,
}

/// What verifying found.
pub(super) struct Verification {
    pub(super) adapter: String,
    pub(super) software: bool,
    pub(super) modes: Vec<ModeFigures>,
    /// The GPU's own decoding of each layer; empty where it was not asked for.
    pub(super) decoding: Vec<DecodingDifference>,
    /// Formats that the adapter does not sample.
    pub(super) decoded: Vec<TexelFormat>,
}

fn mode_name(mode: TextureMode) -> &'static str {
    match mode {
        TextureMode::Native => "native",
        TextureMode::Decoded => "decoded",
    }
}

/// Of a channel; grey pictures have the first only.
fn channel_name(channel: usize) -> &'static str {
    ["R", "G", "B"][channel.min(2)]
}

impl LightFigures {
    fn passes(&self) -> bool {
        self.difference.max <= self.allowed
    }

    /// How much of what is allowed is used up.
    fn share(&self) -> f64 {
        if self.difference.max == 0.0 { 0.0 } else { self.difference.max / self.allowed }
    }

    fn print(&self) {
        let Difference { max, mean, psnr, worst, .. } = &self.difference;
        let [x, y, z] = self.light.components();
        let at = format!("{}, {} {}", worst.x, worst.y, channel_name(worst.channel));
        say!(
            "{max:9.2e}  {mean:9.2e}  {psnr:7.2}  {:9.2e}  {at:>13}  {:11.7}  {:11.7}  {x:.3} {y:.3} {z:.3}",
            self.allowed,
            worst.drawn,
            worst.reference,
        );
    }

    fn to_json(&self) -> Value {
        let Difference { max, mean, psnr, full_range, worst, .. } = self.difference;
        json!({
            "light": self.light.components(),
            "max": finite(max),
            "mean": finite(mean),
            "psnr": finite(psnr),
            "full_range": full_range,
            "allowed": self.allowed,
            "worst": {
                "x": worst.x, "y": worst.y, "channel": worst.channel,
                "gpu": finite(f64::from(worst.drawn)), "cpu": finite(f64::from(worst.reference)),
            },
            "passed": self.passes(),
        })
    }
}

/// JSON has no infinities: equal pictures have no PSNR.
fn finite(value: f64) -> Option<f64> {
    value.is_finite().then_some(value)
}

impl ModeFigures {
    fn passes(&self) -> bool {
        self.lights.iter().all(LightFigures::passes)
    }

    fn max(&self) -> f64 {
        self.lights.iter().fold(0.0, |max, light| max.max(light.difference.max))
    }

    fn mean(&self) -> f64 {
        self.lights.iter().map(|light| light.difference.mean).sum::<f64>() / self.lights.len() as f64
    }

    /// Of all lights' samples together, each light's against its own full range.
    fn psnr(&self) -> f64 {
        let squares = self.lights.iter().map(|light| libm::pow(10.0, -light.difference.psnr / 10.0));
        -10.0 * libm::log10(squares.sum::<f64>() / self.lights.len() as f64)
    }

    fn print(&self) {
        let who = match self.mode {
            TextureMode::Native => "the GPU decodes the texels",
            TextureMode::Decoded => "relight decodes the texels",
        };
        say!("");
        say!("mode {}: {who}", mode_name(self.mode));
        say!("      max       mean  PSNR dB    allowed          worst          GPU          CPU  light");
        self.lights.iter().for_each(LightFigures::print);
        let verdict = if self.passes() { "within what is allowed" } else { "MORE than is allowed" };
        let lights = self.lights.len();
        let (max, mean, psnr) = (self.max(), self.mean(), self.psnr());
        say!("{max:9.2e}  {mean:9.2e}  {psnr:7.2}  over all {lights} lights: {verdict}");
    }

    fn to_json(&self) -> Value {
        json!({
            "mode": mode_name(self.mode),
            "max": finite(self.max()),
            "mean": finite(self.mean()),
            "psnr": finite(self.psnr()),
            "passed": self.passes(),
            "lights": self.lights.iter().map(LightFigures::to_json).collect::<Vec<_>>(),
        })
    }
}

impl Verification {
    /// The decoding error over all layers: the largest and the mean.
    fn decoding(&self) -> Option<(&DecodingDifference, f64)> {
        let worst = self.decoding.iter().max_by(|a, b| a.max.total_cmp(&b.max))?;
        let mean = self.decoding.iter().map(|layer| layer.mean).sum::<f64>() / self.decoding.len() as f64;
        Some((worst, mean))
    }

    pub(super) fn print(&self) {
        let software = if self.software { ", a program on the CPU" } else { "" };
        say!("adapter: {}{software}", self.adapter);
        for format in &self.decoded {
            say!("it does not sample {}: relight decodes those texels in native mode too", format.name());
        }
        self.modes.iter().for_each(ModeFigures::print);
        if let Some((worst, mean)) = self.decoding() {
            say!("");
            say!(
                "GPU's own decoding error: max {:.2e} ({}, array {}, layer {}), mean {mean:.2e} of a texel",
                worst.max,
                worst.format.name(),
                worst.array,
                worst.layer
            );
        }
    }

    pub(super) fn to_json(&self) -> Value {
        let layer = |layer: &DecodingDifference| {
            json!({
                "array": layer.array,
                "layer": layer.layer,
                "format": layer.format.name(),
                "max": finite(layer.max),
                "mean": finite(layer.mean),
            })
        };
        json!({
            "adapter": self.adapter,
            "software": self.software,
            "not_sampled": self.decoded.iter().map(|format| format.name()).collect::<Vec<_>>(),
            "passed": self.modes.iter().all(|mode| mode.passes()),
            "modes": self.modes.iter().map(ModeFigures::to_json).collect::<Vec<_>>(),
            "gpu_decoding": self.decoding.iter().map(layer).collect::<Vec<_>>(),
        })
    }

    /// Fails where a light's difference exceeds what is allowed.
    pub(super) fn verdict(&self) -> Result<(), Failure> {
        let failed = |mode: &&ModeFigures| !mode.passes();
        let Some(ModeFigures { mode, lights }) = self.modes.iter().find(failed) else { return Ok(()) };
        let worst = lights.iter().max_by(|a, b| a.share().total_cmp(&b.share()));
        let Some(LightFigures { light, difference, allowed }) = worst else { return Ok(()) };
        let worst = &difference.worst;
        let [x, y, z] = light.components();
        let message = format!(
            "in mode {} the GPU's picture under light {x:.3},{y:.3},{z:.3} differs by {:.2e} at pixel {}, {}, \
             channel {} ({} where the CPU has {}); {allowed:.2e} is allowed",
            mode_name(*mode),
            difference.max,
            worst.x,
            worst.y,
            channel_name(worst.channel),
            worst.drawn,
            worst.reference,
        );
        Err(Failure::new(Exit::CheckFailed, message))
    }
}
