//! Block formats, mips and containers from the command line: what they cost, and that every way of storing an
//! asset gives the same pictures.

#![allow(clippy::unwrap_used, reason = "a test's helpers fail as the test does")]

mod scene;

use scene::{icon72, json_of, made, number, relight, relight_words};
use std::fs;

/// Mean PSNR of the pictures that were left out, and what the report says of storing.
fn baked(here: &std::path::Path, options: &str) -> (f64, serde_json::Value) {
    let input = icon72();
    let mut words = vec!["bake", input.to_str().unwrap(), "-o", "a.ktx2", "--holdout", "every:6"];
    words.extend(["--report", "r.json"]);
    words.extend(options.split_whitespace());
    relight_words(here, &words).ok();
    let report = json_of(&here.join("r.json"));
    (number(&report, "holdout.mean.psnr"), report["storing"].clone())
}

#[test]
fn a_real_capture_loses_little_in_codes_and_blocks() {
    let folder = tempfile::tempdir().unwrap();
    let here = folder.path();
    let (float, storing) = baked(here, "--precision f32");
    assert_eq!(number(&storing, "relit_rmse"), 0.0);
    for (options, allowed, bits) in [
        ("", 0.1, 192.0),
        ("--range minmax", 0.1, 192.0),
        ("--block bc7 --quality fast", 0.3, 48.0),
        ("--block bc1 --quality fast", 1.5, 24.0),
        ("--block bc4 --quality fast", 0.3, 72.0),
        ("--block bc5s --quality fast", 0.3, 72.0),
        ("--block auto --quality fast", 0.5, 48.0),
    ] {
        let (psnr, storing) = baked(here, options);
        assert!(float - psnr <= allowed, "{options}: {psnr} dB, float {float} dB");
        assert!(number(&storing, "bits_per_pixel") <= bits, "{options}: {storing}");
        assert!(number(&storing, "relit_rmse") > 1e-4, "{options}: {storing}");
    }
}

#[test]
fn formats_are_chosen_by_map_within_the_bits_that_are_given() {
    let folder = tempfile::tempdir().unwrap();
    let here = folder.path();
    let cost = |options: &str| {
        let (_, storing) = baked(here, options);
        (number(&storing, "relit_rmse"), number(&storing, "bits_per_pixel"))
    };
    let (all_bc1, _) = cost("--block bc1 --quality fast");
    let (all_bc7, _) = cost("--block bc7 --quality fast");
    let (chosen, bits) = cost("--block auto --bits-per-pixel 36 --quality fast");
    assert!(bits <= 36.0, "{bits} bits");
    // Half of the maps in eight bits gain far more than half of the difference.
    assert!(chosen < 0.5 * (all_bc1 + all_bc7), "{chosen} of {all_bc1} and {all_bc7}");
    assert!(here.join("a_1.ktx2").exists(), "two formats are two files");
    let info = relight(here, "info a.ktx2").ok().stdout;
    assert!(info.contains("bc7") && info.contains("a.ktx2 a_1.ktx2"), "{info}");
}

#[test]
fn every_container_gives_the_same_picture() {
    let folder = made(12);
    let here = folder.path();
    for block in ["bc7 --quality fast", "bc5", "none"] {
        let mut pictures = Vec::new();
        for (name, options) in [
            ("a.ktx2", ""),
            ("b.ktx2", "--mips --zstd=3"),
            ("c.ktx2", "--split --wrap repeat"),
            ("d.dds", ""),
            ("e.dds", "--mips --split"),
        ] {
            let folder = here.join(format!("{block}{name}").replace([' ', '.'], "_"));
            fs::create_dir(&folder).unwrap();
            relight(here, &format!("bake capture -o {}/{name} --block {block} {options}", folder.display()))
                .ok();
            relight(
                here,
                &format!("render {}/{name} -o {name}.exr --light 0.48,-0.36,0.8", folder.display()),
            )
            .ok();
            pictures.push(fs::read(here.join(format!("{name}.exr"))).unwrap());
        }
        assert!(pictures.iter().all(|picture| *picture == pictures[0]), "{block}");
    }
}

#[test]
fn shaders_are_written_for_every_language() {
    let folder = made(12);
    let here = folder.path();
    relight(here, "bake capture -o a.ktx2 --block bc7 --quality fast --basis srbf -k 4").ok();
    for (language, word) in
        [("wgsl", "fn relight_weights"), ("glsl", "void relight_weights"), ("hlsl", "Texture2DArray")]
    {
        relight(here, &format!("shader a.ktx2 --lang {language} -o a.txt")).ok();
        let text = fs::read_to_string(here.join("a.txt")).unwrap();
        assert!(text.contains(word), "{text}");
        assert_eq!(text, relight(here, &format!("shader a.ktx2 --lang {language}")).ok().stdout);
        assert!(!text.contains("RELIGHT_PASSES"), "passes that nobody asked for");
    }
    let passes = relight(here, "shader a.ktx2 --maps-per-pass 2").ok().stdout;
    assert!(passes.contains("RELIGHT_PASSES: i32 = 2"), "{passes}");
}
