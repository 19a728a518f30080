//! What a person can choose about depth inside the optimisation.

use serde::{Deserialize, Serialize};

/// Which stages see the depths.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum DepthStages {
    /// None: the scale is free, as without depth maps.
    Off,
    /// Global positioning; a last robust fit gives the scale.
    Positioning,
    /// Bundle adjustment; a first robust fit gives it a scale to begin with.
    Bundle,
    /// Both.
    #[default]
    Both,
}

/// How depths weigh against pixels in bundle adjustment.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum DepthWeight {
    /// By their own uncertainty: one standard deviation weighs as much as one pixel (solver.md §5.3).
    #[default]
    Uncertainty,
    /// As the published code of InstantSfM does, for comparison: 0.1 on inverse metres for every observation, those without
    /// depth pulled to 1e8 m (algorithms.md §1.8).
    Paper,
}

/// Depth inside the optimisation.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct Options {
    /// Which stages see the depths.
    pub stages: DepthStages,
    /// How depths weigh in bundle adjustment.
    pub weight: DepthWeight,
    /// Learn a scale and a shift of the inverse depth of every map, as maps of learned monocular models need. The scale
    /// of the scene is then what the maps agree on.
    pub affine: bool,
    /// With `affine`: standard deviation of a map's scale around what the maps agree on.
    pub affine_scale_sigma: f64,
    /// With `affine`: standard deviation of a map's shift, in units of its median inverse depth.
    pub affine_shift_sigma: f64,
    /// Share of the depths that must fit the rays, within three standard deviations and a scale of each map, for any of
    /// them to be believed. Random depths of a scene that is ten times as deep as it is near reach 0.13.
    pub min_agreeing_share: f64,
    /// Least relative bias at which a map that contradicts the others gets a scale of its own: below, the bounded loss of
    /// bundle adjustment and the number of maps are protection enough.
    pub min_map_bias: f64,
}

impl Default for Options {
    fn default() -> Self {
        Self {
            stages: DepthStages::Both,
            weight: DepthWeight::Uncertainty,
            affine: false,
            affine_scale_sigma: 0.5,
            affine_shift_sigma: 0.2,
            min_agreeing_share: 0.3,
            min_map_bias: 0.03,
        }
    }
}
