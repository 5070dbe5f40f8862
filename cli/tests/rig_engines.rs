//! Rigs for engines: exports that agree with each other, shader text, and the check on a GPU.

#![allow(clippy::unwrap_used, reason = "a test's helpers fail as the test does")]

mod scene;

use scene::{Outcome, relight};
use serde_json::Value;
use std::path::{Path, PathBuf};

fn testdata(name: &str) -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("../testdata/rigs").join(name)
}

/// A folder with a rig of the figure, two nodes along x, a slope along y, nothing along z.
fn with_rig() -> tempfile::TempDir {
    let folder = tempfile::tempdir().unwrap();
    let mesh = testdata("figure.glb");
    let line = format!("rig bake {} --model mixed:2,gradient,constant -o a.rig", mesh.display());
    relight(folder.path(), &line).ok();
    folder
}

fn export(folder: &Path, options: &str) -> Value {
    let scene = testdata("small.toml");
    let line = format!("rig export a.rig --scene {} {options} -o a.json", scene.display());
    relight(folder, &line).ok();
    serde_json::from_slice(&std::fs::read(folder.join("a.json")).unwrap()).unwrap()
}

fn floats(value: &Value) -> Vec<f64> {
    value.as_array().unwrap().iter().map(|v| v.as_f64().unwrap()).collect()
}

/// Weights of the model at coordinates of the box, as docs/formats.md has them.
fn weights(part: &Value, at: [f64; 3]) -> Vec<f64> {
    let of_axis = |function: &Value, at: f64| match function.as_str() {
        Some("one") => 1.0,
        Some(_) => at,
        None => {
            let [node, nodes] = ["node", "nodes"].map(|field| function[field].as_f64().unwrap());
            (1.0 - (at - (2.0 * node / (nodes - 1.0) - 1.0)).abs() * (nodes - 1.0) / 2.0).max(0.0)
        }
    };
    let list = part["weights"].as_array().unwrap();
    list.iter().map(|product| (0..3).map(|axis| of_axis(&product[axis], at[axis])).product()).collect()
}

/// The sum of a part's vectors by their weights: value, then R, G, B.
fn blended(part: &Value, at: [f64; 3]) -> Vec<[f64; 3]> {
    let vectors = part["vectors"].as_array().unwrap();
    let mut sum = vec![[0.0; 3]; vectors[0].as_array().unwrap().len()];
    for (vector, weight) in vectors.iter().zip(weights(part, at)) {
        for (sum, value) in sum.iter_mut().zip(vector.as_array().unwrap()) {
            floats(value).into_iter().zip(sum).for_each(|(value, sum)| *sum += weight * value);
        }
    }
    sum
}

const PLACES: [[f64; 3]; 4] = [[-1.0, -1.0, -1.0], [1.0, 1.0, 0.5], [0.25, -0.5, 1.0], [-0.75, 0.125, 0.0]];
const NORMALS: [[f64; 3]; 4] = [[0.6, 0.0, 0.8], [0.0, -0.6, -0.8], [-0.48, 0.8, 0.36], [0.36, -0.48, 0.8]];

fn polynomial(values: &[[f64; 3]], [x, y, z]: [f64; 3]) -> [f64; 3] {
    let terms = [1.0, y, z, x, x * y, y * z, 3.0 * z * z - 1.0, x * z, x * x - y * y];
    [0, 1, 2].map(|c| values.iter().zip(terms).map(|(value, term)| value[c] * term).sum())
}

#[test]
fn all_targets_say_the_same_of_a_point() {
    let folder = with_rig();
    let here = folder.path();
    let filament = export(here, "--target filament");
    let part = &filament["parts"][0];
    assert_eq!(part["vectors"].as_array().unwrap().len(), 4);
    let unity = export(here, "--target unity");
    assert_eq!(unity["axes"], "-x,y,z");
    let turned = export(here, "--target filament --axes x,z,-y");
    let radiance = export(here, "--target directxmath");
    let bevy = export(here, "--target bevy");
    for (at, normal) in PLACES.into_iter().zip(NORMALS) {
        let [x, y, z] = normal;
        let expected = polynomial(&blended(part, at), normal);
        assert!(expected.iter().all(|value| (0.01..10.0).contains(value)), "{expected:?}");
        let same = |got: [f64; 3], what: &str| {
            let off = (0..3).map(|c| (got[c] - expected[c]).abs()).fold(0.0, f64::max);
            assert!(off < 1e-5, "{what}: {got:?} {expected:?}");
        };
        let unity = blended(&unity["parts"][0], [-at[0], at[1], at[2]]);
        same(polynomial(&unity, [-x, y, z]), "unity");
        let turned = blended(&turned["parts"][0], [at[0], at[2], -at[1]]);
        same(polynomial(&turned, [x, z, -y]), "--axes");
        // Cosine lobe over pi times the factor of each polynomial, with the phase.
        let factors =
            [0.282095, -0.325735, 0.325735, -0.325735, 0.273137, -0.273137, 0.078848, -0.273137, 0.136569];
        let of_radiance: Vec<_> = blended(&radiance["parts"][0], at)
            .into_iter()
            .zip(factors)
            .map(|(value, factor)| value.map(|v| v * factor))
            .collect();
        same(polynomial(&of_radiance, normal), "directxmath");
    }
    // Bevy's cell at the corner of the box: the even part on the axes and 5/4 of the odd one.
    let volume = &bevy["parts"][0]["volume"];
    assert_eq!(volume["cells"], serde_json::json!([2, 2, 1]));
    assert_eq!(volume["texture"], serde_json::json!([2, 4, 3]));
    let p = blended(part, [1.0, -1.0, 0.0]);
    let texel = |x: usize, y: usize, z: usize| floats(&volume["texels"][x + 2 * (y + 4 * z)]);
    for c in 0..3 {
        let expected = [
            (texel(1, 0, 0), p[0][c] - p[6][c] + p[8][c] + 1.25 * p[3][c]),
            (texel(1, 2, 0), p[0][c] - p[6][c] + p[8][c] - 1.25 * p[3][c]),
            (texel(1, 2, 1), p[0][c] - p[6][c] - p[8][c] - 1.25 * p[1][c]),
            (texel(1, 0, 2), p[0][c] + 2.0 * p[6][c] + 1.25 * p[2][c]),
        ];
        assert!(expected.iter().all(|(got, expected)| (got[c] - expected).abs() < 1e-5), "{expected:?}");
    }
}

#[test]
fn zh3_has_five_values_and_words_are_checked() {
    let folder = with_rig();
    let here = folder.path();
    let zh3 = export(here, "--zh3");
    assert_eq!((zh3["target"].as_str(), zh3["values"].as_array().unwrap().len()), (Some("zh3"), 5));
    assert_eq!(blended(&zh3["parts"][0], [0.0; 3]).len(), 5);
    let scene = testdata("small.toml");
    for (options, word) in [
        ("--target cryengine", "directxmath"),
        ("--target unity --axes x,y,y", "-x,y,z"),
        ("--target unity --zh3", "cannot be used"),
        ("", "--target"),
    ] {
        let line = format!("rig export a.rig --scene {} {options} -o b.json", scene.display());
        let outcome = relight(here, &line);
        assert_eq!(outcome.code, Some(2), "{line}: {}", outcome.stderr);
        assert!(outcome.stderr.contains(word), "{line}: {}", outcome.stderr);
        assert!(!here.join("b.json").exists());
    }
}

#[test]
fn shaders_of_rigs_have_what_was_asked_for() {
    let folder = with_rig();
    let here = folder.path();
    let text = relight(here, "shader a.rig --lang glsl").ok().stdout.clone();
    assert!(text.contains("vec3 relight_reflectance(vec3 position, vec3 normal)"), "{text}");
    assert!(!text.contains("sphere"), "{text}");
    let text = relight(here, "shader a.rig --lights sphere").ok().stdout.clone();
    assert!(text.contains("fn relight_sphere_reflectance("), "{text}");
    for (options, word) in [("--table t.ktx2", "--table"), ("--part arm", "--part")] {
        let outcome: Outcome = relight(here, &format!("shader a.rig {options}"));
        assert_eq!(outcome.code, Some(2));
        assert!(outcome.stderr.contains(word), "{}", outcome.stderr);
    }
}

/// Without an adapter this says that it skips, unless RELIGHT_REQUIRE_GPU is 1.
#[cfg(feature = "gpu")]
#[test]
fn a_rig_passes_on_the_gpu_and_fails_where_nothing_is_allowed() {
    let folder = with_rig();
    let here = folder.path();
    let outcome = relight(here, "verify a.rig --json --count 3");
    if outcome.code == Some(6) {
        let required = std::env::var("RELIGHT_REQUIRE_GPU").is_ok_and(|value| value == "1");
        assert!(!required, "RELIGHT_REQUIRE_GPU is 1: {}", outcome.stderr);
        println!("skipped: {}", outcome.stderr);
        return;
    }
    let found = outcome.ok().json();
    let comparisons = found["comparisons"].as_array().unwrap();
    assert_eq!((found["passed"].as_bool(), comparisons.len()), (Some(true), 2));
    for comparison in comparisons {
        assert!(comparison["samples"].as_u64().unwrap() > 2000, "{comparison}");
        let share = comparison["worst"]["share"].as_f64().unwrap();
        // Rounding shows, and is no tenfold below what is allowed.
        assert!((0.02..1.0).contains(&share), "{comparison}");
    }
    let failed = relight(here, "verify a.rig --tolerance 1e-12");
    assert_eq!(failed.code, Some(1));
    assert!(failed.stderr.contains("is allowed"), "{}", failed.stderr);
    let refused = relight(here, "verify a.rig --mode native");
    assert_eq!(refused.code, Some(2));
    assert!(refused.stderr.contains("--mode is for textures"), "{}", refused.stderr);
}
