//! `relight lights`, the capture doctor, and what bake notes of lights that do not fit.

#![allow(clippy::unwrap_used, reason = "a test's helpers fail as the test does")]

mod scene;

use scene::pictures::read_png;
use scene::{icon72, light_lines, made, name, relight, relight_words, write_lines};
use std::fs;

#[test]
fn a_capture_in_order_is_described() {
    let folder = made(20);
    let said = relight(folder.path(), "lights capture").ok();
    assert_eq!(said.stderr, "");
    let out = said.stdout;
    for words in ["20 lights", "largest hole: ", "lowest light: 12.0 deg above the picture plane (p19.png)"] {
        assert!(out.contains(words), "no '{words}' in\n{out}");
    }
    for words in ["pairs of lights", "unit length", "match no file", "no line names", "exposed"] {
        assert!(!out.contains(words), "'{words}' in\n{out}");
    }
    assert!(out.lines().last().unwrap().starts_with("largest usable: ptm "), "{out}");
}

#[test]
fn every_flaw_of_a_capture_is_found() {
    let folder = made(20);
    let here = folder.path();
    let mut lines = light_lines(20);
    lines[8] = lines[3].replace(&name(3), &name(8));
    lines[6] = format!("{} 0 1.5 1.5", name(6));
    write_lines(&here.join("capture/lights.lp"), &lines);
    fs::write(here.join("capture/stray.png"), fs::read(here.join("capture/p00.png")).unwrap()).unwrap();
    let flat = |level: u8| image::RgbImage::from_fn(24, 16, |x, _| image::Rgb([level, (x % 7) as u8, level]));
    flat(255).save(here.join("capture").join(name(10))).unwrap();
    flat(9).save(here.join("capture").join(name(11))).unwrap();
    let out = relight(here, "lights capture").ok().stdout;
    for words in [
        "pairs of lights less than 0.1 deg apart: 1\n  p03.png (line 5) and p08.png (line 10)\n",
        "vectors that are not of unit length (directions are used): 1\n  p06.png (line 8): length 2.121\n",
        "pictures that no line names: 1\n",
        "stray.png\n",
        "pictures over- or under-exposed: 2\n  p10.png: over-exposed, 66.7 % of its samples at full scale\n  p11.png: under-exposed, ",
    ] {
        assert!(out.contains(words), "no '{words}' in\n{out}");
    }
    // What a bake would refuse is a failed check: the rest is told all the same.
    fs::remove_file(here.join("capture").join(name(2))).unwrap();
    fs::remove_file(here.join("capture/stray.png")).unwrap();
    let failed = relight(here, "lights capture");
    failed.assert_refused(1, &["lights.lp", "1 of 20 pictures", "'p02.png'"]);
    let out = &failed.stdout;
    assert!(out.contains("names that match no file: 1\n  p02.png (line 4)\n"), "{out}");
    assert!(out.contains("largest usable: "), "{out}");
    relight(here, "bake capture -o a.ktx2").assert_refused(3, &["1 of 20 pictures", "'p02.png'"]);
}

#[test]
fn few_lights_carry_few_functions() {
    let usable = |count: usize| {
        let out = relight(made(count).path(), "lights capture").ok().stdout;
        out.lines().last().unwrap().to_owned()
    };
    let last = usable(6);
    assert!(last.contains("no ptm") && last.contains("hsh 4"), "{last}");
    let last = usable(60);
    assert!(last.contains("ptm 15") && last.contains("hsh 16"), "{last}");
}

#[test]
fn the_drawing_has_a_disc_for_each_light() {
    let folder = made(20);
    let here = folder.path();
    let mut lines = light_lines(20);
    lines[19] = format!("{} 0.6 0.2 -0.5", name(19));
    write_lines(&here.join("capture/lights.lp"), &lines);
    relight(here, "lights capture --plot a.svg").ok();
    let svg = fs::read_to_string(here.join("a.svg")).unwrap();
    assert!(svg.starts_with("<svg ") && svg.ends_with("</svg>\n"));
    let tags = svg.lines().filter(|l| !l.is_empty()).skip(1);
    let closed = |l: &str| l.ends_with("/>") || l.ends_with("</text>") || l == "</svg>";
    assert!(svg.matches('<').count() == svg.matches('>').count() && tags.clone().all(closed), "{svg}");
    let filled = |color: &str| {
        tags.clone().filter(|l| l.starts_with("<circle") && l.contains(&format!("fill=\"{color}\""))).count()
    };
    assert_eq!((filled("#ca620a"), filled("#2563b4")), (19, 1), "lights above and below in {svg}");
    // Up in the world is up on the page: SVG's y runs down.
    let [x, y, _] = scene::light(7, 20);
    let at = format!("cx=\"{:.2}\" cy=\"{:.2}\"", 320.0 + 280.0 * x, 320.0 - 280.0 * y);
    let near = |l: &str| {
        let number = |key: &str| {
            l.split(&format!("{key}=\"")).nth(1).unwrap().split('"').next().unwrap().parse::<f64>().unwrap()
        };
        (number("cx") - 320.0 - 280.0 * x).abs() < 0.02 && (number("cy") - 320.0 + 280.0 * y).abs() < 0.02
    };
    assert!(tags.clone().any(|l| l.starts_with("<circle") && near(l)), "no disc at {at}");

    relight(here, "lights capture --plot a.png").ok();
    let (png, bits) = read_png(&here.join("a.png"));
    assert_eq!((png.width, png.height, bits), (640, 640, 8));
    let pixel = |x: f64, y: f64| &png.samples[3 * (y as usize * 640 + x as usize)..][..3];
    let disc = pixel(320.0 + 280.0 * x, 320.0 - 280.0 * y);
    for (sample, code) in disc.iter().zip([202.0, 98.0, 10.0]) {
        assert!((sample * 255.0 - code).abs() < 1.0, "{disc:?} where light 7 is drawn");
    }
    let refused = relight(here, "lights capture --plot a.jpg");
    refused.assert_refused(2, &["a.jpg", ".svg or .png"]);
    assert_eq!(refused.stdout, "", "a wrong name is refused before the work");
}

/// Swaps the names of two pictures in the light file of the real capture; what bake notes.
fn notes_of_swap(a: usize, b: usize, options: &str) -> String {
    let folder = tempfile::tempdir().unwrap();
    let here = folder.path();
    scene::copy_icon72(&here.join("capture"), 1);
    let [a, b] = [a, b].map(|i| format!("image{i:02}.jpg"));
    let text = fs::read_to_string(icon72().join("lights.lp")).unwrap();
    assert!(text.contains(&a) && text.contains(&b));
    let swapped = text.replace(&a, "A").replace(&b, &a).replace('A', &b);
    fs::write(here.join("capture/lights.lp"), swapped).unwrap();
    let words = ["bake", "capture", "-o", "a.ktx2"].into_iter().chain(options.split_whitespace());
    relight_words(here, &words.collect::<Vec<_>>()).ok().stderr
}

#[test]
fn swapped_pictures_are_noted() {
    for (a, b) in [(3, 30), (10, 60), (20, 50), (39, 50), (2, 28)] {
        let notes = notes_of_swap(a, b, "");
        let named = |i: usize| notes.contains(&format!("image{i:02}.jpg"));
        assert!(named(a) && named(b), "{a} and {b}: {notes}");
    }
    // An untouched capture raises no alarm, whatever the basis.
    let folder = tempfile::tempdir().unwrap();
    scene::copy_icon72(&folder.path().join("capture"), 1);
    for basis in ["ptm", "sh", "hsh -k 16", "srbf"] {
        let untouched = relight(folder.path(), &format!("bake capture -o a.ktx2 --basis {basis}")).ok();
        assert_eq!(untouched.stderr, "", "{basis}");
    }
}
