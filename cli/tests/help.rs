//! The program's own words: help, version, wrong commands.

#![allow(clippy::unwrap_used, reason = "a test's helpers fail as the test does")]

mod scene;

use scene::relight;
use std::path::Path;

/// A program without `gpu` lacks the last two.
const SUBCOMMANDS: &[&str] = &[
    "bake",
    "sweep",
    "convert",
    "render",
    "view",
    "evaluate",
    "lights",
    "calibrate",
    "normals",
    "shader",
    "positions",
    "info",
    "completions",
    "man",
    #[cfg(feature = "gpu")]
    "verify",
    #[cfg(feature = "gpu")]
    "preview",
];

#[test]
fn help_names_every_subcommand_and_exit_code() {
    let help = relight(Path::new("."), "--help").ok();
    assert_eq!(help.stderr, "");
    for word in SUBCOMMANDS.iter().chain(&["Exit codes: 0 done", "5 over budget", "130 interrupted"]) {
        assert!(help.stdout.contains(word), "no '{word}' in\n{}", help.stdout);
    }
}

#[test]
fn every_subcommand_explains_its_options() {
    for (subcommand, options) in [
        (
            "bake",
            &["--output <FILE>", "--basis <NAME>", "--holdout <WHICH>", "--memory <SIZE>", "--jobs"][..],
        ),
        (
            "sweep",
            &["<INPUT>", "--output <FOLDER>", "--axes <AXES>", "--keep <WHICH>", "--target-psnr", "--json"],
        ),
        (
            "convert",
            &["<INPUT>", "--output <FILE>", "--basis <NAME>", "--block <FORMAT>", "--ridge", "--json"],
        ),
        ("render", &["--light <X,Y,Z[,R,G,B]>", "--angles", "--lights <FILE.lp>", "--depth"]),
        ("view", &["--view <YAW,PITCH,FOV>", "--mesh <FILE>", "--latitude", "--space", "--albedo"]),
        ("evaluate", &["<ASSET>", "<SET>", "--json", "--heatmap"]),
        ("lights", &["<SET>", "--plot"]),
        ("calibrate", &["<FOLDER>", "--sphere <X,Y,R[,Z]|auto>", "--fov", "--positions", "--scale"]),
        ("normals", &["<SET>", "--albedo", "--height", "--method", "--flip-y", "--truth", "--json"]),
        ("positions", &["--depth <FILE>", "--camera <FILE>", "--depth-kind", "--depth-channel", "--output"]),
        ("info", &["<FILE>", "--json"]),
        ("bake", &["--depfile <FILE>", "--depfile-format", "--dry-run", "--log-format <FORMAT>"]),
        ("completions", &["<SHELL>", "bash", "fish", "zsh"]),
        ("man", &["--output <FOLDER>"]),
        ("shader", &["<ASSET>", "--lang", "--output", "--maps-per-pass"]),
        #[cfg(feature = "gpu")]
        ("verify", &["<ASSET>", "--lights", "--tolerance", "--against", "--require-gpu"]),
        #[cfg(feature = "gpu")]
        ("preview", &["<ASSET>", "--size", "--light", "--backend"]),
    ] {
        for spelling in
            [format!("{subcommand} --help"), format!("help {subcommand}"), format!("{subcommand} -h")]
        {
            let help = relight(Path::new("."), &spelling).ok();
            for option in options {
                assert!(help.stdout.contains(option), "{spelling}: no '{option}' in\n{}", help.stdout);
            }
        }
    }
}

#[test]
fn the_version_is_the_packages() {
    let version = relight(Path::new("."), "--version").ok().stdout;
    assert_eq!(version, concat!("relight ", env!("CARGO_PKG_VERSION"), "\n"));
}

#[test]
fn wrong_commands_are_usage_errors() {
    let here = Path::new(".");
    relight(here, "bakery").assert_refused(2, &["unrecognized subcommand 'bakery'", "'bake'"]);
    relight(here, "bake --basis ptm")
        .assert_refused(2, &["not provided", "--output <FILE>", "<INPUT>", "--help"]);
    relight(here, "info a --frob").assert_refused(2, &["'--frob'"]);
    relight(here, "render a.ktx2 -o a.png --depth 12").assert_refused(2, &["'12'", "8, 16, half, float"]);
    let nothing = relight(here, "");
    assert_eq!(nothing.code, Some(2));
    assert!(SUBCOMMANDS.iter().all(|word| nothing.stderr.contains(word)), "{}", nothing.stderr);
}
