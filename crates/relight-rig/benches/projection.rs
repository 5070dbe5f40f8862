//! What harmonics of many lights at a point cost, on one thread.
//!
//! `cargo bench -p relight-rig --bench projection` prints the table of docs/accuracy.md.

#![allow(clippy::print_stdout, reason = "a bench talks")]

use relight_core::CpuLevel;
use relight_core::vectors::{cross, unit};
use relight_rig::{CutDiscs, Light, MOST_BANDS, Projector, Source, SurfaceRows, add_reflectance};
use std::hint::black_box;
use std::time::Instant;

/// Places on a spiral around the origin, none like another.
fn place(i: usize) -> [f64; 3] {
    let turn = i as f64 * 2.399_963;
    let z = -1.0 + (i % 997) as f64 / 498.5;
    let distance = 3.0 + (i % 13) as f64;
    [distance * libm::cos(turn), distance * libm::sin(turn), distance * z]
}

fn spheres(count: usize) -> Vec<Light> {
    let sphere = |i| Source::Sphere { centre: place(i), radius: 0.1 + 0.01 * (i % 17) as f64 };
    lights((0..count).map(sphere))
}

fn discs(count: usize, distance: f64) -> Vec<Light> {
    let disc = |i| {
        let far = place(i);
        let length = far.iter().map(|c| c * c).sum::<f64>().sqrt();
        let centre = far.map(|c| distance * c / length);
        Source::Disc { centre, normal: far.map(|c| -c / length), radius: 1.0 }
    };
    lights((0..count).map(disc))
}

fn lights(sources: impl Iterator<Item = Source>) -> Vec<Light> {
    sources.map(|source| Light { name: String::new(), source, color: [1.0, 0.7, 0.4] }).collect()
}

/// Least nanoseconds of `work` a unit of `units`, of many runs.
fn least(units: usize, mut work: impl FnMut()) -> f64 {
    let mut best = f64::INFINITY;
    for _ in 0..30 {
        let start = Instant::now();
        let mut runs = 0;
        while start.elapsed().as_secs_f64() < 2e-3 {
            work();
            runs += 1;
        }
        best = best.min(start.elapsed().as_secs_f64() / f64::from(runs));
    }
    best * 1e9 / units as f64
}

fn projection(name: &str, lights: &[Light], level: CpuLevel) {
    let weighted: Vec<_> = lights.iter().map(|light| (light, 1.0)).collect();
    for bands in 1..=MOST_BANDS {
        let projector = Projector::new(&weighted, bands, ([0.0; 3], 1.0));
        let (mut values, mut slopes) = (vec![[0.0; 3]; bands * bands], vec![[[0.0; 3]; 3]; bands * bands]);
        let point = [0.1, -0.2, 0.3];
        let value = least(lights.len(), || projector.project(level, black_box(point), &mut values));
        let both = least(lights.len(), || {
            projector.project_with_gradient(level, black_box(point), &mut values, &mut slopes);
        });
        println!(
            "{name} | {} | {bands} | {value:.2} | {:.1} | {both:.2} | {:.1}",
            level.name(),
            1e3 / value,
            1e3 / both
        );
    }
}

/// Discs from 32 points together, for irradiance.
fn together(name: &str, lights: &[Light], level: CpuLevel) {
    let weighted: Vec<_> = lights.iter().map(|light| (light, 1.0)).collect();
    let points: Vec<_> = (0..32).map(|i| place(i).map(|c| 0.01 * c)).collect();
    for bands in [3, 5, MOST_BANDS] {
        let projector = Projector::new(&weighted, bands, ([0.0; 3], 1.0)).for_irradiance();
        let mut values = vec![[0.0; 3]; bands * bands * points.len()];
        let each = least(lights.len() * points.len(), || {
            projector.project_all(level, black_box(&points), &mut values);
        });
        println!("{name} | {} | {bands} | {each:.2} | {:.1}", level.name(), 1e3 / each);
    }
}

/// At points around the origin, whose normals are `normal(point)`.
fn reflectance(
    name: &str,
    light: &Light,
    cut: CutDiscs,
    level: CpuLevel,
    normal: impl Fn([f64; 3]) -> [f64; 3],
) {
    const POINTS: usize = 4096;
    let axis = |a: usize| -> Vec<f32> { (0..POINTS).map(|i| place(i)[a] as f32 / 15.0).collect() };
    let normal = |a: usize| -> Vec<f32> {
        (0..POINTS).map(|i| unit(normal(place(i))).map_or(0.0, |n| n[a] as f32)).collect()
    };
    let [x, y, z, nx, ny, nz] = [axis(0), axis(1), axis(2), normal(0), normal(1), normal(2)];
    let points = SurfaceRows { x: &x, y: &y, z: &z, nx: &nx, ny: &ny, nz: &nz };
    let mut out = [vec![0.0f32; POINTS], vec![0.0; POINTS], vec![0.0; POINTS]];
    let nanoseconds = least(POINTS, || {
        let [r, g, b] = &mut out;
        add_reflectance(black_box(light), cut, level, &points, [r, g, b]);
    });
    println!("{name} | {} | {nanoseconds:.2} | {:.1}", level.name(), 1e3 / nanoseconds);
}

fn main() {
    println!("lights | level | bands | ns a light | million/s | with gradient ns | million/s");
    for level in CpuLevel::available() {
        projection("1,024 spheres", &spheres(1024), level);
    }
    let level = CpuLevel::detect();
    projection("16 spheres", &spheres(16), level);
    projection("64 discs at 10 radii", &discs(64, 10.0), level);
    projection("64 discs at 3 radii", &discs(64, 3.0), level);
    for (radii, count) in [(20.0, 190), (8.0, 190), (5.0, 190), (3.3, 190)] {
        for level in CpuLevel::available() {
            together(&format!("{count} discs at {radii} radii from 32 points"), &discs(count, radii), level);
        }
    }
    println!("\none light at many points | level | ns a point | million/s");
    for level in CpuLevel::available() {
        reflectance("sphere", &spheres(1)[0], CutDiscs::Exact, level, |point| point);
    }
    for radii in [10.0, 7.0, 5.0, 3.3, 2.3] {
        for (name, cut) in [("exact", CutDiscs::Exact), ("fast", CutDiscs::Fast)] {
            let name = format!("disc at {radii} radii that all horizons cut, {name}");
            reflectance(&name, &discs(1, radii)[0], cut, level, |point| cross(place(0), point));
        }
    }
    reflectance("disc at 10 radii", &discs(1, 10.0)[0], CutDiscs::Exact, level, |point| point);
    let sources = [
        ("point", Source::Point { position: place(1), nearest: 0.1 }),
        ("directional", Source::Directional { direction: [0.0, 0.6, 0.8] }),
    ];
    for (name, source) in sources {
        reflectance(name, &lights([source].into_iter())[0], CutDiscs::Exact, level, |point| point);
    }
}
