//! What accuracy costs in time: paths, scenes and the memory's own speed, on one thread unless said.
//!
//! `cargo bench -p relight-lights` prints the tables of docs/accuracy.md.

#![allow(clippy::unwrap_used, clippy::print_stdout, reason = "a bench talks and fails at once")]

use relight_core::sphere::{Cap, fibonacci_in};
use relight_core::{
    Basis, CpuLevel, Design, Direction, Family, Layout, LightSet, Model, PositionMap, RelightingMap,
    RelightingMaps, Space, Texels,
};
use relight_lights::{
    Accuracy, Attenuation, Directions, Evaluator, HorizonRule, Lamp, Light, Path, Plan, Scene, Settings,
    relight_scene,
};
use std::hint::black_box;
use std::sync::Mutex;
use std::time::Instant;

fn basis(family: &str, count: usize) -> Basis {
    let dome = fibonacci_in(Cap { axis: Direction::OUT, radius: 1.45 }, 100);
    Family::by_name(family).unwrap().build(&Design::new(count, &LightSet::from_directions(dome))).unwrap()
}

fn asset(family: &str, count: usize, width: usize, height: usize) -> RelightingMaps {
    let lights = fibonacci_in(Cap { axis: Direction::OUT, radius: 1.45 }, 100);
    let model = Model {
        basis: basis(family, count),
        layout: Layout::Rgb,
        space: Space::Linear,
        lights,
        figures: None,
        provenance: None,
    };
    let mut seed = 1u32;
    let mut code = || {
        seed = seed.wrapping_mul(1_664_525).wrapping_add(1_013_904_223);
        (seed >> 24) as u8
    };
    let plane = |_| RelightingMap {
        scale: 0.5,
        bias: -0.2,
        texels: Texels::U8((0..width * height).map(|_| code()).collect()),
    };
    let planes = (0..model.plane_count()).map(plane).collect();
    RelightingMaps { width, height, model, planes }
}

fn positions(width: usize, height: usize) -> PositionMap {
    let point = |i: usize| {
        let (x, y) = ((i % width) as f32 / width as f32, (i / width) as f32 / height as f32);
        [4.0 * x - 2.0, 2.0 - 4.0 * y, 0.3 * (x - y)]
    };
    PositionMap { width, height, points: (0..width * height).map(point).collect() }
}

fn point(position: [f64; 3], intensity: f64) -> Light {
    let attenuation = Attenuation::InverseSquare { nearest: 0.01 };
    Light { name: String::new(), lamp: Lamp::Point { position }, color: [1.0; 3], intensity, attenuation }
}

fn directional(direction: Direction) -> Light {
    Light {
        name: String::new(),
        lamp: Lamp::Directional { direction },
        color: [1.0; 3],
        intensity: 1.0,
        attenuation: Attenuation::None,
    }
}

/// The least seconds of several runs, each after the other alternatives' so that none has the machine's good
/// minute to itself.
fn least<const N: usize>(runs: usize, work: [&dyn Fn(); N]) -> [f64; N] {
    let mut best = [f64::INFINITY; N];
    for _ in 0..runs {
        for (best, work) in best.iter_mut().zip(work) {
            let start = Instant::now();
            work();
            *best = best.min(start.elapsed().as_secs_f64());
        }
    }
    best
}

/// Pictures one after another, as in a sequence and as a copy's target: each in the memory of the one before.
#[derive(Default)]
struct Sequence(Mutex<Vec<f32>>);

impl Sequence {
    fn draw(
        &self,
        maps: &RelightingMaps,
        map: Option<&PositionMap>,
        scene: &Scene,
        path: Option<Path>,
        step: f64,
    ) {
        let mut plan = Plan::new(scene, &maps.model, Accuracy::Exact);
        if path.is_some() {
            plan.path = path;
        }
        let settings = Settings { level: CpuLevel::detect(), step, timed: false };
        let mut memory = self.0.lock().unwrap();
        let (picture, _) = relight_scene(maps, map, scene, &plan, &settings, std::mem::take(&mut *memory));
        *memory = black_box(picture).samples;
    }
}

fn in_pool(threads: usize, work: impl FnOnce() + Send) {
    rayon::ThreadPoolBuilder::new().num_threads(threads).build().unwrap().install(work);
}

/// The largest error of a path's functions over 20,000 directions.
fn error_of(basis: &Basis, path: Path) -> f64 {
    let all = fibonacci_in(Cap { axis: Direction::OUT, radius: std::f64::consts::PI }, 20_000);
    let axis = |a: usize| -> Vec<f32> { all.iter().map(|d| d.components()[a] as f32).collect() };
    let (x, y, z) = (axis(0), axis(1), axis(2));
    let mut found = vec![0.0f32; all.len() * basis.count()];
    let evaluator = Evaluator::new(basis, path).unwrap();
    evaluator.evaluate(CpuLevel::detect(), Directions { x: &x, y: &y, z: &z }, &mut found);
    let mut exact = vec![0.0; basis.count()];
    let mut worst = 0.0f64;
    for i in 0..all.len() {
        basis.evaluate(Direction::new(x[i].into(), y[i].into(), z[i].into()).unwrap(), &mut exact);
        for (j, exact) in exact.iter().enumerate() {
            worst = worst.max((f64::from(found[j * all.len() + i]) - exact).abs());
        }
    }
    worst
}

fn paths() {
    println!(
        "\npath, a point light, RGB in 8 bits, 1 MP | largest error of a function | ns a pixel | Mpix/s"
    );
    let (map, sequence) = (positions(1024, 1024), Sequence::default());
    let scene = Scene { lights: vec![point([0.5, 0.3, 1.5], 4.0)], horizon: HorizonRule::Extrapolate };
    for (family, count) in [("srbf", 25), ("sh", 25), ("sh", 121), ("ptm", 6), ("hsh", 16)] {
        let maps = asset(family, count, 1024, 1024);
        let mut paths = vec![Path::Exact];
        if let Basis::Srbf(srbf) = &maps.model.basis {
            paths.extend([Path::Fine, Path::Coarse]);
            for error in [1e-3, 1e-4] {
                paths.push(Path::CosineTable { nodes: Path::cosine_nodes(srbf.spread(), error) });
                paths.push(Path::HalfSineTable { nodes: Path::half_sine_nodes(srbf.spread(), error) });
            }
        }
        if count <= 25 {
            paths.extend([Path::CubeMap { size: 32 }, Path::CubeMap { size: 128 }]);
        }
        for path in paths {
            let mut seconds = [0.0];
            let draw = || sequence.draw(&maps, Some(&map), &scene, Some(path), 0.0);
            in_pool(1, || seconds = least(9, [&draw]));
            println!(
                "{family} {count}, {path} | {:.1e} | {:.1} | {:.1}",
                error_of(&maps.model.basis, path),
                seconds[0] * 1e9 / 1_048_576.0,
                1.048_576 / seconds[0]
            );
        }
    }
}

fn bandwidth() {
    println!("\ndirectional light, 4096 x 4096, k = 16, RGB in 8 bits, beside a copy of the same bytes");
    let maps = asset("sh", 16, 4096, 4096);
    let bytes: Vec<&[u8]> = maps
        .planes
        .iter()
        .map(|plane| match &plane.texels {
            Texels::U8(codes) => &codes[..],
            _ => unreachable!(),
        })
        .collect();
    let target = Mutex::new(vec![1u8; bytes.iter().map(|b| b.len()).sum()]);
    let copy = || {
        let mut target = target.lock().unwrap();
        for (to, from) in target.chunks_mut(bytes[0].len()).zip(&bytes) {
            to.copy_from_slice(from);
        }
        black_box(&target[..]);
    };
    let scene = Scene { lights: vec![directional(Direction::OUT)], horizon: HorizonRule::Extrapolate };
    let pools = [1, 2].map(|n| rayon::ThreadPoolBuilder::new().num_threads(n).build().unwrap());
    let sequence = Sequence::default();
    let relight = |pool: usize| pools[pool].install(|| sequence.draw(&maps, None, &scene, None, 0.0));
    let [copied, one, two] = least(5, [&copy, &|| relight(0), &|| relight(1)]);
    let gigabytes = bytes.len() as f64 * bytes[0].len() as f64 / 1e9;
    println!(
        "copy {copied:.3} s ({:.1} GB/s read); one thread {one:.3} s = {:.0} % of the copy's speed; two threads {two:.3} s = {:.2} times one",
        gigabytes / copied,
        100.0 * copied / one,
        one / two
    );
}

fn many_lights() {
    println!("\n4 point lights and 60 out of reach, srbf 25, 1 MP, one thread");
    let (maps, map) = (asset("srbf", 25, 1024, 1024), positions(1024, 1024));
    let near: Vec<Light> =
        (0..4).map(|i| point([f64::from(i) - 1.5, 0.5, 1.0 + 0.1 * f64::from(i)], 1.0)).collect();
    let far = (0..60).map(|i| point([900.0 + f64::from(i), -700.0, 800.0], 0.1));
    let few = Scene { lights: near.clone(), horizon: HorizonRule::Fade };
    let many = Scene { lights: near.into_iter().chain(far).collect(), horizon: HorizonRule::Fade };
    let step = 1.0 / (255.0 * 12.92);
    let (mut seconds, sequence) = ([0.0; 3], Sequence::default());
    in_pool(1, || {
        seconds = least(
            3,
            [
                &|| sequence.draw(&maps, Some(&map), &few, None, step),
                &|| sequence.draw(&maps, Some(&map), &many, None, step),
                &|| sequence.draw(&maps, Some(&map), &many, None, 0.0),
            ],
        );
    });
    let [few, many, all] = seconds;
    println!("4: {few:.3} s; 64: {many:.3} s = {:.2} times; 64, none skipped: {all:.3} s", many / few);
}

fn the_papers() {
    println!(
        "\nthe papers' work, 1024 x 256, SH k = 16, RGB (theirs: 114 frames a second directional, 20 point)"
    );
    let (maps, map) = (asset("sh", 16, 1024, 256), positions(1024, 256));
    let scenes = [directional(Direction::OUT), point([0.5, 0.3, 1.5], 4.0)]
        .map(|light| Scene { lights: vec![light], horizon: HorizonRule::Extrapolate });
    for threads in [1, 2] {
        let (mut seconds, sequence) = ([0.0; 2], Sequence::default());
        in_pool(threads, || {
            seconds = least(
                20,
                [&|| sequence.draw(&maps, None, &scenes[0], None, 0.0), &|| {
                    sequence.draw(&maps, Some(&map), &scenes[1], None, 0.0)
                }],
            );
        });
        println!(
            "{threads} thread(s): {:.0} frames a second directional, {:.0} point",
            1.0 / seconds[0],
            1.0 / seconds[1]
        );
    }
}

fn main() {
    println!("CPU level {}", CpuLevel::detect().name());
    paths();
    bandwidth();
    many_lights();
    the_papers();
}
