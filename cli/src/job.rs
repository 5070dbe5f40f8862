//! Job files: TOML that says what the flags of `relight bake` say.
//!
//! A job file is turned into arguments that stand before the user's own, so every flag has its
//! key, each value goes through the flag's own parser, and flags win. Paths in a job file are
//! relative to its folder.

use crate::bake::BakeArguments;
use crate::failure::{Failure, words_of_parser};
use clap::{Arg, ArgAction, Args, Command};
use std::ffi::OsString;
use std::path::{Path, PathBuf};

/// Keys whose values are paths.
const PATHS: [&str; 9] =
    ["input", "output", "report", "heatmaps", "positions", "depth", "camera", "scene", "intensities"];

/// Keys of which a flag of the user's replaces all others.
const SIZES: [&str; 3] = ["k", "order", "degree"];

/// Replaces a job file among the arguments of `bake` by what it says.
///
/// # Errors
/// A job file that can't be read, is no TOML, has an unknown key or a value that is no text
/// or number.
pub(crate) fn expand(arguments: Vec<OsString>) -> Result<Vec<OsString>, Failure> {
    let is_bake = arguments.get(1).is_some_and(|command| command == "bake");
    let is_job = |argument: &OsString| {
        Path::new(argument).extension().is_some_and(|extension| extension.eq_ignore_ascii_case("toml"))
    };
    if !is_bake {
        return Ok(arguments);
    }
    // The parser tells the input from the values of flags.
    let command = BakeArguments::augment_args(Command::new("bake")).ignore_errors(true).no_binary_name(true);
    let parsed = command.mut_args(|arg| arg.required(false)).try_get_matches_from(&arguments[2..]);
    let input = parsed.ok().and_then(|matches| matches.get_raw("input")?.next().map(OsString::from));
    let Some(input) = input.filter(is_job) else { return Ok(arguments) };
    let Some(at) = arguments.iter().rposition(|argument| *argument == input) else { return Ok(arguments) };
    let path = PathBuf::from(&arguments[at]);
    let text = relight_formats::read_text(&path)?;
    let given: Vec<OsString> =
        arguments[2..].iter().enumerate().filter(|(i, _)| i + 2 != at).map(|(_, a)| a.clone()).collect();
    let from_job = arguments_of_job(&text, &path, &given)?;
    Ok(arguments[..2].iter().cloned().chain(from_job).chain(given).collect())
}

/// The arguments that a job file stands for, less those that `given` replace.
fn arguments_of_job(text: &str, path: &Path, given: &[OsString]) -> Result<Vec<OsString>, Failure> {
    let bad = |what: String| Failure::usage(format!("{}: {what}", path.display()));
    let table: toml::Table = text.parse().map_err(|error: toml::de::Error| {
        let line = error.span().map_or(0, |span| text[..span.start].lines().count().max(1));
        bad(format!("line {line}: {}", error.message().replace('\n', " ")))
    })?;
    let command = BakeArguments::augment_args(Command::new("bake"));
    let keys: Vec<(&Arg, &str)> = command.get_arguments().map(|arg| (arg, arg.get_id().as_str())).collect();
    let sized = given.iter().any(|argument| {
        let argument = argument.to_string_lossy();
        let long = argument.strip_prefix("--").map(|long| long.split('=').next().unwrap_or(long));
        argument.starts_with("-k") || long.is_some_and(|long| SIZES.contains(&long))
    });
    let mut arguments = Vec::new();
    for (key, value) in &table {
        let id = key.replace('-', "_");
        let Some((arg, _)) = keys.iter().find(|(_, name)| *name == id) else {
            return Err(bad(unknown_key(key, keys.iter().map(|(_, name)| *name))));
        };
        if sized && SIZES.contains(&key.as_str()) {
            continue;
        }
        let flag = matches!(arg.get_action(), ArgAction::SetTrue)
            || arg.get_num_args().is_some_and(|range| range.min_values() == 0);
        let mut text = match value {
            // `mips = true` is --mips; `zstd = true` is --zstd at its own level.
            toml::Value::Boolean(wanted) if flag => {
                if let (true, Some(long)) = (*wanted, arg.get_long()) {
                    arguments.push(format!("--{long}").into());
                }
                continue;
            }
            toml::Value::String(text) => text.clone(),
            toml::Value::Integer(number) => number.to_string(),
            toml::Value::Float(number) => number.to_string(),
            other => {
                let kind = other.type_str();
                let takes = if flag { "true or false" } else { "text or a number" };
                return Err(bad(format!("key '{key}' is of type {kind}; write {takes}")));
            }
        };
        let is_light_file = key == "holdout" && text.to_ascii_lowercase().ends_with(".lp");
        if PATHS.contains(&key.as_str()) || is_light_file {
            text = path.parent().unwrap_or(Path::new("")).join(text).to_string_lossy().into_owned();
        }
        match arg.get_long() {
            // One argument, so that a value starting with a dash stays a value.
            Some(long) => arguments.push(format!("--{long}={text}").into()),
            None => arguments.push(text.into()),
        }
    }
    // The parser meets these once more among the user's own; here it tells whose mistake it is.
    let alone = command.clone().no_binary_name(true).mut_args(|arg| arg.required(false));
    if let Err(error) = alone.try_get_matches_from(&arguments) {
        return Err(bad(words_of_parser(&error)));
    }
    if !table.contains_key("input") {
        return Err(bad("key 'input' is missing; name the .lp file or the folder of pictures".to_owned()));
    }
    let is_output = |argument: &OsString| {
        let argument = argument.to_string_lossy();
        argument.starts_with("-o") || argument.starts_with("--output")
    };
    if !table.contains_key("output") && !given.iter().any(is_output) {
        return Err(bad("key 'output' is missing; name the asset to write, or give -o".to_owned()));
    }
    Ok(arguments)
}

/// An unknown key in words, with the key that was perhaps meant.
fn unknown_key<'a>(key: &str, known: impl Iterator<Item = &'a str>) -> String {
    let known: Vec<String> = known.map(|name| name.replace('_', "-")).collect();
    let distance = |name: &&String| strsim::damerau_levenshtein(key, name);
    match known.iter().min_by_key(distance) {
        Some(near) if strsim::damerau_levenshtein(key, near) <= 3 => {
            format!("unknown key '{}'; did you mean '{near}'?", key.escape_debug())
        }
        _ => format!("unknown key '{}'; known keys: {}", key.escape_debug(), known.join(", ")),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn expanded(text: &str, given: &[&str]) -> Result<Vec<String>, Failure> {
        let given: Vec<OsString> = given.iter().map(OsString::from).collect();
        let arguments = arguments_of_job(text, Path::new("jobs/a.toml"), &given)?;
        Ok(arguments.into_iter().map(|a| a.into_string().unwrap()).collect())
    }

    #[test]
    fn keys_become_flags_and_paths_are_relative_to_the_job() {
        let arguments =
            expanded("input = 'icon 72'\noutput = 'x.ktx2'\nk = 25\nridge = 1e-4\nholdout = 'every:6'", &[])
                .unwrap();
        let sep = std::path::MAIN_SEPARATOR;
        assert!(arguments.contains(&format!("jobs{sep}icon 72")), "{arguments:?}");
        for expected in
            [&format!("--output=jobs{sep}x.ktx2"), "--k=25", "--ridge=0.0001", "--holdout=every:6"]
        {
            assert!(arguments.iter().any(|a| a == expected), "{expected} in {arguments:?}");
        }
    }

    #[test]
    fn a_size_flag_replaces_every_size_key() {
        let arguments = expanded("input = 'a'\noutput = 'b.ktx2'\nk = 25", &["--order", "3"]).unwrap();
        assert!(!arguments.iter().any(|a| a.starts_with("--k")), "{arguments:?}");
        let arguments = expanded("input = 'a'\nk = 25", &["--kernel", "spherical", "-o", "b.ktx2"]).unwrap();
        assert!(arguments.contains(&"--k=25".to_owned()), "{arguments:?}");
    }

    #[test]
    fn switches_are_true_or_false() {
        let job = "input = 'a'\noutput = 'b.ktx2'\nmips = true\nsplit = false\nzstd = 3";
        let arguments = expanded(job, &[]).unwrap();
        assert!(arguments.contains(&"--mips".to_owned()), "{arguments:?}");
        assert!(arguments.contains(&"--zstd=3".to_owned()), "{arguments:?}");
        assert!(!arguments.iter().any(|a| a.contains("split")), "{arguments:?}");
        let arguments = expanded("input = 'a'\noutput = 'b.ktx2'\nzstd = true", &[]).unwrap();
        assert!(arguments.contains(&"--zstd".to_owned()), "{arguments:?}");
    }

    #[test]
    fn mistakes_are_named() {
        let words = |text: &str| format!("{:?}", expanded(text, &[]).unwrap_err());
        assert!(words("input = 'a'\nbassis = 'sh'").contains("did you mean 'basis'?"));
        assert!(words("basis = 'sh'").contains("'input' is missing"));
        assert!(words("input = 'a'").contains("'output' is missing"));
        assert!(words("input = 'a'\nk = [1]").contains("'k' is of type array"));
        assert!(words("input = 'a'\n\nk = = 2").contains("line 3"));
        assert!(words("input = 'a'\nk = true").contains("'k' is of type boolean; write text or a number"));
    }
}
