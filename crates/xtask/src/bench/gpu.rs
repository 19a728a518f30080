//! `cargo xtask bench gpu`: bundle adjustment on whatever WebGPU adapter there is, measured against a stream read.

use std::path::PathBuf;

use clap::Args;

use crate::error::Error;
use crate::process::{self, cargo};

#[derive(Args)]
pub(crate) struct Arguments {
    /// Sizes of the synthetic problems, observations.
    #[arg(long, value_delimiter = ',', default_value = "30000,100000,300000,1000000,5000000")]
    observations: Vec<usize>,
    /// Steps of each problem's solve.
    #[arg(long, default_value_t = 5)]
    steps: usize,
    /// How long to repeat what is timed, seconds.
    #[arg(long, default_value_t = 1.0)]
    seconds: f64,
    /// Take the time by the wall, also where the device has timestamps.
    #[arg(long)]
    no_timestamps: bool,
    /// WebGPU's default limits, as a browser gives them, instead of the adapter's.
    #[arg(long)]
    default_limits: bool,
    /// Also write the figures as JSON.
    #[arg(long, value_name = "FILE")]
    json: Option<PathBuf>,
}

pub(crate) fn run(arguments: &Arguments) -> Result<(), Error> {
    let sizes: Vec<String> = arguments.observations.iter().map(ToString::to_string).collect();
    let example = ["--package", "epipole-optimize", "--features", "gpu", "--example", "bench_gpu"];
    let mut bench = cargo(&[&["run", "--release", "--locked"], &example[..], &["--"]].concat());
    bench.arg(format!("observations={}", sizes.join(",")));
    bench.arg(format!("steps={}", arguments.steps)).arg(format!("seconds={}", arguments.seconds));
    bench.arg(format!("timestamps={}", !arguments.no_timestamps));
    bench.arg(format!("default-limits={}", arguments.default_limits));
    if let Some(path) = &arguments.json {
        // The program runs in the workspace's root.
        let path = std::path::absolute(path).map_err(|source| Error::Io { path: path.clone(), source })?;
        bench.arg(format!("json={}", path.display()));
    }
    process::run(&mut bench, "")
}
