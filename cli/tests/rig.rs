//! Rigs from the command line: baked, planned, drawn and reported on.

#![allow(clippy::unwrap_used, reason = "a test's helpers fail as the test does")]

mod scene;

use scene::{Outcome, json_of, relight};
use std::path::{Path, PathBuf};

fn testdata(name: &str) -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("../testdata/rigs").join(name)
}

fn bake(folder: &Path, mesh: &str, options: &str, rig: &str) -> Outcome {
    relight(folder, &format!("rig bake {} {options} -o {rig}", testdata(mesh).display()))
}

#[test]
fn a_mixed_rig_of_six_vectors_stands_up_to_a_lattice_of_64_on_a_car() {
    // Irradiance Rigs, section 2.1: comparable to 8 x 4 x 2 nodes, better than 12.
    let folder = tempfile::tempdir().unwrap();
    let at = folder.path();
    bake(at, "car.glb", "--model mixed:3,gradient,constant", "car.rig").ok();
    relight(at, "rig report car.rig --json r.json --models mixed:3,constant,gradient;lattice:8x4x2;lattice:2x2x3;gradient;constant --distances 2,3,4,6,12").ok();
    let report = json_of(&at.join("r.json"));
    let rows = report["models"].as_array().unwrap();
    let errors = |model: &str, way: &str| -> Vec<f64> {
        let row = rows.iter().find(|row| row["model"] == model && row["fitted"] == way).unwrap();
        row["rig"].as_array().unwrap().iter().map(|v| v.as_f64().unwrap()).collect()
    };
    let mixed = errors("mixed:3,constant,gradient", "least squares");
    println!("mixed {mixed:?}");
    for model in ["lattice:8x4x2", "lattice:2x2x3", "gradient", "constant"] {
        println!("{model} {:?} nodes {:?}", errors(model, "least squares"), errors(model, "nodes"));
    }
    // What least squares minimises is not the largest error, but it is below that of nodes all the same where a model has
    // more than one vector.
    for model in ["lattice:2x2x3", "gradient", "mixed:3,constant,gradient"] {
        let (fitted, nodes) = (errors(model, "least squares"), errors(model, "nodes"));
        assert!(fitted[2] < 1.1 * nodes[2], "{model}: {} for {}", fitted[2], nodes[2]);
    }
}

#[test]
fn auto_meets_its_target_or_says_what_comes_nearest() {
    let folder = tempfile::tempdir().unwrap();
    let at = folder.path();
    bake(at, "car.glb", "--target-error 12 --samples 128 --report a.json", "a.rig").ok();
    let part = &json_of(&at.join("a.json"))["parts"][0];
    assert!(part["error_grey"].as_f64().unwrap() <= 12.0, "{part}");
    assert!(part["tried"].as_array().unwrap().len() > 2);
    let refused = bake(at, "car.glb", "--target-error 1e-9 --samples 16 --nearest 1.2", "b.rig");
    refused.assert_refused(1, &["raise --target-error"]);
    assert!(!at.join("b.rig").exists());
}

#[test]
fn a_plan_is_drawn_within_its_tolerance_whatever_the_threads() {
    let folder = tempfile::tempdir().unwrap();
    let at = folder.path();
    bake(at, "figure.glb", "--parts --model gradient --samples 64 --bands 5", "f.rig").ok();
    let (mesh, small) = (testdata("figure.glb"), testdata("small.toml"));
    relight(at, &format!("rig plan f.rig --scene {} --tolerance 2 -o plan.json", small.display())).ok();
    let plan = json_of(&at.join("plan.json"));
    assert_eq!(plan["pictures"].as_array().unwrap().len(), 4);
    assert_eq!(plan["pictures"][0]["parts"].as_array().unwrap().len(), 6);
    for picture in plan["pictures"].as_array().unwrap() {
        assert!(picture["error_grey"].as_f64().unwrap() <= 2.0);
        for part in picture["parts"].as_array().unwrap() {
            assert_eq!(part["lights"][2]["way"], "rig", "a probe of two bands is exact in a rig: {part}");
        }
    }
    let draw = |options: &str| {
        let line = format!(
            "rig render f.rig --mesh {} --scene {} --tolerance 2 --size 160x200 {options}",
            mesh.display(),
            small.display()
        );
        relight(at, &line).ok().stdout
    };
    let words = draw("-o many --difference d -j2");
    let grey = words.split("largest difference ").nth(1).and_then(|rest| rest.split(' ').next()).unwrap();
    assert!(grey.parse::<f64>().unwrap() <= 2.0, "{words}");
    draw("-o one -j1 --cpu baseline");
    for frame in 1..=4 {
        let name = format!("frame_{frame:04}.png");
        let [a, b] = ["many", "one"].map(|folder| std::fs::read(at.join(folder).join(&name)).unwrap());
        assert_eq!(a, b, "{name}");
    }
    // The rig alone errs more: it is the plan that keeps the tolerance.
    let words = draw("-o rig --by rig --difference e");
    let alone = words.split("largest difference ").nth(1).and_then(|rest| rest.split(' ').next()).unwrap();
    assert!(alone.parse::<f64>().unwrap() > 2.0, "{words}");
}

#[test]
fn only_what_a_scene_calls_for_is_written() {
    let folder = tempfile::tempdir().unwrap();
    let at = folder.path();
    bake(at, "car.glb", "--model gradient --samples 64", "a.rig").ok();
    let far =
        "[[light]]\nkind = \"sphere\"\nposition = [400.0, 0.0, 90.0]\nradius = 1.0\nintensity = 2000.0\n";
    std::fs::write(at.join("far.toml"), far).unwrap();
    let words =
        relight(at, "rig plan a.rig --scene far.toml --tolerance 8 --table t.exr -o p.json").ok().stdout;
    assert!(words.contains("t.exr: not written") && !at.join("t.exr").exists(), "{words}");
    assert_eq!(json_of(&at.join("p.json"))["tables"], serde_json::json!([]));
    std::fs::write(
        at.join("near.toml"),
        far.replace("400.0, 0.0, 90.0", "3.0, 0.0, 0.9").replace("2000", "2"),
    )
    .unwrap();
    relight(at, "rig plan a.rig --scene near.toml --table t.exr -o p.json").ok();
    assert!(at.join("t.exr").exists());
    assert_eq!(json_of(&at.join("p.json"))["tables"], serde_json::json!(["sphere"]));
    // No light at all is black, not an error.
    std::fs::write(at.join("none.toml"), "").unwrap();
    relight(
        at,
        &format!("rig render a.rig --mesh {} --scene none.toml -o n.png", testdata("car.glb").display()),
    )
    .ok();
}

#[test]
fn what_makes_no_sense_is_refused_in_a_sentence() {
    let folder = tempfile::tempdir().unwrap();
    let at = folder.path();
    bake(at, "car.glb", "--model cubic", "a.rig").assert_refused(2, &["lattice:XxYxZ"]);
    bake(at, "car.glb", "--samples 0", "a.rig").assert_refused(2, &["1..1024"]);
    bake(at, "car.glb", "--bands 8", "a.rig").assert_refused(2, &["1..=7"]);
    bake(at, "car.glb", "--nearest 0.5", "a.rig").assert_refused(2, &["more than 1 radius"]);
    assert!(!at.join("a.rig").exists());
    bake(at, "car.glb", "--model gradient --samples 32", "a.rig").ok();
    let room = testdata("room.toml");
    relight(at, &format!("rig plan a.rig --scene {}", room.display()))
        .assert_refused(3, &["bake it again with --parts"]);
    let figure = testdata("figure.glb");
    let line = format!(
        "rig render a.rig --mesh {} --scene {} -o x.png",
        figure.display(),
        testdata("flyby.toml").display()
    );
    relight(at, &line).assert_refused(3, &["another mesh"]);
    std::fs::write(
        at.join("spot.toml"),
        "[[light]]\nkind = \"spot\"\nposition = [0, 0, 3]\ntarget = [0, 0, 0]\ncone_deg = 20\n",
    )
    .unwrap();
    relight(at, "rig plan a.rig --scene spot.toml").assert_refused(3, &["spot"]);
    relight(at, "rig report a.rig --distances 0.5").assert_refused(2, &["within the mesh's sphere"]);
    let sequence = format!(
        "rig render a.rig --mesh {} --scene {} -o",
        testdata("car.glb").display(),
        testdata("flyby.toml").display()
    );
    relight(at, &format!("{sequence} x.png")).assert_refused(2, &["x.png: a sequence is a folder"]);
    relight(at, &format!("{sequence} x --difference x"))
        .assert_refused(2, &["another file of this command too"]);
    relight(at, "rig report a.rig -o x.png").assert_refused(2, &["ends in .svg"]);
    bake(at, "car.glb", "--model constant", "a.foo").assert_refused(2, &["ends in .rig"]);
    relight(at, &format!("rig plan a.rig --scene {} --tolerance -1", testdata("flyby.toml").display()))
        .assert_refused(2, &["'-1'"]);
    assert_eq!(std::fs::read_dir(at).unwrap().count(), 2);
    let info = relight(at, "info a.rig").ok().stdout;
    assert!(info.contains("irradiance rig") && info.contains("gradient: vectors 4, samples 32"), "{info}");
    std::fs::write(at.join("bad.rig"), b"not a rig").unwrap();
    relight(at, "rig report bad.rig").assert_refused(3, &["bad.rig"]);
}

#[test]
fn light_below_0_is_reported_and_windows_say_what_they_cost() {
    let folder = tempfile::tempdir().unwrap();
    let at = folder.path();
    bake(at, "car.glb", "--model constant --samples 32", "a.rig").ok();
    // One sun rings most: by 3.7 % of its brightest in three bands.
    std::fs::write(
        at.join("sun.toml"),
        "[[light]]\nkind = \"directional\"\ndirection = [0.6, 0.0, 0.8]\nintensity = 3.0\n",
    )
    .unwrap();
    relight(at, "rig plan a.rig --scene sun.toml --tolerance 90 -o p.json").ok();
    let ringing = &json_of(&at.join("p.json"))["pictures"][0]["parts"][0]["ringing"];
    assert!(ringing["negative_share"].as_f64().unwrap() > 0.05, "{ringing}");
    // Of the light as planned, a part of it exact.
    assert!(ringing["lowest_over_brightest"].as_f64().unwrap() < -1e-3, "{ringing}");
    let draw = |options: &str| {
        let mesh = testdata("car.glb");
        let line = format!(
            "rig render a.rig --mesh {} --scene sun.toml --by rig --size 80x60 -o a.png",
            mesh.display()
        );
        relight(at, &format!("{line} {options}")).ok().stdout
    };
    let number = |words: &str, before: &str| -> f64 {
        let rest = words.split(before).nth(1).and_then(|rest| rest.split([' ', ';']).next()).unwrap();
        rest.trim().parse().unwrap()
    };
    // From behind, where it rings.
    let plain = draw("--from=-1,0.2,-0.4");
    let share = number(&plain, "the mesh: ");
    assert!(share > 2.0 && plain.contains("% of pixels below 0, down to -0."), "{plain}");
    let usual = draw("--from=-1,0.2,-0.4 --window hanning");
    assert!(usual.contains("bands count 1.00 0.750 0.250"), "{usual}");
    let least = draw("--from=-1,0.2,-0.4 --window least");
    let [with, without] =
        ["; largest difference ", "without the window: largest difference "].map(|b| number(&least, b));
    let hanning = number(&usual, "; largest difference ");
    assert!(with < hanning, "{with} of {without}, Hanning's {hanning}: {least}");
    // Points of the surface are clear of it, pixels between them nearly.
    let left = if least.contains("no pixels below 0") { 0.0 } else { number(&least, "the mesh: ") };
    assert!(left < 0.2 * share, "{least}");
    let refused = format!(
        "rig render a.rig --mesh {} --scene sun.toml --by brute-force --window least -o b.png",
        testdata("car.glb").display()
    );
    relight(at, &refused).assert_refused(2, &["--by rig or plan"]);
    let export = |window: &str| {
        relight(
            at,
            &format!("rig export a.rig --scene sun.toml --target filament --window {window} -o e.json"),
        )
        .ok();
        json_of(&at.join("e.json"))["parts"][0].clone()
    };
    let (least, hanning) = (export("least"), export("hanning"));
    let error = |part: &serde_json::Value| part["ringing"]["largest_error_grey"].as_f64().unwrap();
    assert_eq!(least["ringing"]["negative_share"], 0.0);
    assert!(least["ringing"]["without_window"]["negative_share"].as_f64().unwrap() > 0.05);
    assert!(error(&least) < error(&hanning), "{} {}", error(&least), error(&hanning));
    // What is written is what was windowed: band 1 by three quarters.
    relight(at, "rig export a.rig --scene sun.toml --target filament -o f.json").ok();
    let value = |part: &serde_json::Value, i: usize| part["vectors"][0][i][0].as_f64().unwrap();
    let plain = json_of(&at.join("f.json"))["parts"][0].clone();
    assert!((value(&hanning, 0) / value(&plain, 0) - 1.0).abs() < 1e-6);
    assert!((value(&hanning, 2) / value(&plain, 2) - 0.75).abs() < 1e-5);
}
