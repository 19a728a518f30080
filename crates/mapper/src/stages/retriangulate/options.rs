//! What can be chosen about retriangulation, with COLMAP's values and their reasons.

use serde::{Deserialize, Serialize};

/// Retriangulation; defaults are those of COLMAP 4.2's global mapper (algorithms.md §2.10) unless said otherwise.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct Options {
    /// Whether the stage runs at all.
    pub enabled: bool,
    /// Rounds of bundle adjustment, completing, merging and filtering at most.
    pub rounds: usize,
    /// Share of the observations below which the changes of a round do not justify another.
    pub settled_share: f64,
    /// Largest angle between a ray and the point it founds, degrees.
    pub create_max_angle_error_deg: f64,
    /// Largest angle between a ray and an existing point it joins, degrees.
    pub continue_max_angle_error_deg: f64,
    /// A new point needs two rays that meet under at least this angle, degrees. Narrower ones are uncertain in depth.
    pub min_angle_deg: f64,
    /// Farthest projection of a point from a keypoint that completes its track, px. Wider than the final filter, for
    /// poses and points still move; the filter after the next adjustment decides.
    pub complete_max_error_px: f64,
    /// Matches that completing follows away from a track.
    pub complete_max_transitivity: usize,
    /// Farthest projection of a merged point from any keypoint of either track, px.
    pub merge_max_error_px: f64,
    /// Leave out matches between two keypoints that are matched with nothing else: no third view can confirm them.
    pub ignore_two_view_tracks: bool,
    /// Pairs with a smaller share of matches that became points are tried again.
    pub weak_pair_max_ratio: f64,
    /// As `continue_max_angle_error_deg`, for those pairs.
    pub weak_pair_max_angle_error_deg: f64,
    /// Leave out images whose camera has a focal length or distortion beyond belief: a failed self-calibration.
    pub skip_bogus_cameras: bool,
    /// The filter after each adjustment: observations that project farther from their keypoint are dropped, px.
    pub filter_max_error_px: f64,
    /// The filter after each adjustment: points that no two rays see under this angle are dropped, degrees.
    pub filter_min_angle_deg: f64,
    /// Gauss–Newton steps on the points alone after tracks have grown; 0 turns it off. Not in COLMAP, whose grown points
    /// stay where they were until the next bundle adjustment.
    pub polish_steps: usize,
    /// Huber threshold of those steps, px; that of bundle adjustment.
    pub polish_huber_px: f64,
}

impl Default for Options {
    fn default() -> Self {
        Self {
            enabled: true,
            rounds: 5,
            settled_share: 5e-4,
            create_max_angle_error_deg: 2.0,
            continue_max_angle_error_deg: 2.0,
            min_angle_deg: 1.0,
            complete_max_error_px: 15.0,
            complete_max_transitivity: 5,
            merge_max_error_px: 15.0,
            ignore_two_view_tracks: true,
            weak_pair_max_ratio: 0.2,
            weak_pair_max_angle_error_deg: 5.0,
            skip_bogus_cameras: true,
            filter_max_error_px: 4.0,
            filter_min_angle_deg: 1.5,
            polish_steps: 3,
            polish_huber_px: 1.0,
        }
    }
}
