//! Normals, albedo and height as files.

#![allow(clippy::unwrap_used, reason = "a test's helpers fail as the test does")]

mod scene;

use scene::pictures::{read_exr, read_png};
use scene::{HEIGHT, WIDTH, light_lines, made, number, relight, write_lines};
use std::fs;
use std::path::Path;

/// The normals of the made surface, see `scene::radiance`.
fn truth() -> image::Rgb32FImage {
    image::ImageBuffer::from_fn(WIDTH as u32, HEIGHT as u32, |x, y| {
        let (fx, fy) = (f64::from(x), f64::from(y));
        let slope = [0.5 * libm::sin(0.4 * fx + 0.2 * fy), 0.45 * libm::cos(0.33 * fy - 0.1 * fx)];
        let length = (slope[0] * slope[0] + slope[1] * slope[1] + 1.0).sqrt();
        image::Rgb([slope[0], slope[1], 1.0].map(|c| (c / length) as f32))
    })
}

#[test]
fn normals_albedo_and_height_are_written() {
    let folder = made(30);
    let at = |name: &str| folder.path().join(name);
    let truth = truth();
    let codes = image::ImageBuffer::<image::Rgb<u16>, _>::from_fn(WIDTH as u32, HEIGHT as u32, |x, y| {
        image::Rgb(truth.get_pixel(x, y).0.map(|c| (32767.5 * (c + 1.0) + 0.5) as u16))
    });
    codes.save(at("truth.png")).unwrap();
    let line = "normals capture -o n.png --albedo a.png --height h.png --truth truth.png";
    let run = relight(folder.path(), line).ok();
    assert!(
        run.stdout.contains("n.png: 24 x 16, robust, 384 normals, 0 pixels without one"),
        "{}",
        run.stdout
    );
    let figures = relight(folder.path(), &format!("{line} --json")).ok().json();
    // The made surface is a little bright in the shade, which is not what normals are made for.
    let mean = number(&figures, "truth.mean_deg");
    assert!(mean < 2.0 && number(&figures, "truth.median_deg") <= 2.0 * mean, "{figures}");
    let (pixels, bits) = read_png(&at("n.png"));
    assert_eq!((pixels.width, pixels.height, bits), (WIDTH, HEIGHT, 16));
    for (pixel, expected) in pixels.samples.chunks_exact(3).zip(truth.pixels()) {
        for c in 0..3 {
            assert!((2.0 * pixel[c] - 1.0 - f64::from(expected[c])).abs() < 0.1, "{pixel:?} {expected:?}");
        }
    }
    // The albedo of `scene::radiance`, linear in .exr and encoded in .png.
    relight(folder.path(), "normals capture -o n.exr --albedo a.exr --height h.exr").ok();
    let (linear, _) = read_exr(&at("a.exr"));
    let (stored, _) = read_png(&at("a.png"));
    for at in 0..WIDTH * HEIGHT {
        let (x, y) = (at % WIDTH, at / WIDTH);
        let expected = [
            0.3 + 0.6 * x as f64 / 24.0,
            0.9 - 0.5 * y as f64 / 16.0,
            0.25 + 0.5 * ((x + 2 * y) % 7) as f64 / 7.0,
        ];
        for (c, expected) in expected.into_iter().enumerate() {
            let (linear, stored) = (linear.samples[3 * at + c], stored.samples[3 * at + c]);
            assert!((linear - expected).abs() < 0.04, "{x} {y}: {linear} for {expected}");
            assert!((scene::pictures::decoded(stored) - linear.min(1.0)).abs() < 1e-3, "{x} {y}");
        }
    }
    // y down, the rest as it was.
    relight(folder.path(), "normals capture -o f.exr --flip-y").ok();
    let ((up, half), (down, _)) = (read_exr(&at("n.exr")), read_exr(&at("f.exr")));
    assert!(!half);
    for (up, down) in up.samples.chunks_exact(3).zip(down.samples.chunks_exact(3)) {
        assert_eq!([up[0], -up[1], up[2]], [down[0], down[1], down[2]]);
    }
    // The same bytes with any threads and any memory.
    relight(folder.path(), "normals capture -o t.exr -j 1 --cpu baseline").ok();
    scene::relight_in_least_memory(folder.path(), "normals capture -o m.exr").ok();
    let bytes = |name: &str| fs::read(at(name)).unwrap();
    assert!(bytes("t.exr") == bytes("n.exr") && bytes("m.exr") == bytes("n.exr"));
}

#[test]
fn what_tells_no_normals_is_refused() {
    let folder = made(12);
    let lines = light_lines(12);
    let lights = folder.path().join("capture/lights.lp");
    write_lines(&lights, &lines[..2]);
    relight(folder.path(), "normals capture -o n.png").assert_refused(3, &["at least 3 lights", "has 2"]);
    let plane: Vec<String> =
        (0..12).map(|i| format!("p{i:02}.png {} 0 0.8", 0.1 * f64::from(i) - 0.5)).collect();
    write_lines(&lights, &plane);
    relight(folder.path(), "normals capture -o n.png").assert_refused(3, &["12 lights", "one plane"]);
    write_lines(&lights, &lines);
    for (line, code, words) in [
        ("normals capture -o n.jpg", 2, ".png or .exr"),
        ("normals capture -o n.png --albedo n.png", 2, "another file"),
        ("normals capture -o capture/p03.png", 2, "another file"),
        ("normals capture -o n.png --height h.png --memory 1M", 5, "--memory"),
        ("normals capture -o n.png --truth none.png", 4, "none.png"),
    ] {
        relight(folder.path(), line).assert_refused(code, &[words]);
    }
    image::RgbImage::new(23, 16).save(folder.path().join("small.png")).unwrap();
    relight(folder.path(), "normals capture -o n.png --truth small.png")
        .assert_refused(3, &["23 x 16", "24 x 16"]);
    assert!(!folder.path().join("n.png").exists());
}

#[test]
fn the_robust_method_finds_the_relief() {
    let data = Path::new(env!("CARGO_MANIFEST_DIR")).join("../../shared/data");
    let Ok(data) = data.canonicalize() else {
        println!("skipped: no {}", data.display());
        return;
    };
    let folder = tempfile::tempdir().unwrap();
    let data = data.display();
    let mean = |set: &str, truth: &str, method: &str| {
        let line = format!("normals {data}/{set} -o n.png --truth {data}/{truth} --method {method} --json");
        number(&relight(folder.path(), &line).ok().json(), "truth.mean_deg")
    };
    let relief = |method: &str| mean("relief256", "relief256_truth/normals.png", method);
    let synthetic = |method: &str| mean("synthrti/dome", "synthrti/test/normals.png", method);
    let (robust, plain) = (relief("robust"), relief("least-squares"));
    println!("relief256: robust {robust:.2} deg, least squares {plain:.2} deg");
    println!(
        "synthrti: robust {:.2} deg, least squares {:.2} deg",
        synthetic("robust"),
        synthetic("least-squares")
    );
    assert!(robust < 1.3 && plain > 4.0, "{robust} {plain}");
}
