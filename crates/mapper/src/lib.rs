//! The pipeline: from a view graph to reconstructions, one file a stage.
//!
//! Every stage is a function from plain data to plain data, usable, tested and timed alone; [`reconstruct`] runs them
//! all, component by component.

mod component;
mod correspondences;
mod error;
mod event;
pub mod metric;
mod options;
mod parallel;
mod pipeline;
mod reasons;
mod report;
pub mod stages;

pub use component::Component;
pub use correspondences::CorrespondenceGraph;
pub use error::MapperError;
pub use event::{Event, Observer, Silent, Stage, breath};
pub use options::{Intrinsics, Matches, Options, Preset, Settings};
pub use pipeline::{Outcome, reconstruct, reconstruct_blocking};
pub use report::{ComponentReport, ImageReport, Report, StageTime, UnregisteredReason};
