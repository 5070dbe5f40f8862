//! Captures for tests, made or copied, and the program under test.

#![allow(
    dead_code,
    clippy::unwrap_used,
    reason = "each test file uses a part; a helper fails as its test does"
)]

pub(crate) mod pictures;
pub(crate) mod schema;

use serde_json::Value;
use std::collections::BTreeMap;
use std::fs;
use std::path::{Path, PathBuf};
use std::process::{Command, Output};

/// Pixels of a made picture.
pub(crate) const WIDTH: usize = 24;
pub(crate) const HEIGHT: usize = 16;

/// What a run of the program left behind.
pub(crate) struct Outcome {
    pub(crate) line: String,
    pub(crate) code: Option<i32>,
    pub(crate) stdout: String,
    pub(crate) stderr: String,
}

/// Runs `relight` in `folder`; the arguments are separated by blanks.
pub(crate) fn relight(folder: &Path, line: &str) -> Outcome {
    relight_words(folder, &line.split_whitespace().collect::<Vec<_>>())
}

/// Runs `relight` in `folder`.
pub(crate) fn relight_words(folder: &Path, words: &[&str]) -> Outcome {
    outcome(words.join(" "), command(folder).args(words).output().unwrap())
}

/// Runs `relight` with the least `--memory` that it takes, in MiB.
pub(crate) fn relight_in_least_memory(folder: &Path, line: &str) -> Outcome {
    let runs = (32..512).map(|memory| relight(folder, &format!("{line} --memory {memory}M")));
    runs.into_iter().find(|run| run.code != Some(5)).unwrap()
}

/// The program, to be run in `folder`.
pub(crate) fn command(folder: &Path) -> Command {
    let mut command = Command::new(env!("CARGO_BIN_EXE_relight"));
    command.current_dir(folder).env_remove("TMPDIR");
    // The jobserver of a make that runs these tests.
    for name in ["MAKEFLAGS", "MFLAGS", "CARGO_MAKEFLAGS"] {
        command.env_remove(name);
    }
    command
}

pub(crate) fn outcome(line: String, output: Output) -> Outcome {
    Outcome {
        line,
        code: output.status.code(),
        stdout: String::from_utf8(output.stdout).unwrap(),
        stderr: String::from_utf8(output.stderr).unwrap(),
    }
}

impl Outcome {
    /// Itself, when the program succeeded.
    #[track_caller]
    pub(crate) fn ok(self) -> Self {
        assert_eq!(self.code, Some(0), "relight {}\n{}", self.line, self.stderr);
        self
    }

    /// Standard output as JSON.
    #[track_caller]
    pub(crate) fn json(&self) -> Value {
        serde_json::from_str(&self.stdout).unwrap_or_else(|e| panic!("relight {}: {e}", self.line))
    }

    /// Fails unless it ended with `code` and one sentence that has all of `words`.
    #[track_caller]
    pub(crate) fn assert_refused(&self, code: i32, words: &[&str]) {
        let Self { line, stderr, .. } = self;
        assert_eq!(self.code, Some(code), "relight {line}\n{stderr}");
        let errors: Vec<_> = stderr.lines().filter(|line| !line.starts_with("relight: note: ")).collect();
        let [error] = errors[..] else { panic!("relight {line}: one sentence was expected, not\n{stderr}") };
        assert!(error.starts_with("relight: error: "), "relight {line}\n{stderr}");
        for word in words {
            assert!(error.contains(word), "relight {line}: no '{word}' in\n{error}");
        }
    }
}

/// The real capture in testdata: 72 JPEGs of 402 x 395 pixels.
pub(crate) fn icon72() -> PathBuf {
    let path = Path::new(env!("CARGO_MANIFEST_DIR")).join("../testdata/icon72");
    path.canonicalize().unwrap()
}

/// Copies every `step`th picture of the real capture, and their lights, into a new `folder`.
pub(crate) fn copy_icon72(folder: &Path, step: usize) {
    fs::create_dir_all(folder).unwrap();
    let text = fs::read_to_string(icon72().join("lights.lp")).unwrap();
    let lines: Vec<String> = text.lines().skip(1).step_by(step).map(str::to_owned).collect();
    for line in &lines {
        let name = line.split(' ').next().unwrap();
        fs::copy(icon72().join(name), folder.join(name)).unwrap();
    }
    write_lines(&folder.join("lights.lp"), &lines);
}

/// A number of a JSON value, named as in `mean.psnr`.
#[track_caller]
pub(crate) fn number(value: &Value, path: &str) -> f64 {
    let found = path.split('.').fold(value, |value, key| &value[key]);
    found.as_f64().unwrap_or_else(|| panic!("{path} is {found}"))
}

/// The strings under `key` of the objects in a list.
#[track_caller]
pub(crate) fn strings(list: &Value, key: &str) -> Vec<String> {
    let string = |object: &Value| object[key].as_str().unwrap().to_owned();
    list.as_array().unwrap_or_else(|| panic!("no list but {list}")).iter().map(string).collect()
}

pub(crate) fn json_of(path: &Path) -> Value {
    serde_json::from_str(&fs::read_to_string(path).unwrap()).unwrap()
}

/// An asset but for where it comes from: another capture may give the same.
pub(crate) fn maps_of(asset: &Path) -> relight_core::RelightingMaps {
    let mut maps = relight_formats::read_asset(asset, 1 << 30).unwrap();
    maps.model.provenance = None;
    maps
}

/// Every file below `folder` with its bytes; folders have none.
pub(crate) fn snapshot(folder: &Path) -> BTreeMap<PathBuf, Vec<u8>> {
    let mut files = BTreeMap::new();
    for entry in fs::read_dir(folder).unwrap() {
        let path = entry.unwrap().path();
        if path.is_dir() {
            files.extend(snapshot(&path));
            files.insert(path, Vec::new());
        } else {
            files.insert(path.clone(), fs::read(&path).unwrap());
        }
    }
    files
}

/// Names in `folder`, hidden ones too, sorted.
pub(crate) fn names_in(folder: &Path) -> Vec<String> {
    let name = |entry: std::io::Result<fs::DirEntry>| entry.unwrap().file_name().into_string().unwrap();
    let mut names: Vec<_> = fs::read_dir(folder).unwrap().map(name).collect();
    names.sort();
    names
}

/// The direction of light `i` of `count`: a spiral from 80 deg above the picture plane down to 12.
pub(crate) fn light(i: usize, count: usize) -> [f64; 3] {
    let elevation = (80.0 - 68.0 * i as f64 / (count - 1) as f64).to_radians();
    let azimuth = 2.399_963 * i as f64;
    let flat = libm::cos(elevation);
    [flat * libm::cos(azimuth), flat * libm::sin(azimuth), libm::sin(elevation)]
}

/// Linear light of a bumpy, coloured Lambertian surface, no two pixels alike.
pub(crate) fn radiance(x: usize, y: usize, light: [f64; 3]) -> [f64; 3] {
    let (fx, fy) = (x as f64, y as f64);
    let slope = [0.5 * libm::sin(0.4 * fx + 0.2 * fy), 0.45 * libm::cos(0.33 * fy - 0.1 * fx)];
    let length = (slope[0] * slope[0] + slope[1] * slope[1] + 1.0).sqrt();
    let lambert = (slope[0] * light[0] + slope[1] * light[1] + light[2]).max(0.0) / length;
    let albedo = [0.3 + 0.6 * fx / 24.0, 0.9 - 0.5 * fy / 16.0, 0.25 + 0.5 * ((x + 2 * y) % 7) as f64 / 7.0];
    albedo.map(|albedo| albedo * (0.95 * lambert + 0.03))
}

/// The name of made picture `i`.
pub(crate) fn name(i: usize) -> String {
    format!("p{i:02}.png")
}

/// The lines of the light file of a made capture.
pub(crate) fn light_lines(count: usize) -> Vec<String> {
    let line = |i: usize| {
        let [x, y, z] = light(i, count);
        format!("{} {x:.6} {y:.6} {z:.6}", name(i))
    };
    (0..count).map(line).collect()
}

pub(crate) fn write_lines(path: &Path, lines: &[String]) {
    fs::write(path, format!("{}\n{}\n", lines.len(), lines.join("\n"))).unwrap();
}

/// A folder with `capture`: `count` made 8-bit pictures and `lights.lp`.
pub(crate) fn made(count: usize) -> tempfile::TempDir {
    let folder = tempfile::tempdir().unwrap();
    let capture = folder.path().join("capture");
    fs::create_dir(&capture).unwrap();
    for i in 0..count {
        pictures::write_made(&capture.join(name(i)), light(i, count), WIDTH, HEIGHT);
    }
    write_lines(&capture.join("lights.lp"), &light_lines(count));
    folder
}
