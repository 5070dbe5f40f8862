//! What bake, normals and evaluate make of photographs when they read them: parts, intensities, exposure, white balance.

#![allow(clippy::unwrap_used, reason = "a test's helpers fail as the test does")]

mod scene;

use exr::prelude::write_rgb_file;
use scene::pictures::{encoded, psnr, read_exr, read_png};
use scene::{HEIGHT, WIDTH, json_of, light, light_lines, made, name, number, radiance, relight, write_lines};
use std::fs;
use std::path::Path;

/// The intensity of the lamp of made picture `i`: exact in floats, each channel's its own.
fn intensity(i: usize) -> [f64; 3] {
    [0, 1, 2].map(|c| [0.5, 1.0, 2.0, 4.0][(i * (c + 1) + c) % 4])
}

/// Writes a capture of linear float pictures whose light is multiplied by `factors(picture)`.
fn write_floats(folder: &Path, count: usize, factors: fn(usize) -> [f64; 3]) {
    fs::create_dir(folder).unwrap();
    for i in 0..count {
        let path = folder.join(name(i)).with_extension("exr");
        write_rgb_file(path, WIDTH, HEIGHT, |x, y| {
            let color = radiance(x, y, light(i, count)).map(|value| value as f32);
            let [r, g, b] = [0, 1, 2].map(|c| color[c] * factors(i)[c] as f32);
            (r, g, b)
        })
        .unwrap();
    }
    let lines: Vec<String> = light_lines(count).iter().map(|line| line.replace(".png", ".exr")).collect();
    write_lines(&folder.join("lights.lp"), &lines);
}

/// Writes 8-bit pictures of the light that `color(x, y, picture)` gives.
fn write_bytes(folder: &Path, count: usize, color: impl Fn(usize, usize, usize) -> [f64; 3]) {
    fs::create_dir(folder).unwrap();
    for i in 0..count {
        let pixel = |x: u32, y: u32| {
            let linear = color(x as usize, y as usize, i);
            image::Rgb(linear.map(|value| (encoded(value).min(1.0) * 255.0).round() as u8))
        };
        let picture = image::RgbImage::from_fn(WIDTH as u32, HEIGHT as u32, pixel);
        picture.save(folder.join(name(i))).unwrap();
    }
    write_lines(&folder.join("lights.lp"), &light_lines(count));
}

#[test]
fn a_crop_is_as_if_the_pictures_had_been_cut() {
    let folder = made(20);
    let here = folder.path();
    fs::create_dir(here.join("cut")).unwrap();
    for i in 0..20 {
        let whole = image::open(here.join("capture").join(name(i))).unwrap();
        whole.crop_imm(5, 3, 13, 8).save(here.join("cut").join(name(i))).unwrap();
    }
    write_lines(&here.join("cut/lights.lp"), &light_lines(20));
    let maps = |name: &str| scene::maps_of(&here.join(name));
    relight(here, "bake cut -o a.ktx2 --basis hsh -k 4 --holdout every:6 --report a.json").ok();
    relight(
        here,
        "bake capture -o b.ktx2 --basis hsh -k 4 --holdout every:6 --report b.json --crop 13x8+5+3",
    )
    .ok();
    assert!(maps("a.ktx2") == maps("b.ktx2"));
    assert_eq!(json_of(&here.join("a.json"))["holdout"], json_of(&here.join("b.json"))["holdout"]);
    scene::relight_in_least_memory(
        here,
        "bake capture -o m.ktx2 --basis hsh -k 4 --holdout every:6 --crop 13x8+5+3",
    )
    .ok();
    // Of the same pictures, to the byte.
    let bytes = |name: &str| fs::read(here.join(name)).unwrap();
    assert!(bytes("b.ktx2") == bytes("m.ktx2"));
    let cut = relight(here, "evaluate a.ktx2 cut --json").ok().stdout;
    assert_eq!(relight(here, "evaluate a.ktx2 capture --json --crop 13x8+5+3").ok().stdout, cut);
    relight(here, "normals cut -o a.png --albedo aa.png").ok();
    relight(here, "normals capture -o b.png --albedo ba.png --crop 13x8+5+3").ok();
    assert!(bytes("a.png") == bytes("b.png") && bytes("aa.png") == bytes("ba.png"));
    // The key of a job file.
    fs::write(here.join("j.toml"), "input = 'capture'\noutput = 'j.ktx2'\nbasis = 'hsh'\nk = 4\ncrop = '13x8+5+3'\nholdout = 'every:6'\n")
        .unwrap();
    relight(here, "bake j.toml").ok();
    assert!(bytes("b.ktx2") == bytes("j.ktx2"));

    relight(here, "bake capture -o c.ktx2 --crop 13x8+12+3")
        .assert_refused(2, &["--crop 13x8+12+3", "24 x 16 pixels", "within"]);
    relight(here, "bake capture -o c.ktx2 --crop 13x8").assert_refused(2, &["WxH+X+Y", "'13x8'"]);
    relight(here, "evaluate a.ktx2 capture").assert_refused(3, &["13 x 8", "24 x 16"]);
}

#[test]
fn positions_and_true_normals_are_cropped_alike() {
    let folder = made(20);
    let here = folder.path();
    let point = |x: usize, y: usize| [x as f32, 0.5 * y as f32 + 3.0, (x * y) as f32 / 16.0];
    let write = |path: &Path, size: (usize, usize), first: (usize, usize)| {
        let channels = exr::prelude::SpecificChannels::build()
            .with_channel::<f32>("X")
            .with_channel::<f32>("Y")
            .with_channel::<f32>("Z")
            .with_pixel_fn(|at: exr::prelude::Vec2<usize>| {
                <(f32, f32, f32)>::from(point(at.0 + first.0, at.1 + first.1))
            });
        use exr::prelude::WritableImage;
        exr::prelude::Image::from_channels(size, channels).write().to_file(path).unwrap();
    };
    write(&here.join("P.exr"), (WIDTH, HEIGHT), (0, 0));
    write(&here.join("cut.exr"), (13, 8), (5, 3));
    fs::create_dir(here.join("cut")).unwrap();
    for i in 0..20 {
        let whole = image::open(here.join("capture").join(name(i))).unwrap();
        whole.crop_imm(5, 3, 13, 8).save(here.join("cut").join(name(i))).unwrap();
    }
    write_lines(&here.join("cut/lights.lp"), &light_lines(20));
    relight(here, "bake cut -o a.exr --positions cut.exr").ok();
    relight(here, "bake capture -o b.exr --positions P.exr --crop 13x8+5+3").ok();
    assert!(scene::maps_of(&here.join("a.exr")) == scene::maps_of(&here.join("b.exr")));
    relight(here, "normals capture -o whole.png").ok();
    let figures =
        relight(here, "normals capture -o n.png --crop 13x8+5+3 --truth whole.png --json").ok().json();
    assert!(
        number(&figures, "truth.mean_deg") < 0.01 && number(&figures, "truth.pixels") == 104.0,
        "{figures}"
    );
}

#[test]
fn intensities_undo_lamps_of_any_strength_and_colour_whatever_the_order_of_their_lines() {
    let folder = tempfile::tempdir().unwrap();
    let here = folder.path();
    write_floats(&here.join("even"), 20, |_| [1.0; 3]);
    write_floats(&here.join("uneven"), 20, intensity);
    // Names with other extensions and in the wrong order, and one line too many.
    let line = |i: usize| {
        let [r, g, b] = intensity(i);
        format!("{} {r} {g} {b}\n", name(i).to_uppercase())
    };
    let text: String = (0..20).rev().map(line).collect();
    fs::write(here.join("i.txt"), format!("21\n{text}elsewhere.png 3\n")).unwrap();
    let maps = |name: &str| scene::maps_of(&here.join(name));
    let fit = "--basis hsh -k 9 --holdout every:6";
    relight(here, &format!("bake even -o a.ktx2 {fit} --report a.json")).ok();
    relight(here, &format!("bake uneven -o b.ktx2 {fit} --report b.json --intensities i.txt")).ok();
    relight(here, &format!("bake uneven -o c.ktx2 {fit}")).ok();
    assert!(maps("a.ktx2") == maps("b.ktx2") && maps("a.ktx2") != maps("c.ktx2"));
    assert_eq!(json_of(&here.join("a.json"))["holdout"], json_of(&here.join("b.json"))["holdout"]);
    let judged = |rest: &str| relight(here, &format!("evaluate a.ktx2 {rest} --json")).ok().stdout;
    assert_eq!(judged("uneven --intensities i.txt"), judged("even"));
    relight(here, "normals even -o a.exr").ok();
    relight(here, "normals uneven -o b.exr --intensities i.txt").ok();
    let bytes = |name: &str| fs::read(here.join(name)).unwrap();
    assert!(bytes("a.exr") == bytes("b.exr"));
    // A hold-out of another light file takes its lines of the same file.
    let lines = light_lines(20)
        .iter()
        .skip(3)
        .step_by(6)
        .map(|line| line.replace(".png", ".exr"))
        .collect::<Vec<_>>();
    for of in ["even", "uneven"] {
        fs::create_dir(here.join(format!("{of}_out"))).unwrap();
        for i in (3..20).step_by(6) {
            let file = name(i).replace(".png", ".exr");
            fs::copy(here.join(of).join(&file), here.join(format!("{of}_out")).join(&file)).unwrap();
        }
        write_lines(&here.join(format!("{of}_out/out.lp")), &lines);
    }
    relight(here, "bake even -o d.ktx2 --holdout even_out/out.lp --report d.json").ok();
    relight(here, "bake uneven -o e.ktx2 --holdout uneven_out/out.lp --report e.json --intensities i.txt")
        .ok();
    assert_eq!(json_of(&here.join("d.json"))["holdout"], json_of(&here.join("e.json"))["holdout"]);
    // Numbers alone are in the order of the light file.
    let alone: String =
        (0..20).map(|i| format!("{}\n", intensity(i).map(|v| v.to_string()).join(" "))).collect();
    fs::write(here.join("alone.txt"), format!("20\n{alone}")).unwrap();
    relight(here, &format!("bake uneven -o f.ktx2 {fit} --intensities alone.txt")).ok();
    assert!(bytes("b.ktx2") == bytes("f.ktx2"));
}

#[test]
fn intensities_of_bytes_are_divided_in_linear_light() {
    let folder = made(20);
    let here = folder.path();
    let factor = |i: usize| [0.3, 0.9, 0.55][i % 3];
    write_bytes(&here.join("uneven"), 20, |x, y, i| radiance(x, y, light(i, 20)).map(|v| v * factor(i)));
    let text: String = (0..20).map(|i| format!("{} {}\n", name(i), factor(i))).collect();
    fs::write(here.join("i.txt"), text).unwrap();
    for space in ["encoded", "linear"] {
        let render = |capture: &str, rest: &str| {
            let line =
                format!("bake {capture} -o a.ktx2 --basis sh -k 9 --precision f32 --space {space} {rest}");
            relight(here, &line).ok();
            relight(here, "render a.ktx2 -o a.png --angles 200,40").ok();
            read_png(&here.join("a.png")).0.samples
        };
        let even = render("capture", "");
        let mended = psnr(&even, &render("uneven", "--intensities i.txt"));
        let uneven = psnr(&even, &render("uneven", ""));
        assert!(mended > 45.0 && uneven < 25.0, "{space}: {mended} dB, {uneven} dB without");
    }
}

#[test]
fn intensity_files_that_do_not_fit_are_refused_with_line_and_value() {
    let folder = made(6);
    let here = folder.path();
    let refused = |text: &str, words: &[&str]| {
        fs::write(here.join("i.txt"), text).unwrap();
        relight(here, "bake capture -o a.ktx2 --intensities i.txt").assert_refused(3, words);
    };
    let five = "p00.png 1\np01.png 1\np02.png 1\np03.png 1\np04.png 1\n";
    refused(five, &["i.txt", "1 of 6 pictures", "'p05.png'"]);
    refused(&format!("{five}p05.png 1\n\np02 1"), &["lines 3 and 8", "'p02.png'"]);
    refused(&format!("{five}p05.png 2e5"), &["line 6", "200000", "1e-4..1e4"]);
    refused(&format!("{five}p05.png one"), &["line 6", "'p05.png one'", "name factor"]);
    refused("1\n1\n1\n1\n1\n", &["5 numbers for 6 pictures"]);
    refused("0\n1\n1\n1\n1\n1\n", &["line 1", "intensity 0"]);
    relight(here, "bake capture -o a.ktx2 --intensities none.txt").assert_refused(4, &["none.txt"]);
    relight(here, "bake capture -o a.ktx2 --intensities i.txt --exposure auto")
        .assert_refused(2, &["--exposure"]);
    fs::write(here.join("i.ktx2"), "1\n".repeat(6)).unwrap();
    relight(here, "bake capture -o i.ktx2 --intensities i.ktx2")
        .assert_refused(2, &["i.ktx2", "another file"]);
}

#[test]
fn exposure_is_found_out_and_what_is_off_is_listed() {
    let folder = tempfile::tempdir().unwrap();
    let here = folder.path();
    // Without the made surface's light from everywhere, which makes pictures of low lamps look brighter.
    let matte = |x, y, i| {
        let (lit, unlit) = (radiance(x, y, light(i, 30)), radiance(x, y, [0.0, 0.0, -1.0]));
        [0, 1, 2].map(|c| lit[c] - unlit[c])
    };
    write_bytes(&here.join("capture"), 30, matte);
    let factor = |i: usize| match i {
        4 => 0.6,
        11 => 1.25,
        23 => 0.8,
        _ => 1.0,
    };
    write_bytes(&here.join("uneven"), 30, |x, y, i| matte(x, y, i).map(|v| v * factor(i)));
    let note = |capture: &str| {
        let stderr =
            relight(here, &format!("bake {capture} -o a.ktx2 --basis sh -k 9 --exposure auto")).ok().stderr;
        stderr.lines().filter(|line| line.contains("note: exposure")).collect::<String>()
    };
    let factors = |capture: &str| -> Vec<(String, f64)> {
        let note = note(capture);
        let list = note.split("factors: ").nth(1).unwrap_or_default();
        let pair =
            |entry: &str| entry.rsplit_once(' ').map(|(name, f)| (name.to_owned(), f.parse().unwrap()));
        list.split(", ").filter_map(pair).collect()
    };
    let found = factors("uneven");
    for i in [4, 11, 23] {
        let listed =
            found.iter().find(|(listed, _)| *listed == name(i)).unwrap_or_else(|| panic!("{i} in {found:?}"));
        let mean = (27.0 + 0.6 + 1.25 + 0.8) / 30.0;
        assert!((listed.1 / (factor(i) / mean) - 1.0).abs() < 0.02, "{found:?}");
    }
    assert_eq!(
        factors("capture").iter().filter(|(_, f)| (f - 1.0).abs() > 0.1).count(),
        0,
        "{:?}",
        note("capture")
    );
    // The asset is as of even lamps.
    let render = |line: &str| {
        relight(here, &format!("bake {line} -o a.ktx2 --basis sh -k 9 --precision f32")).ok();
        relight(here, "render a.ktx2 -o a.png --angles 200,40").ok();
        read_png(&here.join("a.png")).0.samples
    };
    let (even, mended, uneven) = (render("capture"), render("uneven --exposure auto"), render("uneven"));
    assert!(
        psnr(&even, &mended) > psnr(&even, &uneven) + 6.0,
        "{} {}",
        psnr(&even, &mended),
        psnr(&even, &uneven)
    );
    // Pictures to judge by are divided, too.
    let judged = |rest: &str| {
        number(&relight(here, &format!("evaluate a.ktx2 {rest} --json")).ok().json(), "mean.psnr")
    };
    relight(here, "bake uneven -o a.ktx2 --basis sh -k 9 --exposure auto").ok();
    assert!(judged("uneven --exposure auto") > judged("uneven") + 1.0);
    // The same bytes with any number of threads.
    let bytes = |line: &str| {
        relight(here, &format!("bake uneven -o t.ktx2 --basis sh -k 9 --exposure auto {line}")).ok();
        fs::read(here.join("t.ktx2")).unwrap()
    };
    assert!(bytes("-j 1 --cpu baseline") == fs::read(here.join("a.ktx2")).unwrap());
}

#[test]
fn factors_that_a_flat_surface_makes_are_refused_and_those_of_lamps_are_not() {
    let folder = tempfile::tempdir().unwrap();
    let here = folder.path();
    // A nearly flat, glossy surface.
    let flat = |x: usize, y: usize, i: usize| {
        let [lx, _, lz] = light(i, 40);
        let slant = 0.02 * ((x * 5 + y * 3) % 7) as f64 - 0.06;
        let halfway = (lx * slant + lz + 1.0) / (2.0 + 2.0 * lz).sqrt();
        let albedo = [0.3, 0.25, 0.2].map(|c| c + 0.02 * ((x + 3 * y) % 5) as f64);
        albedo.map(|albedo| albedo * (lx * slant + lz).max(0.0) + 0.4 * halfway.max(0.0).powi(40))
    };
    write_bytes(&here.join("even"), 40, flat);
    let factor = |i: usize| [0.7, 1.2, 0.95, 1.1, 0.85][i * i % 5];
    write_bytes(&here.join("flickering"), 40, |x, y, i| radiance(x, y, light(i, 40)).map(|v| v * factor(i)));
    let bake = |capture: &str, rest: &str| {
        let line = format!("bake {capture} -o a.ktx2 --basis hsh -k 9 --report r.json {rest}");
        relight(here, &line).ok();
        let notes = json_of(&here.join("r.json"))["notes"].to_string();
        (scene::maps_of(&here.join("a.ktx2")), notes)
    };
    let (refused, notes) = bake("even", "--exposure auto");
    assert!(notes.contains("are not taken") && notes.contains("--intensities"), "{notes}");
    assert!(refused == bake("even", "").0, "the asset is that of the stored pictures");
    let (accepted, notes) = bake("flickering", "--exposure auto");
    assert!(notes.contains("are taken") && notes.contains("factors: "), "{notes}");
    assert!(accepted != bake("flickering", "").0);
}

#[test]
fn white_balance_makes_a_card_grey_and_keeps_its_luminance() {
    let folder = tempfile::tempdir().unwrap();
    let here = folder.path();
    let tint = [1.3, 0.9, 0.6];
    // A card of reflectance 0.4 about pixel 19, 4 under a lamp of that colour.
    let is_card = |x: usize, y: usize| x.abs_diff(19) <= 3 && y.abs_diff(4) <= 3;
    write_bytes(&here.join("tinted"), 20, |x, y, i| {
        let color = if is_card(x, y) { [0.4 * light(i, 20)[2]; 3] } else { radiance(x, y, light(i, 20)) };
        [0, 1, 2].map(|c| 0.7 * color[c] * tint[c])
    });
    let luminance = 0.2126 * tint[0] + 0.7152 * tint[1] + 0.0722 * tint[2];
    for balance in ["1.3,0.9,0.6", "auto:19,4,3"] {
        relight(
            here,
            &format!(
                "bake tinted -o a.ktx2 --basis sh -k 4 --ridge 0 --precision f32 --space linear --white-balance {balance}"
            ),
        )
        .ok();
        let [x, y, z] = light(6, 20);
        relight(here, &format!("render a.ktx2 -o a.exr --depth float --light {x:.6},{y:.6},{z:.6}")).ok();
        let relit = read_exr(&here.join("a.exr")).0;
        let card = &relit.samples[3 * (4 * WIDTH + 19)..][..3];
        let expected = 0.7 * 0.4 * light(6, 20)[2] * luminance;
        for value in card {
            assert!((value / expected - 1.0).abs() < 0.01, "{balance}: {card:?} for {expected}");
        }
    }
    // The whole asset is that of a white lamp as bright, also where the card is cropped away.
    write_bytes(&here.join("white"), 20, |x, y, i| {
        radiance(x, y, light(i, 20)).map(|value| 0.7 * value * luminance)
    });
    let render = |line: &str| {
        relight(here, &format!("bake {line} -o a.ktx2 --basis hsh -k 9 --precision f32 --crop 10x12+2+1"))
            .ok();
        relight(here, "render a.ktx2 -o a.png --angles 30,50").ok();
        read_png(&here.join("a.png")).0.samples
    };
    let (white, balanced) = (render("white"), render("tinted --white-balance auto:19,4,3"));
    assert!(
        psnr(&white, &balanced) > 42.0 && psnr(&white, &render("tinted")) < 30.0,
        "{}",
        psnr(&white, &balanced)
    );

    let refused = |rest: &str, words: &[&str]| {
        relight(here, &format!("bake tinted -o b.ktx2 --white-balance {rest}")).assert_refused(2, words);
    };
    refused("auto:22,4,3", &["auto:22,4,3", "24 x 16 pixels"]);
    refused("auto:2,4,3", &["auto:2,4,3", "24 x 16 pixels"]);
    refused("1,0,1", &["'1,0,1'", "1e-6 to 1e6"]);
    fs::create_dir(here.join("grey")).unwrap();
    for i in 0..20 {
        let grey = image::open(here.join("tinted").join(name(i))).unwrap().into_luma8();
        grey.save(here.join("grey").join(name(i))).unwrap();
    }
    write_lines(&here.join("grey/lights.lp"), &light_lines(20));
    relight(here, "bake grey -o b.ktx2 --white-balance 1,1,1").assert_refused(2, &["one channel"]);
    let text: String = (0..20).map(|i| format!("{} 1 2 3\n", name(i))).collect();
    fs::write(here.join("i.txt"), text).unwrap();
    relight(here, "bake grey -o b.ktx2 --intensities i.txt").assert_refused(3, &["line 1", "one channel"]);
}
