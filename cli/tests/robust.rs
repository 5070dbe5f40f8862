//! `bake --robust`: the matte layer below shadows and highlights.

#![allow(clippy::unwrap_used, reason = "a test's helpers fail as the test does")]

mod scene;

use exr::prelude::write_rgb_file;
use scene::pictures::{psnr, read_exr};
use scene::{HEIGHT, WIDTH, light, light_lines, made, name, relight, write_lines};
use std::fs;
use std::path::Path;

const LIGHTS: usize = 48;

/// A surface of gentle slopes, its matte light and, where `spoilt`, a highlight or a cast shadow under a third of the lights,
/// others at each pixel.
fn color(x: usize, y: usize, picture: usize, spoilt: bool) -> [f64; 3] {
    let [lx, ly, lz] = light(picture, LIGHTS);
    let slope = [0.2 * libm::sin(x as f64 * 0.7), 0.2 * libm::cos(y as f64 * 0.9)];
    let matte = (slope[0] * lx + slope[1] * ly + lz).max(0.0);
    let albedo = [0.5, 0.4, 0.3].map(|c| c + 0.03 * ((x * 3 + y) % 7) as f64);
    match (picture * 7 + x * 5 + y * 11) % 9 {
        0 | 4 if spoilt => [0.0; 3],
        2 if spoilt => albedo.map(|a| a * matte + 0.8),
        _ => albedo.map(|a| a * matte),
    }
}

fn write(folder: &Path, spoilt: bool) {
    fs::create_dir(folder).unwrap();
    for picture in 0..LIGHTS {
        let path = folder.join(name(picture)).with_extension("exr");
        let pixel = |x: usize, y: usize| {
            let [r, g, b] = color(x, y, picture, spoilt).map(|value| value as f32);
            (r, g, b)
        };
        write_rgb_file(path, WIDTH, HEIGHT, pixel).unwrap();
    }
    let lines: Vec<String> = light_lines(LIGHTS).iter().map(|line| line.replace(".png", ".exr")).collect();
    write_lines(&folder.join("lights.lp"), &lines);
}

#[test]
fn shadows_and_highlights_are_left_out_of_the_matte_layer() {
    let folder = tempfile::tempdir().unwrap();
    let here = folder.path();
    write(&here.join("spoilt"), true);
    let bake = |output: &str, rest: &str| {
        relight(here, &format!("bake spoilt -o {output} --basis sh -k 4 --precision f32 {rest}")).ok()
    };
    let matte = |asset: &str| {
        let figures = [3, 17, 40].map(|picture| {
            let [x, y, z] = light(picture, LIGHTS);
            relight(here, &format!("render {asset} --light {x},{y},{z} -o lit.exr")).ok();
            let truth: Vec<f64> =
                (0..WIDTH * HEIGHT).flat_map(|i| color(i % WIDTH, i / WIDTH, picture, false)).collect();
            psnr(&read_exr(&here.join("lit.exr")).0.samples, &truth)
        });
        figures.into_iter().fold(f64::INFINITY, f64::min)
    };
    bake("plain.ktx2", "");
    let robust = bake("robust.ktx2", "--robust");
    assert!(robust.stderr.contains("those of plain least squares"), "{}", robust.stderr);
    assert!(robust.stdout.contains("sh with 4 functions, robust"), "{}", robust.stdout);
    let (plain, kept) = (matte("plain.ktx2"), matte("robust.ktx2"));
    println!("matte layer, worst of three lights: least squares {plain:.1} dB, robust {kept:.1} dB");
    assert!(kept > 40.0 && plain < 25.0, "least squares {plain} dB, robust {kept} dB");
    // Whoever fits, on how many threads and in which spans: the same bytes.
    bake("again.ktx2", "--robust -j 1 --cpu baseline");
    assert!(fs::read(here.join("robust.ktx2")).unwrap() == fs::read(here.join("again.ktx2")).unwrap());
}

#[test]
fn what_has_no_weights_of_its_own_at_each_pixel_is_refused() {
    let folder = made(20);
    let here = folder.path();
    for rest in ["--basis pca -k 3", "--basis ptm --planes 4", "--basis ptm --color lrgb"] {
        relight(here, &format!("bake capture -o a.ktx2 --robust {rest}")).assert_refused(2, &["--robust"]);
    }
    assert!(!here.join("a.ktx2").exists());
}
