//! The page of a report in headless Chromium, with a real pointer: what it draws is what `relight render` draws.
//!
//! Without Chromium it prints that it skips; `RELIGHT_REQUIRE_CHROMIUM=1` makes that a failure.

#![allow(clippy::unwrap_used, reason = "a test's helpers fail the test")]

mod chromium;
mod devtools;
mod scene;

use devtools::Browser;
use relight_core::CpuLevel;
use relight_formats::Samples;
use scene::{copy_icon72, icon72, json_of, made, number, relight, relight_words};
use serde_json::{Value, json};
use std::fs;
use std::path::Path;

/// Largest difference of an 8-bit value that counts as the same picture.
const TOLERANCE: u8 = 2;

/// Pixels of a part of the capture.
const PART: (usize, usize) = (96, 80);

fn browser(folder: &Path) -> Option<Browser> {
    match Browser::start(folder) {
        Ok(browser) => Some(browser),
        Err(reason) => {
            chromium::skip(&reason);
            None
        }
    }
}

/// Bakes part of every fourth picture with a page `NAME.html`.
fn bake(here: &Path, name: &str, options: &str) {
    if !here.join("capture").exists() {
        copy_icon72(&here.join("capture"), 4);
    }
    let (width, height) = PART;
    let line =
        format!("bake capture -o {name}.ktx2 --crop {width}x{height}+150+170 --report {name}.html {options}");
    relight(here, &line).ok();
}

/// R, G, B of `asset` under `light`, as `relight render` has them.
fn rendered(here: &Path, asset: &str, light: &Value) -> Vec<u8> {
    let [x, y, z] = [0, 1, 2].map(|i| light[i].as_f64().unwrap());
    relight_words(here, &["render", asset, &format!("--light={x},{y},{z}"), "-o", "r.png"]).ok();
    image::open(here.join("r.png")).unwrap().into_rgb8().into_raw()
}

/// R, G, B of the part of a picture of the capture.
fn photograph(here: &Path, name: &Value) -> Vec<u8> {
    let path = here.join("capture").join(name.as_str().unwrap());
    let decoded = relight_formats::decode(&path, CpuLevel::BASELINE, 1 << 30).unwrap();
    let Samples::U8(codes) = decoded.samples else { panic!("8 bits") };
    let row = |y: usize| &codes[3 * ((170 + y) * decoded.info.width + 150)..][..3 * PART.0];
    (0..PART.1).flat_map(|y| row(y).to_vec()).collect()
}

/// The largest difference of a code.
fn worst(a: &[u8], b: &[u8]) -> u8 {
    assert_eq!(a.len(), b.len());
    a.iter().zip(b).map(|(a, b)| a.abs_diff(*b)).max().unwrap()
}

#[test]
fn dragging_the_light_gives_the_rendered_picture() {
    let folder = tempfile::tempdir().unwrap();
    let here = folder.path();
    let Some(mut browser) = browser(here) else { return };
    browser.resize(1280, 800);
    for (name, options) in [
        ("ptm", "--basis ptm"),
        ("ptm-lrgb", "--basis ptm --color lrgb --precision f16"),
        ("sh", "--basis sh -k 9"),
        ("hsh-linear", "--basis hsh -k 4 --space linear --precision f16"),
        ("srbf", "--basis srbf -k 12 --precision f32"),
        ("srbf-sphere", "--basis srbf -k 9 --kernel spherical --block bc7 --quality fast"),
        ("pca", "--basis pca -k 7"),
    ] {
        bake(here, name, options);
        for query in ["", "?canvas"] {
            browser.open(&here.join(format!("{name}.html")), query);
            let words = browser.value("document.getElementById('painter').textContent");
            let drawn_by = if query.is_empty() { "WebGL2" } else { "plain script" };
            assert!(words.as_str().unwrap().contains(drawn_by), "{name}{query}: {words}");
            let before = browser.codes("live-picture");
            for end in [[0.72, 0.3], [0.2, 0.66]] {
                browser.drag("panel", &[[0.5, 0.5], [0.6, 0.45], end]);
                let light = browser.value("state.direction");
                let drawn = browser.codes("live-picture");
                let expected = rendered(here, &format!("{name}.ktx2"), &light);
                let off = worst(&drawn, &expected);
                println!("{name}{query} {light}: off by {off}");
                assert!(off <= TOLERANCE, "{name}{query} {light}: off by {off}");
                let changed = drawn.iter().zip(&before).filter(|(a, b)| a != b).count();
                assert!(changed > drawn.len() / 4, "{name}{query}: {changed} codes changed");
            }
            // The light is where the pointer was, on a dome over the shorter side.
            let x = number(&browser.value("({ x: state.direction[0] })"), "x");
            assert!((x - (0.2 - 0.5) * 2.0 * 96.0 / 80.0).abs() < 0.03, "{x}");
            browser.click("panel", [0.4, 0.4], 2);
            assert_eq!(browser.value("state.direction"), json!([0, 0, 1]), "a double click resets");
            assert_eq!(browser.complaints, Vec::<String>::new(), "{name}{query}");
        }
    }
}

#[test]
fn the_slider_has_the_picture_on_one_side_and_the_bake_on_the_other() {
    let folder = tempfile::tempdir().unwrap();
    let here = folder.path();
    let Some(mut browser) = browser(here) else { return };
    bake(here, "asset", "--basis srbf -k 9 --holdout every:3");
    browser.open(&here.join("asset.html"), "");
    browser.resize(1280, 800);
    let split = |browser: &mut Browser| {
        browser.value("[document.querySelector('.handle').getAttribute('aria-valuenow'), document.getElementById('picture').style.clipPath]")
    };
    assert_eq!(split(&mut browser), json!(["50", "inset(0px 50% 0px 0px)"]));
    browser.drag("slider", &[[0.5, 0.6], [0.4, 0.6], [0.25, 0.6]]);
    let [now, clip] = [0, 1].map(|i| split(&mut browser)[i].as_str().unwrap().to_owned());
    assert_eq!(now, "25");
    assert!(clip.starts_with("inset(0px 7"), "{clip}");
    browser.value("document.querySelector('.handle').focus()");
    browser.key("ArrowRight");
    assert_eq!(split(&mut browser)[0], "27");

    // The last light is one that was left out: its row in the table takes it.
    browser.value("document.querySelector('#errors-table tbody tr:last-child button').click()");
    browser.settle();
    let light = browser.value("details.lights[state.light]");
    assert_eq!(light["fitted"], false, "{light}");
    assert_eq!(browser.value("Number(document.getElementById('light').value) === state.light"), true);
    browser.value("document.getElementById('picture').decode().then(() => true)");
    let (bake, picture) = (browser.codes("bake"), browser.codes("picture"));
    assert!(worst(&bake, &rendered(here, "asset.ktx2", &light["direction"])) <= TOLERANCE);
    let photograph = photograph(here, &light["name"]);
    let mean = |a: &[u8], b: &[u8]| {
        a.iter().zip(b).map(|(a, b)| f64::from(a.abs_diff(*b))).sum::<f64>() / a.len() as f64
    };
    assert!(mean(&picture, &photograph) < 1.5, "{}", mean(&picture, &photograph));
    // As far apart as the report says of this light.
    let report = json_of(&here.join("asset.json"));
    let judged = report["holdout"]["pictures"].as_array().unwrap().last().unwrap();
    assert_eq!(judged["name"], light["name"]);
    let square: f64 = bake.iter().zip(&photograph).map(|(a, b)| f64::from(a.abs_diff(*b)).powi(2)).sum();
    let rmse = (square / bake.len() as f64).sqrt() / 255.0;
    assert!((rmse - number(judged, "rmse")).abs() < 0.002, "{rmse} {judged}");
    assert_eq!(browser.complaints, Vec::<String>::new());
}

#[test]
fn a_clicked_pixel_has_its_samples_and_the_value_that_render_gives() {
    let folder = tempfile::tempdir().unwrap();
    let here = folder.path();
    let Some(mut browser) = browser(here) else { return };
    bake(here, "asset", "--basis sh -k 9 --color lrgb --precision f16");
    browser.open(&here.join("asset.html"), "?canvas");
    browser.resize(390, 844);
    browser.drag("panel", &[[0.5, 0.5], [0.45, 0.6], [0.3, 0.7]]);
    let (x, y) = (61, 23);
    let at = [(x as f64 + 0.5) / PART.0 as f64, (y as f64 + 0.5) / PART.1 as f64];
    browser.click("panel", at, 1);
    assert_eq!(browser.value("document.getElementById('pixel-title').textContent"), "Pixel 61, 23");
    let light = browser.value("state.direction");
    let expected = &rendered(here, "asset.ktx2", &light)[3 * (y * PART.0 + x)..][..3];
    let text = browser.value("document.getElementById('pixel-text').textContent");
    let text = text.as_str().unwrap();
    let codes = text.split_once("it is ").unwrap().1.split_once(" of 255").unwrap().0;
    let codes: Vec<u8> = codes.split(", ").map(|code| code.parse().unwrap()).collect();
    assert!(worst(&codes, expected) <= TOLERANCE, "{text} {expected:?}");

    // The sample under the chosen light is that of its picture, by luminance.
    let name = browser.value("details.lights[state.light].name");
    let picture = photograph(here, &name);
    let [r, g, b] = [0, 1, 2].map(|c| f64::from(picture[3 * (y * PART.0 + x) + c]));
    let sample: f64 = text.split_once("sample ").unwrap().1.split_once(',').unwrap().0.parse().unwrap();
    let luminance = (0.2126 * r + 0.7152 * g + 0.0722 * b) / 255.0;
    assert!((sample - luminance).abs() < 0.02, "{sample} {luminance}");
    let marks = browser.value("document.querySelectorAll('#pixel-plot .sample').length");
    assert_eq!(marks, 18);
    assert_eq!(browser.complaints, Vec::<String>::new());
}

#[test]
fn a_sweeps_page_plots_its_choices_and_fits_every_view() {
    let folder = tempfile::tempdir().unwrap();
    let here = folder.path();
    let set = icon72();
    let line = [
        "sweep",
        set.to_str().unwrap(),
        "-o",
        "out",
        "--crop",
        "96x80+150+170",
        "--axes",
        "basis=ptm/srbf,k=6/9,block=none/bc1",
    ];
    relight_words(here, &line).ok();
    let report = json_of(&here.join("out/report.json"));
    let choices = report["choices"].as_array().unwrap();
    let page = fs::read_to_string(here.join("out/report.html")).unwrap();
    assert_eq!(page.matches("<circle class=\"point").count(), 3 * choices.len());
    // The best of the front of bytes is shown.
    let psnr = |choice: &&Value| (choice["psnr"].as_f64().unwrap() * 1e9) as i64;
    let best = choices.iter().filter(|choice| choice["front"]["bytes"] == true).max_by_key(psnr).unwrap();
    assert!(page.contains(&format!("\"shown\":{}", best["name"])));
    let Some(mut browser) = browser(here) else { return };
    browser.open(&here.join("out/report.html"), "");
    for (width, height) in [(1280, 800), (390, 844)] {
        browser.resize(width, height);
        let needed = browser.value("document.documentElement.scrollWidth").as_u64().unwrap();
        assert!(needed <= width as u64, "{needed} of {width}");
    }
    let names = "Array.from(document.querySelectorAll('#choices tbody tr td:first-child'), (cell) => cell.textContent)";
    assert_eq!(browser.value(names).as_array().unwrap().len(), choices.len());
    // Sorted by PSNR, the best is first.
    browser.value("document.querySelectorAll('#choices th button')[1].click()");
    let most = choices.iter().max_by_key(psnr).unwrap();
    assert_eq!(browser.value(names)[0], most["name"]);
    let leverages = browser.value("details.lights.map((light) => light.leverage)");
    let sum: f64 = leverages.as_array().unwrap().iter().map(|leverage| leverage.as_f64().unwrap()).sum();
    // The trace of a hat matrix is the number of functions, less a little for the ridge.
    let functions = best["k"].as_f64().unwrap();
    assert!(sum < functions && sum > functions - 1.0, "{sum} {functions}");
    assert_eq!(browser.complaints, Vec::<String>::new());

    relight_words(here, &[&line[..], &["--keep", "none"]].concat()).ok();
    browser.open(&here.join("out/report.html"), "");
    assert_eq!(browser.value("document.getElementById('relight').hidden"), true);
    let notes = browser.value("document.getElementById('notes-list').textContent");
    assert!(notes.as_str().unwrap().contains("No asset was kept"), "{notes}");
    assert_eq!(browser.complaints, Vec::<String>::new());
}

#[test]
fn names_stay_names_and_pages_of_one_input_are_alike() {
    let folder = made(9);
    let here = folder.path();
    let capture = here.join("capture");
    let odd = "<!--<script>&\"'.png";
    fs::rename(capture.join("p04.png"), capture.join(odd)).unwrap();
    let lines = fs::read_to_string(capture.join("lights.lp")).unwrap();
    fs::write(capture.join("lights.lp"), lines.replace("p04.png", odd)).unwrap();
    let page = |folder: &str, threads: &str| {
        fs::create_dir(here.join(folder)).unwrap();
        let line = ["bake", "../capture", "-o", "a.ktx2", "--report", "r.html", "-j", threads];
        relight_words(&here.join(folder), &line).ok();
        let page = fs::read_to_string(here.join(folder).join("r.html")).unwrap();
        let (before, rest) = page.split_once("id=\"data\">").unwrap();
        let (data, after) = rest.split_once("</script>").unwrap();
        let mut data: Value = serde_json::from_str(data).unwrap();
        for key in ["machine", "command"] {
            assert!(data.as_object_mut().unwrap().remove(key).is_some());
        }
        assert!(data["report"].as_object_mut().unwrap().remove("seconds").is_some());
        (before.to_owned(), data, after.to_owned())
    };
    let (one, two) = (page("one", "1"), page("two", "2"));
    assert!(one == two);
    assert_eq!(one.1["details"]["lights"][4]["name"], odd);
    let Some(mut browser) = browser(here) else { return };
    browser.open(&here.join("one/r.html"), "");
    let listed = browser.value("document.querySelectorAll('#light option')[4].textContent");
    assert_eq!(listed, odd);
    assert_eq!(browser.complaints, Vec::<String>::new());
}

#[test]
fn a_report_is_json_or_a_page_with_json_beside_it() {
    let folder = made(9);
    let here = folder.path();
    relight(here, "bake capture -o a.ktx2 --report r.json").ok();
    assert!(here.join("r.json").exists() && !here.join("r.html").exists());
    fs::rename(here.join("r.json"), here.join("alone.json")).unwrap();
    relight(here, "bake capture -o a.ktx2 --report r.html").ok();
    let (alone, beside) = (json_of(&here.join("alone.json")), json_of(&here.join("r.json")));
    assert_eq!(alone["lights"], beside["lights"]);
    let refused = relight(here, "bake capture -o a.ktx2 --report r.txt");
    refused.assert_refused(2, &["--report r.txt", ".json", ".html"]);
    // Neither may be a file that is read.
    fs::copy(here.join("capture/lights.lp"), here.join("capture/keep.lp")).unwrap();
    let taken = relight(here, "bake capture -o r.ktx2 --report r.ktx2");
    assert_eq!(taken.code, Some(2), "{}", taken.stderr);
}

#[test]
fn large_assets_are_shown_small() {
    let folder = tempfile::tempdir().unwrap();
    let here = folder.path();
    fs::create_dir(here.join("capture")).unwrap();
    let (width, height) = (1100, 3);
    let mut lines = Vec::new();
    for i in 0..7 {
        let light = scene::light(i, 7);
        scene::pictures::write_made(&here.join("capture").join(scene::name(i)), light, width, height);
        lines.push(format!("{} {} {} {}", scene::name(i), light[0], light[1], light[2]));
    }
    scene::write_lines(&here.join("capture/lights.lp"), &lines);
    relight(here, "bake capture -o a.exr --precision f32 --report r.html").ok();
    let Some(mut browser) = browser(here) else { return };
    browser.open(&here.join("r.html"), "?canvas");
    let facts = browser.value("[details.width, details.height, details.factor]");
    assert_eq!(facts, json!([367, 1, 3]));
    let words = browser.value("document.getElementById('painter').textContent");
    assert!(words.as_str().unwrap().contains("the mean of 3 x 3 of the asset's 1100 x 3"), "{words}");
    browser.drag("sphere", &[[0.5, 0.5], [0.6, 0.5], [0.65, 0.4]]);
    let light = browser.value("state.direction");
    let (drawn, whole) = (browser.codes("live-picture"), rendered(here, "a.exr", &light));
    for x in [0, 100, 365, 366] {
        for c in 0..3 {
            let columns = (3 * x)..(3 * x + 3).min(width);
            let count = (columns.len() * height) as f64;
            let sum: f64 = columns
                .flat_map(|column| (0..height).map(move |row| (row * width + column) * 3 + c))
                .map(|at| f64::from(whole[at]))
                .sum();
            let expected = sum / count;
            assert!((f64::from(drawn[3 * x + c]) - expected).abs() < 1.6, "{x} {c}: {expected}");
        }
    }
    assert_eq!(browser.complaints, Vec::<String>::new());
}
