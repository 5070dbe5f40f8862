//! Job files: TOML that says what the flags of `relight bake` say.
//!
//! A job file is turned into arguments that stand before the user's own, so every flag has its
//! key, each value goes through the flag's own parser, and flags win. Paths in a job file are
//! relative to its folder.

use crate::bake::BakeArguments;
use crate::failure::{Exit, Failure, words_of_parser};
use crate::key::{InputsArguments, KeyArguments};
use crate::page::report_files;
use crate::plan::{PlanArguments, is_path};
use crate::say::is_dash;
use clap::parser::ValueSource;
use clap::{Arg, ArgAction, ArgMatches, Args, Command, FromArgMatches};
use relight_formats::place_of;
use std::collections::HashMap;
use std::ffi::OsString;
use std::io::Read as _;
use std::path::{Path, PathBuf};

/// Keys of which a flag of the user's replaces all others.
const SIZES: [&str; 3] = ["k", "order", "degree"];

/// Flags that name one file, of which several jobs need one each.
const FILES: [(&str, &str); 4] =
    [("output", "-o"), ("report", "--report"), ("heatmaps", "--heatmaps"), ("depfile", "--depfile")];

/// A command to run.
pub(crate) struct Call {
    /// Its job in words.
    pub(crate) name: String,
    /// The file of that, where it has one.
    pub(crate) job_file: Option<PathBuf>,
    /// Arguments, the program's name first, or why there are none.
    pub(crate) arguments: Result<Vec<OsString>, Failure>,
}

/// A job file in words.
fn name_of(path: &Path) -> String {
    if is_dash(path) { "standard input".to_owned() } else { path.display().to_string() }
}

/// The calls that arguments stand for: themselves, or where `bake` (or what takes the same) is given job files one for each, in
/// which the file is replaced by what it says.
///
/// # Errors
/// Exit code 2 for several jobs that share a file to write. A job file that can't be read, is no TOML, has an unknown key or
/// a value that is no text or number is that call's failure.
pub(crate) fn expand(arguments: Vec<OsString>) -> Result<Vec<Call>, Failure> {
    let mut arguments = arguments;
    let names_plan = |argument: &OsString| argument.to_string_lossy().split('=').next() == Some("--plan");
    if arguments.get(1).is_some_and(|command| command == "bake") && arguments.iter().any(names_plan) {
        arguments[1] = "shard".into();
    }
    let name = arguments.get(1).and_then(|command| command.to_str()).unwrap_or_default().to_owned();
    let is_job = |argument: &OsString| {
        let path = Path::new(argument);
        is_dash(path) || path.extension().is_some_and(|extension| extension.eq_ignore_ascii_case("toml"))
    };
    let plain =
        |arguments| Ok(vec![Call { name: "relight".to_owned(), job_file: None, arguments: Ok(arguments) }]);
    let Some(command) = command_of(&name) else { return plain(arguments) };
    let Some(parsed) = parsed(&command, &arguments[2..]) else { return plain(arguments) };
    let jobs = inputs_of(&parsed);
    if jobs.is_empty() || !jobs.iter().all(is_job) {
        return plain(arguments);
    }
    if let [_, _, ..] = &jobs[..] {
        let is_given = |id: &str| parsed.value_source(id) == Some(ValueSource::CommandLine);
        if let Some((id, flag)) = FILES.iter().find(|(id, _)| is_given(id)) {
            return Err(Failure::usage(format!(
                "{flag} names one file, but there are {} jobs; give each job file a key '{id}' of its own",
                jobs.len()
            )));
        }
        if jobs.iter().filter(|job| is_dash(Path::new(job))).count() > 1 {
            return Err(Failure::usage("- stands for standard input, which holds one job; give it once"));
        }
    }
    let mut given = arguments[2..].to_vec();
    for (index, job) in jobs.iter().enumerate().rev() {
        match place_of_input(&command, &given, job, &jobs[..index]) {
            Some(at) => drop(given.remove(at)),
            None => return plain(arguments),
        }
    }
    let keys = BakeArguments::augment_args(Command::new("bake"));
    let call = |job: OsString| {
        let path = PathBuf::from(job);
        let mut own = arguments_of_file(&keys, &path, &given);
        if name == "plan" {
            own = own.map(|own| own.into_iter().map(asset_of_plan).collect());
        }
        let all =
            |own: Vec<OsString>| arguments[..2].iter().cloned().chain(own).chain(given.clone()).collect();
        let job_file = Some(path.clone()).filter(|path| !is_dash(path));
        Call { name: name_of(&path), job_file, arguments: own.map(all) }
    };
    let calls: Vec<Call> = jobs.into_iter().map(call).collect();
    if name == "bake" {
        check_outputs(&calls)?;
    }
    Ok(calls)
}

/// Fails where two jobs name one file to write: the later one would win without a word.
fn check_outputs(calls: &[Call]) -> Result<(), Failure> {
    let mut writers: HashMap<PathBuf, (usize, &str)> = HashMap::new();
    for (index, call) in calls.iter().enumerate() {
        for word in call.arguments.as_deref().unwrap_or_default() {
            let option = word.to_str().and_then(|word| word.strip_prefix("--")?.split_once('='));
            let Some((flag, value)) = option.filter(|(flag, _)| FILES.iter().any(|(name, _)| name == flag))
            else {
                continue;
            };
            for file in files_of(flag, Path::new(value)) {
                let Some(place) = place_of(&file) else { continue };
                let (first, name) = *writers.entry(place).or_insert((index, &call.name));
                if first != index {
                    let (file, other) = (file.display(), &call.name);
                    return Err(Failure::usage(format!(
                        "{name} and {other} both write {file}; give each its own {flag}"
                    )));
                }
            }
        }
    }
    Ok(())
}

/// The files that such a flag's value names; a report as a page has figures beside it.
fn files_of(flag: &str, value: &Path) -> Vec<PathBuf> {
    match flag {
        _ if is_dash(value) => Vec::new(),
        // What is wrong with its name its own job says.
        "report" => {
            report_files(value).map_or(Vec::new(), |(json, page)| page.into_iter().chain([json]).collect())
        }
        _ => vec![value.to_owned()],
    }
}

/// What words after `relight bake` say.
///
/// # Errors
/// Exit code 2 for words that can't be meant.
pub(crate) fn bake_arguments(words: impl IntoIterator<Item = OsString>) -> Result<BakeArguments, Failure> {
    let command =
        BakeArguments::augment_args(Command::new("bake").no_binary_name(true).args_override_self(true));
    let parsed =
        command.try_get_matches_from(words).and_then(|matches| BakeArguments::from_arg_matches(&matches));
    parsed.map_err(|error| Failure::of_command_line(&error))
}

/// The subcommand of that name, where it is one that takes what `bake` does, as a parser that finds nothing wrong.
fn command_of(name: &str) -> Option<Command> {
    let command = Command::new("bake").ignore_errors(true).no_binary_name(true);
    let command = match name {
        "bake" => BakeArguments::augment_args(command),
        "key" => KeyArguments::augment_args(command),
        "inputs" => InputsArguments::augment_args(command),
        "plan" => PlanArguments::augment_args(command),
        _ => return None,
    };
    let command = command.mut_args(|arg| arg.required(false));
    Some(command.mut_arg("input", |arg| arg.num_args(1..).action(ArgAction::Append)))
}

/// What `command` makes of arguments.
fn parsed(command: &Command, arguments: &[OsString]) -> Option<ArgMatches> {
    command.clone().try_get_matches_from(arguments).ok()
}

/// There, -o names the plan.
fn asset_of_plan(argument: OsString) -> OsString {
    match argument.to_str().and_then(|text| text.strip_prefix("--output=")) {
        Some(output) => format!("--asset={output}").into(),
        None => argument,
    }
}

/// What is no flag and no value of one.
fn inputs_of(parsed: &ArgMatches) -> Vec<OsString> {
    parsed.get_raw("input").into_iter().flatten().map(OsString::from).collect()
}

/// Where `job` stands among `arguments` as an input, those before it being `others`.
fn place_of_input(
    command: &Command,
    arguments: &[OsString],
    job: &OsString,
    others: &[OsString],
) -> Option<usize> {
    let mut places = (0..arguments.len()).rev().filter(|at| arguments[*at] == *job);
    let last = places.next()?;
    let leaves_others = |at: &usize| {
        let rest = [&arguments[..*at], &arguments[at + 1..]].concat();
        parsed(command, &rest).is_some_and(|parsed| inputs_of(&parsed) == others)
    };
    // The parser need be asked only where a flag may have the same value.
    match places.next() {
        None => Some(last),
        Some(next) => [last, next].into_iter().chain(places).find(leaves_others),
    }
}

/// The arguments that the job file at `path` stands for by the keys of `command`, less those that `given` replace.
fn arguments_of_file(command: &Command, path: &Path, given: &[OsString]) -> Result<Vec<OsString>, Failure> {
    if is_dash(path) {
        // As much as a job file may hold.
        let limit = 1 << 20;
        let mut text = String::new();
        let read = std::io::stdin().take(limit + 1).read_to_string(&mut text);
        read.map_err(|error| {
            Failure::new(Exit::InputOutput, format!("cannot read standard input: {error}"))
        })?;
        if text.len() as u64 > limit {
            return Err(Failure::usage("standard input: is larger than 1 MiB, so hardly a job"));
        }
        return arguments_of_job(command, &text, Path::new(&name_of(path)), given);
    }
    arguments_of_job(command, &relight_formats::read_text(path)?, path, given)
}

/// The arguments that a job file stands for, less those that `given` replace.
fn arguments_of_job(
    command: &Command,
    text: &str,
    path: &Path,
    given: &[OsString],
) -> Result<Vec<OsString>, Failure> {
    let bad = |what: String| Failure::usage(format!("{}: {what}", path.display()));
    let table: toml::Table = text.parse().map_err(|error: toml::de::Error| {
        let line = error.span().map_or(0, |span| text[..span.start].lines().count().max(1));
        bad(format!("line {line}: {}", error.message().replace('\n', " ")))
    })?;
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
        let text = match value {
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
        let is_path = is_path(arg) || is_light_file;
        let text = match is_path && !is_dash(Path::new(&text)) {
            true => path.parent().unwrap_or(Path::new("")).join(text).into_os_string(),
            false => text.into(),
        };
        // One argument, so that a value starting with a dash stays a value.
        let mut argument = arg.get_long().map_or_else(OsString::new, |long| format!("--{long}=").into());
        argument.push(text);
        arguments.push(argument);
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
        let command = BakeArguments::augment_args(Command::new("bake"));
        let arguments = arguments_of_job(&command, text, Path::new("jobs/a.toml"), &given)?;
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
