//! Why a reconstruction can fail as a whole.

use epipole_optimize::OptimizeError;

/// A failure of the pipeline; problems of single images or pairs are warnings and reasons instead.
#[derive(Debug, thiserror::Error)]
pub enum MapperError {
    /// Fewer than two images.
    #[error(
        "{0} image(s) in the database: a reconstruction needs at least two that overlap; add images and match them"
    )]
    TooFewImages(usize),
    /// No pair is usable.
    #[error("no pair of images has enough verified matches ({min_inliers} or more): {hint}")]
    NoPairs {
        /// The option that set the bound.
        min_inliers: usize,
        /// What to try.
        hint: String,
    },
    /// Nothing could be reconstructed.
    #[error("no component of the view graph could be reconstructed: {0}")]
    NothingReconstructed(String),
    /// An option is out of range.
    #[error("option {name} is {value}: {expected}")]
    InvalidOption {
        /// Dotted path of the option.
        name: String,
        /// What was given.
        value: String,
        /// What is allowed.
        expected: String,
    },
    /// The optimiser refused a problem.
    #[error(transparent)]
    Optimize(OptimizeError),
    /// A linear solve of rotation averaging failed.
    #[error("rotation averaging: {0}")]
    Rotation(String),
    /// A person asked to stop before anything was finished.
    #[error("stopped before any component was finished")]
    Stopped,
}

impl From<OptimizeError> for MapperError {
    fn from(error: OptimizeError) -> Self {
        match error {
            OptimizeError::Stopped => Self::Stopped,
            error => Self::Optimize(error),
        }
    }
}
