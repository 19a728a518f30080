//! Why a chore could not be done, always with what to do about it.

use std::path::PathBuf;

/// A chore's failure.
#[derive(Debug, thiserror::Error)]
pub(crate) enum Error {
    /// A program is not installed or cannot be started.
    #[error("`{program}` could not be started ({source}); {advice}")]
    NotStarted {
        /// Which program.
        program: String,
        /// What the system said.
        source: std::io::Error,
        /// What to do.
        advice: String,
    },
    /// A program ran and failed.
    #[error("`{command}` failed ({status}){advice}")]
    Failed {
        /// The command line.
        command: String,
        /// Its exit status.
        status: String,
        /// What to do; empty where the program has said it.
        advice: String,
    },
    /// Something is missing that only a person can provide.
    #[error("{0}")]
    Missing(String),
    /// Two things that should agree do not.
    #[error("{0}")]
    Apart(String),
    /// A file or folder could not be read or made.
    #[error("{}: {source}", path.display())]
    Io {
        /// The file or folder.
        path: PathBuf,
        /// What the system said.
        source: std::io::Error,
    },
}
