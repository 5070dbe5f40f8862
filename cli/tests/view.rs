//! `relight view`: panoramas, lightmaps and tangent-space textures, from files to files.
//!
//! Goldens are in testdata/surfaces; RELIGHT_UPDATE_GOLDEN=1 writes them anew: look at what changed before it is committed.

#![allow(clippy::unwrap_used, reason = "a test's helpers fail as the test does")]

mod scene;

use scene::pictures::{decoded, encoded, read_exr, read_png};
use scene::{light, light_lines, made, name, relight, write_lines};
use std::f64::consts::PI;
use std::fs;
use std::path::{Path, PathBuf};

fn testdata(name: &str) -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("../testdata/surfaces").join(name)
}

/// Bakes a capture of 20 lights whose picture under a light is `radiance` in linear light.
fn bake(
    here: &Path,
    (width, height): (u32, u32),
    options: &str,
    radiance: impl Fn(u32, u32, [f64; 3]) -> [f64; 3],
) {
    let capture = here.join("own");
    fs::create_dir(&capture).unwrap();
    for i in 0..20 {
        let color = |x: u32, y: u32| {
            image::Rgb(radiance(x, y, light(i, 20)).map(|value| (encoded(value) * 255.0).round() as u8))
        };
        image::RgbImage::from_fn(width, height, color).save(capture.join(name(i))).unwrap();
    }
    write_lines(&capture.join("lights.lp"), &light_lines(20));
    relight(here, &format!("bake own -o a.ktx2 {options}")).ok();
}

fn lambert(normal: [f64; 3], light: [f64; 3]) -> f64 {
    0.05 + 0.9 * (0..3).map(|i| normal[i] * light[i]).sum::<f64>().max(0.0)
}

/// A round room in stripes of latitude and longitude: each direction a colour of its own.
fn room(x: u32, y: u32, light: [f64; 3]) -> [f64; 3] {
    let azimuth = (f64::from(x) + 0.5) / 96.0 * 2.0 * PI - PI;
    let elevation = PI / 2.0 - (f64::from(y) + 0.5) / 48.0 * PI;
    let flat = libm::cos(elevation);
    let direction = [flat * libm::sin(azimuth), flat * libm::cos(azimuth), libm::sin(elevation)];
    let stripe = libm::sin(6.0 * azimuth) * flat + 0.5 * libm::sin(9.0 * elevation);
    let shade = lambert(direction.map(|c| -c), light);
    [0.5 + 0.3 * stripe, 0.55 + 0.35 * direction[0], 0.5 - 0.4 * direction[2]].map(|albedo| albedo * shade)
}

/// Bumps with a slope to the right on their left side, tinted from left to right.
fn bumps(x: u32, y: u32, light: [f64; 3]) -> [f64; 3] {
    let (u, v) = ((f64::from(x) + 0.5) / 48.0, (f64::from(y) + 0.5) / 48.0);
    let slope = [0.8 * libm::sin(3.0 * 2.0 * PI * u), 0.8 * libm::cos(2.0 * 2.0 * PI * v)];
    let length = (1.0 + slope[0] * slope[0] + slope[1] * slope[1]).sqrt();
    let shade = lambert([slope[0] / length, slope[1] / length, 1.0 / length], light);
    [0.9 - 0.6 * u, 0.4 + 0.5 * v, 0.3 + 0.5 * u].map(|albedo| albedo * shade)
}

/// Holds an 8-bit picture to the golden of that name, within a step.
#[track_caller]
fn assert_golden(path: &Path, golden: &str) {
    let golden = testdata("golden").join(golden);
    if std::env::var("RELIGHT_UPDATE_GOLDEN").is_ok_and(|value| value == "1") {
        fs::create_dir_all(testdata("golden")).unwrap();
        fs::copy(path, &golden).unwrap();
    }
    let (found, expected) = (read_png(path).0, read_png(&golden).0);
    assert_eq!((found.width, found.height), (expected.width, expected.height));
    for (i, (a, b)) in found.samples.iter().zip(&expected.samples).enumerate() {
        assert!((a - b).abs() < 1.5 / 255.0, "{}: sample {i} is {a}, was {b}", golden.display());
    }
}

#[test]
fn panoramas_are_seen_in_perspective() {
    let folder = tempfile::tempdir().unwrap();
    let here = folder.path();
    bake(here, (96, 48), "--basis sh -k 9", room);
    let view = "view a.ktx2 --angles 30,40 --size 96x64";
    for (golden, options) in [
        ("ahead.png", "--view 10,5,90"),
        ("seam.png", "--view 180,0,80 --filter bicubic"),
        ("pole.png", "--view 0,90,120 --filter bilinear"),
        ("band.png", "--view -120,-20,100 --latitude 30 --background 0.1,0.2,0.4"),
    ] {
        relight(here, &format!("{view} -o v.png {options}")).ok();
        assert_golden(&here.join("v.png"), golden);
    }
    // One pixel that looks along a direction is what the capture has there.
    relight(here, "render a.ktx2 -o whole.png --angles 30,40 --depth 16").ok();
    relight(here, "view a.ktx2 -o one.exr --angles 30,40 --size 1x1 --view -88.125,43.125,0.5").ok();
    let whole = read_png(&here.join("whole.png")).0;
    let one = read_exr(&here.join("one.exr")).0;
    for (c, value) in one.samples.iter().enumerate() {
        let expected = decoded(whole.samples[3 * (12 * 96 + 24) + c]);
        assert!((value - expected).abs() < 1e-3, "{value} {expected}");
    }
}

#[test]
fn lightmaps_are_drawn_with_albedo_on_gltf_and_obj() {
    let folder = tempfile::tempdir().unwrap();
    let here = folder.path();
    bake(here, (48, 48), "--basis ptm --space linear --precision f32", bumps);
    let mesh = testdata("table.gltf");
    let view = format!(
        "view a.ktx2 --angles 200,35 --size 96x64 --eye 1.2,-2.6,2.2 --target 0,0,0 --up 0,0,1 --fov 50 --mesh {}",
        mesh.display()
    );
    relight(here, &format!("{view} -o v.png --albedo {}", testdata("checker.png").display())).ok();
    assert_golden(&here.join("v.png"), "table.png");
    // The same table as OBJ, which has one set of coordinates, from straight above.
    let above = "--size 48x48 --eye 0,0,3 --target 0,0,0 --width 2 --samples 1 --dilate 0";
    relight(here, "render a.ktx2 --angles 200,35 -o relit.png --depth 16").ok();
    let line =
        format!("view a.ktx2 --angles 200,35 -o o.exr {above} --mesh {}", testdata("table.obj").display());
    relight(here, &line).ok();
    let (found, expected) = (read_exr(&here.join("o.exr")).0, read_png(&here.join("relit.png")).0);
    for (i, (a, b)) in found.samples.iter().zip(&expected.samples).enumerate() {
        assert!((a.clamp(0.0, 1.0) - decoded(*b)).abs() < 2e-3, "sample {i}: {a} {}", decoded(*b));
    }
}

#[test]
fn textures_are_relit_in_tangent_space_on_a_fold_with_a_mirrored_half() {
    let folder = tempfile::tempdir().unwrap();
    let here = folder.path();
    bake(here, (48, 48), "--basis ptm", bumps);
    let mesh = testdata("fold.obj");
    let view = format!(
        "view a.ktx2 --space tangent --wrap clamp --size 96x64 --eye 0,0.6,3 --target 0,0,0 --fov 45 --mesh {}",
        mesh.display()
    );
    for (golden, options) in [
        ("fold_right.png", "--angles 0,35"),
        ("fold_left.png", "--angles 180,35 --light 0,1,0,0.1,0.1,0.3"),
        ("fold_point.png", "--point 0.4,0.3,0.6,0.5,0.4,0.3 --background 0,0,0.2"),
    ] {
        relight(here, &format!("{view} -o v.png {options}")).ok();
        assert_golden(&here.join("v.png"), golden);
    }
    // The fold is its own mirror image, so under mirrored lights its pictures are mirror images: the right half's
    // bumps would be lit from the wrong side without its handedness.
    relight(here, &format!("{view} -o l.exr --angles 160,35")).ok();
    relight(here, &format!("{view} -o r.exr --angles 20,35")).ok();
    let (left, right) = (read_exr(&here.join("l.exr")).0, read_exr(&here.join("r.exr")).0);
    for y in 0..64 {
        for x in 0..96 {
            for c in 0..3 {
                let (a, b) = (left.samples[3 * (96 * y + x) + c], right.samples[3 * (96 * y + 95 - x) + c]);
                assert!((a - b).abs() < 2e-3, "{x} {y} {c}: {a} {b}");
            }
        }
    }
}

#[test]
fn pictures_do_not_depend_on_threads_or_cpu() {
    let folder = made(20);
    let here = folder.path();
    relight(here, "bake capture -o a.ktx2 --basis hsh -k 9").ok();
    let mesh = testdata("fold.obj");
    let drawn = format!("--mesh {} --eye 0.3,0.6,3 --target 0,0,0", mesh.display());
    for options in ["--view 170,40,100 --filter bicubic", &drawn, &format!("{drawn} --space tangent")] {
        let bytes = |machine: &str| {
            relight(here, &format!("view a.ktx2 -o v.exr --size 70x40 --light 1,1,1 {options} {machine}"))
                .ok();
            fs::read(here.join("v.exr")).unwrap()
        };
        assert_eq!(bytes("-j 1 --cpu baseline"), bytes("-j 3"), "{options}");
    }
}

#[test]
fn what_can_not_be_seen_is_refused_before_the_work() {
    let folder = made(20);
    let here = folder.path();
    relight(here, "bake capture -o a.ktx2").ok();
    let panorama = "view a.ktx2 -o v.png --light 0,0,1";
    let table = testdata("table.obj");
    let mesh = format!("{panorama} --mesh {} --eye 0,0,3", table.display());
    for (line, code, words) in [
        (format!("{panorama} --view 0,0,180"), 2, &["field of view is 180", "below 180 degrees"][..]),
        (format!("{panorama} --view 0,95,60"), 2, &["the pitch is 95", "-90 to 90"]),
        (format!("{panorama} --view 0,0"), 2, &["three numbers"]),
        (format!("{panorama} --view 0,0,60 --latitude 0"), 2, &["latitude is 0"]),
        (format!("{panorama} --view 0,0,60 --size 0x5"), 2, &["'0x5'", "800x600"]),
        (format!("{panorama} --view 0,0,60 --size 16384x16384 --memory 64M"), 5, &["--size"]),
        (panorama.to_owned(), 2, &["--view"]),
        (
            format!("{panorama} --view 0,0,60 --mesh a.obj --eye 0,0,1 --target 0,0,0"),
            2,
            &["cannot be used with"],
        ),
        ("view a.ktx2 -o v.png --view 0,0,60".to_owned(), 2, &["no light", "--angles"]),
        ("view a.ktx2 -o v.jpg --light 0,0,1 --view 0,0,60".to_owned(), 2, &[".png or .exr"]),
        ("view a.ktx2 -o a.ktx2 --light 0,0,1 --view 0,0,60".to_owned(), 2, &[".png or .exr"]),
        (mesh.clone(), 2, &["--target"]),
        (format!("{mesh} --target 0,0,3"), 2, &["eye and target must differ"]),
        (format!("{mesh} --target 0,0,0 --up 0,0,1"), 2, &["up must not point along the view"]),
        (format!("{mesh} --target 0,0,0 --point 1,1,1"), 2, &["--space tangent"]),
        (format!("{mesh} --target 0,0,0 --space tangent --albedo a.png"), 2, &["--albedo is for lightmaps"]),
        (format!("{mesh} --target 0,0,0 --albedo absent.png"), 4, &["absent.png"]),
        (format!("{panorama} --mesh absent.glb --eye 0,0,1 --target 0,0,0"), 4, &["absent.glb"]),
        (
            format!("{panorama} --mesh a.ktx2 --eye 0,0,1 --target 0,0,0"),
            3,
            &["a.ktx2", ".glb, .gltf or .obj"],
        ),
    ] {
        relight(here, &line).assert_refused(code, words);
    }
    assert!(!here.join("v.png").exists());
}
