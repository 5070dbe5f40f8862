//! Errors by stage: numbers, and maps in colours of one fixed scale.

use super::shrink::{shrunk, shrunk_length};
use crate::evaluate::heat;
use crate::failure::Failure;
use relight_formats::PagePicture;
use serde_json::{Value, json};
use std::path::Path;

/// What each stage adds to the error, as the page shows it.
#[derive(Clone, Debug, Default)]
pub(crate) struct ErrorBudget {
    /// In the order in which errors arise.
    pub(crate) stages: Vec<BudgetStage>,
    /// Mean squared error of all of them together.
    pub(crate) total: f64,
    /// The light with the largest error, with its root mean square error.
    pub(crate) worst_light: Option<(String, f64)>,
    /// x, y and root mean square error, the worst first.
    pub(crate) worst_pixels: Vec<(usize, usize, f64)>,
    /// What the GPU made of it, in a sentence, where there was one.
    pub(crate) gpu: Option<String>,
    /// Width and height of the maps.
    pub(crate) size: (usize, usize),
}

/// A stage and its share.
#[derive(Clone, Debug)]
pub(crate) struct BudgetStage {
    pub(crate) name: String,
    /// Mean squared error that it adds; negative where it takes some away.
    pub(crate) adds: f64,
    /// By pixel, the mean over lights of the squared error after this stage.
    pub(crate) map: Option<Vec<f32>>,
}

/// Root mean square errors at the ends of the colour scale, which is logarithmic: 60 and 10 dB.
const SCALE: (f32, f32) = (0.001, 0.316_227_77);

/// The longest side of a map in pixels.
const LONGEST: usize = 320;

/// Pixels of the legend.
const LEGEND: usize = 256;

/// Where `rmse` lies on the colour scale, 0 to 1.
fn place(rmse: f32) -> f32 {
    let (least, most) = SCALE;
    (libm::logf(rmse.max(least) / least) / libm::logf(most / least)).min(1.0)
}

fn colors(places: impl Iterator<Item = f32>) -> Vec<u8> {
    places.flat_map(heat).map(|value| (value * 255.0 + 0.5) as u8).collect()
}

impl ErrorBudget {
    /// What the page's script takes.
    pub(super) fn json(&self, page: &Path) -> Result<Value, Failure> {
        let (width, height) = self.size;
        let factor = width.max(height).div_ceil(LONGEST).max(1);
        let size = (shrunk_length(width, factor), shrunk_length(height, factor));
        let mut stages = Vec::new();
        for stage in &self.stages {
            let map = stage.map.as_ref().filter(|map| map.len() == width * height && !map.is_empty());
            let uri = match map {
                Some(map) => {
                    let row = |y: usize, out: &mut [f32]| out.copy_from_slice(&map[y * width..][..width]);
                    let small = shrunk(self.size, 1, factor, row);
                    let codes = colors(small.into_iter().map(|square| place(square.max(0.0).sqrt())));
                    Some(PagePicture { size, channels: 3, codes: &codes }.png_uri(page)?)
                }
                None => None,
            };
            stages.push(json!({ "name": stage.name, "adds": stage.adds, "map": uri }));
        }
        let legend = colors((0..LEGEND).map(|i| i as f32 / (LEGEND - 1) as f32));
        let legend = PagePicture { size: (LEGEND, 1), channels: 3, codes: &legend }.png_uri(page)?;
        let ticks =
            [0.001f32, 0.003, 0.01, 0.03, 0.1, 0.3].map(|rmse| json!([rmse.to_string(), place(rmse)]));
        Ok(json!({
            "stages": stages,
            "total": self.total,
            "worst_light": self.worst_light,
            "worst_pixels": self.worst_pixels,
            "gpu": self.gpu,
            "legend": { "image": legend, "ticks": ticks },
        }))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn maps_of_all_stages_have_one_scale_and_stages_without_have_none() {
        let stage = |name: &str, adds, map| BudgetStage { name: name.to_owned(), adds, map };
        let budget = ErrorBudget {
            stages: vec![
                stage("fit", 4e-4, Some(vec![1e-6, 1e-4, 0.1, 0.2, 0.0, 1.0])),
                stage("<quantisation>", -1e-5, Some(vec![1e-6; 6])),
                stage("GPU", 0.0, None),
            ],
            total: 3.9e-4,
            size: (3, 2),
            ..ErrorBudget::default()
        };
        let value = budget.json(Path::new("r.html")).unwrap();
        let stages = value["stages"].as_array().unwrap();
        assert!(stages[0]["map"].as_str().unwrap().starts_with("data:image/png;base64,"));
        assert!(stages[2]["map"].is_null());
        assert_eq!((&stages[1]["name"], &stages[1]["adds"]), (&json!("<quantisation>"), &json!(-1e-5)));
        // 60 dB is the scale's beginning, 35 dB its middle, 10 dB and what is worse its end.
        assert_eq!(place(0.001), 0.0);
        assert!((place(libm::powf(10.0, -35.0 / 20.0)) - 0.5).abs() < 1e-6);
        assert_eq!((place(0.0), place(0.7)), (0.0, 1.0));
        assert_eq!(colors([0.0, 1.0].into_iter()), [0, 0, 0, 255, 255, 255]);
    }
}
