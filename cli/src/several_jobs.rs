//! Several jobs in one call, one after another: `relight bake a.toml b.toml`.

use crate::failure::{Exit, Failure};
use crate::job::Call;
use crate::log;
use crate::say::{self, say};

/// Runs each of `calls` by `run` and says how each ended. A job that fails stops none but Ctrl-C.
///
/// # Errors
/// The first failure's exit code; what went wrong was said.
pub(crate) fn run(calls: Vec<Call>, mut run: impl FnMut(Call) -> Result<(), Failure>) -> Result<(), Exit> {
    let mut first = Ok(());
    for call in calls {
        let name = call.name.clone();
        log::set_job(Some(name.clone()));
        let ended = run(call).and_then(|()| say::finish());
        if let Err(failure) = &ended {
            failure.report();
        }
        match ended {
            Ok(()) => say!("{name}: done"),
            Err(failure) => {
                let exit = failure.exit();
                say!("{name}: error: {}, exit code {}", exit.name(), exit as u8);
                first = first.and(Err(exit));
                if exit == Exit::Interrupted {
                    break;
                }
            }
        }
    }
    log::set_job(None);
    first
}
