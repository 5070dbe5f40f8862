//! Job files of `relight bake`.

#![allow(clippy::unwrap_used, reason = "a test's helpers fail as the test does")]

mod scene;

use scene::{made, names_in, relight};
use std::fs;

#[test]
fn a_job_file_says_what_flags_say_and_flags_win() {
    let folder = made(20);
    let here = folder.path();
    fs::create_dir_all(here.join("jobs/out")).unwrap();
    let job = "input = '../capture'\noutput = 'out/a.ktx2'\nbasis = 'hsh'\norder = 2\nridge = 1e-3\n\
               precision = 'f16'\nholdout = 'every:6'\nreport = 'out/a.json'\nweights = 'uniform'\n";
    fs::write(here.join("jobs/my job.toml"), job).unwrap();
    scene::relight_words(here, &["bake", "jobs/my job.toml"]).ok();
    assert_eq!(names_in(&here.join("jobs/out")), ["a.json", "a.ktx2"]);
    let flags = "bake capture -o b.ktx2 --basis hsh -k 9 --ridge 0.001 --precision f16 --holdout every:6 --weights uniform";
    relight(here, flags).ok();
    let bytes = |name: &str| fs::read(here.join(name)).unwrap();
    assert!(bytes("jobs/out/a.ktx2") == bytes("b.ktx2"));

    // A flag that only begins like a size leaves the size alone.
    fs::write(here.join("s.toml"), "input = 'capture'\noutput = 's.ktx2'\nbasis = 'srbf'\nk = 7\n").unwrap();
    let said = relight(here, "bake s.toml --kernel spherical").ok().stdout;
    assert!(said.contains("srbf with 7 functions"), "{said}");

    // Every flag of the user's replaces its key; -k replaces the order.
    let more = ["bake", "jobs/my job.toml", "-o", "c.ktx2", "-k", "16", "--precision", "u8", "--ridge=auto"];
    scene::relight_words(here, &more).ok();
    let report = scene::json_of(&here.join("jobs/out/a.json"));
    assert_eq!((&report["functions"], &report["precision"]), (&16.into(), &"u8".into()));
    relight(here, "bake capture -o d.ktx2 --basis hsh -k 16 --holdout every:6 --weights uniform").ok();
    assert!(bytes("c.ktx2") == bytes("d.ktx2"));
}

#[test]
fn mistakes_in_a_job_file_name_the_file_and_the_key() {
    let folder = made(12);
    let here = folder.path();
    let start = "input = 'capture'\noutput = 'a.ktx2'\n";
    for (rest, words) in [
        ("bassis = 'sh'", &["unknown key 'bassis'", "did you mean 'basis'?"][..]),
        ("colour = 'rgb'", &["unknown key 'colour'", "'color'"]),
        ("frobnicate = 1", &["unknown key 'frobnicate'", "known keys:", "holdout"]),
        ("k = 'many'", &["'--k <N>'", "'many'"]),
        ("k = [6]", &["'k'", "array"]),
        ("color = 'grey'", &["'--color <COLOR>'", "'grey'", "rgb, lrgb"]),
        ("ridge = -1", &["'--ridge <RIDGE>'", "'-1'", "0 to 1"]),
        ("memory = 'lots'", &["'--memory <SIZE>'", "'lots'", "800M"]),
        ("k = 9\norder = 2\nbasis = 'sh'", &["cannot be used with"]),
        ("k = = 6", &["line 3"]),
    ] {
        fs::write(here.join("a.toml"), format!("{start}{rest}\n")).unwrap();
        let before = names_in(here);
        let ran = relight(here, "bake a.toml");
        ran.assert_refused(2, words);
        ran.assert_refused(2, &["a.toml"]);
        assert_eq!(before, names_in(here));
    }
    fs::write(here.join("a.toml"), "output = 'a.ktx2'\n").unwrap();
    relight(here, "bake a.toml").assert_refused(2, &["a.toml", "'input' is missing"]);
    relight(here, "bake none.toml").assert_refused(4, &["none.toml"]);
    // A mistake in the user's own flags is not blamed on the job file.
    fs::write(here.join("a.toml"), start).unwrap();
    let ran = relight(here, "bake a.toml --color grey");
    ran.assert_refused(2, &["'grey'"]);
    assert!(!ran.stderr.contains("a.toml"), "{}", ran.stderr);
}
