//! Assets of ours drawn in headless Chromium beside `relight render`: a BC7 array by WebGL2 with our GLSL, web
//! folders by a page that follows the description of their format.
//!
//! Without Chromium, or with one that lacks EXT_texture_compression_bptc, it prints that it skips;
//! `RELIGHT_REQUIRE_CHROMIUM=1` makes that a failure.

#![allow(clippy::unwrap_used, reason = "a test's helpers fail the test")]

mod chromium;

use chromium::skip;
use serde_json::{Value, json};
use std::path::Path;
use std::process::Command;

const LIGHTS: [[f64; 3]; 5] =
    [[0.0, 0.0, 1.0], [-0.6, 0.0, 0.8], [0.6, 0.64, 0.48], [0.36, -0.8, 0.48], [-0.48, 0.64, 0.6]];

/// Largest difference of an 8-bit value that counts as the same picture.
const TOLERANCE: u64 = 3;

/// The same of web folders, whose codes are the browser's own: what is left is rounding.
const WEB_TOLERANCE: u64 = 1;

fn relight(arguments: &[&str], folder: &Path) {
    let output =
        Command::new(env!("CARGO_BIN_EXE_relight")).args(arguments).current_dir(folder).output().unwrap();
    assert!(output.status.success(), "{arguments:?}: {}", String::from_utf8_lossy(&output.stderr));
}

/// The title of `page.html` once its scripts have run, or why there is none.
fn title_in_chromium(folder: &Path) -> Result<String, String> {
    let name = chromium::program();
    let output = Command::new(&name)
        .args(["--headless=new", "--no-sandbox", "--use-angle=swiftshader", "--enable-unsafe-swiftshader"])
        .args(["--allow-file-access-from-files", "--virtual-time-budget=60000", "--dump-dom"])
        .arg(format!("--user-data-dir={}", folder.join("profile").display()))
        .arg(format!("file://{}", folder.join("page.html").display()))
        .output()
        .map_err(|error| format!("{} can't be run: {error}", name.to_string_lossy()))?;
    let text = String::from_utf8_lossy(&output.stdout).into_owned();
    let title = text.split_once("<title>").and_then(|(_, rest)| rest.split_once("</title>"));
    title.map(|(title, _)| title.to_owned()).ok_or_else(|| format!("the page has no title: {text}"))
}

/// Renders `asset` at all lights, and lists them in `lights.json`.
fn render_lights(asset: &str, folder: &Path) {
    let mut lights = Vec::new();
    for (i, direction) in LIGHTS.iter().enumerate() {
        let [x, y, z] = direction;
        let name = format!("light{i}.png");
        relight(&["render", asset, &format!("--light={x},{y},{z}"), "-o", &name], folder);
        lights.push(json!({ "direction": direction, "picture": name }));
    }
    std::fs::write(folder.join("lights.json"), Value::from(lights).to_string()).unwrap();
}

#[test]
fn a_bc7_array_in_webgl2_is_the_rendered_picture() {
    let folder = tempfile::tempdir().unwrap();
    let folder = folder.path();
    let root = Path::new(env!("CARGO_MANIFEST_DIR")).join("..");
    let set = root.join("testdata/icon72");
    relight(
        &[
            "bake",
            set.to_str().unwrap(),
            "-o",
            "asset.ktx2",
            "--basis",
            "hsh",
            "-k",
            "9",
            "--block",
            "bc7",
            "--quality",
            "fast",
            "--mips",
        ],
        folder,
    );
    relight(&["shader", "asset.ktx2", "--lang", "glsl", "-o", "asset.glsl"], folder);
    render_lights("asset.ktx2", folder);
    std::fs::write(folder.join("page.html"), include_str!("browser/page.html")).unwrap();
    let title = match title_in_chromium(folder) {
        Ok(title) => title,
        Err(reason) => return skip(&reason),
    };
    let verdict: Value = serde_json::from_str(&title).unwrap();
    if let Some(reason) = verdict["skipped"].as_str() {
        return skip(reason);
    }
    println!("{verdict}");
    assert_eq!(verdict["lights"], LIGHTS.len(), "{verdict}");
    assert!(verdict["levels"].as_u64().unwrap() > 1, "{verdict}");
    assert!(verdict["worst"].as_u64().unwrap() <= TOLERANCE, "{verdict}");
}

#[test]
fn web_folders_in_a_page_that_follows_their_description_are_the_rendered_pictures() {
    let folder = tempfile::tempdir().unwrap();
    let folder = folder.path();
    let set = Path::new(env!("CARGO_MANIFEST_DIR")).join("../testdata/icon72");
    let set = set.to_str().unwrap();
    std::fs::write(folder.join("page.html"), include_str!("browser/web.html")).unwrap();
    for options in ["ptm -k 6", "ptm -k 6 --color lrgb", "hsh -k 9", "sh -k 9", "pca -k 10"] {
        let words: Vec<&str> = ["bake", set, "-o", "asset.web", "--jpeg-quality", "80", "--basis"]
            .into_iter()
            .chain(options.split(' '))
            .collect();
        relight(&words, folder);
        render_lights("asset.web", folder);
        let title = match title_in_chromium(folder) {
            Ok(title) => title,
            Err(reason) => return skip(&reason),
        };
        let verdict: Value = serde_json::from_str(&title).unwrap();
        println!("{options}: {verdict}");
        assert_eq!(verdict["lights"], LIGHTS.len(), "{options}: {verdict}");
        assert!(verdict["worst"].as_u64().unwrap() <= WEB_TOLERANCE, "{options}: {verdict}");
    }
}
