//! Where bundle adjustment is computed: on the processor or on a WebGPU device.

use epipole_optimize::bundle::{Options, Problem, solve_with};
use epipole_optimize::lm::{LmReport, Observer};

use crate::args::{BundleBackend, Precision};
use crate::error::CliError;

/// Solves where it was asked for. `auto` says in one line what it chose and why.
pub(super) fn solve(
    problem: &mut Problem,
    options: &Options,
    precision: Precision,
    backend: BundleBackend,
    observer: &mut dyn Observer,
) -> Result<LmReport, CliError> {
    match backend {
        BundleBackend::Cpu => on_cpu(problem, options, precision, observer),
        BundleBackend::Gpu => gpu::solve(problem, options, observer),
        BundleBackend::Auto => match gpu::choose(problem) {
            Err(reason) => {
                eprintln!("backend: cpu ({reason})");
                on_cpu(problem, options, precision, observer)
            }
            Ok(reason) => {
                eprintln!("backend: gpu ({reason})");
                gpu::solve(problem, options, observer).or_else(|error| {
                    // The problem is as it was: a device that fails leaves it alone.
                    eprintln!("backend: cpu ({error})");
                    on_cpu(problem, options, precision, observer)
                })
            }
        },
    }
}

fn on_cpu(
    problem: &mut Problem,
    options: &Options,
    precision: Precision,
    observer: &mut dyn Observer,
) -> Result<LmReport, CliError> {
    Ok(match precision {
        Precision::F64 => solve_with::<f64>(problem, options, observer)?,
        Precision::F32 => solve_with::<f32>(problem, options, observer)?,
    })
}

#[cfg(not(feature = "gpu"))]
mod gpu {
    use super::{CliError, LmReport, Observer, Options, Problem};

    const MISSING: &str = "this program was built without the cargo feature `gpu`";

    pub(super) fn choose(_: &Problem) -> Result<String, String> {
        Err(MISSING.into())
    }

    pub(super) fn solve(_: &mut Problem, _: &Options, _: &mut dyn Observer) -> Result<LmReport, CliError> {
        Err(CliError::Usage(format!("{MISSING}; build with `--features gpu`, or use --backend cpu")))
    }
}

#[cfg(feature = "gpu")]
mod gpu {
    use epipole_optimize::OptimizeError;
    use epipole_optimize::bundle::gpu;
    use epipole_optimize::gpu::{Device, Limits};
    use epipole_optimize::lm::LmOptions;
    use pollster::block_on;

    use super::{CliError, LmReport, Observer, Options, Problem};

    /// Below this the processor is done before a device has answered a few dozen times.
    const MIN_OBSERVATIONS: usize = 100_000;
    /// In single precision a smaller decrease is rounding (source: `solver.md` §5.7).
    const MIN_TOLERANCE: f64 = 1e-7;

    /// Why to use the GPU, or why not.
    pub(super) fn choose(problem: &Problem) -> Result<String, String> {
        let observations = problem.observation_px.len();
        if observations < MIN_OBSERVATIONS {
            return Err(format!("{observations} observations are too few to pay for a GPU"));
        }
        let device = block_on(Device::open(Limits::Adapter)).map_err(|error| error.to_string())?;
        match device.is_software() {
            true => Err(format!("there is only {}", device.description())),
            false => Ok(device.description().to_string()),
        }
    }

    pub(super) fn solve(
        problem: &mut Problem,
        options: &Options,
        observer: &mut dyn Observer,
    ) -> Result<LmReport, CliError> {
        let device = block_on(Device::open(Limits::Adapter)).map_err(OptimizeError::from)?;
        eprintln!("on {}", device.description());
        let lm = LmOptions {
            relative_decrease_tolerance: options.lm.relative_decrease_tolerance.max(MIN_TOLERANCE),
            lambda_min: LmOptions::default().lambda_min,
            ..options.lm
        };
        Ok(block_on(gpu::solve(&device, problem, &Options { lm, ..*options }, observer))?)
    }
}
