//! What an output was made of, for build systems: `--depfile`, and `--dry-run` beside it.

use crate::failure::Failure;
use crate::options::{check_apart, check_writable};
use crate::say::{is_dash, say, write_product};
use clap::{Args, ValueEnum};
use std::collections::HashSet;
use std::path::{Path, PathBuf};

/// Options of commands that a build runs.
#[derive(Args, Clone, Debug)]
#[group(id = "build")]
pub(crate) struct BuildOptions {
    /// Also write which files were read, as Ninja, Make and CMake understand it; - for standard output
    #[arg(long, value_name = "FILE")]
    depfile: Option<PathBuf>,
    /// make: 'target: inputs'; json: an object with 'target' and 'inputs'
    #[arg(long, value_name = "FORMAT", value_enum, default_value = "make")]
    depfile_format: DepfileFormat,
    /// Check all that can be told without decoding pictures, say which files would be read and written, and write none
    #[arg(long)]
    dry_run: bool,
    /// The job file that the arguments come from: it is an input.
    #[arg(skip)]
    job_file: Option<PathBuf>,
}

#[derive(Clone, Copy, Debug, PartialEq, Eq, ValueEnum)]
pub(crate) enum DepfileFormat {
    Make,
    Json,
}

/// A depfile that is still to be written, since it says that the outputs stand.
#[derive(Debug)]
pub(crate) struct Depfile {
    path: PathBuf,
    bytes: Vec<u8>,
}

impl Depfile {
    /// Writes it; to be done when all outputs stand.
    ///
    /// # Errors
    /// Those of writing.
    pub(crate) fn write(&self) -> Result<(), Failure> {
        write_product(&self.path, &self.bytes)
    }
}

impl BuildOptions {
    /// Notes the job file that the arguments come from.
    pub(crate) fn set_job_file(&mut self, path: PathBuf) {
        self.job_file = Some(path);
    }

    /// Fails where one of these is given to `command`, which makes no asset.
    ///
    /// # Errors
    /// Exit code 2.
    pub(crate) fn refuse(&self, command: &str) -> Result<(), Failure> {
        let given = [("--depfile", self.depfile.is_some()), ("--dry-run", self.dry_run)];
        match given.iter().find(|(_, given)| *given) {
            Some((flag, _)) => {
                Err(Failure::usage(format!("{flag} is of relight bake; relight {command} makes no asset")))
            }
            None => Ok(()),
        }
    }

    /// The job file that the arguments come from.
    pub(crate) fn job_file(&self) -> Option<&PathBuf> {
        self.job_file.as_ref()
    }

    /// Whether nothing is to be written.
    pub(crate) fn is_dry_run(&self) -> bool {
        self.dry_run
    }

    /// The file that is written beside the outputs.
    pub(crate) fn file(&self) -> Option<&PathBuf> {
        self.depfile.as_ref()
    }

    /// The depfile of `target`, as it is named on the command line, made of `inputs`; to be asked for before the work.
    ///
    /// # Errors
    /// Exit code 2 for names that the format can't hold and a depfile that is one of the other files; else those of writing
    /// where it is to stand.
    pub(crate) fn depfile<'a>(
        &'a self,
        target: &Path,
        inputs: impl IntoIterator<Item = &'a PathBuf>,
    ) -> Result<Option<Depfile>, Failure> {
        let Some(path) = &self.depfile else { return Ok(None) };
        let inputs = self.all(inputs);
        if !is_dash(path) {
            check_apart([path], inputs.iter().copied().chain([&target.to_owned()]))?;
            if !self.dry_run {
                check_writable(path)?;
            }
        }
        let bytes = match self.depfile_format {
            DepfileFormat::Make => make_text(target, &inputs),
            DepfileFormat::Json => json_text(target, &inputs),
        };
        let bytes =
            bytes.map_err(|words| Failure::usage(format!("--depfile {}: {words}", path.display())))?;
        Ok(Some(Depfile { path: path.clone(), bytes }))
    }

    /// Says which files would be read and written.
    pub(crate) fn say_files<'a>(
        &'a self,
        inputs: impl IntoIterator<Item = &'a PathBuf>,
        outputs: impl IntoIterator<Item = &'a PathBuf>,
    ) {
        self.all(inputs).iter().for_each(|path| say!("read {}", path.display()));
        let mut seen = HashSet::new();
        let outputs = outputs.into_iter().chain(self.file());
        let written = outputs.filter(|path| !is_dash(path) && seen.insert(*path));
        written.for_each(|path| say!("write {}", path.display()));
    }

    /// Inputs and the job file, each once.
    fn all<'a>(&'a self, inputs: impl IntoIterator<Item = &'a PathBuf>) -> Vec<&'a PathBuf> {
        let mut seen = HashSet::new();
        inputs.into_iter().chain(&self.job_file).filter(|path| seen.insert(*path)).collect()
    }
}

/// `target: input input ..`, an input a line.
fn make_text(target: &Path, inputs: &[&PathBuf]) -> Result<Vec<u8>, String> {
    let mut text = escaped(target)?;
    text.push(b':');
    for input in inputs {
        text.extend(b" \\\n  ");
        text.extend(escaped(input)?);
    }
    text.push(b'\n');
    Ok(text)
}

/// A name as both GNU make and Ninja read it back.
///
/// Ninja's `depfile_parser` and GNU make agree on these escapes alone. A backslash before one of them is one that they read
/// differently, and nothing stands for the characters that are refused.
fn escaped(path: &Path) -> Result<Vec<u8>, String> {
    let refused = |what: &str| {
        let name = path.to_string_lossy().replace(char::is_control, "?");
        Err(format!(
            "'{name}' {what}, which a depfile of Make can't hold; rename it or give --depfile-format json"
        ))
    };
    if !cfg!(unix) && path.to_str().is_none() {
        return refused("is not Unicode");
    }
    let bytes = path.as_os_str().as_encoded_bytes();
    let mut text = Vec::with_capacity(bytes.len() + 8);
    for (at, &byte) in bytes.iter().enumerate() {
        let follows_backslash = at > 0 && bytes[at - 1] == b'\\';
        match byte {
            b'\n' | b'\r' => return refused("has a line break"),
            b'=' => return refused("has a '='"),
            b';' => return refused("has a ';'"),
            b'*' => return refused("has a '*'"),
            b'|' | b'<' | b'>' | b'^' | b'`' => return refused(&format!("has a '{}'", char::from(byte))),
            0..=31 | 127 => return refused("has a tab or another control character"),
            b' ' | b'#' | b':' if follows_backslash => {
                return refused("has a backslash before a space, '#' or ':'");
            }
            b' ' | b'#' | b':' => text.extend([b'\\', byte]),
            b'$' => text.extend(b"$$"),
            _ => text.push(byte),
        }
    }
    match bytes.last() {
        Some(b'\\') => refused("ends in a backslash"),
        Some(b':') => refused("ends in a ':'"),
        _ => Ok(text),
    }
}

fn json_text(target: &Path, inputs: &[&PathBuf]) -> Result<Vec<u8>, String> {
    let text = |path: &Path| {
        path.to_str().map(str::to_owned).ok_or_else(|| {
            format!(
                "'{}' is not Unicode, which JSON can't hold; rename it or give --depfile-format make",
                path.display()
            )
        })
    };
    let inputs = inputs.iter().map(|path| text(path)).collect::<Result<Vec<_>, _>>()?;
    let object = serde_json::json!({ "target": text(target)?, "inputs": inputs });
    Ok(format!("{object:#}\n").into_bytes())
}

#[cfg(test)]
mod tests {
    use super::*;

    fn made(target: &str, inputs: &[&str]) -> Result<String, String> {
        let inputs: Vec<PathBuf> = inputs.iter().map(PathBuf::from).collect();
        let bytes = make_text(Path::new(target), &inputs.iter().collect::<Vec<_>>())?;
        Ok(String::from_utf8(bytes).unwrap())
    }

    #[test]
    fn names_are_escaped_for_make() {
        let text = made("out/a b.ktx2", &["x#1.png", "$HOME.png", "c:d", "a\\b", "é%?[1].png"]).unwrap();
        assert_eq!(
            text,
            "out/a\\ b.ktx2: \\\n  x\\#1.png \\\n  $$HOME.png \\\n  c\\:d \\\n  a\\b \\\n  é%?[1].png\n"
        );
    }

    #[test]
    fn names_that_make_cannot_hold_are_refused_with_a_reason() {
        for (name, reason) in [
            ("a=b", "'='"),
            ("a;b", "';'"),
            ("a*b", "'*'"),
            ("a|b", "'|'"),
            ("a<b", "'<'"),
            ("a>b", "'>'"),
            ("a^b", "'^'"),
            ("a`b", "'`'"),
            ("a\nb", "line break"),
            ("a\tb", "control"),
            ("a\\", "ends in a backslash"),
            ("a\\ b", "backslash before"),
            ("a\\#b", "backslash before"),
            ("a:", "ends in a ':'"),
        ] {
            for text in [made("t", &["x", name]), made(name, &["x"])] {
                let words = text.unwrap_err();
                assert!(words.contains(reason) && !words.contains('\n'), "{words}");
            }
        }
    }

    #[cfg(unix)]
    #[test]
    fn bytes_that_are_no_text_come_through_make_and_are_refused_by_json() {
        use std::os::unix::ffi::OsStrExt;
        let odd = PathBuf::from(std::ffi::OsStr::from_bytes(b"a\xff b"));
        assert_eq!(make_text(Path::new("t"), &[&odd]).unwrap(), b"t: \\\n  a\xff\\ b\n");
        assert!(json_text(Path::new("t"), &[&odd]).unwrap_err().contains("not Unicode"));
    }
}
