//! Errors of reading and writing files, by who must act.

use std::fmt;
use std::path::{Path, PathBuf};

/// Why a file could not be read or written.
#[derive(Debug)]
#[non_exhaustive]
pub enum FormatError {
    /// The operating system refused: a missing file, no permission, a full disk.
    Io {
        /// The file.
        path: PathBuf,
        /// What was being done: "read", "write", "create" ...
        action: &'static str,
        /// The system's word.
        source: std::io::Error,
    },
    /// The file is damaged or contradicts itself.
    Invalid {
        /// The file.
        path: PathBuf,
        /// What is wrong, where, the value, the allowed range and the remedy, in one sentence.
        problem: String,
    },
    /// The file is whole but holds something that relight does not read.
    Unsupported {
        /// The file.
        path: PathBuf,
        /// What it is and the remedy, in one sentence.
        problem: String,
    },
    /// Reading it would take more memory than allowed.
    TooLarge {
        /// The file.
        path: PathBuf,
        /// Bytes that it would take.
        needed: u64,
        /// Bytes allowed.
        limit: u64,
        /// What to do about it.
        remedy: &'static str,
    },
    /// The work was called off (Ctrl-C).
    Cancelled,
}

impl FormatError {
    /// An [`FormatError::Io`] of `action` on `path`.
    pub fn io(path: &Path, action: &'static str, source: std::io::Error) -> Self {
        Self::Io { path: path.to_owned(), action, source }
    }

    /// An [`FormatError::Invalid`].
    pub fn invalid(path: &Path, problem: impl Into<String>) -> Self {
        Self::Invalid { path: path.to_owned(), problem: problem.into() }
    }

    /// A [`FormatError::Invalid`] of a picture that is no longer what its header said.
    pub(crate) fn changed(path: &Path) -> Self {
        Self::invalid(path, "changed while it was being read; run again")
    }

    /// A [`FormatError::TooLarge`].
    pub fn too_large(path: &Path, needed: u64, limit: u64) -> Self {
        Self::TooLarge { path: path.to_owned(), needed, limit, remedy: "raise --memory or lower -j" }
    }

    /// An [`FormatError::Unsupported`].
    pub fn unsupported(path: &Path, problem: impl Into<String>) -> Self {
        Self::Unsupported { path: path.to_owned(), problem: problem.into() }
    }
}

/// Refuses what would take more than `limit` bytes, before it is allocated.
pub(crate) fn check_memory(needed: u64, limit: u64, path: &Path) -> Result<(), FormatError> {
    if needed > limit || usize::try_from(needed).is_err() {
        return Err(FormatError::too_large(path, needed, limit));
    }
    Ok(())
}

impl fmt::Display for FormatError {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Io { path, action, .. } => write!(f, "cannot {action} {}", path.display()),
            Self::Invalid { path, problem } | Self::Unsupported { path, problem } => {
                write!(f, "{}: {problem}", path.display())
            }
            Self::TooLarge { path, needed, limit, remedy } => write!(
                f,
                "{}: needs {} MiB of memory where {} MiB are allowed; {remedy}",
                path.display(),
                needed.div_ceil(1 << 20),
                limit >> 20
            ),
            Self::Cancelled => {
                write!(f, "interrupted; no file is half-written, what was not finished is not there")
            }
        }
    }
}

impl std::error::Error for FormatError {
    fn source(&self) -> Option<&(dyn std::error::Error + 'static)> {
        match self {
            Self::Io { source, .. } => Some(source),
            _ => None,
        }
    }
}
