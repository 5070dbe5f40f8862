//! Failures in words, once, and the exit codes.

use crate::log;
use relight_core::BasisError;
use relight_fit::FitError;
use relight_formats::FormatError;
use std::error::Error;
use std::fmt::Write as _;
use std::process::ExitCode;

/// The text of the codes in `--help`; [`Exit`] is their definition.
pub(crate) const EXIT_CODES: &str = "Exit codes: 0 done, 1 a check failed, 2 usage, 3 bad input, 4 input/output, \
5 over budget (memory), 6 unsupported on this machine, 70 a bug of ours, 130 interrupted";

/// Exit codes.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Exit {
    /// A check failed: a capture that a bake would refuse.
    CheckFailed = 1,
    /// A command line or job file that can't be meant.
    Usage = 2,
    /// A file that is damaged or does not fit.
    BadInput = 3,
    /// The operating system refused to read or write.
    InputOutput = 4,
    /// More memory than allowed.
    OverBudget = 5,
    /// An instruction set that this machine lacks.
    Unsupported = 6,
    /// A bug of ours.
    Bug = 70,
    /// Ctrl-C or a termination signal.
    Interrupted = 130,
}

impl Exit {
    /// What it stands for, in the words of [`EXIT_CODES`].
    pub(crate) fn name(self) -> &'static str {
        match self {
            Self::CheckFailed => "check failed",
            Self::Usage => "usage",
            Self::BadInput => "bad input",
            Self::InputOutput => "input/output",
            Self::OverBudget => "over budget",
            Self::Unsupported => "unsupported",
            Self::Bug => "bug",
            Self::Interrupted => "interrupted",
        }
    }
}

/// Why a command ended early.
#[derive(Debug)]
pub(crate) struct Failure {
    exit: Exit,
    message: String,
}

impl Failure {
    pub(crate) fn new(exit: Exit, message: impl Into<String>) -> Self {
        Self { exit, message: message.into() }
    }

    /// A wrong command line.
    pub(crate) fn usage(message: impl Into<String>) -> Self {
        Self::new(Exit::Usage, message)
    }

    /// What the parser of the command line found, in one sentence.
    pub(crate) fn of_command_line(error: &clap::Error) -> Self {
        Self::usage(format!("{}; try --help", words_of_parser(error)))
    }

    /// An output that was asked for and can't be: a wrong command line unless the system refused it.
    pub(crate) fn of_output(error: FormatError) -> Self {
        let Self { exit, message } = error.into();
        Self { exit: if exit == Exit::BadInput { Exit::Usage } else { exit }, message }
    }

    /// Why.
    pub(crate) fn words(&self) -> &str {
        &self.message
    }

    /// This failure, which came up where `place` says.
    pub(crate) fn within(self, place: &str) -> Self {
        Self { message: format!("{place}: {}", self.message), ..self }
    }

    /// The exit code.
    pub(crate) fn exit(&self) -> Exit {
        self.exit
    }

    /// Says why on standard error and gives the exit code.
    pub(crate) fn report(&self) -> ExitCode {
        log::error(self.exit, &self.message);
        ExitCode::from(self.exit as u8)
    }
}

/// The parser's lines up to its usage as one sentence, without its "error: ".
pub(crate) fn words_of_parser(error: &clap::Error) -> String {
    let text = error.render().to_string();
    let lines = text.lines().map(str::trim).filter(|line| !line.is_empty());
    let mut words = String::new();
    for line in lines.take_while(|line| !line.starts_with("Usage:") && !line.starts_with("For more")) {
        words += if words.is_empty() {
            ""
        } else if words.ends_with(':') {
            " "
        } else {
            "; "
        };
        words += line.trim_start_matches("error: ");
    }
    words
}

/// An error and its causes, joined by colons.
fn words(error: &dyn Error) -> String {
    let mut words = error.to_string();
    let mut cause = error.source();
    while let Some(error) = cause {
        let _ = write!(words, ": {error}");
        cause = error.source();
    }
    words
}

impl From<FormatError> for Failure {
    fn from(error: FormatError) -> Self {
        let exit = match error {
            FormatError::Io { .. } => Exit::InputOutput,
            FormatError::TooLarge { .. } => Exit::OverBudget,
            FormatError::Cancelled => Exit::Interrupted,
            _ => Exit::BadInput,
        };
        Self::new(exit, words(&error))
    }
}

impl From<FitError> for Failure {
    fn from(error: FitError) -> Self {
        let exit = match error {
            FitError::Stack(_) => Exit::InputOutput,
            FitError::NoLights | FitError::TooFewForNormals { .. } | FitError::CoplanarLights { .. } => {
                Exit::BadInput
            }
            FitError::OutOfReach { .. } => Exit::CheckFailed,
            _ => Exit::Usage,
        };
        Self::new(exit, words(&error))
    }
}

impl From<BasisError> for Failure {
    fn from(error: BasisError) -> Self {
        Self::usage(words(&error))
    }
}

#[cfg(feature = "gpu")]
impl From<relight_gpu::GpuError> for Failure {
    fn from(error: relight_gpu::GpuError) -> Self {
        let exit = match error {
            relight_gpu::GpuError::OutOfMemory => Exit::OverBudget,
            _ => Exit::Unsupported,
        };
        Self::new(exit, words(&error))
    }
}
