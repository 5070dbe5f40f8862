//! `relight key` and `relight inputs`: what an asset will be made of, without making it.

use crate::bake::{BakeArguments, Job, Stages, fit_key_of, key_of};
use crate::failure::{Exit, Failure};
use crate::say;
use clap::{Args, ValueEnum};
use relight_formats::hexadecimal;
use serde_json::json;
use std::path::{Path, PathBuf};

impl InputsArguments {
    /// Notes the job file that the arguments come from.
    pub(crate) fn set_job_file(&mut self, path: PathBuf) {
        self.bake.set_job_file(path);
    }
}

/// A bake whose key is wanted: the command line of `relight bake`.
#[derive(Args, Debug)]
pub(crate) struct KeyArguments {
    #[command(flatten)]
    bake: BakeArguments,
    /// Print all that it is the key of
    #[arg(long)]
    json: bool,
}

/// A bake whose inputs are wanted: the command line of `relight bake`.
#[derive(Args, Debug)]
pub(crate) struct InputsArguments {
    #[command(flatten)]
    bake: BakeArguments,
    /// How to list them
    #[arg(long, value_name = "FORMAT", value_enum, default_value = "lines")]
    format: ListFormat,
}

#[derive(Clone, Copy, Debug, PartialEq, Eq, ValueEnum)]
enum ListFormat {
    /// One a line
    Lines,
    /// An array
    Json,
    /// A Starlark list INPUTS for a .bzl file
    Bazel,
}

/// Runs `relight key`.
pub(crate) fn run_key(arguments: &KeyArguments) -> Result<(), Failure> {
    arguments.bake.build.refuse("key")?;
    let job = Job::open_for_others(&arguments.bake, &mut Stages::default())?;
    let key = hexadecimal(&key_of(&job.provenance));
    if arguments.json {
        let fit_key = hexadecimal(&fit_key_of(&job.provenance));
        say::json(&json!({ "key": key, "fit_key": fit_key, "provenance": job.provenance }));
    } else {
        say::product(format!("{key}\n").as_bytes());
    }
    Ok(())
}

/// Runs `relight inputs`.
pub(crate) fn run_inputs(arguments: &InputsArguments) -> Result<(), Failure> {
    arguments.bake.build.refuse("inputs")?;
    let job = Job::open_for_others(&arguments.bake, &mut Stages::default())?;
    let judges = job.judges();
    let mut files = job.inputs(judges.as_ref());
    files.extend(arguments.bake.build.job_file());
    match arguments.format {
        ListFormat::Lines => files.iter().try_for_each(|path| {
            let text = text_of(path)?;
            if text.contains('\n') {
                let message =
                    format!("{text:?}: a name with a newline can't stand on a line; use --format json");
                return Err(Failure::new(Exit::BadInput, message));
            }
            say::product(format!("{text}\n").as_bytes());
            Ok(())
        })?,
        ListFormat::Json => say::json(&json!(texts_of(&files)?)),
        ListFormat::Bazel => {
            // Starlark's strings are those of JSON.
            let lines: Vec<String> =
                texts_of(&files)?.iter().map(|text| format!("    {},\n", json!(text))).collect();
            say::product(format!("INPUTS = [\n{}]\n", lines.concat()).as_bytes());
        }
    }
    Ok(())
}

fn texts_of<'a>(files: &[&'a PathBuf]) -> Result<Vec<&'a str>, Failure> {
    files.iter().map(|path| text_of(path)).collect()
}

fn text_of(path: &Path) -> Result<&str, Failure> {
    path.to_str().ok_or_else(|| {
        let message =
            format!("{}: the name is no UTF-8, so it can't be listed; rename the file", path.display());
        Failure::new(Exit::BadInput, message)
    })
}
