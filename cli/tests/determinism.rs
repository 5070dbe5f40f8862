//! The same input gives the same bytes, whatever the machine does.

#![allow(clippy::unwrap_used, reason = "a test's helpers fail as the test does")]

mod scene;

use relight_core::CpuLevel;
use scene::{command, json_of, made, number, outcome, relight};
use serde_json::Value;
use std::fs;
use std::path::Path;

/// A report without what may differ between runs.
fn lasting(path: &Path) -> Value {
    let mut report = json_of(path);
    for key in ["seconds", "output", "spilled_bytes"] {
        assert!(report.as_object_mut().unwrap().remove(key).is_some(), "no {key} in the report");
    }
    report
}

/// Ways of running that must not show in the result.
fn machines() -> Vec<String> {
    let mut machines: Vec<String> = ["-j 1", "-j 3"].map(str::to_owned).into();
    machines.extend(CpuLevel::available().map(|level| format!("--cpu {}", level.name())));
    machines
}

#[test]
fn threads_instruction_sets_and_memory_do_not_show_in_files() {
    let folder = tempfile::tempdir().unwrap();
    let here = folder.path();
    scene::copy_icon72(&here.join("capture"), 3);
    for options in [
        "-o a.ktx2 --basis hsh -k 16",
        "-o a.ktx2 --basis srbf -k 12 --precision f16 --color lrgb",
        "-o a.ktx2 --block bc7 --quality fast --mips --zstd=3",
        "-o a.dds --block auto --quality fast --color lrgb",
        "-o a.exr --basis ptm -k 10",
        "-o a.ptm",
        "-o a.ptm --color lrgb",
    ] {
        let file = options.split(' ').nth(1).unwrap();
        let line = format!("bake capture --report r.json {options}");
        let result = || (fs::read(here.join(file)).unwrap(), lasting(&here.join("r.json")));
        relight(here, &line).ok();
        let (bytes, report) = result();
        let assert_same = |how: &str| {
            let (other, other_report) = result();
            let first = bytes.iter().zip(&other).position(|(a, b)| a != b);
            assert_eq!((first, bytes.len()), (None, other.len()), "{options} {how}: first other byte");
            assert_eq!(report, other_report, "{options} {how}");
        };
        for machine in machines() {
            relight(here, &format!("{line} {machine}")).ok();
            assert_same(&machine);
        }
        scene::relight_in_least_memory(here, &line).ok();
        assert_same("in the least memory");
        let spilled = number(&json_of(&here.join("r.json")), "spilled_bytes");
        assert!(spilled > 1e6, "{options}: {spilled} bytes went to a temporary file");
    }
}

#[test]
fn folders_and_spelling_of_paths_do_not_show_in_files() {
    let folder = made(20);
    let here = folder.path();
    fs::create_dir_all(here.join("elsewhere/below")).unwrap();
    let absolute = here.join("capture/lights.lp");
    for (name, options) in
        [("a.ktx2", ""), ("a.ktx2", "--precision f16"), ("a.exr", "--basis sh"), ("a.ptm", "")]
    {
        let bake = |folder: &Path, input: &str, output: &str| {
            let line = format!("bake {input} -o {output} {options} --holdout every:6 --report {output}.json");
            let ran = relight(folder, &line).ok();
            let report = lasting(&folder.join(format!("{output}.json")));
            (fs::read(folder.join(output)).unwrap(), report, ran.stderr)
        };
        let expected = bake(here, "capture", name);
        assert!(expected == bake(here, "./elsewhere/../capture/", &format!("./elsewhere//{name}")));
        assert!(expected == bake(&here.join("elsewhere/below"), "../../capture/lights.lp", name));
        let moved = here.join(format!("elsewhere/below/x{name}"));
        assert!(
            expected == bake(&here.join("elsewhere"), absolute.to_str().unwrap(), moved.to_str().unwrap())
        );
    }
}

#[test]
fn renderings_and_evaluations_do_not_depend_on_the_machine() {
    let folder = tempfile::tempdir().unwrap();
    let here = folder.path();
    scene::copy_icon72(&here.join("capture"), 6);
    relight(here, "bake capture -o a.ktx2 --basis srbf -k 9").ok();
    let run = |machine: &str| {
        let line = "render a.ktx2 -o a.png --depth 16 --light -1,2,1,0.9,0.5,0.25 --angles 40,30";
        relight(here, &format!("{line} {machine}")).ok();
        let said =
            relight(here, &format!("evaluate a.ktx2 capture --json --heatmap h.png {machine}")).ok().stdout;
        let bytes = |name: &str| fs::read(here.join(name)).unwrap();
        (bytes("a.png"), bytes("h.png"), said)
    };
    let expected = run("");
    for machine in machines() {
        assert!(expected == run(&machine), "{machine}");
    }
}

#[test]
fn the_locale_and_the_temporary_folder_do_not_matter() {
    let folder = made(12);
    let here = folder.path();
    relight(here, "bake capture -o a.ktx2 --report a.json").ok();
    fs::create_dir(here.join("tmp")).unwrap();
    let line = "bake capture -o b.ktx2 --report b.json";
    let run = command(here)
        .args(line.split(' '))
        .envs([("LC_ALL", "de_DE.UTF-8"), ("TZ", "Asia/Tokyo"), ("TMPDIR", "tmp")])
        .output()
        .unwrap();
    outcome(line.to_owned(), run).ok();
    assert!(fs::read(here.join("a.ktx2")).unwrap() == fs::read(here.join("b.ktx2")).unwrap());
    assert_eq!(lasting(&here.join("a.json")), lasting(&here.join("b.json")));
    assert!(scene::names_in(&here.join("tmp")).is_empty());
}
