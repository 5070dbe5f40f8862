//! `--near`: photographs under lamps that are close, against renderings of the same surface under distant light.

#![allow(clippy::unwrap_used, reason = "a test's helpers fail as the test does")]

mod scene;

use relight_core::PositionMap;
use relight_formats::write_position_file;
use scene::pictures::{encoded, psnr, read_png};
use scene::{json_of, number, relight, write_lines};
use std::fs;
use std::path::{Path, PathBuf};

const WIDTH: usize = 96;
const HEIGHT: usize = 72;

/// Millimetres in a pixel: the surface is 48 wide and 36 high.
const PIXEL: f64 = 0.5;

/// Lamps stand about 1.2 widths away.
const DISTANCE: f64 = 57.6;

fn lamp(i: usize, count: usize) -> [f64; 3] {
    let distance = DISTANCE * (1.0 + 0.02 * libm::sin(5.0 * i as f64));
    scene::light(i, count).map(|c| distance * c)
}

/// How the surface is.
#[derive(Clone, Copy, PartialEq)]
enum Relief {
    /// Flat, white with a tint, matt.
    Blank,
    /// Normals all over the place, colours and a gloss; geometrically flat.
    Mapped,
    /// The same on steps of up to 8 mm.
    Steps,
}

fn point(relief: Relief, x: usize, y: usize) -> [f64; 3] {
    let height = match relief {
        Relief::Steps => 4.0 * ((x / 12 + y / 9) % 3) as f64,
        _ => 0.0,
    };
    let across = |at: usize, size: usize| at as f64 + 0.5 - 0.5 * size as f64;
    [PIXEL * across(x, WIDTH), -PIXEL * across(y, HEIGHT), height]
}

fn unit(v: [f64; 3]) -> [f64; 3] {
    let length = dot(v, v).sqrt();
    v.map(|c| c / length)
}

fn dot(a: [f64; 3], b: [f64; 3]) -> f64 {
    a.iter().zip(b).map(|(a, b)| a * b).sum()
}

/// Linear light of a pixel lit from the unit vector `light` by irradiance 1 on what faces it.
fn radiance(relief: Relief, x: usize, y: usize, light: [f64; 3]) -> [f64; 3] {
    if relief == Relief::Blank {
        return [0.3, 0.25, 0.2].map(|albedo| albedo * light[2].max(0.0));
    }
    let (fx, fy) = (x as f64, y as f64);
    let normal = unit([0.35 * libm::sin(0.5 * fx + 0.2 * fy), 0.3 * libm::cos(0.43 * fy - 0.1 * fx), 1.0]);
    let half = unit([light[0], light[1], light[2] + 1.0]);
    let gloss = 0.05 * libm::pow(dot(normal, half).max(0.0), 20.0);
    let albedo = [0.15 + 0.1 * (x % 5) as f64 / 5.0, 0.25, 0.15 + 0.1 * ((x + 2 * y) % 7) as f64 / 7.0];
    albedo.map(|albedo| albedo * dot(normal, light).max(0.0) + gloss)
}

/// From the mean of all points.
fn from_middle(relief: Relief, lamp: [f64; 3]) -> [f64; 3] {
    let heights: f64 = (0..WIDTH * HEIGHT).map(|pixel| point(relief, pixel % WIDTH, pixel / WIDTH)[2]).sum();
    [lamp[0], lamp[1], lamp[2] - heights / (WIDTH * HEIGHT) as f64]
}

/// Linear light of a pixel under a lamp that lights what faces it in the middle of the surface by 1.
fn near_radiance(relief: Relief, lamp: [f64; 3]) -> impl Fn(usize, usize) -> [f64; 3] {
    let middle = from_middle(relief, lamp);
    move |x, y| {
        let p = point(relief, x, y);
        let way = [0, 1, 2].map(|i| lamp[i] - p[i]);
        radiance(relief, x, y, unit(way)).map(|value| value * dot(middle, middle) / dot(way, way))
    }
}

/// cos^4 of a lens that sees the pictures' width at 50 degrees.
fn lens(x: usize, y: usize) -> f64 {
    let focal = 0.5 * WIDTH as f64 / libm::tan(25f64.to_radians());
    let across = |at: usize, size: usize| (at as f64 + 0.5 - 0.5 * size as f64) / focal;
    let square = 1.0 + across(x, WIDTH).powi(2) + across(y, HEIGHT).powi(2);
    1.0 / (square * square)
}

fn samples(color: impl Fn(usize, usize) -> [f64; 3]) -> Vec<f64> {
    (0..WIDTH * HEIGHT).flat_map(|pixel| color(pixel % WIDTH, pixel / WIDTH)).map(encoded).collect()
}

fn write_16(path: &Path, color: impl Fn(usize, usize) -> [f64; 3]) {
    let codes = samples(color).into_iter().map(|value| (value.min(1.0) * 65535.0).round() as u16).collect();
    image::ImageBuffer::<image::Rgb<u16>, Vec<u16>>::from_raw(WIDTH as u32, HEIGHT as u32, codes)
        .unwrap()
        .save(path)
        .unwrap();
}

fn name(i: usize) -> String {
    format!("p{i:02}.png")
}

fn position_lines(count: usize) -> Vec<String> {
    let line = |i: usize| {
        let [x, y, z] = lamp(i, count);
        format!("{} {x:.6} {y:.6} {z:.6}", name(i))
    };
    (0..count).map(line).collect()
}

/// A folder with a `capture` of `count` pictures under near lamps, its directions as the middle sees them, and `lamps.txt`.
fn capture(relief: Relief, count: usize, is_vignetted: bool) -> tempfile::TempDir {
    let folder = tempfile::tempdir().unwrap();
    let pictures = folder.path().join("capture");
    fs::create_dir(&pictures).unwrap();
    for i in 0..count {
        let near = near_radiance(relief, lamp(i, count));
        write_16(&pictures.join(name(i)), |x, y| {
            let through = if is_vignetted { lens(x, y) } else { 1.0 };
            near(x, y).map(|value| value * through)
        });
    }
    write_lines(&pictures.join("lights.lp"), &position_lines(count));
    write_lines(&folder.path().join("lamps.txt"), &position_lines(count));
    let points =
        (0..WIDTH * HEIGHT).map(|pixel| point(relief, pixel % WIDTH, pixel / WIDTH).map(|c| c as f32));
    let map = PositionMap { width: WIDTH, height: HEIGHT, points: points.collect() };
    write_position_file(&folder.path().join("p.exr"), &map).unwrap();
    folder
}

/// The four corners of a picture, each a quarter of its width and height.
fn corners(samples: &[f64]) -> Vec<f64> {
    let is_corner = |pixel: usize| {
        let (x, y) = (pixel % WIDTH, pixel / WIDTH);
        !(WIDTH / 4..3 * WIDTH / 4).contains(&x) && !(HEIGHT / 4..3 * HEIGHT / 4).contains(&y)
    };
    let pixels = samples.chunks_exact(3).enumerate().filter(|(pixel, _)| is_corner(*pixel));
    pixels.flat_map(|(_, rgb)| rgb.to_vec()).collect()
}

/// Mean PSNR in the corners of what `options` renders of `asset` against `expected`, light by light.
fn in_corners(folder: &Path, asset: &str, lights: &[(String, Vec<f64>)]) -> f64 {
    let of = |(options, expected): &(String, Vec<f64>)| {
        relight(folder, &format!("render {asset} {options} -o relit.png --depth 16")).ok();
        let (relit, _) = read_png(&folder.join("relit.png"));
        psnr(&corners(&relit.samples), &corners(expected))
    };
    lights.iter().map(of).sum::<f64>() / lights.len() as f64
}

/// Renderings under distant lights that no lamp was in the direction of.
fn distant(relief: Relief) -> Vec<(String, Vec<f64>)> {
    let light = |i: usize| {
        let (azimuth, elevation) = (0.9 * i as f64, 0.6 + 0.12 * i as f64);
        let (sine, cosine) = libm::sincos(elevation);
        let light = [cosine * libm::cos(azimuth), cosine * libm::sin(azimuth), sine];
        let expected = samples(|x, y| radiance(relief, x, y, light));
        (format!("--light {},{},{}", light[0], light[1], light[2]), expected)
    };
    (0..7).map(light).collect()
}

/// Renderings under lamps a third nearer than the capture's, as scene files in `folder`.
fn closer(folder: &Path, relief: Relief) -> Vec<(String, Vec<f64>)> {
    let light = |i: usize| {
        let lamp = scene::light(3 * i + 1, 22).map(|c| 0.67 * DISTANCE * c);
        let middle = from_middle(relief, lamp);
        let scene = format!(
            "horizon = 'extrapolate'\n[[light]]\nkind = 'point'\nposition = {lamp:?}\nintensity = {}\n",
            dot(middle, middle)
        );
        fs::write(folder.join(format!("s{i}.toml")), scene).unwrap();
        let expected = samples(near_radiance(relief, lamp));
        (format!("--scene s{i}.toml --positions p.exr"), expected)
    };
    (0..5).map(light).collect()
}

#[test]
fn corners_are_three_decibels_better_than_with_distant_lamps() {
    for (relief, surface) in [(Relief::Mapped, "--scale 0.5"), (Relief::Steps, "--positions p.exr")] {
        let folder = capture(relief, 48, false);
        let at = folder.path();
        for (basis, least) in [("--basis ptm", 3.0), ("--basis hsh -k 9", 3.0), ("--basis sh -k 16", 3.0)] {
            let options = format!("bake capture {basis} --precision f16 --holdout every:8 --report");
            relight(at, &format!("{options} far.json -o far.ktx2")).ok();
            relight(at, &format!("{options} near.json -o near.ktx2 --near lamps.txt {surface}")).ok();
            let [far, near] = ["far", "near"].map(|name| json_of(&at.join(format!("{name}.json"))));
            assert!(number(&near, "near.off") <= 1.0 / 64.0 && far["near"].is_null());
            for (what, lights) in [("distant", distant(relief)), ("closer", closer(at, relief))] {
                let [far, near] = ["far.ktx2", "near.ktx2"].map(|asset| in_corners(at, asset, &lights));
                println!(
                    "{basis} {surface}: corners under {what} lights: far {far:.2} dB, near {near:.2} dB"
                );
                assert!(near > far + least, "{basis} {what}: far {far}, near {near}");
            }
            let [far, near] = [far, near].map(|report| number(&report, "holdout.mean.psnr"));
            println!("{basis} {surface}: held-out lamps: far {far:.2} dB, near {near:.2} dB");
            // Of the capture's own dome a fit to distant lamps knows what fall-off and directions do, pixel by pixel.
            assert!(near > far - 0.5, "{basis}: held out, far {far}, near {near}");
        }
        // The same lamps judged by evaluate, which is told of them likewise.
        let bake = "bake capture --basis hsh -k 9 --precision f16 -o near.ktx2 --near lamps.txt";
        relight(at, &format!("{bake} {surface}")).ok();
        let scale = if relief == Relief::Steps { "" } else { surface };
        let judged =
            |options: &str| relight(at, &format!("evaluate near.ktx2 capture --json {options}")).ok().json();
        let near = number(&judged(&format!("--near lamps.txt {scale}")), "mean.psnr");
        let far = number(&judged(""), "mean.psnr");
        println!("evaluate: near {near:.2} dB, as if they were far {far:.2} dB");
        assert!(near > 35.0 && near > far + 3.0, "{near} {far}");
    }
}

#[test]
fn a_flat_white_surface_is_flat_white_behind_a_lens() {
    let folder = capture(Relief::Blank, 40, true);
    let at = folder.path();
    let bake = "bake capture --basis hsh -k 4 --ridge 0 --precision f16 --near lamps.txt --scale 0.5";
    relight(at, &format!("{bake} --space linear --vignetting 50 -o a.ktx2")).ok();
    relight(at, &format!("{bake} --space linear -o dark.ktx2")).ok();
    let green = |asset: &str| {
        relight(at, &format!("render {asset} --light 0.2,0.1,0.9 -o a.png --depth 16")).ok();
        let (picture, _) = read_png(&at.join("a.png"));
        let linear = picture.samples.chunks_exact(3).map(|rgb| scene::pictures::decoded(rgb[1]));
        linear.map(|value| value / (0.25 * unit([0.2, 0.1, 0.9])[2])).collect::<Vec<f64>>()
    };
    let worst = |values: &[f64]| values.iter().fold(0.0f64, |most, value| most.max((value - 1.0).abs()));
    let (flat, dark) = (worst(&green("a.ktx2")), worst(&green("dark.ktx2")));
    println!("albedo of a white plane off by {flat:.4} with --vignetting, {dark:.4} without");
    assert!(flat < 0.01 && dark > 0.3, "{flat} {dark}");
    // Photographs through the lens are what the asset gives through the lens.
    let judge = |options: &str| {
        let line = format!("evaluate a.ktx2 capture --json --near lamps.txt --scale 0.5 {options}");
        number(&relight(at, &line).ok().json(), "mean.psnr")
    };
    assert!(judge("--vignetting 50") > 50.0 && judge("") < 30.0);
}

#[test]
fn a_crop_is_part_of_the_whole() {
    let folder = capture(Relief::Mapped, 20, true);
    let at = folder.path();
    for surface in ["--scale 0.5", "--positions p.exr"] {
        let bake = format!(
            "bake capture --basis ptm --ridge 1e-4 --precision f32 --vignetting 50 --near lamps.txt {surface}"
        );
        relight(at, &format!("{bake} -o whole.ktx2")).ok();
        relight(at, &format!("{bake} --crop 40x30+50+38 -o part.ktx2")).ok();
        let picture = |asset: &str| {
            relight(at, &format!("render {asset} --light 0.3,-0.2,0.9 -o a.png --depth 16")).ok();
            read_png(&at.join("a.png")).0
        };
        let (whole, part) = (picture("whole.ktx2"), picture("part.ktx2"));
        assert_eq!((part.width, part.height), (40, 30));
        let mut worst = 0.0f64;
        for (i, value) in part.samples.iter().enumerate() {
            let (x, y) = (50 + i / 3 % 40, 38 + i / 120);
            worst = worst.max((value - whole.samples[3 * (y * WIDTH + x) + i % 3]).abs());
        }
        println!("{surface}: {worst}");
        // The middle of a plane stays where it is, that of points is that of those there are.
        let most = if surface.starts_with("--scale") { 0.002 } else { 0.3 };
        assert!(worst < most, "{surface}: {worst}");
    }
}

#[test]
fn threads_memory_and_instruction_sets_change_nothing() {
    let folder = capture(Relief::Steps, 20, false);
    let at = folder.path();
    let bake = "bake capture --basis ptm --near lamps.txt --positions p.exr --color lrgb --mips -o";
    relight(at, &format!("{bake} a.ktx2")).ok();
    let files = || ["a.ktx2", "a_positions.ktx2"].map(|name| fs::read(at.join(name)).unwrap());
    let first = files();
    for options in ["-j 1", "-j 5", "--cpu baseline"] {
        relight(at, &format!("{bake} a.ktx2 {options}")).ok();
        assert!(files() == first, "{options}");
    }
    scene::relight_in_least_memory(at, &format!("{bake} a.ktx2")).ok();
    assert!(files() == first, "memory");
    // What has no room for positions uses them all the same, and says so.
    let run = relight(at, "bake capture --basis ptm --near lamps.txt --positions p.exr -o a.ptm").ok();
    assert!(run.stderr.contains("holds no positions"), "{}", run.stderr);
}

#[test]
fn what_cannot_be_near_is_refused_in_a_sentence() {
    let folder = capture(Relief::Mapped, 8, false);
    let at = folder.path();
    let lines = position_lines(8);
    write_lines(&at.join("few.txt"), &lines[..6]);
    let others: Vec<String> = lines.iter().map(|line| line.replace('p', "q")).collect();
    write_lines(&at.join("others.txt"), &others);
    let with = |line: &str| {
        lines[..7].iter().map(String::as_str).chain([line]).map(str::to_owned).collect::<Vec<_>>()
    };
    write_lines(&at.join("zero.txt"), &with("p07.png 0 0 0"));
    write_lines(&at.join("beyond.txt"), &with("p07.png 0 1e10 0"));
    write_lines(&at.join("twice.txt"), &[lines.clone(), vec![lines[2].clone()]].concat());
    fs::write(at.join("nothing.txt"), "").unwrap();
    let map = PositionMap { width: 4, height: 3, points: vec![[1.0; 3]; 12] };
    write_position_file(&at.join("small.exr"), &map).unwrap();
    let bake = "bake capture -o a.ktx2";
    for (options, code, words) in [
        ("--near lamps.txt", 2, &["--scale", "--positions"][..]),
        ("--near lamps.txt --scale 0", 2, &["--scale"]),
        ("--near lamps.txt --scale 0.5 --positions p.exr", 2, &["--scale"]),
        ("--scale 0.5", 2, &["--near"]),
        ("--vignetting 50", 2, &["--near"]),
        ("--near lamps.txt --scale 0.5 --vignetting 180", 2, &["0.1 to 150"]),
        ("--near lamps.txt --scale 0.5 --basis pca", 2, &["--near", "convert"]),
        ("--near lamps.txt --scale 0.5 --basis sh --planes 4", 2, &["--near", "convert"]),
        ("--near few.txt --scale 0.5", 3, &["few.txt", "2 of 8 pictures have no line", "p06.png"]),
        ("--near others.txt --scale 0.5", 3, &["others.txt", "8 of 8"]),
        ("--near zero.txt --scale 0.5", 3, &["zero.txt", "line 9"]),
        ("--near beyond.txt --scale 0.5", 3, &["beyond.txt", "line 9", "1e9"]),
        ("--near twice.txt --scale 0.5", 3, &["twice.txt", "lines 4 and 10"]),
        ("--near nothing.txt --scale 0.5", 3, &["nothing.txt"]),
        ("--near missing.txt --scale 0.5", 4, &["missing.txt"]),
        ("--near lamps.txt --positions small.exr", 3, &["small.exr", "4 x 3"]),
    ] {
        let run = relight(at, &format!("{bake} {options}"));
        if code == 2 && run.stderr.contains("Usage:") {
            // Words of the parser of options, which take some lines.
            assert_eq!(run.code, Some(2), "{options}\n{}", run.stderr);
            assert!(words.iter().all(|word| run.stderr.contains(word)), "{options}\n{}", run.stderr);
            continue;
        }
        run.assert_refused(code, words);
    }
    let left: Vec<PathBuf> = fs::read_dir(at).unwrap().map(|entry| entry.unwrap().path()).collect();
    assert!(!left.iter().any(|path| path.ends_with("a.ktx2")));
    // Lamps where they can't have been are said, not refused.
    let mirrored: Vec<String> = (0..8)
        .map(|i| {
            let [x, y, z] = lamp(i, 8);
            format!("{} {} {y} {z}", name(i), -x)
        })
        .collect();
    write_lines(&at.join("mirrored.txt"), &mirrored);
    let run = relight(at, &format!("{bake} --near mirrored.txt --scale 0.5")).ok();
    assert!(run.stderr.contains("20 degrees off"), "{}", run.stderr);
    write_lines(&at.join("below.txt"), &with("p07.png 10 10 -20"));
    let run = relight(at, &format!("{bake} --near below.txt --scale 0.5")).ok();
    assert!(run.stderr.contains("behind the picture plane"), "{}", run.stderr);
}
