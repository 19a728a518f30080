//! The stages of the pipeline, in order; each can be run alone.

pub mod calibrate;
pub mod finish;
pub mod position;
pub mod refine;
pub mod relative_pose;
pub mod retriangulate;
pub mod rotation;
pub mod tracks;
