//! Options that several subcommands share.

use crate::failure::{Exit, Failure};
use crate::say::is_dash;
use crate::thread_tokens;
use clap::{Args, ValueEnum};
use relight_core::{CpuLevel, Wrap};
use relight_formats::{OutputFile, picture_depths, place_of, stamp_of};
use std::collections::HashSet;
use std::path::{Path, PathBuf};
use std::str::FromStr;

/// Fails when no file can stand at `path`, so that a slip shows before the work and not after it.
pub(crate) fn check_writable(path: &Path) -> Result<(), Failure> {
    if is_dash(path) {
        return Ok(());
    }
    OutputFile::create(path).map(drop).map_err(Failure::of_output)
}

/// Fails when a name has another extension than what is written to it.
pub(crate) fn check_extension(path: &Path, extension: &str) -> Result<(), Failure> {
    if is_dash(path) || path.extension().is_some_and(|found| found.eq_ignore_ascii_case(extension)) {
        return Ok(());
    }
    Err(Failure::usage(format!(
        "{}: give a name that ends in .{extension}, which is what is written",
        path.display()
    )))
}

/// Fails when the folder of a sequence is named as a picture.
pub(crate) fn check_sequence_folder(path: &Path) -> Result<(), Failure> {
    match picture_depths(path) {
        Ok(_) => Err(Failure::usage(format!(
            "{}: a sequence is a folder of pictures; give a name without a picture's extension",
            path.display()
        ))),
        Err(_) => Ok(()),
    }
}

/// Fails when an output is also read, or written twice.
pub(crate) fn check_apart<'a>(
    outputs: impl IntoIterator<Item = &'a PathBuf>,
    inputs: impl IntoIterator<Item = &'a PathBuf>,
) -> Result<(), Failure> {
    let mut taken = HashSet::new();
    let inputs: Vec<_> = inputs.into_iter().map(|path| (path, stamp_of(path))).collect();
    for output in outputs.into_iter().filter(|output| !is_dash(output)) {
        let Some(place) = place_of(output) else { continue };
        // To follow links takes a call of the system for each folder above, of each input: first what one call tells.
        let stamp = stamp_of(output);
        let mut alike = inputs.iter().filter(|(_, other)| *other == stamp);
        if alike.any(|(input, _)| place_of(input).as_ref() == Some(&place)) || !taken.insert(place) {
            let message = format!(
                "{} is another file of this command too; give the output a name of its own",
                output.display()
            );
            return Err(Failure::usage(message));
        }
    }
    Ok(())
}

/// The name of a choice on the command line.
pub(crate) fn words_of(choice: impl ValueEnum) -> String {
    choice.to_possible_value().map_or(String::new(), |value| value.get_name().to_owned())
}

/// A value, or `none`.
pub(crate) fn optional(value: Option<impl ToString>) -> String {
    value.map_or("none".to_owned(), |value| value.to_string())
}

/// What lies beyond the edge of textures.
#[derive(Clone, Copy, Debug, PartialEq, Eq, ValueEnum)]
pub(crate) enum WrapChoice {
    Clamp,
    Repeat,
    Mirror,
}

impl WrapChoice {
    /// As samplers have it.
    pub(crate) fn mode(self) -> Wrap {
        match self {
            Self::Clamp => Wrap::Clamp,
            Self::Repeat => Wrap::Repeat,
            Self::Mirror => Wrap::Mirror,
        }
    }
}

/// How much of the machine to use.
#[derive(Args, Debug)]
pub(crate) struct MachineOptions {
    /// Memory to stay within, such as 800M or 2G; half of the machine's by default
    #[arg(long, value_name = "SIZE")]
    memory: Option<MemorySize>,
    /// Threads; by default all cores, or what the jobserver of GNU make leaves. Results do not depend on it
    #[arg(short = 'j', long, value_name = "N", value_parser = clap::value_parser!(u16).range(1..=1024))]
    jobs: Option<u16>,
    /// Instruction set: auto, baseline, avx2 or avx512. Results do not depend on it
    #[arg(long, value_name = "LEVEL", default_value = "auto")]
    cpu: String,
}

/// The machine as a command uses it.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Machine {
    /// Bytes to stay within.
    pub(crate) memory: u64,
    /// Threads.
    pub(crate) threads: usize,
    /// Instruction set.
    pub(crate) level: CpuLevel,
}

impl MachineOptions {
    /// These options as words of a command line.
    pub(crate) fn words(&self) -> Vec<String> {
        let memory = self.memory.map(|size| format!("--memory={}", size.0));
        let jobs = self.jobs.map(|jobs| format!("--jobs={jobs}"));
        memory.into_iter().chain(jobs).chain([format!("--cpu={}", self.cpu)]).collect()
    }

    /// Reads the options and sets the number of threads for all that follows.
    pub(crate) fn machine(&self) -> Result<Machine, Failure> {
        let level = CpuLevel::from_str(&self.cpu).map_err(|error| match error.is_level {
            true => Failure::new(Exit::Unsupported, error.to_string()),
            false => Failure::usage(error.to_string()),
        })?;
        let threads = match self.jobs {
            Some(jobs) => usize::from(jobs),
            None => thread_tokens::threads(std::thread::available_parallelism().map_or(1, usize::from)),
        };
        // Of several jobs, the first one's pool serves all.
        let _ = rayon::ThreadPoolBuilder::new().num_threads(threads).build_global();
        let threads = rayon::current_num_threads();
        let memory = self.memory.map_or_else(|| relight_formats::machine_memory() / 2, |size| size.0);
        Ok(Machine { memory, threads, level })
    }
}

/// A number of bytes: digits with K, M, G or T (powers of 1024), `iB` or `B` after them allowed.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) struct MemorySize(pub(crate) u64);

/// A number of bytes.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) struct ByteCount(pub(crate) u64);

impl FromStr for ByteCount {
    type Err = String;

    fn from_str(text: &str) -> Result<Self, String> {
        let refused = || format!("'{text}' is not a size; write a number with K, M, G or T, such as 800M");
        let lower = text.trim().to_ascii_lowercase();
        let number = lower.trim_end_matches("ib").trim_end_matches('b');
        let (digits, unit) = match number.char_indices().last() {
            Some((at, unit)) if unit.is_ascii_alphabetic() => (&number[..at], unit),
            _ => (number, ' '),
        };
        let shift = match unit {
            ' ' => 0,
            'k' => 10,
            'm' => 20,
            'g' => 30,
            't' => 40,
            _ => return Err(refused()),
        };
        let number: f64 = digits.trim().parse().map_err(|_| refused())?;
        let bytes = number * (1u64 << shift) as f64;
        if !(bytes >= 1.0 && bytes < (1u64 << 50) as f64) {
            return Err(format!("{text} is outside 1 byte to 1024T"));
        }
        Ok(Self(bytes as u64))
    }
}

impl FromStr for MemorySize {
    type Err = String;

    fn from_str(text: &str) -> Result<Self, String> {
        match text.parse()? {
            ByteCount(bytes) if bytes >= 1 << 20 => Ok(Self(bytes)),
            ByteCount(_) => Err(format!("{text} is outside 1M..1024T")),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn sizes_are_powers_of_1024() {
        for (text, bytes) in [
            ("800M", 800 << 20),
            ("2G", 2u64 << 30),
            ("1.5g", 3 << 29),
            ("4194304", 4 << 20),
            ("64MiB", 64 << 20),
        ] {
            assert_eq!(text.parse(), Ok(MemorySize(bytes)), "{text}");
        }
        for text in ["", "G", "-1G", "2X", "nan", "1k", "inf", "1e40"] {
            assert!(text.parse::<MemorySize>().is_err(), "{text}");
        }
    }
}
