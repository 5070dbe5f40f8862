//! What is known of a choice once it was made and measured, and where that is kept.

use super::axes::GridPoint;
use crate::bake::{BakeFit, Made};
use crate::evaluate::Evaluation;
use crate::failure::Failure;
use relight_fit::mean_psnr;
use relight_formats::OpenCapture;
use serde::{Deserialize, Serialize};
use std::collections::BTreeMap;
use std::path::Path;

/// A choice and its figures: text and finite numbers, which always become JSON.
#[derive(Clone, Debug, Serialize, Deserialize)]
pub(crate) struct Outcome {
    /// As of [`GridPoint::name`].
    pub(crate) name: String,
    /// The options of `bake` that make it.
    pub(crate) options: Vec<String>,
    pub(crate) basis: String,
    /// Functions of light; of pca, planes.
    pub(crate) k: usize,
    /// Planes of all functions and channels.
    pub(crate) planes: usize,
    /// Of the textures, each once.
    pub(crate) formats: Vec<String>,
    /// Of texels in GPU memory, mip levels included.
    pub(crate) texel_bytes: u64,
    /// Of all its files.
    pub(crate) file_bytes: u64,
    /// Mean over the judged lights of the PSNR, in dB.
    pub(crate) psnr: f64,
    /// Mean over the judged lights of the root mean square error.
    pub(crate) rmse: f64,
    /// Root mean square error of the fit on its own lights.
    pub(crate) fit_rmse: f64,
    /// Root mean square error of relit pictures from storing.
    pub(crate) storing_rmse: f64,
    pub(crate) lights: Vec<LightFigure>,
    #[serde(flatten)]
    pub(crate) times: Times,
}

/// Error of a judged light.
#[derive(Clone, Debug, Serialize, Deserialize)]
pub(crate) struct LightFigure {
    pub(crate) name: String,
    pub(crate) rmse: f64,
}

/// What depends on the machine and its minute.
#[derive(Clone, Debug, Serialize, Deserialize)]
pub(crate) struct Times {
    /// Seconds of each stage of a bake of this choice alone.
    pub(crate) seconds: BTreeMap<String, f64>,
    /// Nanoseconds a pixel on one thread under a directional light.
    pub(crate) directional_ns: f64,
    /// The same under a point light.
    pub(crate) point_ns: f64,
    /// The same as `directional_ns` on the GPU, where there is one.
    pub(crate) gpu: Option<GpuTime>,
}

/// Nanoseconds a pixel on a GPU.
#[derive(Clone, Debug, Serialize, Deserialize)]
pub(crate) struct GpuTime {
    pub(crate) adapter: String,
    pub(crate) ns: f64,
}

impl Times {
    /// Seconds of the whole bake.
    pub(crate) fn bake_seconds(&self) -> f64 {
        self.seconds.values().sum()
    }
}

/// A figure of each judged light and their means.
pub(crate) struct Judged {
    pub(crate) psnr: f64,
    pub(crate) rmse: f64,
    pub(crate) lights: Vec<LightFigure>,
}

impl Judged {
    /// By pictures that were left out of the fit.
    pub(crate) fn of_left_out(evaluation: &Evaluation) -> Self {
        let lights =
            evaluation.light_errors().map(|(name, rmse)| LightFigure { name: name.to_owned(), rmse });
        Self { psnr: evaluation.mean_psnr(), rmse: evaluation.mean_rmse(), lights: lights.collect() }
    }

    /// By the closed form: each light as the others predict it, and what storing adds, independent of that.
    /// Lights that nothing predicts don't count.
    pub(crate) fn predicted(fit: &BakeFit<'_>, storing_rmse: f64, capture: &OpenCapture) -> Self {
        let of_lights = fit.solved.leave_one_out().left_out.iter().zip(&capture.capture.lights.lights);
        let lights: Vec<LightFigure> = of_lights
            .filter(|(rmse, _)| rmse.is_finite())
            .map(|(rmse, light)| LightFigure {
                name: light.name.clone(),
                rmse: (rmse * rmse + storing_rmse * storing_rmse).sqrt(),
            })
            .collect();
        let errors: Vec<f64> = lights.iter().map(|light| light.rmse).collect();
        let rmse = if errors.is_empty() { 1.0 } else { errors.iter().sum::<f64>() / errors.len() as f64 };
        Self { psnr: mean_psnr(&errors), rmse, lights }
    }
}

/// The figures of `point` without its times.
pub(crate) fn outcome_of(
    point: &GridPoint,
    fit: &BakeFit<'_>,
    made: &Made,
    judged: Judged,
    planes: usize,
    size: (usize, usize),
    times: Times,
) -> Outcome {
    let packing = &made.plan.packing;
    Outcome {
        name: point.name(),
        options: point.flags(),
        basis: point.basis.to_owned(),
        k: point.count,
        planes,
        formats: packing.format_names().into_iter().map(str::to_owned).collect(),
        texel_bytes: packing.texel_bytes(size.0, size.1),
        file_bytes: made.files.iter().map(|file| relight_formats::bytes_on_disk(file)).sum(),
        psnr: judged.psnr,
        rmse: judged.rmse,
        fit_rmse: fit.solved.figures().fit_rmse,
        storing_rmse: made.packed.relit_rmse,
        lights: judged.lights,
        times,
    }
}

/// An outcome as it is kept, with the key of what it was measured on.
#[derive(Serialize, Deserialize)]
struct Kept {
    key: String,
    outcome: Outcome,
}

/// Keeps `outcome` at `path`, whole or not at all.
pub(crate) fn keep(path: &Path, key: &str, outcome: &Outcome) -> Result<(), Failure> {
    let kept = Kept { key: key.to_owned(), outcome: outcome.clone() };
    let text = serde_json::to_string_pretty(&kept).unwrap_or_default();
    Ok(relight_formats::write_whole(path, format!("{text}\n").as_bytes())?)
}

/// What is kept at `path` under `key`; anything else there is measured anew.
pub(crate) fn kept(path: &Path, key: &str) -> Option<Outcome> {
    let text = relight_formats::read_text(path).ok()?;
    let kept: Kept = serde_json::from_str(&text).ok()?;
    (kept.key == key).then_some(kept.outcome)
}
