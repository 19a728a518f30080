//! Why a scene cannot be made or written.

use epipole_formats::FormatError;

/// A failure of the synthesiser.
#[derive(Debug, thiserror::Error)]
pub enum SynthError {
    /// An option is out of range.
    #[error("synthesiser option {name} is {value}: {expected}")]
    InvalidOption {
        /// The option's name.
        name: &'static str,
        /// What was given.
        value: String,
        /// What is allowed.
        expected: &'static str,
    },
    /// A file could not be written.
    #[error(transparent)]
    Format(#[from] FormatError),
    /// A file or folder could not be made.
    #[error("{path}: {source}; choose a folder that can be written")]
    Io {
        /// The file or folder.
        path: std::path::PathBuf,
        /// What the system said.
        source: std::io::Error,
    },
}
