//! Web folders at the command line: another reader, written from the format's description, sees what `render`
//! draws; bakes lose little; those of another program are drawn.

#![allow(clippy::unwrap_used, reason = "a test's helpers fail as the test does")]

mod scene;

use relight_core::CpuLevel;
use relight_formats::{Samples, decode};
use scene::pictures::{psnr, read_png};
use scene::{copy_icon72, json_of, made, names_in, number, relight};
use serde_json::Value;
use std::f64::consts::PI;
use std::path::Path;

/// What the reader of this test must agree to, in dB: its JPEG decoder is that of pictures, whose codes differ by 1
/// at one pixel in a hundred. `browser.rs` has the codes themselves.
const ALIKE: f64 = 60.0;

/// The functions of a type in the folder's order; spherical harmonics without the phase.
fn functions(kind: &str, [x, y, z]: [f64; 3]) -> Vec<f64> {
    let (phi, s) = (libm::atan2(y, x), (z - z * z).max(0.0).sqrt());
    let (sin, cos) = (libm::sin, libm::cos);
    let root = |over: f64, under: f64| (over / (under * PI)).sqrt();
    match kind {
        "ptm" => vec![1.0, x, y, x * x, x * y, y * y],
        "hsh" => vec![
            1.0 / (2.0 * PI).sqrt(),
            root(6.0, 1.0) * cos(phi) * s,
            root(3.0, 2.0) * (2.0 * z - 1.0),
            root(6.0, 1.0) * sin(phi) * s,
            root(30.0, 1.0) * cos(2.0 * phi) * (z * z - z),
            root(30.0, 1.0) * cos(phi) * (2.0 * z - 1.0) * s,
            root(5.0, 2.0) * (1.0 - 6.0 * z + 6.0 * z * z),
            root(30.0, 1.0) * (2.0 * z - 1.0) * s * sin(phi),
            root(30.0, 1.0) * sin(2.0 * phi) * (z * z - z),
        ],
        "sh" => vec![
            root(1.0, 4.0),
            root(3.0, 4.0) * y,
            root(3.0, 4.0) * z,
            root(3.0, 4.0) * x,
            root(15.0, 4.0) * x * y,
            root(15.0, 4.0) * y * z,
            root(5.0, 16.0) * (3.0 * z * z - 1.0),
            root(15.0, 4.0) * x * z,
            root(15.0, 16.0) * (x * x - y * y),
        ],
        other => panic!("{other}"),
    }
}

/// The mean and each plane's weights, of R, G, B each, of a `bilinear` folder.
fn rows(info: &Value, [x, y, z]: [f64; 3]) -> Vec<[f64; 3]> {
    let edge = info["resolution"].as_u64().unwrap() as usize;
    let sum = x.abs() + y.abs() + z.max(0.0);
    let place = |value: f64| 0.5 * (value / sum + 1.0) * (edge - 1) as f64;
    let (column, row) = (place(x + y), place(y - x));
    let (left, top) = ((column as usize).min(edge - 2), (row as usize).min(edge - 2));
    let (s, t) = (column - left as f64, row - top as f64);
    let planes = info["nplanes"].as_u64().unwrap() as usize;
    let value = |p: usize, i: usize, j: usize, channel: usize| {
        let place = 3 * (p * edge * edge + (top + j) * edge + left + i) + channel;
        let code = info["basis"][place].as_f64().unwrap();
        if p == 0 { code } else { (code - 127.0) / info["materials"][0]["range"][p - 1].as_f64().unwrap() }
    };
    let of = |p: usize, c: usize| {
        (1.0 - t) * ((1.0 - s) * value(p, 0, 0, c) + s * value(p, 1, 0, c))
            + t * ((1.0 - s) * value(p, 0, 1, c) + s * value(p, 1, 1, c))
    };
    (0..=planes).map(|p| [of(p, 0), of(p, 1), of(p, 2)]).collect()
}

/// A reader of web folders written from the format's description alone: R, G, B of each pixel from the top row,
/// 0..1.
fn picture_of_folder(folder: &Path, light: [f64; 3]) -> Vec<f64> {
    let info = json_of(&folder.join("info.json"));
    let planes = info["nplanes"].as_u64().unwrap() as usize;
    let mut values = Vec::new();
    for file in 0..planes.div_ceil(3) {
        let path = folder.join(format!("plane_{file}.jpg"));
        let Samples::U8(samples) = decode(&path, CpuLevel::BASELINE, 1 << 30).unwrap().samples else {
            panic!()
        };
        for channel in 0..3 {
            let number = |key: &str| info["materials"][0][key][3 * file + channel].as_f64().unwrap();
            let (scale, bias) = (number("scale"), number("bias"));
            let of_plane = samples.iter().skip(channel).step_by(3);
            values.push(of_plane.map(|&c| (f64::from(c) / 255.0 - bias) * scale * 255.0).collect::<Vec<_>>());
        }
    }
    let (kind, lrgb) = (info["type"].as_str().unwrap(), info["colorspace"] == "lrgb");
    let weights: Vec<[f64; 3]> = match kind {
        "bilinear" => rows(&info, light),
        kind => functions(kind, light).into_iter().map(|weight| [weight; 3]).collect(),
    };
    let sample = |i: usize| {
        let (pixel, c) = (i / 3, i % 3);
        let terms = weights.iter().enumerate();
        match (kind, lrgb) {
            ("bilinear", _) => {
                let planes = terms.skip(1).map(|(p, weight)| values[p - 1][pixel] * weight[c]);
                weights[0][c] + planes.sum::<f64>()
            }
            (_, true) => {
                let luminance: f64 = terms.map(|(j, weight)| values[3 + j][pixel] * weight[c]).sum();
                luminance * values[c][pixel] / 255.0
            }
            _ => terms.map(|(j, weight)| values[3 * j + c][pixel] * weight[c]).sum(),
        }
    };
    (0..3 * values[0].len()).map(|i| sample(i) / 255.0).collect()
}

#[test]
fn web_folders_lose_little_and_another_reader_sees_the_same() {
    let folder = tempfile::tempdir().unwrap();
    let here = folder.path();
    copy_icon72(&here.join("icon72"), 2);
    for (options, loss) in [
        ("--basis ptm", 0.1),
        ("--basis ptm --color lrgb", 0.1),
        ("--basis hsh -k 9", 0.15),
        ("--basis sh -k 9", 0.15),
        ("--basis pca -k 10", 0.25),
        ("--basis hsh -k 16 --planes 9", 0.25),
    ] {
        let mean = |file: &str| {
            relight(here, &format!("bake icon72 {options} --holdout every:6 --report r.json -o {file}")).ok();
            number(&json_of(&here.join("r.json")), "holdout.mean.psnr")
        };
        let (float, stored) = (mean("float.ktx2 --precision f32"), mean("a.web"));
        println!("{options}: {stored} dB in .web, {float} dB in floats");
        assert!((stored - float).abs() < loss, "{options}: {stored} dB in .web, {float} dB in floats");
        for light in [[0.48, -0.36, 0.8], [-0.6, 0.64, 0.48], [0.0, 0.0, 1.0]] {
            let words = light.map(|c: f64| c.to_string()).join(",");
            relight(here, &format!("render a.web -o a.png --depth 16 --light {words}")).ok();
            let rendered = read_png(&here.join("a.png")).0.samples;
            let theirs = picture_of_folder(&here.join("a.web"), light);
            let alike = psnr(&rendered, &theirs);
            assert!(alike > ALIKE, "{options} {light:?}: {alike} dB");
        }
        let info = relight(here, "info a.web").ok().stdout;
        assert!(info.contains("info.json plane_0.jpg"), "{info}");
        assert_eq!(relight(here, "info a.web/info.json").ok().stdout, info);
    }
}

#[test]
fn folders_are_replaced_by_their_like_alone() {
    let folder = made(20);
    let here = folder.path();
    relight(here, "bake capture -o a.web -j 1").ok();
    let bytes = |name: &str| std::fs::read(here.join(name)).unwrap();
    let (info, plane) = (bytes("a.web/info.json"), bytes("a.web/plane_1.jpg"));
    relight(here, "bake capture -o a.web --jpeg-quality 50 -j 3").ok();
    assert!(bytes("a.web/plane_1.jpg").len() < plane.len());
    relight(here, "bake capture -o a.web -j 3").ok();
    assert!(bytes("a.web/info.json") == info && bytes("a.web/plane_1.jpg") == plane);
    std::fs::create_dir(here.join("site.web")).unwrap();
    std::fs::write(here.join("site.web/index.html"), "mine").unwrap();
    let names = names_in(here);
    relight(here, "bake capture -o site.web").assert_refused(2, &["site.web", "index.html"]);
    relight(here, "bake capture -o b.web --basis srbf").assert_refused(2, &["not srbf with"]);
    relight(here, "bake capture -o b.web --precision f16").assert_refused(2, &["precision u8, not f16"]);
    relight(here, "render capture -o c.png --light 0,0,1").assert_refused(3, &["without info.json"]);
    assert_eq!(names_in(here), names);
}

#[test]
fn the_folder_of_another_program_is_drawn() {
    let theirs = Path::new(env!("CARGO_MANIFEST_DIR")).join("../../shared/data/peer_web_ptm");
    if !theirs.is_dir() {
        println!("skipped: {} is not there", theirs.display());
        return;
    }
    let folder = tempfile::tempdir().unwrap();
    let here = folder.path();
    let theirs_name = theirs.display();
    for light in [[0.48, -0.36, 0.8], [-0.6, 0.64, 0.48]] {
        let words = light.map(|c: f64| c.to_string()).join(",");
        relight(here, &format!("render {theirs_name} -o a.png --depth 16 --light {words}")).ok();
        let alike = psnr(&read_png(&here.join("a.png")).0.samples, &picture_of_folder(&theirs, light));
        assert!(alike > ALIKE, "{alike} dB");
    }
}

#[test]
fn a_bake_in_tiles_is_relit_as_one_without() {
    let folder = tempfile::tempdir().unwrap();
    let here = folder.path();
    copy_icon72(&here.join("capture"), 6);
    relight(here, "bake capture -o whole.web").ok();
    relight(here, "bake capture -o tiled.web --deepzoom").ok();
    relight(here, "convert whole.web -o again.web --deepzoom").ok();
    let picture = |asset: &str| {
        relight(here, &format!("render {asset} -o {asset}.png --light 0.3,-0.4,0.8")).ok();
        read_png(&here.join(format!("{asset}.png"))).0.samples
    };
    let whole = picture("whole.web");
    // 402 x 395 pixels are four tiles.
    for asset in ["tiled.web", "again.web"] {
        assert_eq!(names_in(&here.join(format!("{asset}/plane_5_files/9"))).len(), 4, "{asset}");
        let same = psnr(&picture(asset), &whole);
        assert!(same > 45.0, "{asset}: {same} dB");
    }
    let refused = ["--deepzoom", "ptm holds no tiles"];
    relight(here, "convert whole.web -o a.ptm --deepzoom").assert_refused(2, &refused[1..]);
}
