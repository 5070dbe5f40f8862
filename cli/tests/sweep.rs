//! `relight sweep`: fronts that are fronts, choices that `bake` takes too, and runs that go on where they stopped.

#![allow(clippy::unwrap_used, reason = "a test's helpers fail as the test does")]

mod scene;

use scene::{copy_icon72, icon72, names_in, relight, relight_words};
use serde_json::Value;
use std::fs;
use std::path::Path;

const AXES: &str = "basis=ptm/sh/pca,k=6/9,block=none/bc1";

/// The program on a part of the real capture.
fn run(folder: &Path, command: &str, options: &str) -> scene::Outcome {
    let input = icon72();
    let words = [command, input.to_str().unwrap(), "--crop", "64x48+160+180"];
    relight_words(folder, &words.into_iter().chain(options.split_whitespace()).collect::<Vec<_>>())
}

fn report(folder: &Path) -> Value {
    serde_json::from_str(&fs::read_to_string(folder.join("report.json")).unwrap()).unwrap()
}

/// The figures that don't depend on the minute.
fn without_times(mut report: Value) -> Value {
    let times = ["seconds", "bake_seconds", "directional_ns", "point_ns", "gpu", "front"];
    for choice in report["choices"].as_array_mut().unwrap() {
        let choice = choice.as_object_mut().unwrap();
        times.iter().for_each(|time| drop(choice.remove(*time)));
    }
    let all = report.as_object_mut().unwrap();
    ["seconds", "seconds_alone", "stages", "measured"].iter().for_each(|time| drop(all.remove(*time)));
    report
}

fn assets(folder: &Path) -> Vec<(String, Vec<u8>)> {
    let names = names_in(&folder.join("assets"));
    names
        .into_iter()
        .map(|name| (name.clone(), fs::read(folder.join("assets").join(name)).unwrap()))
        .collect()
}

#[test]
fn fronts_hold_what_no_other_choice_beats_and_bake_takes_the_same() {
    let folder = tempfile::tempdir().unwrap();
    let here = folder.path();
    run(here, "sweep", &format!("-o out --axes {AXES}")).ok();
    let report = report(&here.join("out"));
    scene::schema::check("sweep", &report);
    let choices = report["choices"].as_array().unwrap();
    // ptm 6, sh 9, pca 6 and 9, each plain and in blocks.
    assert_eq!(choices.len(), 8);
    let number = |choice: &Value, key: &str| choice[key].as_f64().unwrap();
    for (front, cost) in [("bytes", "texel_bytes"), ("time", "directional_ns"), ("bake", "bake_seconds")] {
        for choice in choices {
            let (c, q) = (number(choice, cost), number(choice, "psnr"));
            let beaten = choices.iter().any(|other| {
                let (oc, oq) = (number(other, cost), number(other, "psnr"));
                oc <= c && oq >= q && (oc < c || oq > q)
            });
            assert_eq!(choice["front"][front], !beaten, "{front} {}", choice["name"]);
        }
    }
    let on_front = |choice: &&Value| choice["front"]["bytes"] == true || choice["front"]["time"] == true;
    let mut kept: Vec<String> =
        choices.iter().filter(on_front).map(|c| format!("{}.ktx2", c["name"].as_str().unwrap())).collect();
    kept.sort();
    assert_eq!(names_in(&here.join("out/assets")), kept);

    // A plain choice and one in blocks, by the figures of a bake of its own.
    for name in ["sh-9", "pca-9-bc1"] {
        let choice = choices.iter().find(|choice| choice["name"] == name).unwrap();
        let options: Vec<&str> =
            choice["options"].as_array().unwrap().iter().map(|o| o.as_str().unwrap()).collect();
        run(here, "bake", &format!("-o a.ktx2 --report r.json {}", options.join(" "))).ok();
        let alone: Value = serde_json::from_str(&fs::read_to_string(here.join("r.json")).unwrap()).unwrap();
        let storing = alone["storing"]["relit_rmse"].as_f64().unwrap();
        let lights = alone["lights"].as_array().unwrap();
        let psnr = |light: &Value| {
            let error = light["leave_one_out_rmse"].as_f64().unwrap();
            -10.0 * libm::log10(error * error + storing * storing)
        };
        let mean = lights.iter().map(psnr).sum::<f64>() / lights.len() as f64;
        assert!((mean - number(choice, "psnr")).abs() < 1e-6, "{name}: {mean}");
        // The file of a bake also says what it was made of; alignment may take some bytes more.
        let made_of = relight_formats::read_asset(&here.join("a.ktx2"), 1 << 30).unwrap().model.provenance;
        let said = serde_json::to_string(&made_of).unwrap().len() as f64;
        let bytes = fs::metadata(here.join("a.ktx2")).unwrap().len() as f64;
        let more = bytes - said - number(choice, "file_bytes");
        assert!((0.0..64.0).contains(&more), "{name}: {more}");
    }
}

/// `bake` with a target measures as a sweep over the usual grid does, and takes what that takes.
#[test]
fn bake_takes_what_the_sweeps_front_gives_for_a_target() {
    let folder = tempfile::tempdir().unwrap();
    let here = folder.path();
    // Of the whole usual grid: between figures that are there, at them, and above all.
    run(here, "sweep", "-o usual --keep none").ok();
    let report = report(&here.join("usual"));
    let choices = report["choices"].as_array().unwrap();
    let points: Vec<(f64, f64, &str)> = choices
        .iter()
        .map(|c| {
            (c["texel_bytes"].as_f64().unwrap(), c["psnr"].as_f64().unwrap(), c["name"].as_str().unwrap())
        })
        .collect();
    let best = points.iter().map(|point| point.1).fold(0.0, f64::max);
    for target in [best - 6.0, best - 2.5, best - 0.4] {
        let reach = points.iter().filter(|point| point.1 >= target);
        let wanted = reach.min_by(|a, b| a.0.total_cmp(&b.0).then(b.1.total_cmp(&a.1))).unwrap();
        let bake = run(here, "bake", &format!("-o t.ktx2 --target-psnr {target}"));
        assert!(
            bake.stderr.contains(&format!("{} reaches", wanted.2)),
            "{target}: {wanted:?}\n{}",
            bake.stderr
        );
        assert_eq!(bake.code, Some(0));
    }
    let budget = points[4].0 as u64;
    let wanted = points.iter().filter(|p| p.0 <= budget as f64).max_by(|a, b| a.1.total_cmp(&b.1)).unwrap();
    let bake = run(here, "bake", &format!("-o t.ktx2 --budget-bytes {budget}"));
    assert!(bake.stderr.contains(&format!("{} reaches", wanted.2)), "{wanted:?}\n{}", bake.stderr);
    let before = fs::read(here.join("t.ktx2")).unwrap();
    let missed = run(here, "bake", "-o t.ktx2 --target-psnr 90");
    assert_eq!(missed.code, Some(1), "{}", missed.stderr);
    let name = points.iter().find(|point| point.1 == best).unwrap().2;
    assert!(
        missed.stderr.contains(&format!("no choice reaches 90 dB; the best, {name} reaches {best:.2} dB")),
        "{}",
        missed.stderr
    );
    assert!(fs::read(here.join("t.ktx2")).unwrap() == before);
    assert!(names_in(&here.join("usual/assets")).is_empty());
    assert_eq!(names_in(here), ["t.ktx2", "usual"], "nothing else is left");
}

#[test]
fn an_interrupted_sweep_goes_on_and_ends_the_same() {
    let folder = tempfile::tempdir().unwrap();
    let here = folder.path();
    run(here, "sweep", &format!("-o whole --keep all --axes {AXES}")).ok();
    let whole = (without_times(report(&here.join("whole"))), assets(&here.join("whole")));
    // What a run that stopped half-way leaves: some choices with their assets, some asset without its figures.
    run(here, "sweep", &format!("-o part --keep all --axes {AXES}")).ok();
    for name in ["sh-9", "pca-6-bc1"] {
        fs::remove_file(here.join(format!("part/choices/{name}.json"))).unwrap();
    }
    fs::remove_file(here.join("part/assets/sh-9.ktx2")).unwrap();
    fs::remove_file(here.join("part/report.json")).unwrap();
    fs::write(here.join("part/choices/ptm-6.json"), "{ cut short").unwrap();
    let again = run(here, "sweep", &format!("-o part --keep all --axes {AXES}"));
    assert!(again.stderr.contains("5 of 8 choices are taken up"), "{}", again.stderr);
    assert_eq!(report(&here.join("part"))["measured"], 3);
    assert!((without_times(report(&here.join("part"))), assets(&here.join("part"))) == whole);
    // A run with other pictures or options takes nothing up.
    let other = run(here, "sweep", &format!("-o part --keep all --axes {AXES} --ridge 0.01"));
    assert!(!other.stderr.contains("taken up"), "{}", other.stderr);
    // Assets that an earlier run did not keep are made again, by the figures that are there.
    run(here, "sweep", &format!("-o whole --keep none --axes {AXES}")).ok();
    assert!(assets(&here.join("whole")).is_empty());
    run(here, "sweep", &format!("-o whole --keep all --axes {AXES}")).ok();
    assert!((without_times(report(&here.join("whole"))), assets(&here.join("whole"))) == whole);
}

#[test]
fn figures_are_taken_up_wherever_the_pictures_lie_and_only_of_the_same_ones() {
    let folder = tempfile::tempdir().unwrap();
    let here = folder.path();
    copy_icon72(&here.join("one"), 4);
    fs::write(here.join("lamps.txt"), "1\n".repeat(18)).unwrap();
    let sweep = |capture: &str, lamps: &str| {
        let line = [
            "sweep",
            capture,
            "-o",
            "out",
            "--axes",
            "basis=ptm",
            "--crop",
            "64x48+160+180",
            "--intensities",
            lamps,
        ];
        relight_words(here, &line).ok().stderr
    };
    sweep("one", "lamps.txt");
    fs::rename(here.join("one"), here.join("another place")).unwrap();
    fs::rename(here.join("lamps.txt"), here.join("l.txt")).unwrap();
    assert!(sweep("another place", "l.txt").contains("1 of 1 choices are taken up"));
    let picture = here.join("another place").join("image05.jpg");
    let mut bytes = fs::read(&picture).unwrap();
    bytes.push(0);
    fs::write(&picture, bytes).unwrap();
    assert!(!sweep("another place", "l.txt").contains("taken up"));
    fs::write(here.join("l.txt"), "2\n".repeat(18)).unwrap();
    assert!(!sweep("another place", "l.txt").contains("taken up"));
}

#[test]
fn left_out_pictures_judge_as_evaluate_does() {
    let folder = tempfile::tempdir().unwrap();
    let here = folder.path();
    let line = "--keep all --axes basis=hsh/pca,k=9,block=none/bc7 --holdout every:6";
    run(here, "sweep", &format!("-o out {line} -j 1")).ok();
    run(here, "bake", "-o a.ktx2 --basis pca -k 9 --block bc7 --holdout every:6 --report r.json").ok();
    let alone: Value = serde_json::from_str(&fs::read_to_string(here.join("r.json")).unwrap()).unwrap();
    let report = report(&here.join("out"));
    let choice = report["choices"].as_array().unwrap().iter().find(|c| c["name"] == "pca-9-bc7").unwrap();
    assert_eq!(choice["psnr"], alone["holdout"]["mean"]["psnr"]);
    assert_eq!(choice["rmse"], alone["holdout"]["mean"]["rmse"]);
    assert_eq!(report["judges"], 12);
    assert!(scene::maps_of(&here.join("a.ktx2")) == scene::maps_of(&here.join("out/assets/pca-9-bc7.ktx2")));
}

#[test]
fn what_is_no_sweep_is_refused() {
    let folder = tempfile::tempdir().unwrap();
    let here = folder.path();
    fs::write(here.join("file"), "mine").unwrap();
    let refused = |line: &str, code: i32, words: &str| {
        let run = run(here, "sweep", line);
        assert!(
            run.code == Some(code) && run.stderr.contains(words),
            "{line}: {:?} {}",
            run.code,
            run.stderr
        );
    };
    refused("-o file", 2, "is a file");
    refused("-o out --axes colour", 2, "there is no axis 'colour'");
    refused("-o out --axes basis=fourier", 2, "unknown basis 'fourier'");
    refused("-o out --axes block=bc9", 2, "--axes block: write none, auto or a format");
    refused("-o out --axes basis=ptm,k=7", 2, "none of the families has 7 functions");
    refused("-o out --axes basis,k --basis sh", 2, "leave out --basis");
    assert!(!here.join("out").exists(), "nothing was made");
    refused("-o missing/out/x.json/ --axes k --holdout every:1", 2, "every:N");
    assert_eq!(fs::read(here.join("file")).unwrap(), b"mine");
    let missing = relight(here, "sweep nowhere.lp -o out2");
    assert_eq!((missing.code, here.join("out2").exists()), (Some(4), false));
}
