//! Known rotations, wrong edges, and the real view graph of Ellis Island.

mod ellis_island;
mod synthetic;
