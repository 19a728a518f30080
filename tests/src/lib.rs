//! What the end-to-end tests share: the scene synthesiser, the shared real scenes and the damage done to databases.

pub mod damage;
pub mod depth_damage;
mod depth_files;
pub mod fixtures;
pub mod shared_data;
pub mod synth;
