//! Errors by stage: numbers, and maps in colours of one fixed scale.

use super::shrink::{shrunk, shrunk_length};
use crate::budget::Budget;
use crate::evaluate::heat;
use crate::failure::Failure;
use relight_formats::PagePicture;
use serde_json::{Value, json};
use std::path::Path;

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

/// What the page's script takes.
pub(super) fn budget_json(budget: &Budget, page: &Path) -> Result<Value, Failure> {
    let (width, height) = budget.size;
    let factor = width.max(height).div_ceil(LONGEST).max(1);
    let size = (shrunk_length(width, factor), shrunk_length(height, factor));
    let mut stages = Vec::new();
    for stage in &budget.stages {
        let row = |y: usize, out: &mut [f32]| out.copy_from_slice(&stage.map[y * width..][..width]);
        let small = shrunk(budget.size, 1, factor, row);
        let codes = colors(small.into_iter().map(|square| place(square.max(0.0).sqrt())));
        let map = PagePicture { size, channels: 3, codes: &codes }.png_uri(page)?;
        stages.push(json!({ "name": stage.name, "adds": stage.adds, "map": map }));
    }
    let legend = colors((0..LEGEND).map(|i| i as f32 / (LEGEND - 1) as f32));
    let legend = PagePicture { size: (LEGEND, 1), channels: 3, codes: &legend }.png_uri(page)?;
    let ticks = [0.001f32, 0.003, 0.01, 0.03, 0.1, 0.3].map(|rmse| json!([rmse.to_string(), place(rmse)]));
    let worst_pixels: Vec<Value> =
        budget.worst_pixels.iter().map(|worst| json!([worst.x, worst.y, worst.rmse])).collect();
    Ok(json!({
        "stages": stages,
        "total": budget.total,
        "worst_light": budget.worst_light(),
        "worst_pixels": worst_pixels,
        "gpu": budget.gpu_words(),
        "legend": { "image": legend, "ticks": ticks },
    }))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::budget::Stage;

    #[test]
    fn maps_of_all_stages_have_one_scale() {
        let stage = |name, adds, map: &[f32]| Stage { name, adds, map: map.to_vec() };
        let budget = Budget {
            stages: vec![
                stage("fit", 4e-4, &[1e-6, 1e-4, 0.1, 0.2, 0.0, 1.0]),
                stage("quantisation", -1e-5, &[1e-6; 6]),
            ],
            total: 3.9e-4,
            lights: Vec::new(),
            worst_pixels: Vec::new(),
            gpu: None,
            gpu_missing: None,
            size: (3, 2),
        };
        let value = budget_json(&budget, Path::new("r.html")).unwrap();
        let stages = value["stages"].as_array().unwrap();
        assert!(stages.iter().all(|s| s["map"].as_str().unwrap().starts_with("data:image/png;base64,")));
        assert_ne!(stages[0]["map"], stages[1]["map"]);
        assert_eq!((&stages[1]["name"], &stages[1]["adds"]), (&json!("quantisation"), &json!(-1e-5)));
        // 60 dB is the scale's beginning, 35 dB its middle, 10 dB and what is worse its end.
        assert_eq!(place(0.001), 0.0);
        assert!((place(libm::powf(10.0, -35.0 / 20.0)) - 0.5).abs() < 1e-6);
        assert_eq!((place(0.0), place(0.7)), (0.0, 1.0));
        assert_eq!(colors([0.0, 1.0].into_iter()), [0, 0, 0, 255, 255, 255]);
    }
}
