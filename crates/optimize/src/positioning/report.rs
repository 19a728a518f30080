//! What happened in a solve, for people and for the stages after it.

use std::fmt;

use super::convex::ConvexReport;
use super::quality::Quality;
use crate::lm::LmReport;

/// Where an attempt began.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Start {
    /// All free scales equal.
    EqualScales,
    /// Least unsquared deviations.
    Lud,
    /// The best of the others, with its worst observations left out.
    Clipped,
}

/// One start and the variable projection after it.
#[derive(Clone, Debug, PartialEq)]
pub struct Attempt {
    /// Where it began.
    pub start: Start,
    /// The convex solves; all zero for [`Start::Clipped`].
    pub convex: ConvexReport,
    /// The loop; its costs are `½ Σ ω ρ`. For [`Start::Clipped`] over fewer observations.
    pub lm: LmReport,
    /// How well all rays agree with the result.
    pub quality: Quality,
}

/// Something the caller should tell the user.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Warning {
    /// Cameras fall into groups without common points; groups are placed and sized independently of each other.
    Disconnected {
        /// Number of groups.
        components: usize,
        /// Images outside the largest.
        images_outside: usize,
    },
    /// Images without a usable observation stay at the origin.
    ImagesWithoutTracks {
        /// How many.
        count: usize,
    },
    /// The best attempt still looks failed.
    Suspicious {
        /// Share of observations within 1°.
        agreeing_share: f64,
        /// Lowest such share over cameras with 30 or more observations.
        worst_camera_share: Option<f64>,
    },
    /// The loop ran out of iterations.
    NotConverged {
        /// How many it had.
        iterations: usize,
    },
}

impl fmt::Display for Warning {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Disconnected { components, images_outside } => write!(
                f,
                "tracks connect the images in {components} separate groups; {images_outside} images outside the largest \
                 have no meaningful place relative to it"
            ),
            Self::ImagesWithoutTracks { count } => write!(f, "{count} images see no usable point and are not placed"),
            Self::Suspicious { agreeing_share, worst_camera_share } => {
                write!(f, "only {:.0} % of the rays pass their point within 1°", 100.0 * agreeing_share)?;
                if let Some(worst) = worst_camera_share {
                    write!(f, ", in the worst image {:.0} %", 100.0 * worst)?;
                }
                f.write_str("; positions are probably wrong (check rotations, focal lengths and matches)")
            }
            Self::NotConverged { iterations } => {
                write!(f, "positioning stopped after {iterations} iterations before it converged")
            }
        }
    }
}

/// The result besides the positions.
#[derive(Clone, Debug, PartialEq)]
pub struct Report {
    /// What was tried, in order.
    pub attempts: Vec<Attempt>,
    /// Index of the attempt whose positions were kept.
    pub chosen: usize,
    /// Observations that took part: in tracks seen by two or more images.
    pub observations: usize,
    /// Images in connected groups, largest first (then by first image), ascending within.
    pub components: Vec<Vec<u32>>,
    /// Images without usable observations, left at the origin.
    pub unplaced_images: Vec<u32>,
    /// Points seen by one image only: placed on their ray at the pinned or the median distance.
    pub single_view_points: usize,
    /// Points without observations, left at the origin.
    pub unseen_points: usize,
    /// Factor of the final fit of the scale to the pinned depths; `None` without pins.
    pub metric_scale_correction: Option<f64>,
    /// What to tell the user.
    pub warnings: Vec<Warning>,
}

impl Report {
    /// The attempt that was kept.
    pub fn kept(&self) -> &Attempt {
        &self.attempts[self.chosen]
    }
}
