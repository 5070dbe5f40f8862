//! `.ptm` files: written by bake, read back, and read by another reader.

#![allow(clippy::unwrap_used, reason = "a test's helpers fail as the test does")]

mod scene;

use relight_core::CpuLevel;
use relight_formats::{Samples, decode, open_capture};
use scene::pictures::{psnr, read_png};
use scene::{icon72, json_of, made, number, relight, relight_words};
use serde_json::Value;
use std::fs;
use std::path::Path;

/// A reader of `.ptm` written from the format's description alone: R, G, B of each pixel from the
/// top row, 0..1, under a light at (u, v) of the picture plane.
fn picture_of_ptm(path: &Path, u: f64, v: f64) -> Vec<f64> {
    let bytes = fs::read(path).unwrap();
    let (mut words, mut at) = (Vec::new(), 0);
    // Version, format, width, height, six scales, six biases.
    while words.len() < 16 {
        let end = at + bytes[at..].iter().position(|&byte| byte == b'\n').unwrap();
        words.extend(std::str::from_utf8(&bytes[at..end]).unwrap().split_whitespace());
        at = end + 1;
    }
    let number = |i: usize| words[i].parse::<f64>().unwrap();
    let (width, height) = (number(2) as usize, number(3) as usize);
    let (data, pixels, terms) = (&bytes[at..], width * height, [u * u, v * v, u * v, u, v, 1.0]);
    let sum = |six: &[u8]| -> f64 {
        (0..6).map(|j| (f64::from(six[j]) - number(10 + j)) * number(4 + j) * terms[j]).sum()
    };
    assert_eq!(words[0], "PTM_1.2");
    let value = |i: usize| {
        let (x, y, channel) = (i / 3 % width, i / 3 / width, i % 3);
        let pixel = (height - 1 - y) * width + x;
        match words[1] {
            "PTM_FORMAT_RGB" => sum(&data[(channel * pixels + pixel) * 6..]) / 255.0,
            "PTM_FORMAT_LRGB" => {
                sum(&data[pixel * 6..]) / 255.0 * f64::from(data[pixels * 6 + pixel * 3 + channel]) / 255.0
            }
            other => panic!("{other}"),
        }
    };
    (0..3 * pixels).map(value).collect()
}

#[test]
fn ptm_files_lose_little_and_another_reader_agrees_on_photographs_left_out() {
    let folder = tempfile::tempdir().unwrap();
    let here = folder.path();
    let input = icon72();
    let input = input.to_str().unwrap();
    let capture = open_capture(input.as_ref()).unwrap().capture;
    for color in ["rgb", "lrgb"] {
        let bake = |file: &str, more: &[&str]| {
            let options =
                ["bake", input, "-o", file, "--color", color, "--holdout", "every:6", "--report", "r.json"];
            relight_words(here, &[&options[..], more].concat()).ok();
            json_of(&here.join("r.json"))["holdout"].take()
        };
        let float = number(&bake("float.ktx2", &["--precision", "f32"]), "mean.psnr");
        let judged = bake("a.ptm", &[]);
        let mean = number(&judged, "mean.psnr");
        assert!((mean - float).abs() < 0.3, "{color}: {mean} dB in .ptm, {float} dB in floats");
        // The other reader sees, picture by picture, what the report says.
        let pictures = judged["pictures"].as_array().unwrap();
        assert_eq!(pictures.len(), 12);
        for (picture, i) in pictures.iter().zip((3..72).step_by(6)) {
            assert_eq!(picture["name"], Value::from(capture.lights.lights[i].name.clone()));
            let light = capture.lights.lights[i].direction;
            let relit = picture_of_ptm(&here.join("a.ptm"), light.x(), light.y());
            let photograph = decode(&capture.pictures[i], CpuLevel::BASELINE, 1 << 30).unwrap().samples;
            let Samples::U8(codes) = photograph else { panic!("a JPEG of 8 bits") };
            let photograph: Vec<f64> = codes.iter().map(|&code| f64::from(code) / 255.0).collect();
            let (other, said) = (psnr(&relit, &photograph), number(picture, "psnr"));
            assert!((other - said).abs() < 0.01, "{color} {i}: {other} dB by the other reader, {said} dB");
        }
    }
}

#[test]
fn ptm_files_are_rendered_evaluated_and_described() {
    let folder = made(20);
    let here = folder.path();
    for color in ["rgb", "lrgb"] {
        relight(here, &format!("bake capture -o a.ptm --color {color}")).ok();
        relight(here, "render a.ptm -o a.png --depth 16 --light 0.48,-0.36,0.8").ok();
        let rendered = read_png(&here.join("a.png")).0.samples;
        let expected = picture_of_ptm(&here.join("a.ptm"), 0.48, -0.36);
        for (i, (a, b)) in rendered.iter().zip(expected).enumerate() {
            assert!((a - b.clamp(0.0, 1.0)).abs() < 2e-5, "{color}, sample {i}: {a} rendered, {b}");
        }
        let judged = relight(here, "evaluate a.ptm capture --json").ok().json();
        assert!(number(&judged, "mean.psnr") > 20.0, "{color}: {}", judged["mean"]);
        let info = relight(here, "info a.ptm").ok().stdout;
        let layout = info.lines().find(|line| line.starts_with("layout"));
        assert_eq!(layout.and_then(|line| line.split_whitespace().last()), Some(color));
        for words in ["PTM_1.2", "24 x 16", "ptm, 6 functions"] {
            assert!(info.contains(words), "no {words} in\n{info}");
        }
    }
}
