//! Scenes with a known truth: the world, the photographs, the matches and the geometry a match database would hold.
//!
//! Everything follows from [`Options::seed`]; the same options give the same scene. World units are metres, +Z is up.

mod bal;
mod cameras;
mod circuit;
mod depth;
mod error;
mod layout;
mod observe;
mod options;
mod overlap;
mod pairs;
mod random;
mod relative_pose;
mod scene;
mod write;

pub use bal::{BalPerturbation, bal_problem, write_bal};
pub use circuit::{Circuit, CircuitScene, circuit};
pub use depth::{DepthModel, MapFiles, MapFormat, give_depths, write_depth_maps};
pub use error::SynthError;
pub use options::{FocalKnowledge, Kind, Options, StoredPoses};
pub use scene::{Scene, generate};
pub use write::{write_scene, write_truth};
