//! By what two bakes differ: prepared pairs, each of which differs in one component.

#![allow(clippy::unwrap_used, reason = "a test's helpers fail as the test does")]

mod scene;

use scene::{copy_icon72, names_in, relight, relight_words};
use serde_json::Value;
use std::fs;
use std::path::Path;

const CROP: &str = "--crop 64x48+160+180";

/// What `explain` says that `b` differs in from `a`.
fn told(here: &Path, a: &str, b: &str) -> Vec<String> {
    let differences = relight_words(here, &["explain", a, b, "--json"]).ok().json();
    let words = |difference: &Value| {
        let word = |key: &str| difference[key].as_str().unwrap().to_owned();
        format!("{} {}: {} -> {}", word("component"), word("name"), word("old"), word("new"))
    };
    differences.as_array().unwrap().iter().map(words).collect()
}

#[test]
fn each_changed_component_is_named_with_its_values() {
    let folder = tempfile::tempdir().unwrap();
    let here = folder.path();
    copy_icon72(&here.join("set"), 6);
    let bake = |name: &str, options: &str| {
        relight(here, &format!("bake set -o {name}.ktx2 --report {name}.json {CROP} {options}")).ok();
    };
    bake("base", "");
    // A flag of the fit, one of storing, one of the photographs.
    for (name, options, expected) in [
        ("basis", "--basis sh -k 6", None),
        ("ridge", "--ridge 0.001", Some("fit ridge: auto -> 0.001")),
        ("block", "--block bc4", Some("storing block: none -> bc4")),
        ("mips", "--mips", Some("storing mips: false -> true")),
        ("balance", "--white-balance 0.5,0.5,0.4", Some("fit white_balance: none -> 0.5,0.5,0.4")),
    ] {
        if name == "basis" {
            let run = relight(here, &format!("bake set -o basis.ktx2 {CROP} {options}"));
            assert!(run.code == Some(0) || run.code == Some(2), "{}", run.stderr);
            relight(here, &format!("bake set -o basis.ktx2 --report basis.json {CROP} --basis sh -k 4")).ok();
            let found = told(here, "base.ktx2", "basis.ktx2");
            assert_eq!(found, ["fit basis: ptm -> sh", "fit k: usual -> 4"]);
            continue;
        }
        bake(name, options);
        for extension in ["ktx2", "json"] {
            let found = told(here, &format!("base.{extension}"), &format!("{name}.{extension}"));
            assert_eq!(found, [expected.unwrap()], "{name}.{extension}");
        }
    }
    // The order of the light file does not matter.
    let lights = here.join("set/lights.lp");
    let text = fs::read_to_string(&lights).unwrap();
    let mut lines: Vec<String> = text.lines().skip(1).map(str::to_owned).collect();
    lines.reverse();
    scene::write_lines(&lights, &lines);
    bake("order", "");
    assert!(told(here, "base.ktx2", "order.ktx2").is_empty());
    let same = relight(here, "explain base.ktx2 order.json").ok();
    assert!(same.stdout.starts_with("both are of the key "), "{}", same.stdout);
    // A light.
    let moved: Vec<String> = lines
        .iter()
        .enumerate()
        .map(|(i, line)| {
            let name = line.split(' ').next().unwrap();
            if i == 3 { format!("{name} 0.6 0 0.8") } else { line.clone() }
        })
        .collect();
    scene::write_lines(&lights, &moved);
    bake("light", "");
    let found = told(here, "base.ktx2", "light.ktx2");
    assert!(
        found.len() == 1
            && found[0].starts_with("light of picture ")
            && found[0].ends_with("-> (0.6000, 0.0000, 0.8000)"),
        "{found:?}"
    );
    // A picture.
    scene::write_lines(&lights, &lines);
    let picture = names_in(&here.join("set")).into_iter().find(|name| name.ends_with("jpg")).unwrap();
    let bytes = fs::read(here.join("set").join(&picture)).unwrap();
    fs::write(here.join("set").join(&picture), [&bytes[..], b"!"].concat()).unwrap();
    bake("picture", "");
    let found = told(here, "base.ktx2", "picture.ktx2");
    assert!(found.len() == 1 && found[0].starts_with("picture under the light "), "{found:?}");
    fs::write(here.join("set").join(&picture), bytes).unwrap();
    // A picture less.
    scene::write_lines(&lights, &lines[1..]);
    bake("less", "");
    let found = told(here, "base.ktx2", "less.ktx2");
    assert!(found.len() == 1 && found[0].ends_with("-> none"), "{found:?}");
    scene::write_lines(&lights, &lines);
    // The tool.
    let mut report: Value = scene::json_of(&here.join("base.json"));
    report["provenance"]["abi"] = 999.into();
    fs::write(here.join("tool.json"), report.to_string()).unwrap();
    let found = told(here, "base.ktx2", "tool.json");
    assert!(
        found.len() == 1 && found[0].starts_with("tool ABI number: ") && found[0].ends_with("-> 999"),
        "{found:?}"
    );
    // Other formats that hold it.
    for name in ["b.dds", "b.exr"] {
        relight(here, &format!("bake set -o {name} --precision f16 {CROP}")).ok();
    }
    assert_eq!(told(here, "b.dds", "b.exr"), ["storing format: dds -> exr"]);
    assert_eq!(told(here, "b.json", "b.exr"), ["storing format: dds -> exr"]);
    // Jobs, keys and codes.
    let job = format!("input = 'set'\noutput = 'j.ktx2'\ncrop = '{}'\nmips = true\n", &CROP[7..]);
    fs::write(here.join("j.toml"), job).unwrap();
    assert!(told(here, "mips.ktx2", "j.toml").is_empty());
    relight(here, "bake j.toml --cache kept").ok();
    let key = relight(here, "key j.toml").ok().stdout.trim().to_owned();
    let run = relight(here, &format!("explain base.json {key} --cache kept --exit-code"));
    assert_eq!(run.code, Some(1));
    assert_eq!(run.stdout.lines().next(), Some("storing mips: false -> true"));
    assert!(run.stdout.contains("the fit is the same"), "{}", run.stdout);
    relight(here, "explain base.json base.ktx2 --exit-code").ok();
    relight(here, &format!("explain base.json {}", "0".repeat(64))).assert_refused(2, &["--cache"]);
    relight(here, "explain base.json none.ktx2").assert_refused(4, &["no such file"]);
    relight(here, &format!("bake set -o p.ptm {CROP}")).ok();
    relight(here, "explain base.json p.ptm").assert_refused(3, &["does not say what it was made of"]);
}

#[test]
fn inputs_are_listed_as_build_systems_want_them() {
    let folder = tempfile::tempdir().unwrap();
    let here = folder.path();
    copy_icon72(&here.join("set"), 24);
    let lines = relight(here, "inputs set -o a.ktx2").ok().stdout;
    let listed: Vec<&str> = lines.lines().collect();
    let mut sorted: Vec<String> =
        listed.iter().map(|line| line.strip_prefix("set/").unwrap().to_owned()).collect();
    sorted.sort();
    assert_eq!(sorted, names_in(&here.join("set")));
    let json: Vec<String> =
        serde_json::from_str(&relight(here, "inputs set -o a.ktx2 --format json").ok().stdout).unwrap();
    assert_eq!(json, listed);
    // A job file is an input, too; options of outputs have no meaning here.
    fs::write(here.join("a job.toml"), "input = 'set'\noutput = 'a.ktx2'\n").unwrap();
    let of_job = relight_words(here, &["inputs", "a job.toml"]).ok().stdout;
    assert_eq!(of_job, format!("{lines}a job.toml\n"));
    for command in ["inputs", "key"] {
        relight(here, &format!("{command} set -o a.ktx2 --depfile a.d")).assert_refused(2, &["--depfile"]);
    }
    relight(here, "plan set --asset a.ktx2 -o p.json --dry-run").assert_refused(2, &["--dry-run"]);
    assert!(!here.join("p.json").exists());
    let bazel = relight(here, "inputs set -o a.ktx2 --format bazel").ok().stdout;
    let words: String = listed.iter().map(|line| format!("    \"{line}\",\n")).collect();
    assert_eq!(bazel, format!("INPUTS = [\n{words}]\n"));
}
