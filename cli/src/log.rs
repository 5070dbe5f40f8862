//! What the program says beside its products: as text, or with `--log-format json` an object a line on standard error.
//! docs/schema/log.schema.json describes these.

use crate::failure::Exit;
use clap::{Arg, ValueEnum, builder::EnumValueParser};
use serde_json::{Map, Value};
use std::ffi::OsString;
use std::io::Write as _;
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::{Mutex, PoisonError};

static IS_JSON: AtomicBool = AtomicBool::new(false);

/// The job in hand, where there are several.
static JOB: Mutex<Option<String>> = Mutex::new(None);

#[derive(Clone, Copy, Debug, PartialEq, Eq, ValueEnum)]
pub(crate) enum LogFormat {
    /// Sentences
    Text,
    /// An object a line, on standard error
    Json,
}

const OPTION: &str = "--log-format";

/// The option, for the parser of every command.
pub(crate) fn argument() -> Arg {
    Arg::new("log_format")
        .long("log-format")
        .global(true)
        .value_name("FORMAT")
        .value_parser(EnumValueParser::<LogFormat>::new())
        .default_value("text")
        .help("How notes, results, errors and progress are said")
}

/// Takes the option out of the arguments, wherever it stands, so that whatever is wrong with the others is said as it
/// demands. A value that there isn't is left to the parser.
pub(crate) fn take_format(arguments: &mut Vec<OsString>) {
    let mut at = 1;
    while at < arguments.len() && arguments[at] != "--" {
        let Some(rest) = arguments[at].to_str().and_then(|word| word.strip_prefix(OPTION)) else {
            at += 1;
            continue;
        };
        let (value, words) = match rest.strip_prefix('=') {
            Some(value) => (Some(value), 1),
            None if rest.is_empty() => (arguments.get(at + 1).and_then(|next| next.to_str()), 2),
            None => (None, 1),
        };
        match value.and_then(|value| LogFormat::from_str(value, false).ok()) {
            Some(format) => {
                set_format(format);
                arguments.drain(at..at + words);
            }
            None => at += words,
        }
    }
}

fn set_format(format: LogFormat) {
    IS_JSON.store(format == LogFormat::Json, Ordering::Relaxed);
    if format == LogFormat::Json {
        std::panic::set_hook(Box::new(|panic| note(&panic.to_string())));
    } else {
        drop(std::panic::take_hook());
    }
}

pub(crate) fn is_json() -> bool {
    IS_JSON.load(Ordering::Relaxed)
}

/// Names the job in hand on all lines that follow.
pub(crate) fn set_job(job: Option<String>) {
    *JOB.lock().unwrap_or_else(PoisonError::into_inner) = job;
}

/// What is worth saying but not fatal.
pub(crate) fn note(words: &str) {
    match is_json() {
        true => object("note", words, []),
        false => text(&format!("relight: note: {words}")),
    }
}

/// Why a command ended early.
pub(crate) fn error(exit: Exit, words: &str) {
    match is_json() {
        true => object("error", words, [("code", (exit as u8).into()), ("name", exit.name().into())]),
        false => {
            let job = JOB.lock().unwrap_or_else(PoisonError::into_inner);
            let job = job.as_ref().filter(|job| !words.starts_with(*job));
            let job = job.map_or(String::new(), |job| format!("{job}: "));
            text(&format!("relight: error: {job}{words}"));
        }
    }
}

/// A line of what a command found out, where it is not said on standard output.
pub(crate) fn result(words: &str) {
    match is_json() {
        true => object("result", words, []),
        false => text(words),
    }
}

/// The beginning of a phase of `steps` steps; as text, bars show it.
pub(crate) fn phase(name: &str, steps: usize) {
    if is_json() {
        object("progress", name, [("steps", steps.into())]);
    }
}

fn object<const N: usize>(level: &str, message: &str, fields: [(&str, Value); N]) {
    let job = JOB.lock().unwrap_or_else(PoisonError::into_inner).clone();
    let named = [("level", level.into()), ("message", message.into())];
    let job = job.map(|job| ("job", job.into()));
    let fields: Map<String, Value> = named
        .into_iter()
        .chain(job)
        .chain(fields)
        .map(|(name, value): (&str, Value)| (name.to_owned(), value))
        .collect();
    text(&Value::Object(fields).to_string());
}

/// Writes a line to standard error. Where that is closed nobody listens.
fn text(line: &str) {
    let _ = writeln!(std::io::stderr().lock(), "{line}");
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_option_is_taken_wherever_it_stands() {
        for (line, rest) in [
            ("relight --log-format text bake a", "relight bake a"),
            ("relight bake a --log-format=text", "relight bake a"),
            ("relight bake --log-format text a --log-format text", "relight bake a"),
            ("relight bake --log-format xml", "relight bake --log-format xml"),
            ("relight bake --log-format", "relight bake --log-format"),
            ("relight bake --log-formats text", "relight bake --log-formats text"),
            ("relight bake -- --log-format text", "relight bake -- --log-format text"),
        ] {
            let mut arguments: Vec<OsString> = line.split(' ').map(OsString::from).collect();
            take_format(&mut arguments);
            assert_eq!(arguments.join(" ".as_ref()), rest);
        }
    }
}
