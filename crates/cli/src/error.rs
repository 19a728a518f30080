//! Failures of commands, and the exit code of each.

use epipole_formats::FormatError;
use epipole_mapper::MapperError;
use epipole_optimize::OptimizeError;

/// A command failed.
#[derive(Debug, thiserror::Error)]
pub(crate) enum CliError {
    /// A file could not be read.
    #[error(transparent)]
    Input(FormatError),
    /// A result could not be written.
    #[error("the result could not be written: {0}")]
    Output(FormatError),
    /// Options or files that do not go together.
    #[error("{0}")]
    Usage(String),
    /// The pipeline.
    #[error(transparent)]
    Mapper(#[from] MapperError),
    /// The optimiser.
    #[error(transparent)]
    Optimize(#[from] OptimizeError),
    /// A person asked to stop.
    #[error("{0}")]
    Stopped(String),
}

impl CliError {
    /// 1 for a failed computation, 2 for bad usage or bad input.
    pub(crate) fn exit_code(&self) -> u8 {
        match self {
            Self::Input(_) | Self::Usage(_) => 2,
            Self::Mapper(
                MapperError::TooFewImages(_) | MapperError::NoPairs { .. } | MapperError::InvalidOption { .. },
            ) => 2,
            Self::Mapper(_) | Self::Optimize(_) | Self::Output(_) | Self::Stopped(_) => 1,
        }
    }
}
