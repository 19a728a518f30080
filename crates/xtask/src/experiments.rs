//! `cargo xtask experiments`: the experiments of `solver.md` §8 that need no GPU, and more where there is one.

use std::path::PathBuf;
use std::process::Command;
use std::time::Duration;

use clap::Args;

use crate::error::Error;
use crate::process::{self, cargo, root, run_within, target_dir};
use crate::shaders::{chromium, playwright};

/// All kernels and some thousand empty dispatches on SwiftShader take seconds; beyond this the browser hangs.
const BROWSER_LIMIT: Duration = Duration::from_secs(180);

#[derive(Args)]
pub(crate) struct Arguments {
    /// Only what needs no browser.
    #[arg(long)]
    no_browser: bool,
    /// Path of Chromium, where it is not in one of the usual places.
    #[arg(long)]
    chromium: Option<PathBuf>,
}

pub(crate) fn run(arguments: &Arguments) -> Result<(), Error> {
    let package = ["-p", "epipole-optimize", "--features", "gpu", "--locked"];
    let native = [&["run"], &package[..], &["--example", "gpu_experiments"]].concat();
    process::run(&mut cargo(&native), "the experiments need a Vulkan driver")?;
    // R7 natively; what the kernels read and wrote is left for the browser.
    let folder = target_dir().join("kernel-traces");
    if folder.exists() {
        std::fs::remove_dir_all(&folder).map_err(|source| Error::Io { path: folder.clone(), source })?;
    }
    std::fs::create_dir_all(&folder).map_err(|source| Error::Io { path: folder.clone(), source })?;
    let tests = ["--lib", "--", "--nocapture", "many_small_cameras", "one_shared_camera", "incremental_residuals"];
    let mut traces = cargo(&[&["test"], &package[..], &tests].concat());
    process::run(traces.env("EPIPOLE_KERNEL_TRACES", &folder), "a kernel and its twin differ")?;
    if arguments.no_browser {
        println!("LEFT OUT: Chromium, as asked");
        return Ok(());
    }
    let (chromium, modules) = (chromium(arguments.chromium.as_ref())?, playwright()?);
    let mut node = Command::new("node");
    node.arg(root().join("crates/xtask/js/experiments.mjs")).arg(&folder);
    node.arg(root().join("crates/optimize/examples/gpu_experiments/empty.wgsl")).arg(chromium).current_dir(modules);
    run_within(&mut node, BROWSER_LIMIT, "a kernel gives other numbers in Chromium than natively")
}
