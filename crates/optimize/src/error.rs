//! Why a problem cannot be solved, said with array and row.

/// What is wrong with a problem, or what ran out.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
pub enum OptimizeError {
    /// Two arrays that belong together differ in length.
    #[error(
        "problem array `{array}` has {found} rows, expected {expected}; build all arrays from the same images, points \
         and observations"
    )]
    Length {
        /// Name of the array.
        array: &'static str,
        /// Its length.
        found: usize,
        /// The length the other arrays ask for.
        expected: usize,
    },
    /// An index points past the end of the array it refers to.
    #[error("problem array `{array}` row {row} refers to {target} {index}, but there are only {count}")]
    Index {
        /// Name of the array.
        array: &'static str,
        /// Row of the first bad index.
        row: usize,
        /// What it refers to.
        target: &'static str,
        /// The index.
        index: usize,
        /// How many there are.
        count: usize,
    },
    /// A number is NaN, infinite or out of range.
    #[error("problem array `{array}` row {row} is not {expected}; drop the row or mend the input")]
    Value {
        /// Name of the array.
        array: &'static str,
        /// Row of the first bad value.
        row: usize,
        /// What the value should have been.
        expected: &'static str,
    },
    /// The problem does not fit 32-bit indices.
    #[error("the problem has {count} {what}, more than the {limit} that can be indexed; split it")]
    TooLarge {
        /// What there is too much of.
        what: &'static str,
        /// How many.
        count: usize,
        /// How many are possible.
        limit: usize,
    },
    /// Memory ran out.
    #[error("not enough memory for {what}")]
    OutOfMemory {
        /// For what.
        what: &'static str,
    },
    /// No point is seen by two or more images, so no position can be found.
    #[error(
        "no point is seen by two or more images ({images} images, {points} points, {observations} observations); match \
         more pairs or relax the track filters"
    )]
    NothingToPosition {
        /// Number of images.
        images: usize,
        /// Number of points.
        points: usize,
        /// Number of observations.
        observations: usize,
    },
    /// The linear system of a convex start has no factor, even with more damping.
    #[error("the linear system of the {stage} start of positioning has no solution; the rays carry no usable geometry")]
    Singular {
        /// Which start failed.
        stage: &'static str,
    },
    /// The observer asked to stop before there was anything to keep. The problem is as it was.
    #[error("stopped before the first solve was over; let it run longer")]
    Stopped,
    /// The GPU failed while it solved. The problem holds the state of the checkpoint, or is as it was where there is none.
    #[cfg(feature = "gpu")]
    #[error("{error}; {}", what_is_kept(.kept.as_ref()))]
    Interrupted {
        /// What happened.
        error: crate::gpu::GpuError,
        /// What the problem was left at.
        kept: Option<crate::bundle::gpu::Checkpoint>,
    },
    /// The GPU failed before it began, or cannot do it; the problem is as it was.
    #[cfg(feature = "gpu")]
    #[error(transparent)]
    Gpu(#[from] crate::gpu::GpuError),
}

#[cfg(feature = "gpu")]
fn what_is_kept(kept: Option<&crate::bundle::gpu::Checkpoint>) -> String {
    match kept {
        None => "the problem is as it was".into(),
        Some(kept) => format!(
            "the problem holds the state of iteration {} with cost {:.6e}, resume with a first damping of {:.1e}",
            kept.iteration, kept.cost, kept.lambda
        ),
    }
}
