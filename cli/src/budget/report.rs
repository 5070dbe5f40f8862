//! An error budget in words, as JSON and as pictures.

use super::{Budget, HELD_OUT, STAGES, Stage, WorstPixel};
use crate::evaluate::heat_map;
use crate::failure::Failure;
use relight_formats::{PictureDepth, create_folder, remove_file, write_picture};
use serde_json::{Value, json};
use std::fmt::Write as _;
use std::path::{Path, PathBuf};

/// Where heat maps of all stages that there are stand in `folder`.
pub(crate) fn heat_map_files(folder: &Path, is_stage: impl Fn(&str) -> bool) -> Vec<PathBuf> {
    STAGES.into_iter().filter(|name| is_stage(name)).map(|name| heat_map_file(folder, name)).collect()
}

fn heat_map_file(folder: &Path, stage: &str) -> PathBuf {
    folder.join(format!("heatmap-{}.png", stage.to_lowercase().replace(' ', "-")))
}

impl Budget {
    /// The judged light of the largest error in the asset as read back, and its root mean square.
    pub(crate) fn worst_light(&self) -> Option<(&str, f64)> {
        let errors = self.lights.iter().map(|light| {
            (light.name.as_str(), light.after.last().copied().unwrap_or_default().max(0.0).sqrt())
        });
        // Of equal ones the first.
        errors.reduce(|worst, next| if next.1 > worst.1 { next } else { worst })
    }

    /// What is added, with its sum; the worst; the GPU.
    pub(crate) fn lines(&self) -> Vec<String> {
        let mut sum = "error budget (mean squared): ".to_owned();
        for (i, Stage { name, adds, .. }) in self.stages.iter().enumerate() {
            let sign = match (i, *adds < 0.0) {
                (0, _) => "",
                (_, true) => " - ",
                (_, false) => " + ",
            };
            // Text in memory takes all that is written.
            let _ = write!(sum, "{sign}{name} {:.2e}", adds.abs());
        }
        let judges = match self.stages.iter().any(|stage| stage.name == HELD_OUT) {
            true => "left-out",
            false => "fitted",
        };
        let lights = self.lights.len();
        let _ = write!(
            sum,
            " = {:.2e} (root {:.4}), of the file over {lights} {judges} pictures",
            self.total,
            self.total.sqrt()
        );
        let mut worst = Vec::new();
        if let Some((name, rmse)) = self.worst_light() {
            worst.push(format!("worst light {name}, RMSE {rmse:.4}"));
        }
        if let Some(WorstPixel { x, y, rmse }) = self.worst_pixels.first() {
            worst.push(format!("worst pixel {x}, {y}, RMSE {rmse:.4}"));
        }
        worst.extend(self.gpu_words());
        vec![sum, worst.join("; ")]
    }

    /// How far the GPU's pictures are from the CPU's, in words.
    pub(crate) fn gpu_words(&self) -> Option<String> {
        let gpu = self.gpu.as_ref()?;
        Some(format!("GPU against CPU at most {:.2e}, RMS {:.2e} ({})", gpu.max, gpu.rms, gpu.adapter))
    }

    /// The figures as JSON.
    pub(crate) fn to_json(&self) -> Value {
        let mut after = 0.0;
        let stages: Vec<Value> = self
            .stages
            .iter()
            .map(|Stage { name, adds, .. }| {
                after += adds;
                // Rounding may leave less than nothing of an exact fit.
                json!({ "name": name, "adds_mse": adds, "rmse_after": after.max(0.0).sqrt() })
            })
            .collect();
        let lights = self.lights.iter().map(|light| json!({ "name": light.name, "mse_after": light.after }));
        let pixels = self.worst_pixels.iter().map(|w| json!({ "x": w.x, "y": w.y, "rmse": w.rmse }));
        json!({
            "stages": stages,
            "total_mse": self.total,
            "total_rmse": self.total.sqrt(),
            "worst_light": self.worst_light().map(|(name, rmse)| json!({ "name": name, "rmse": rmse })),
            "worst_pixels": pixels.collect::<Vec<_>>(),
            "lights": lights.collect::<Vec<_>>(),
            "gpu": self.gpu.as_ref().map(|gpu| {
                // A sample that is NaN is infinitely far off, which JSON does not know.
                let finite = |value: f64| value.is_finite().then_some(value);
                json!({ "adapter": gpu.adapter, "max": finite(gpu.max), "rms": finite(gpu.rms), "lights": gpu.lights })
            }),
            "gpu_missing": self.gpu_missing,
        })
    }

    /// Writes a picture of each stage's map to `folder`, which is made where it is missing: the root of the squared error,
    /// in colours of one scale. Those of stages that this asset does not have are removed.
    ///
    /// # Errors
    /// Those of writing.
    pub(crate) fn write_heat_maps(&self, folder: &Path) -> Result<(), Failure> {
        create_folder(folder)?;
        for name in STAGES {
            let file = heat_map_file(folder, name);
            match self.stages.iter().find(|stage| stage.name == name) {
                Some(stage) => {
                    let roots = stage.map.iter().map(|square| square.sqrt());
                    write_picture(&file, &heat_map(self.size, roots), PictureDepth::U8)?;
                }
                None => remove_file(&file)?,
            }
        }
        Ok(())
    }
}
