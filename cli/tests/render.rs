//! `relight render`: lights, colours, depths and files.

#![allow(clippy::unwrap_used, reason = "a test's helpers fail as the test does")]

mod scene;

use scene::pictures::{Pixels, decoded, encoded, psnr, read_exr, read_png};
use scene::{made, names_in, relight};
use std::fs;
use std::path::Path;

/// What `render` with `options` writes as 16-bit PNG.
fn rendered(here: &Path, options: &str) -> Vec<f64> {
    relight(here, &format!("render a.ktx2 -o a.png --depth 16 {options}")).ok();
    read_png(&here.join("a.png")).0.samples
}

/// Half a step of 16 bits and the arithmetic in f32.
const CLOSE: f64 = 1.2e-5;

#[track_caller]
fn assert_close(found: &[f64], expected: &[f64], tolerance: f64) {
    assert_eq!(found.len(), expected.len());
    for (i, (a, b)) in found.iter().zip(expected).enumerate() {
        assert!((a - b).abs() <= tolerance, "sample {i}: {a} where {b} was expected");
    }
}

/// A folder with an asset of a made capture.
fn baked() -> tempfile::TempDir {
    let folder = made(20);
    relight(folder.path(), "bake capture -o a.ktx2 --basis hsh -k 9").ok();
    folder
}

#[test]
fn several_lights_add_up_in_linear_light() {
    let folder = baked();
    let here = folder.path();
    let a = rendered(here, "--light 0.3,0.2,0.9");
    let b = rendered(here, "--light -0.8,0.1,0.5");
    // Coloured, so that the sum stays below 1 and a channel's mix-up shows.
    let both = rendered(here, "--light 0.3,0.2,0.9,0.5,0.4,0.3 --light -0.8,0.1,0.5,0.1,0.3,0.45");
    let colors = [[0.5, 0.4, 0.3], [0.1, 0.3, 0.45]];
    let sum = |i: usize| encoded(colors[0][i % 3] * decoded(a[i]) + colors[1][i % 3] * decoded(b[i]));
    let expected: Vec<f64> = (0..a.len()).map(sum).collect();
    // A sum of two rounded pictures, steep at black: 12.92 steps of 16 bits.
    assert_close(&both, &expected, 2e-4);
    // Adding encoded values would be something else.
    let wrong = (0..a.len()).map(|i| (colors[0][i % 3] * a[i] + colors[1][i % 3] * b[i] - both[i]).abs());
    assert!(wrong.fold(0.0, f64::max) > 0.1);
    // The order of lights and the way of naming them does not matter, all of them count.
    let white = rendered(here, "--angles 20,50 --light 0,1,1,0.2,0.2,0.2 --angles 200,30,0.1,0.1,0.1");
    let other = rendered(here, "--light 0,3,3,0.2,0.2,0.2 --angles 200,30,0.1,0.1,0.1 --angles 20,50");
    // One code of 16 bits: floats added in another order.
    assert_close(&white, &other, 1.1 / 65535.0);
    let one = rendered(here, "--angles 20,50");
    assert!(white.iter().zip(&one).all(|(sum, one)| *sum >= one - CLOSE));
    assert!(white != one);
}

#[test]
fn a_coloured_light_scales_linear_channels() {
    let folder = baked();
    let white = rendered(folder.path(), "--light 0.2,-0.3,0.9");
    let tinted = rendered(folder.path(), "--light 0.2,-0.3,0.9,1,0.5,0");
    let factor = [1.0, 0.5, 0.0];
    let expected: Vec<f64> =
        white.iter().enumerate().map(|(i, v)| encoded(factor[i % 3] * decoded(*v))).collect();
    assert_close(&tinted, &expected, 1e-4);
}

#[test]
fn angles_name_the_same_directions_as_vectors() {
    let folder = baked();
    let here = folder.path();
    for (angles, vector) in [
        ("0,30", "0.8660254,0,0.5"),
        ("90,30", "0,0.8660254,0.5"),
        ("-150,45", "-0.6123724,-0.3535534,0.7071068"),
        ("210,45", "-0.6123724,-0.3535534,0.7071068"),
        ("12,90", "0,0,5"),
    ] {
        let (by_angles, by_vector) =
            (rendered(here, &format!("--angles {angles}")), rendered(here, &format!("--light {vector}")));
        assert_close(&by_angles, &by_vector, CLOSE + 1.6e-5);
    }
    // Right is right and up is up.
    let (right, up) = (rendered(here, "--angles 0,30"), rendered(here, "--angles 90,30"));
    let truth = |light: [f64; 3]| -> Vec<f64> {
        (0..24 * 16).flat_map(|i| scene::radiance(i % 24, i / 24, light).map(encoded)).collect()
    };
    for (light, own, other) in [([0.866, 0.0, 0.5], &right, &up), ([0.0, 0.866, 0.5], &up, &right)] {
        let (own, other) = (psnr(own, &truth(light)), psnr(other, &truth(light)));
        assert!(own > 22.0 && other < 18.0, "{light:?}: {own} dB, of the other light {other} dB");
    }
}

#[test]
fn the_photographs_come_back_from_lights_on_a_linear_asset_too() {
    let folder = made(20);
    let here = folder.path();
    relight(here, "bake capture -o a.ktx2 --basis hsh -k 16 --space linear --precision f32").ok();
    for i in [0, 7, 12] {
        let [x, y, z] = scene::light(i, 20);
        let relit = rendered(here, &format!("--light {x},{y},{z}"));
        let (photograph, _) = read_png(&here.join("capture").join(scene::name(i)));
        let psnr = psnr(&relit, &photograph.samples);
        assert!(psnr > 25.0, "light {i}: {psnr} dB");
    }
}

#[test]
fn depths_are_those_asked_for_and_hold_the_same_picture() {
    let folder = baked();
    let here = folder.path();
    let light = "--light 0.5,0.4,0.7";
    let fine = rendered(here, light);
    relight(here, &format!("render a.ktx2 -o b.png {light}")).ok();
    let (Pixels { samples, width, height }, bits) = read_png(&here.join("b.png"));
    assert_eq!((width, height, bits), (24, 16, 8));
    assert_close(&samples, &fine, 0.51 / 255.0);
    assert_eq!(read_png(&here.join("a.png")).1, 16);
    for (depth, is_half, tolerance) in [("", true, 1e-3), ("--depth float", false, 5e-5)] {
        relight(here, &format!("render a.ktx2 -o a.exr {light} {depth}")).ok();
        let (Pixels { samples, width, height }, half) = read_exr(&here.join("a.exr"));
        assert_eq!((width, height, half), (24, 16, is_half), "{depth}");
        // OpenEXR holds linear light.
        let linear: Vec<f64> = fine.iter().map(|value| decoded(*value)).collect();
        assert_close(&samples.iter().map(|v| v.min(1.0)).collect::<Vec<_>>(), &linear, tolerance);
    }
}

#[test]
fn a_light_file_gives_a_picture_for_each_line() {
    let folder = baked();
    let here = folder.path();
    let lines =
        ["3", r"C:\RTI data\first shot.jpg 0.3 0.2 0.9", "second.PNG -2 0.5 1", "sub/first shot.tif 0 0 1"];
    fs::write(here.join("path.lp"), lines.join("\r\n")).unwrap();
    relight(here, "render a.ktx2 --lights path.lp -o made/new --depth 16").ok();
    assert_eq!(names_in(&here.join("made/new")), ["first shot.png", "first shot_line4.png", "second.png"]);
    for (name, light) in
        [("first shot.png", "0.3,0.2,0.9"), ("second.png", "-2,0.5,1"), ("first shot_line4.png", "0,0,1")]
    {
        let picture = read_png(&here.join("made/new").join(name)).0.samples;
        assert_close(&picture, &rendered(here, &format!("--light {light}")), 0.0);
    }
    relight(here, "render a.ktx2 --lights path.lp -o floats --depth float").ok();
    assert_eq!(names_in(&here.join("floats")), ["first shot.exr", "first shot_line4.exr", "second.exr"]);
}
