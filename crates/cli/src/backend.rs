//! Where solves are computed, as `--backend` says: on the processor or on a WebGPU device.

use epipole_optimize::Engine;

use crate::args::Backend;
use crate::error::CliError;

/// The engine that was asked for. `auto` says in one line what it chose and why; `size` is what it judges by: the number of
/// observations, or a bound on it. With `strict` a problem that the device cannot solve is an error, else the
/// processor solves it and a warning says so.
pub(crate) fn engine(backend: Backend, size: Size, strict: bool) -> Result<Engine, CliError> {
    match backend {
        Backend::Cpu => Ok(Engine::Cpu),
        Backend::Gpu => {
            let engine = gpu::open(strict)?;
            eprintln!("backend: gpu ({})", engine.description());
            Ok(engine)
        }
        Backend::Auto => Ok(match gpu::choose(size) {
            Ok(engine) => {
                eprintln!("backend: gpu ({})", engine.description());
                engine
            }
            Err(reason) => {
                eprintln!("backend: cpu ({reason})");
                Engine::Cpu
            }
        }),
    }
}

/// How large a problem is.
#[derive(Clone, Copy, Debug)]
#[cfg_attr(not(feature = "gpu"), allow(dead_code))] // Without a device there is nothing to judge.
pub(crate) enum Size {
    /// Observations of the problem.
    Observations(usize),
    /// Keypoints of all images: no solve can have more observations.
    Keypoints(usize),
}

#[cfg(not(feature = "gpu"))]
mod gpu {
    use super::{CliError, Engine, Size};

    const MISSING: &str = "this program was built without the cargo feature `gpu`";

    pub(super) fn choose(_: Size) -> Result<Engine, String> {
        Err(MISSING.into())
    }

    pub(super) fn open(_: bool) -> Result<Engine, CliError> {
        Err(CliError::Usage(format!(
            "{MISSING}; build it with `cargo build --release --features gpu`, or use --backend cpu"
        )))
    }
}

#[cfg(feature = "gpu")]
mod gpu {
    use epipole_optimize::OptimizeError;
    use epipole_optimize::engine::{DeviceEngine, MIN_OBSERVATIONS, Policy};
    use epipole_optimize::executor::block_on;
    use epipole_optimize::gpu::Limits;

    use super::{CliError, Engine, Size};

    /// A hardware device for problems that are worth it, or why not.
    pub(super) fn choose(size: Size) -> Result<Engine, String> {
        match size {
            Size::Observations(n) if n < MIN_OBSERVATIONS => {
                return Err(format!("{n} observations are too few to pay for a GPU"));
            }
            Size::Keypoints(n) if n < MIN_OBSERVATIONS => {
                return Err(format!("{n} keypoints make too few observations to pay for a GPU"));
            }
            Size::Observations(_) | Size::Keypoints(_) => {}
        }
        let policy = Policy { min_observations: MIN_OBSERVATIONS, ..Policy::default() };
        let engine = block_on(DeviceEngine::open(Limits::Adapter, policy)).map_err(|error| error.to_string())?;
        match engine.device() {
            Some(device) if device.is_software() => Err(format!("there is only {}", device.description())),
            _ => Ok(Engine::Gpu(engine)),
        }
    }

    /// Whatever device there is, for everything.
    pub(super) fn open(strict: bool) -> Result<Engine, CliError> {
        let policy = Policy { strict, ..Policy::default() };
        let engine = block_on(DeviceEngine::open(Limits::Adapter, policy)).map_err(OptimizeError::from)?;
        Ok(Engine::Gpu(engine))
    }
}
