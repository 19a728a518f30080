//! What the stages hand to one another: the view graph that goes in, the reconstruction that comes out,
//! and how well one agrees with another.

pub mod align;
pub mod chamfer;
pub mod depth;
pub mod evaluate;
pub mod filter;
pub mod kd_tree;
pub mod normalize;
mod reconstruction;
pub mod statistics;
mod view_graph;

#[cfg(test)]
mod fixture;

pub use depth::{ImageDepths, KeypointDepth};
pub use epipole_geometry::camera::Camera;
pub use reconstruction::{Frame, Image, NO_POINT, Observation, Point, Reconstruction, Rig, RigSensor, SensorId};
pub use view_graph::{Pair, PairCamera, PairConfig, ViewGraph, ViewImage};
