//! What a run did, for `report.json` and the page: times, counts, and why each missing image is missing.

use epipole_scene::depth::DepthInput;
use serde::Serialize;

use crate::event::Stage;
use crate::metric::MetricReport;
use crate::options::Options;

/// The report of a run.
#[derive(Clone, Debug, Serialize)]
pub struct Report {
    /// Version of the program.
    pub version: &'static str,
    /// The options, resolved.
    pub options: Options,
    /// What came of reading depth maps; the reader fills it in, as it fills in its warnings.
    pub depth_input: Option<DepthInput>,
    /// Images in the database.
    pub num_images: usize,
    /// Images posed in any component.
    pub num_registered: usize,
    /// Whether a person stopped the run early.
    pub stopped: bool,
    /// The components, largest first.
    pub components: Vec<ComponentReport>,
    /// Every image of the database, in its order.
    pub images: Vec<ImageReport>,
    /// Wall time of every stage.
    pub stages: Vec<StageTime>,
    /// Everything a person should know.
    pub warnings: Vec<String>,
}

/// One component.
#[derive(Clone, Debug, Serialize)]
pub struct ComponentReport {
    /// Posed images.
    pub images: usize,
    /// Points.
    pub points: usize,
    /// Observations.
    pub observations: usize,
    /// Mean reprojection error, px.
    pub mean_reprojection_error_px: f64,
    /// Mean track length.
    pub mean_track_length: f64,
    /// Share of observations within 1° after global positioning.
    pub positioning_ok_share: f64,
    /// The lowest such share over cameras with 30 or more observations.
    pub positioning_ok_share_worst_camera: Option<f64>,
    /// Share of the tracks' observations that survived the filters of bundle adjustment.
    pub observations_kept_share: f64,
    /// The scale, where depth maps made it metric; without, the unit of length is arbitrary.
    pub metric: Option<MetricReport>,
}

/// One image.
#[derive(Clone, Debug, Serialize)]
pub struct ImageReport {
    /// COLMAP's image id.
    pub id: u32,
    /// File name.
    pub name: String,
    /// The component it is posed in.
    pub component: Option<usize>,
    /// Points it observes.
    pub points: usize,
    /// Its mean reprojection error, px.
    pub mean_reprojection_error_px: Option<f64>,
    /// Why it is not posed.
    pub unregistered: Option<UnregisteredReason>,
}

/// Why an image is in no component.
#[derive(Clone, Debug, PartialEq, Eq, Serialize)]
#[serde(tag = "reason", rename_all = "snake_case")]
pub enum UnregisteredReason {
    /// No keypoints in the database.
    NoKeypoints,
    /// No pair with this image was ever matched.
    NoPairs,
    /// It has pairs, but none with enough verified matches and a pose; `best` matches in the strongest one.
    WeakPairs {
        /// Verified matches of its strongest pair.
        best: usize,
    },
    /// Every pair disagreed with the averaged rotations.
    InconsistentRotations,
    /// Its component has too few images.
    SmallComponent {
        /// Images of the component.
        images: usize,
    },
    /// Global positioning found no track for it.
    NoTracks,
    /// All its observations were filtered as outliers.
    NoObservationsLeft,
    /// Its component could not be reconstructed.
    ComponentFailed {
        /// Why.
        message: String,
    },
    /// The run was stopped before its component.
    Stopped,
}

/// Wall time of a stage.
#[derive(Clone, Debug, Serialize)]
pub struct StageTime {
    /// Which stage.
    pub stage: Stage,
    /// Which component.
    pub component: usize,
    /// Wall time.
    pub seconds: f64,
    /// One line of counts.
    pub summary: String,
}
