//! Where problems are solved: on the CPU in `f64`, or on a WebGPU device in single precision.
//!
//! Whoever has a problem asks an [`Engine`] and need not know which it is. Its verbs are async because a device answers
//! later, and in a browser tab nothing may block; a native caller waits with [`crate::executor::block_on`].

#[cfg(feature = "gpu")]
mod device;
mod notice;
#[cfg(all(test, feature = "gpu"))]
mod tests;

#[cfg(feature = "gpu")]
pub use device::{DeviceEngine, MIN_OBSERVATIONS, Policy};
pub use notice::Notice;

use crate::error::OptimizeError;
use crate::lm::{LmReport, Observer};
use crate::{bundle, positioning};

/// What solves.
#[derive(Debug, Default)]
pub enum Engine {
    /// The processor, in `f64`.
    #[default]
    Cpu,
    /// A WebGPU device, in `f32`.
    #[cfg(feature = "gpu")]
    Gpu(DeviceEngine),
}

impl Engine {
    /// What it is, for people.
    pub fn description(&self) -> String {
        match self {
            Self::Cpu => "the CPU".into(),
            #[cfg(feature = "gpu")]
            Self::Gpu(engine) => engine.description(),
        }
    }

    /// Bundle adjustment: [`bundle::solve`] or [`bundle::gpu::solve`].
    ///
    /// # Errors
    /// [`OptimizeError`] for a bad problem; on a device see [`DeviceEngine`].
    pub async fn adjust(
        &mut self,
        problem: &mut bundle::Problem,
        options: &bundle::Options,
        observer: &mut dyn Observer,
    ) -> Result<LmReport, OptimizeError> {
        match self {
            Self::Cpu => bundle::solve_async::<f64>(problem, options, observer).await,
            #[cfg(feature = "gpu")]
            Self::Gpu(engine) => engine.adjust(problem, options, observer).await,
        }
    }

    /// Global positioning: [`positioning::solve`] or [`positioning::gpu::solve`].
    ///
    /// # Errors
    /// [`OptimizeError`] for a bad problem; on a device see [`DeviceEngine`].
    pub async fn position(
        &mut self,
        problem: &mut positioning::Problem,
        options: &positioning::Options,
        observer: &mut dyn Observer,
    ) -> Result<positioning::Report, OptimizeError> {
        match self {
            Self::Cpu => positioning::solve_async::<f64>(problem, options, observer).await,
            #[cfg(feature = "gpu")]
            Self::Gpu(engine) => engine.position(problem, options, observer).await,
        }
    }
}
