//! `cargo xtask bench gpu`: bundle adjustment on whatever WebGPU adapter there is, in figures that compare between devices.

#[path = "../../tests/common/mod.rs"]
mod common;
mod report;

use std::path::PathBuf;
use std::process::ExitCode;
use std::time::Instant;

use epipole_optimize::OptimizeError;
use epipole_optimize::bundle::Options;
use epipole_optimize::bundle::gpu::measure::{Timing, operator, steps, stream_bytes_per_second};
use epipole_optimize::executor::block_on;
use epipole_optimize::gpu::{Device, Limits};
use epipole_optimize::lm::LmOptions;
use report::{Report, Row};

/// What can be asked for, as `name=value`; `cargo xtask bench gpu` has the same with a help text.
struct Arguments {
    /// Sizes of the problems, observations, between commas.
    observations: Vec<usize>,
    /// Steps of each problem's solve.
    steps: usize,
    /// How long to repeat what is timed.
    seconds: f64,
    /// Use the device's timestamps where it has them.
    timestamps: bool,
    /// WebGPU's default limits, as a browser gives them, instead of the adapter's.
    default_limits: bool,
    /// Where to write the figures as JSON.
    json: Option<PathBuf>,
}

impl Arguments {
    fn parse(words: impl Iterator<Item = String>) -> Result<Self, String> {
        let mut arguments = Self {
            observations: vec![30_000],
            steps: 5,
            seconds: 1.0,
            timestamps: true,
            default_limits: false,
            json: None,
        };
        for word in words {
            let bad = |what: &str| format!("`{word}`: expected {what}; see `cargo xtask bench gpu --help`");
            let (name, value) = word.split_once('=').ok_or_else(|| bad("name=value"))?;
            match name {
                "observations" => {
                    let sizes = value.split(',').map(str::parse).collect::<Result<_, _>>();
                    arguments.observations = sizes.map_err(|_| bad("numbers between commas"))?;
                }
                "steps" => arguments.steps = value.parse().map_err(|_| bad("a number"))?,
                "seconds" => arguments.seconds = value.parse().map_err(|_| bad("a number"))?,
                "timestamps" => arguments.timestamps = value.parse().map_err(|_| bad("true or false"))?,
                "default-limits" => arguments.default_limits = value.parse().map_err(|_| bad("true or false"))?,
                "json" => arguments.json = Some(value.into()),
                _ => return Err(bad("observations, steps, seconds, timestamps, default-limits or json")),
            }
        }
        Ok(arguments)
    }
}

fn main() -> ExitCode {
    let done = Arguments::parse(std::env::args().skip(1)).and_then(|arguments| {
        let report = run(&arguments).map_err(|error| error.to_string())?;
        let Some(path) = &arguments.json else { return Ok(()) };
        std::fs::write(path, report.json()).map_err(|error| format!("{}: {error}", path.display()))
    });
    match done {
        Ok(()) => ExitCode::SUCCESS,
        Err(error) => {
            eprintln!("error: {error}");
            ExitCode::FAILURE
        }
    }
}

fn run(arguments: &Arguments) -> Result<Report, OptimizeError> {
    let start = Instant::now();
    let clock = || start.elapsed().as_secs_f64();
    let limits = if arguments.default_limits { Limits::Default } else { Limits::Adapter };
    let device = block_on(Device::open(limits))?;
    let timestamps = device.has_timestamps() && arguments.timestamps;
    let timing = Timing { clock: &clock, timestamps, min_seconds: arguments.seconds };
    let stream = block_on(stream_bytes_per_second(&device, &timing))?;
    let mut report = Report::new(&device, timestamps, stream);
    report.print_head();
    for &observations in &arguments.observations {
        let mut problem = common::ring(&common::bench_scene(observations));
        // So far off that every step has something to do.
        common::perturb(&mut problem, 0.1, 0.01, 1);
        let lm = LmOptions {
            max_iterations: arguments.steps,
            relative_decrease_tolerance: 0.0,
            scaled_step_tolerance: 0.0,
            ..LmOptions::default()
        };
        let options = Options { lm, ..Options::default() };
        let operator = block_on(operator(&device, &problem, &options, &timing))?;
        let steps = block_on(steps(&device, &problem, &options, &timing))?;
        let row = Row::new(&problem, &operator, &steps, stream);
        row.print();
        report.rows.push(row);
    }
    Ok(report)
}
