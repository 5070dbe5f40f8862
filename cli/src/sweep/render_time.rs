//! What a pixel costs once it is baked: nanoseconds on one thread.

use crate::failure::{Exit, Failure};
use relight_core::{Direction, PositionMap, RelightingMaps};
use relight_lights::{Accuracy, Attenuation, HorizonRule, Lamp, Light, Plan, Scene, Settings, relight_scene};
use std::hint::black_box;
use std::time::Instant;

/// Pictures of which the fastest counts.
const PICTURES: usize = 3;

/// Nanoseconds a pixel under a directional light and under a point light, on one thread; pictures follow one another in
/// the same memory, as in a sequence.
///
/// # Errors
/// Where the thread can't be made.
pub(crate) fn render_times(maps: &RelightingMaps, settings: Settings) -> Result<(f64, f64), Failure> {
    let pool = rayon::ThreadPoolBuilder::new().num_threads(1).build();
    let pool = pool.map_err(|error| {
        Failure::new(Exit::OverBudget, format!("a thread to time pictures on can't be made: {error}"))
    })?;
    Ok(pool.install(|| on_this_thread(maps, settings)))
}

fn on_this_thread(maps: &RelightingMaps, settings: Settings) -> (f64, f64) {
    let directional = Lamp::Directional { direction: Direction::OUT };
    // A plane as wide as the distance of the lamp above it.
    let point = Lamp::Point { position: [0.3, 0.2, 1.0] };
    let positions = plane(maps.width, maps.height);
    (nanoseconds(maps, None, directional, settings), nanoseconds(maps, Some(&positions), point, settings))
}

fn nanoseconds(
    maps: &RelightingMaps,
    positions: Option<&PositionMap>,
    lamp: Lamp,
    settings: Settings,
) -> f64 {
    let light =
        Light { name: String::new(), lamp, color: [1.0; 3], intensity: 1.0, attenuation: Attenuation::None };
    let scene = Scene { lights: vec![light], horizon: HorizonRule::Extrapolate };
    let plan = Plan::new(&scene, &maps.model, Accuracy::Coarse);
    let mut samples = Vec::new();
    let mut least = f64::INFINITY;
    // The first picture makes the memory.
    for _ in 0..=PICTURES {
        let start = Instant::now();
        let (picture, _) = relight_scene(maps, positions, &scene, &plan, &settings, samples);
        least = least.min(start.elapsed().as_secs_f64());
        samples = black_box(picture).samples;
    }
    least * 1e9 / maps.pixels() as f64
}

fn plane(width: usize, height: usize) -> PositionMap {
    let unit = 1.0 / width.max(height) as f32;
    let point = |i: usize| {
        let (x, y) = ((i % width) as f32, (i / width) as f32);
        [(x - 0.5 * width as f32) * unit, (0.5 * height as f32 - y) * unit, 0.0]
    };
    PositionMap { width, height, points: (0..width * height).map(point).collect() }
}
