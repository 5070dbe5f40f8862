//! `relight info`: what is in a file.

use crate::failure::Failure;
use crate::say::{self, say};
use clap::Args;
use relight_formats::describe;
use std::path::PathBuf;

/// The file to describe.
#[derive(Args, Debug)]
pub(crate) struct InfoArguments {
    /// An asset (.ktx2, .dds, .exr, .ptm, .rti, a .web folder), a rig, a picture or a light file
    file: PathBuf,
    /// Print JSON instead of lines
    #[arg(long)]
    json: bool,
}

/// Runs the subcommand.
pub(crate) fn run(arguments: &InfoArguments) -> Result<(), Failure> {
    let facts = describe(&arguments.file)?;
    if arguments.json {
        let object: serde_json::Map<String, serde_json::Value> =
            facts.into_iter().map(|(name, value)| (name, value.into())).collect();
        say::json(&serde_json::Value::Object(object));
        return Ok(());
    }
    let width = facts.iter().map(|(name, _)| name.len()).max().unwrap_or(0);
    for (name, value) in facts {
        say!("{name:width$}  {value}");
    }
    Ok(())
}
