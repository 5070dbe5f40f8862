//! `relight verify`: what passes, what does not, and machines without a GPU.
//!
//! Without an adapter the tests say that they skip, unless RELIGHT_REQUIRE_GPU is 1.

#![cfg(feature = "gpu")]
#![allow(clippy::unwrap_used, reason = "a test's helpers fail as the test does")]

mod scene;

use scene::{HEIGHT, Outcome, WIDTH, command, made, number, outcome, relight};
use std::fs;
use std::path::Path;
use std::process::Command;

/// `relight verify` with `line`, or `None` and a word on it where there is no adapter.
fn verify(folder: &Path, line: &str) -> Option<Outcome> {
    let line = format!("verify {line}");
    let mut command = command_without_noise(folder);
    let outcome = outcome(line.clone(), command.args(line.split_whitespace()).output().unwrap());
    if outcome.code == Some(6) {
        let required = std::env::var("RELIGHT_REQUIRE_GPU").is_ok_and(|value| value == "1");
        assert!(!required, "RELIGHT_REQUIRE_GPU is 1: {}", outcome.stderr);
        eprintln!("skipped: {}", outcome.stderr);
        return None;
    }
    Some(outcome)
}

/// The program; Mesa complains on standard error where there is no such folder.
fn command_without_noise(folder: &Path) -> Command {
    let mut command = command(folder);
    command.env("XDG_RUNTIME_DIR", folder);
    command
}

#[test]
fn every_way_of_storing_passes_in_both_modes() {
    let folder = made(16);
    let here = folder.path();
    for (file, options) in [
        ("a.ktx2", "--basis hsh -k 9 --block bc7 --quality fast --mips"),
        ("a.ktx2", "--basis ptm --color lrgb --block bc4"),
        ("a.ktx2", "--basis srbf -k 8 --precision f16 --zstd"),
        ("a.ktx2", "--basis pca -k 5 --block bc7 --quality fast --mips"),
        ("a.dds", "--basis ptm --block bc1 --quality fast"),
        ("a.exr", "--basis ptm --precision f32"),
    ] {
        relight(here, &format!("bake capture -o {file} {options}")).ok();
        let Some(verified) = verify(here, &format!("{file} --json --count 5")) else { return };
        let found = verified.ok().json();
        assert_eq!(found["passed"], true, "{options}");
        let modes = found["modes"].as_array().unwrap();
        assert_eq!(
            modes.iter().map(|mode| mode["mode"].as_str().unwrap()).collect::<Vec<_>>(),
            ["native", "decoded"]
        );
        assert!(number(&modes[1], "max") <= 1e-5, "{options}: {}", modes[1]["max"]);
        for mode in modes {
            assert_eq!(mode["lights"].as_array().unwrap().len(), 5);
        }
        assert!(!found["gpu_decoding"].as_array().unwrap().is_empty());
    }
}

#[test]
fn lights_are_the_files_or_the_assets_thinned() {
    let folder = made(16);
    let here = folder.path();
    relight(here, "bake capture -o a.ktx2").ok();
    let directions = |found: &serde_json::Value| -> Vec<Vec<f64>> {
        let lights = found["modes"][0]["lights"].as_array().unwrap();
        lights.iter().map(|light| serde_json::from_value(light["light"].clone()).unwrap()).collect()
    };
    let Some(thinned) = verify(here, "a.ktx2 --json --mode decoded --count 4") else { return };
    // Of an asset's lights, which rise.
    let mut lights: Vec<Vec<f64>> = (0..16).map(|i| scene::light(i, 16).to_vec()).collect();
    lights.sort_by(|a, b| a[0].total_cmp(&b[0]));
    let expected: Vec<Vec<f64>> = lights.into_iter().step_by(4).collect();
    let close = |a: &[f64], b: &[f64]| a.iter().zip(b).all(|(a, b)| (a - b).abs() < 1e-3);
    let found = directions(&thinned.ok().json());
    assert!(found.len() == 4 && found.iter().zip(&expected).all(|(a, b)| close(a, b)), "{found:?}");
    scene::write_lines(&here.join("two.lp"), &["x 0 0 2".to_owned(), "y 0.6 0 0.8".to_owned()]);
    let given = verify(here, "a.ktx2 --json --mode decoded --lights two.lp").unwrap().ok();
    let found = directions(&given.json());
    assert!(
        found.len() == 2 && close(&found[0], &[0.0, 0.0, 1.0]) && close(&found[1], &[0.6, 0.0, 0.8]),
        "{found:?}"
    );
    // A table says the same.
    let table = verify(here, "a.ktx2 --lights two.lp --maps-per-pass 2").unwrap().ok().stdout;
    for words in ["adapter: ", "mode native", "mode decoded", "0.600 0.000 0.800", "own decoding error: max"]
    {
        assert!(table.contains(words), "no '{words}' in\n{table}");
    }
}

/// Where the texels of level 0 of a KTX2 file lie, uncompressed.
fn texels_of(bytes: &[u8]) -> std::ops::Range<usize> {
    let number = |at: usize| u64::from_le_bytes(bytes[at..at + 8].try_into().unwrap()) as usize;
    number(80)..number(80) + number(88)
}

/// Swaps the codes of two texels of a layer.
fn swap_texels(layer: &mut [u8], a: usize, b: usize) {
    for channel in 0..4 {
        layer.swap(4 * a + channel, 4 * b + channel);
    }
}

#[test]
fn a_wrong_scale_swapped_layers_a_transposed_picture_and_wrong_rows_fail() {
    let folder = made(16);
    let here = folder.path();
    relight(here, "bake capture -o right.ktx2").ok();
    let right = fs::read(here.join("right.ktx2")).unwrap();
    let texels = texels_of(&right);
    let layer = WIDTH * HEIGHT * 4;
    assert_eq!(texels.len(), 6 * layer);
    let fault = |change: &dyn Fn(&mut [u8])| {
        let mut bytes = right.clone();
        change(&mut bytes);
        assert_ne!(bytes, right);
        bytes
    };
    let scale_key = right.windows(8).position(|bytes| bytes == b"\"scale\":").unwrap() + 8;
    let faults: [(&str, Vec<u8>); 4] = [
        (
            "a wrong scale",
            fault(&|bytes| {
                // Another digit after the point.
                let digit = scale_key + bytes[scale_key..].iter().position(|byte| *byte == b'.').unwrap() + 1;
                bytes[digit] = if bytes[digit] == b'9' { b'7' } else { bytes[digit] + 1 };
            }),
        ),
        (
            "swapped layers",
            fault(&|bytes| {
                let (a, b) = bytes[texels.clone()].split_at_mut(layer);
                a.swap_with_slice(&mut b[..layer]);
            }),
        ),
        (
            "a transposed picture",
            fault(&|bytes| {
                for layer in bytes[texels.clone()].chunks_exact_mut(layer) {
                    for (x, y) in (0..HEIGHT).flat_map(|y| (0..y).map(move |x| (x, y))) {
                        swap_texels(layer, x + y * WIDTH, y + x * WIDTH);
                    }
                }
            }),
        ),
        (
            "rows from the bottom",
            fault(&|bytes| {
                for layer in bytes[texels.clone()].chunks_exact_mut(layer) {
                    for (x, y) in (0..HEIGHT / 2).flat_map(|y| (0..WIDTH).map(move |x| (x, y))) {
                        swap_texels(layer, x + y * WIDTH, x + (HEIGHT - 1 - y) * WIDTH);
                    }
                }
            }),
        ),
    ];
    let line = "--against right.ktx2 --tolerance 1e-5 --count 3";
    let Some(same) = verify(here, &format!("right.ktx2 {line}")) else { return };
    same.ok();
    for (name, bytes) in faults {
        fs::write(here.join("wrong.ktx2"), bytes).unwrap();
        for mode in ["native", "decoded"] {
            let refused = verify(here, &format!("wrong.ktx2 {line} --mode {mode}")).unwrap();
            assert_eq!(refused.code, Some(1), "{name}");
            refused.assert_refused(1, &["in mode", mode, "at pixel", "is allowed"]);
        }
        // Alone it is an asset like any other.
        verify(here, "wrong.ktx2 --count 2").unwrap().ok();
    }
}

#[test]
fn what_packing_lost_is_measured_against_a_float_bake() {
    let folder = made(16);
    let here = folder.path();
    relight(here, "bake capture -o packed.ktx2 --block bc1").ok();
    relight(here, "bake capture -o float.exr --precision f32").ok();
    let against = "packed.ktx2 --against float.exr --mode decoded --count 4 --json";
    let Some(loose) = verify(here, &format!("{against} --tolerance 0.5")) else { return };
    let lost = number(&loose.ok().json()["modes"][0], "max");
    assert!((1e-3..0.5).contains(&lost), "{lost}");
    let strict = verify(here, &format!("{against} --tolerance {}", lost * 0.5)).unwrap();
    strict.assert_refused(1, &["in mode decoded", "differs by"]);
    assert_eq!(strict.json()["passed"], false, "the figures come even so");
}

#[test]
fn what_cannot_be_compared_is_refused() {
    let folder = made(16);
    let here = folder.path();
    relight(here, "bake capture -o a.ktx2").ok();
    relight(here, "bake capture -o linear.ktx2 --space linear").ok();
    relight(here, "verify a.ktx2 --against linear.ktx2").assert_refused(2, &["--tolerance"]);
    relight(here, "verify a.ktx2 --against linear.ktx2 --tolerance 1")
        .assert_refused(3, &["a.ktx2 and linear.ktx2 differ in values", "linear"]);
    relight(here, "verify a.ktx2 --tolerance -1").assert_refused(2, &["'-1'"]);
    relight(here, "verify a.ktx2 --backend dx9").assert_refused(2, &["'dx9' is not one of any, vulkan, gl"]);
    relight(here, "verify none.ktx2").assert_refused(4, &["none.ktx2"]);
}

#[cfg(target_os = "linux")]
#[test]
fn without_an_adapter_it_says_so_in_a_sentence() {
    let folder = made(16);
    let here = folder.path();
    relight(here, "bake capture -o a.ktx2").ok();
    for (flag, words) in [
        ("", "verification skipped: this machine has no adapter"),
        ("--require-gpu", "this machine has no adapter"),
    ] {
        let line = format!("verify a.ktx2 --backend vulkan {flag}");
        let mut command = command_without_noise(here);
        command.env("VK_ICD_FILENAMES", "/nonexistent").env("VK_DRIVER_FILES", "/nonexistent");
        command.env_remove("RELIGHT_REQUIRE_GPU");
        let refused = outcome(line.clone(), command.args(line.split_whitespace()).output().unwrap());
        refused.assert_refused(6, &[words, "mesa-vulkan-drivers"]);
        assert_eq!(refused.stderr.contains("skipped"), flag.is_empty());
    }
}
