//! Bakes that are cut short: by Ctrl-C, by a signal, by a full disk.

#![cfg(unix)]
#![allow(clippy::unwrap_used, reason = "a test's helpers fail as the test does")]

mod scene;

use scene::{command, icon72, names_in, outcome, relight_words};
use std::fs;
use std::path::{Path, PathBuf};
use std::process::{Child, Command, Stdio};
use std::time::{Duration, Instant};

/// How soon the program must give up.
const PATIENCE: Duration = Duration::from_secs(5);

/// A capture of `copies` times the real one's pictures, by links.
fn long_capture(folder: &Path, copies: usize) {
    fs::create_dir(folder).unwrap();
    let text = fs::read_to_string(icon72().join("lights.lp")).unwrap();
    let mut lines = Vec::new();
    for copy in 0..copies {
        for line in text.lines().skip(1) {
            let name = line.split(' ').next().unwrap();
            std::os::unix::fs::symlink(icon72().join(name), folder.join(format!("{copy}_{name}"))).unwrap();
            lines.push(format!("{copy}_{line}"));
        }
    }
    scene::write_lines(&folder.join("lights.lp"), &lines);
}

fn start(folder: &Path, line: &str) -> Child {
    command(folder).args(line.split(' ')).stdout(Stdio::piped()).stderr(Stdio::piped()).spawn().unwrap()
}

/// Sends `signal` and expects the program to say so and end soon.
fn assert_ends(child: Child, line: &str, signal: &str) {
    let status = Command::new("kill").args([signal, &child.id().to_string()]).status().unwrap();
    assert!(status.success());
    let sent = Instant::now();
    let ended = outcome(line.to_owned(), child.wait_with_output().unwrap());
    assert!(sent.elapsed() < PATIENCE, "{signal}: it took {:?}", sent.elapsed());
    ended.assert_refused(130, &["interrupted"]);
}

#[test]
fn signals_end_a_bake_at_any_stage_and_leave_nothing() {
    let folder = tempfile::tempdir().unwrap();
    let here = folder.path();
    long_capture(&here.join("capture"), 5);
    fs::create_dir(here.join("out")).unwrap();
    fs::write(here.join("out/a.ktx2"), "older").unwrap();
    let line = "bake capture -o out/a.ktx2 --basis srbf -k 64 -j 1 --memory 120M --report out/a.json";
    // While pictures are decoded.
    for signal in ["-INT", "-TERM"] {
        let child = start(here, line);
        std::thread::sleep(Duration::from_millis(100));
        assert_ends(child, line, signal);
    }
    // While the asset is written: its temporary file is there, and the folder of its versions.
    let wait_until = |child: &mut Child, is_there: &dyn Fn() -> bool| {
        while !is_there() {
            assert!(child.try_wait().unwrap().is_none(), "it ended before it was interrupted");
            std::thread::sleep(Duration::from_millis(5));
        }
    };
    let mut child = start(here, line);
    wait_until(&mut child, &|| names_in(&here.join("out")).len() == 3);
    assert!(names_in(&here.join("out"))[..2].iter().all(|name| name.starts_with(".a.ktx2.relight-")));
    assert_ends(child, line, "-INT");
    assert_eq!(names_in(&here.join("out")), ["a.ktx2"]);
    assert_eq!(fs::read(here.join("out/a.ktx2")).unwrap(), b"older");
    // While its versions are held against the pictures, the asset stands already.
    let line = "bake capture -o out/a.ktx2 --basis ptm -j 1 --memory 120M --report out/a.json";
    let mut child = start(here, line);
    wait_until(&mut child, &|| fs::read(here.join("out/a.ktx2")).unwrap() != b"older");
    assert_eq!(names_in(&here.join("out")).len(), 2);
    assert_ends(child, line, "-INT");
    assert_eq!(names_in(&here.join("out")), ["a.ktx2"]);
}

/// A small file system, unmounted when dropped.
struct SmallDisk(PathBuf);

impl SmallDisk {
    /// `None` where the test may not mount.
    fn mount(at: PathBuf, size: &str) -> Option<Self> {
        fs::create_dir(&at).unwrap();
        let option = format!("size={size}");
        let mount = Command::new("mount").args(["-t", "tmpfs", "-o", &option, "tmpfs"]).arg(&at).output();
        mount.is_ok_and(|output| output.status.success()).then_some(Self(at))
    }
}

impl Drop for SmallDisk {
    fn drop(&mut self) {
        let _ = Command::new("umount").arg(&self.0).status();
    }
}

#[test]
fn a_full_disk_is_said_and_leaves_what_stood_there() {
    let folder = tempfile::tempdir().unwrap();
    let here = folder.path();
    let Some(_disk) = SmallDisk::mount(here.join("disk"), "2m") else {
        println!("skipped: this test may not mount a file system");
        return;
    };
    let input = icon72();
    let input = input.to_str().unwrap();
    let bake = |words: &[&str], file: &str, said: &[&str]| {
        fs::write(here.join("disk").join(file), "older").unwrap();
        let target = format!("disk/{file}");
        relight_words(here, &[&["bake", input, "-o", &target], words].concat()).assert_refused(4, said);
        assert_eq!(names_in(&here.join("disk")), [file]);
        assert_eq!(fs::read(here.join(&target)).unwrap(), b"older");
        fs::remove_file(here.join(target)).unwrap();
    };
    bake(&[], "a.ktx2", &["cannot write disk/a.ktx2", "No space left"]);
    bake(&["--precision", "f16"], "a.ktx2", &["cannot write disk/a.ktx2", "No space left"]);
    bake(&[], "a.exr", &["disk/a.exr", "No space left"]);
    bake(&[], "a.ptm", &["cannot write disk/a.ptm", "No space left"]);
    // The temporary file of pictures that exceed the memory goes there too.
    scene::copy_icon72(&here.join("capture"), 1);
    let spilled = scene::relight_in_least_memory(here, "bake capture -o disk/a.ktx2");
    spilled.assert_refused(4, &["temporary file", "disk", "TMPDIR", "No space left"]);
    assert!(names_in(&here.join("disk")).is_empty());
}
