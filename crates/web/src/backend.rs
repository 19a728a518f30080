//! Where a solve runs: the processor or the browser's WebGPU device, and why; never a silent choice.

use epipole_optimize::Engine;
use epipole_optimize::engine::{DeviceEngine, MIN_OBSERVATIONS, Policy};
use epipole_optimize::gpu::{GpuError, Limits};
use serde::Serialize;

use crate::error::Failure;

/// `Adapter` of `web/engine/protocol.js`.
#[derive(Debug, Serialize)]
pub(crate) struct Place {
    kind: &'static str,
    name: String,
    why: String,
}

/// What computes, for as long as a run lasts.
pub(crate) struct Chosen {
    pub(crate) engine: Engine,
    pub(crate) place: Place,
}

/// The engine that was asked for: `cpu`, `gpu` (whatever device there is, for everything) or `auto` (a hardware device for
/// solves that are worth it). No solve can have more observations than there are keypoints.
pub(crate) async fn choose(backend: &str, keypoints: usize) -> Result<Chosen, Failure> {
    match backend {
        "cpu" => Ok(processor("as chosen".into())),
        "gpu" => {
            let engine = DeviceEngine::open(Limits::Adapter, Policy::default())
                .await
                .map_err(|e| Failure::new("WebGPU", refusal(&e), "choose the processor, or let Epipole choose"))?;
            Ok(device(engine, "as chosen"))
        }
        "auto" if keypoints < MIN_OBSERVATIONS => {
            Ok(processor(format!("{keypoints} keypoints make too few observations to pay for a GPU")))
        }
        "auto" => {
            let policy = Policy { min_observations: MIN_OBSERVATIONS, ..Policy::default() };
            Ok(match DeviceEngine::open(Limits::Adapter, policy).await {
                Err(error) => processor(refusal(&error)),
                Ok(engine) if is_software(&engine) => processor(format!(
                    "the only adapter is {}, which computes on the same processor in a slower way",
                    Engine::Gpu(engine).description()
                )),
                Ok(engine) => device(engine, "it is a hardware adapter and the scene is large enough to pay for it"),
            })
        }
        other => Err(Failure::new("settings", format!("there is no backend {other:?}"), "write auto, gpu or cpu")),
    }
}

/// In a tab there is no driver to install.
fn refusal(error: &GpuError) -> String {
    match error {
        GpuError::NoAdapter { .. } => "this browser offers no WebGPU adapter".into(),
        error => error.to_string(),
    }
}

fn is_software(engine: &DeviceEngine) -> bool {
    engine.device().is_some_and(|device| device.is_software())
}

fn processor(why: String) -> Chosen {
    Chosen { engine: Engine::Cpu, place: Place { kind: "none", name: "processor".into(), why } }
}

fn device(engine: DeviceEngine, why: &str) -> Chosen {
    let kind = if is_software(&engine) { "software" } else { "gpu" };
    let engine = Engine::Gpu(engine);
    Chosen { place: Place { kind, name: engine.description(), why: why.into() }, engine }
}
