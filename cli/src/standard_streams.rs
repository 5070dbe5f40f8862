//! `-`: standard input or output where one file is read or written as a whole.

use crate::failure::Failure;
use crate::say;
use clap::{ArgMatches, Command};

/// Where `-` is taken: command (any where none is named), option, whether it is standard output.
const TAKEN: [(&[&str], &str, bool); 5] = [
    (&["bake"], "input", false),
    (&["bake"], "report", true),
    (&[], "depfile", true),
    (&["render"], "output", true),
    (&["shader"], "output", true),
];

/// Refuses `-` where it is not taken, and leaves standard output to a product that goes there.
///
/// # Errors
/// Exit code 2.
pub(crate) fn check(parser: &Command, matches: &ArgMatches) -> Result<(), Failure> {
    let (mut path, mut command, mut matches) = (Vec::new(), parser, matches);
    while let Some((name, inner)) = matches.subcommand() {
        let Some(found) = command.find_subcommand(name) else { break };
        path.push(name);
        (command, matches) = (found, inner);
    }
    let mut products = Vec::new();
    for argument in command.get_arguments() {
        let id = argument.get_id().as_str();
        let values = matches.try_get_raw(id).ok().flatten();
        if !values.into_iter().flatten().any(|value| value == "-") {
            continue;
        }
        let option = argument.get_long().map_or_else(|| id.to_uppercase(), |long| format!("--{long}"));
        match TAKEN
            .iter()
            .find(|(command, taken, _)| *taken == id && (command.is_empty() || *command == path))
        {
            Some((.., true)) => products.push(option),
            Some(_) => {}
            None => {
                return Err(Failure::usage(format!(
                    "{option} - : standard input and output are not taken here; name a file (./- for one of that name)"
                )));
            }
        }
    }
    if !products.is_empty() && matches!(matches.try_get_one("json"), Ok(Some(true))) {
        products.push("--json".to_owned());
    }
    match &products[..] {
        [] => {}
        [_] => say::give_way(),
        [one, other, ..] => {
            return Err(Failure::usage(format!(
                "{one} and {other} can't share standard output; name a file for one of them"
            )));
        }
    }
    Ok(())
}
