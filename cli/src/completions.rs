//! `relight completions` and `relight man`: what shells and `man` know of the command line, from its own definitions.

use crate::failure::{Exit, Failure};
use crate::say;
use clap::{Args, Command};
use clap_complete::Shell;
use relight_formats::{create_folder, write_whole};
use std::path::PathBuf;

/// For which shell.
#[derive(Args, Debug)]
pub(crate) struct CompletionsArguments {
    /// The shell that completes command lines; its script goes to standard output
    #[arg(value_enum)]
    shell: Shell,
}

/// Where manual pages go.
#[derive(Args, Debug)]
pub(crate) struct ManArguments {
    /// A folder for all pages, one a subcommand; the page of relight alone goes to standard output by default
    #[arg(short, long, value_name = "FOLDER")]
    output: Option<PathBuf>,
}

/// Runs `relight completions`.
pub(crate) fn run_completions(arguments: &CompletionsArguments, mut command: Command) -> Result<(), Failure> {
    let mut script = Vec::new();
    clap_complete::generate(arguments.shell, &mut command, "relight", &mut script);
    say::product(&script);
    Ok(())
}

/// Runs `relight man`.
pub(crate) fn run_man(arguments: &ManArguments, command: Command) -> Result<(), Failure> {
    // Subcommands get their whole names and the options that all share.
    let mut command = command.disable_help_subcommand(true);
    command.build();
    let Some(folder) = &arguments.output else {
        say::product(&page(&command)?);
        return Ok(());
    };
    create_folder(folder)?;
    let mut waiting = vec![&command];
    while let Some(command) = waiting.pop() {
        let name = command.get_display_name().unwrap_or(command.get_name());
        write_whole(&folder.join(format!("{name}.1")), &page(command)?)?;
        waiting.extend(command.get_subcommands().filter(|command| !command.is_hide_set()));
    }
    Ok(())
}

/// A page in roff.
fn page(command: &Command) -> Result<Vec<u8>, Failure> {
    let mut page = Vec::new();
    let made = clap_mangen::Man::new(command.clone()).render(&mut page);
    made.map_err(|error| Failure::new(Exit::Bug, format!("cannot make a manual page: {error}")))?;
    Ok(page)
}
