//! What `--explain` says: which passes, maps and lights ran and why, which did not, and what that saved.

use super::jobs::Job;
use super::{Drawn, Loaded};
use crate::say::{self, say};
use relight_lights::LightReport;
use serde_json::{Value, json};

/// A picture and how it came about.
pub(super) struct Explanation {
    name: String,
    lines: Vec<String>,
    json: Value,
}

impl Explanation {
    pub(super) fn of(job: &Job, drawn: &Drawn, loaded: &Loaded) -> Self {
        let Drawn { plan, report, seconds, .. } = drawn;
        let light = |index: usize| job.scene.lights[index].name.as_str();
        let mut lines = Vec::new();
        let folded: usize = plan.uniform.iter().map(|pass| pass.lights.len().saturating_sub(1)).sum();
        let passes = plan.uniform.len();
        let pass_seconds = if passes == 0 { 0.0 } else { report.uniform_seconds / passes as f64 };
        // An environment over encoded values is many passes: one line.
        for same in plan.uniform.chunk_by(|a, b| a.lights == b.lights) {
            let lights = &same[0].lights;
            let names: Vec<_> = lights.iter().map(|&index| format!("'{}'", light(index))).collect();
            let why = match (same.len(), lights.len()) {
                (1, 1) => "one direction everywhere: one weight a plane".to_owned(),
                (1, n) => format!(
                    "{n} lights in one weight a plane, which saved about {}",
                    time((n - 1) as f64 * pass_seconds)
                ),
                (n, _) => {
                    format!("{n} directions, each decoded before they add up: the asset's values are encoded")
                }
            };
            lines.push(format!("pass over the picture: {} ({why})", names.join(", ")));
        }
        if passes > 0 {
            lines.push(format!("passes over the picture took {}", time(report.uniform_seconds)));
        }
        let per_tile = mean_seconds(&report.local);
        let mut saved_by_bounds = 0.0;
        for of_light in &report.local {
            let kind = job.scene.lights[of_light.light].kind();
            let LightReport { evaluated, skipped, seconds, .. } = *of_light;
            let each = if evaluated > 0 { seconds / evaluated as f64 } else { per_tile };
            let saved = skipped as f64 * each;
            saved_by_bounds += saved;
            let mut line =
                format!("{kind} '{}': {evaluated} tiles in {}", light(of_light.light), time(seconds));
            if skipped > 0 {
                line += &format!(
                    ", {skipped} out of its reach or too dim to be seen, which saved about {}",
                    time(saved)
                );
            }
            lines.push(line);
        }
        if let Some(path) = plan.path {
            lines.push(format!("functions of light pixel by pixel: {path}"));
        }
        for (index, why) in &plan.dark {
            lines.push(format!("'{}' is left out: {why}", light(*index)));
        }
        let saved_by_positions = if plan.reads_positions() {
            lines.push(format!("positions: {} pixels read", report.positions_read));
            0.0
        } else {
            let saved = position_seconds(loaded);
            lines.push(format!(
                "positions: not touched, no light is local, which saved about {}",
                time(saved)
            ));
            saved
        };
        if report.negative > 0 {
            lines.push(format!("{} samples came out negative; the file holds 0 there", report.negative));
        }
        if report.at_surface > 0 {
            lines.push(format!(
                "a lamp stands at the surface of {} pixels and lights nothing there",
                report.at_surface
            ));
        }
        lines.push(format!("drawn in {}", time(*seconds)));
        let name = job.path.display().to_string();
        let passes: Vec<Value> = plan
            .uniform
            .iter()
            .map(
                |pass| json!({ "lights": pass.lights.iter().map(|&index| light(index)).collect::<Vec<_>>() }),
            )
            .collect();
        let local: Vec<Value> = report
            .local
            .iter()
            .map(|of_light| {
                json!({
                    "light": light(of_light.light),
                    "kind": job.scene.lights[of_light.light].kind(),
                    "tiles": of_light.evaluated,
                    "tiles_skipped": of_light.skipped,
                    "seconds": of_light.seconds,
                })
            })
            .collect();
        let dark: Vec<Value> =
            plan.dark.iter().map(|(index, why)| json!({ "light": light(*index), "why": why })).collect();
        let json = json!({
            "picture": name,
            "passes": passes,
            "local": local,
            "path": plan.path.map(|path| path.to_string()),
            "left_out": dark,
            "positions_read": report.positions_read,
            "negative_samples": report.negative,
            "pixels_at_a_lamp": report.at_surface,
            "seconds": seconds,
            "seconds_of_passes": report.uniform_seconds,
            "saved_seconds": {
                "folding": folded as f64 * pass_seconds,
                "bounds": saved_by_bounds,
                "positions": saved_by_positions,
            },
        });
        Self { name, lines, json }
    }
}

/// Prints them.
pub(super) fn print(explanations: &[Explanation], as_json: bool) {
    if as_json && !explanations.is_empty() {
        let all: Vec<&Value> = explanations.iter().map(|explanation| &explanation.json).collect();
        say::json(&json!({ "pictures": all }));
        return;
    }
    for explanation in explanations {
        say!("{}", explanation.name);
        for line in &explanation.lines {
            say!("  {line}");
        }
    }
}

/// Seconds that a light took in a tile, over all that were evaluated.
fn mean_seconds(lights: &[LightReport]) -> f64 {
    let tiles: usize = lights.iter().map(|light| light.evaluated).sum();
    if tiles == 0 { 0.0 } else { lights.iter().map(|light| light.seconds).sum::<f64>() / tiles as f64 }
}

/// About what reading positions would have taken, at the speed at which the planes were read.
fn position_seconds(loaded: &Loaded) -> f64 {
    /// Four halves a pixel.
    const BYTES: f64 = 8.0;
    let planes = loaded.maps.texel_bytes();
    loaded.seconds * BYTES * loaded.maps.pixels() as f64 / planes.max(1) as f64
}

fn time(seconds: f64) -> String {
    if seconds < 0.1 { format!("{:.2} ms", 1e3 * seconds) } else { format!("{seconds:.2} s") }
}
