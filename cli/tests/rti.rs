//! Files of RTI tools at the command line: `.rti` of 4, 9 and 16 terms, `.ptm` in its four forms.

#![allow(clippy::unwrap_used, reason = "a test's helpers fail as the test does")]

mod scene;

use scene::pictures::{psnr, read_png};
use scene::{copy_icon72, json_of, made, names_in, number, relight, relight_in_least_memory};
use std::f64::consts::PI;
use std::fs;
use std::path::Path;

/// Gautron's functions by their definition, in the order and signs of `.rti`: l = 0, 1 .., m from l down to
/// -l; sqrt(2) K P_l^|m|(2 cos(theta) - 1) cos(m phi) or sin(|m| phi), negated where m is odd by the phase of
/// Condon and Shortley and again for all m but 0.
fn functions([x, y, z]: [f64; 3], count: usize) -> Vec<f64> {
    let (t, phi) = (2.0 * z - 1.0, libm::atan2(y, x));
    let factorial = |n: i64| (1..=n).product::<i64>() as f64;
    let legendre = |l: i64, m: i64| -> f64 {
        let sine = (1.0 - t * t).max(0.0).sqrt();
        let mut current = (0..m).fold(1.0, |p, i| p * -((2 * i + 1) as f64) * sine);
        let mut before = 0.0;
        for n in m + 1..=l {
            let next = (((2 * n - 1) as f64) * t * current - ((n + m - 1) as f64) * before) / (n - m) as f64;
            (before, current) = (current, next);
        }
        current
    };
    let function = |l: i64, m: i64| -> f64 {
        let n = m.abs();
        let k = ((2 * l + 1) as f64 / (2.0 * PI) * factorial(l - n) / factorial(l + n)).sqrt();
        let angle = if m < 0 { libm::sin(n as f64 * phi) } else { libm::cos(n as f64 * phi) };
        let sign = if m == 0 { 1.0 } else { -(2.0f64.sqrt()) };
        sign * k * legendre(l, n) * angle
    };
    (0i64..4)
        .flat_map(|l| (-l..=l).rev().map(move |m| (l, m)))
        .map(|(l, m)| function(l, m))
        .take(count)
        .collect()
}

/// A reader of `.rti` written from the format's description alone: R, G, B of each pixel from the top row,
/// 0..1.
fn picture_of_rti(path: &Path, light: [f64; 3]) -> Vec<f64> {
    let bytes = fs::read(path).unwrap();
    let (mut words, mut at) = (Vec::new(), 0);
    // Version, kind, width, height, 3, terms, basis type, element size.
    while words.len() < 8 {
        let end = at + bytes[at..].iter().position(|&byte| byte == b'\n').unwrap();
        words.extend(std::str::from_utf8(&bytes[at..end]).unwrap().split_whitespace());
        at = end + 1;
    }
    let word = |i: usize| words[i].parse::<usize>().unwrap();
    assert_eq!((words[0], word(1), word(4), word(7)), ("#HSH1.2", 3, 3, 1));
    let (pixels, terms, weights) = (word(2) * word(3), word(5), functions(light, word(5)));
    let float = |i: usize| f64::from(f32::from_le_bytes(bytes[at + 4 * i..][..4].try_into().unwrap()));
    let data = &bytes[at + 8 * terms..];
    let sum = |of_terms: &[u8]| -> f64 {
        (0..terms).map(|k| (f64::from(of_terms[k]) / 255.0 * float(k) + float(terms + k)) * weights[k]).sum()
    };
    let value = |i: usize| match word(6) {
        2 => sum(&data[i * terms..]),
        1 => {
            let pixel = &data[i / 3 * (terms + 3)..];
            sum(pixel) * f64::from(pixel[terms + i % 3]) / 255.0
        }
        other => panic!("basis type {other}"),
    };
    (0..3 * pixels).map(value).collect()
}

#[test]
fn rti_files_lose_little_and_another_reader_sees_the_same() {
    let folder = tempfile::tempdir().unwrap();
    let here = folder.path();
    copy_icon72(&here.join("icon72"), 2);
    for (terms, color) in [(4, "rgb"), (9, "lrgb"), (16, "rgb")] {
        let fit =
            format!("bake icon72 --basis hsh -k {terms} --color {color} --holdout every:6 --report r.json");
        let mean = |file: &str| {
            relight(here, &format!("{fit} -o {file}")).ok();
            number(&json_of(&here.join("r.json")), "holdout.mean.psnr")
        };
        let (float, stored) = (mean("float.ktx2 --precision f32"), mean("a.rti"));
        assert!((stored - float).abs() < 0.1, "{terms} {color}: {stored} dB in .rti, {float} dB in floats");
        for light in [[0.48, -0.36, 0.8], [-0.6, 0.64, 0.48], [0.0, 0.0, 1.0]] {
            let words = light.map(|c: f64| c.to_string()).join(",");
            relight(here, &format!("render a.rti -o a.png --depth 16 --light {words}")).ok();
            let rendered = read_png(&here.join("a.png")).0.samples;
            for (i, (a, b)) in rendered.iter().zip(picture_of_rti(&here.join("a.rti"), light)).enumerate() {
                assert!((a - b.clamp(0.0, 1.0)).abs() < 2e-5, "{terms}, sample {i}: {a} rendered, {b}");
            }
        }
        let info = relight(here, "info a.rti").ok().stdout;
        for words in ["HSH1.2", &format!("hsh, {terms} functions"), color] {
            assert!(info.contains(words), "no {words} in\n{info}");
        }
        let judged = relight(here, "evaluate a.rti icon72 --json").ok().json();
        assert!(number(&judged, "mean.psnr") > 20.0, "{terms}: {}", judged["mean"]);
    }
}

#[test]
fn ptm_files_of_all_forms_show_the_same_pictures() {
    let folder = tempfile::tempdir().unwrap();
    let here = folder.path();
    copy_icon72(&here.join("icon72"), 2);
    let picture = |asset: &str| {
        relight(here, &format!("render {asset} -o a.png --depth 16 --light 0.48,-0.36,0.8")).ok();
        read_png(&here.join("a.png")).0.samples
    };
    for (color, planes) in [("rgb", 18), ("lrgb", 9)] {
        relight(here, &format!("bake icon72 -o float.ktx2 --precision f32 --color {color}")).ok();
        let float = picture("float.ktx2");
        for (options, least, share) in
            [("", 57.0, 1.0), ("--jpeg-quality 95", 45.0, 0.3), ("--jpeg-quality 70", 37.0, 0.12)]
        {
            relight(here, &format!("bake icon72 -o a.ptm --color {color} {options}")).ok();
            let (quality, bytes) =
                (psnr(&picture("a.ptm"), &float), fs::read(here.join("a.ptm")).unwrap().len());
            let pixels = float.len() / 3;
            assert!(quality > least, "{color} {options}: {quality} dB");
            assert!(
                bytes as f64 <= share * (pixels * planes) as f64 + 300.0,
                "{color} {options}: {bytes} bytes"
            );
        }
        let info = relight(here, "info a.ptm").ok().stdout;
        for words in [format!("PTM_FORMAT_JPEG_{}", color.to_uppercase()), format!("of {planes}")] {
            assert!(info.contains(&words), "no {words} in\n{info}");
        }
    }
}

#[test]
fn planes_in_jpeg_are_the_same_in_little_memory_and_refused_elsewhere() {
    let folder = made(20);
    let here = folder.path();
    relight(here, "bake capture -o a.ptm --jpeg-quality 80 -j 1").ok();
    relight_in_least_memory(here, "bake capture -o b.ptm --jpeg-quality 80 -j 3").ok();
    assert!(fs::read(here.join("a.ptm")).unwrap() == fs::read(here.join("b.ptm")).unwrap());
    let names = names_in(here);
    relight(here, "bake capture -o c.ktx2 --jpeg-quality 80")
        .assert_refused(2, &["no planes in JPEG", ".ptm"]);
    relight(here, "bake capture -o c.ptm --jpeg-quality 101").assert_refused(2, &["101", "1..=100"]);
    relight(here, "bake capture -o c.rti").assert_refused(2, &["hsh with 4, 9 or 16", "not ptm with 6"]);
    assert_eq!(names_in(here), names);
}
