//! `cargo xtask bench`: pycolmap in its own virtual environment, the release build of Epipole, and a Python driver.

mod backends;
mod gpu;

use std::path::{Path, PathBuf};
use std::process::Command;

use clap::{Args, Subcommand};

use crate::error::Error;
use crate::process::{self, cargo, output, root, target_dir};

/// The peer that all figures are measured against.
const PEER: &str = "pycolmap==4.2.1";

/// The scenes of the speed goals.
const SPEED_SCENES: [&str; 3] = ["strecha_Herz-Jesus-P25", "sevenscenes", "bonsai292"];

/// Every scene with a database and a reference.
const ALL_SCENES: [&str; 10] = [
    "strecha_castle-P19",
    "strecha_Herz-Jesus-P25",
    "strecha_Herz-Jesus-P8",
    "lund_door",
    "middlebury_templering19",
    "colmap2017_db",
    "kermit",
    "sceaux_castle",
    "sevenscenes",
    "bonsai292",
];

#[derive(Args)]
#[command(args_conflicts_with_subcommands = true)]
pub(crate) struct Arguments {
    #[command(subcommand)]
    alone: Option<Alone>,
    /// Scenes below the data folder; the three of the speed goals if none is given, `all` for every one.
    scenes: Vec<String>,
    /// Threads of both programs.
    #[arg(long, default_value_t = 2)]
    threads: usize,
    /// Runs of each program on each scene; the medians are compared.
    #[arg(long, default_value_t = 1)]
    repeats: usize,
    /// Where the real scenes are.
    #[arg(long, value_name = "DIR")]
    data: Option<PathBuf>,
    /// Also bundle adjustment alone, from one perturbed model to the same cost.
    #[arg(long)]
    bundle: bool,
    /// The scene whose model `--bundle` perturbs.
    #[arg(long, default_value = "bonsai292")]
    bundle_scene: String,
    /// Only rotation averaging, on Ellis Island.
    #[arg(long)]
    rotations: bool,
    /// Only metric depth on 7-Scenes: which stages see it, damaged maps; a table and `docs/depth/ablation.png`.
    #[arg(long)]
    depth: bool,
    /// Only what must hold of every written model: same bytes on any number of threads, pycolmap's agreement, round trips.
    #[arg(long)]
    check: bool,
    /// Also write the figures as JSON.
    #[arg(long, value_name = "FILE")]
    json: Option<PathBuf>,
}

/// What needs no peer.
#[derive(Subcommand)]
enum Alone {
    /// Bundle adjustment on a WebGPU adapter, from 30 000 to 5 000 000 observations, against a stream read.
    Gpu(gpu::Arguments),
    /// Reconstructs the same scenes on the GPU and on the CPU, and fails where their accuracy differs.
    Backends(backends::Arguments),
}

pub(crate) fn run(arguments: &Arguments) -> Result<(), Error> {
    match &arguments.alone {
        Some(Alone::Gpu(arguments)) => return gpu::run(arguments),
        Some(Alone::Backends(arguments)) => return backends::run(arguments),
        None => {}
    }
    let data = arguments.data.clone().unwrap_or_else(|| root().join("../shared/data"));
    if !data.is_dir() {
        return Err(Error::Missing(format!(
            "{} is not there; name the folder of the real scenes with --data",
            data.display()
        )));
    }
    let python = environment()?;
    if arguments.rotations {
        return rotations(&python, &data);
    }
    process::run(&mut cargo(&["build", "--release", "--package", "epipole"]), "")?;
    let epipole = target_dir().join("release/epipole");
    if arguments.depth {
        return depth(&python, &epipole, &data);
    }
    if arguments.check {
        let mut check = script(&python, "peer_check.py");
        return process::run(check.arg(epipole).arg(&data).args(scenes_of(arguments)), "");
    }
    let mut driver = script(&python, "bench.py");
    driver.arg("--epipole").arg(epipole).arg("--data").arg(&data);
    driver.arg("--threads").arg(arguments.threads.to_string()).arg("--repeats").arg(arguments.repeats.to_string());
    driver.arg("--scenes").args(scenes_of(arguments));
    if arguments.bundle {
        driver.args(["--bundle", "--bundle-scene", &arguments.bundle_scene]);
    }
    if let Some(path) = &arguments.json {
        driver.arg("--json").arg(path);
    }
    process::run(&mut driver, "")
}

/// The scenes that were asked for.
fn scenes_of(arguments: &Arguments) -> Vec<&str> {
    let asked: Vec<&str> = arguments.scenes.iter().map(String::as_str).collect();
    match asked.as_slice() {
        [] => SPEED_SCENES.to_vec(),
        asked if asked.contains(&"all") => ALL_SCENES.to_vec(),
        _ => asked,
    }
}

/// What depth maps are worth, and what damaged ones do.
fn depth(python: &Path, epipole: &Path, data: &Path) -> Result<(), Error> {
    let needs = ["matplotlib", "pillow"];
    if output(&python.to_string_lossy(), &["-c", "import matplotlib, PIL"]).is_none() {
        let mut install = Command::new(python);
        process::run(install.args(["-m", "pip", "install", "--quiet"]).args(needs), "PyPI must be reachable once")?;
    }
    let mut driver = script(python, "depth_ablation.py");
    driver.arg("--epipole").arg(epipole).arg("--data").arg(data);
    driver.arg("--sidecar").arg(root().join("docs/depth/kinect-nominal.json"));
    driver.arg("--plot").arg(root().join("docs/depth/ablation.png"));
    process::run(&mut driver, "")
}

/// Mean and median rotation error of both on the same edges.
fn rotations(python: &Path, data: &Path) -> Result<(), Error> {
    let scene = data.join("rotavg_ellis_island");
    process::run(script(python, "peer_rotations.py").arg(&scene), "")?;
    // Ours prints its figures from the test that guards them.
    let test = ["test", "--release", "--package", "epipole-mapper", "ellis_island", "--", "--nocapture"];
    process::run(&mut cargo(&test), "")
}

fn script(python: &Path, name: &str) -> Command {
    let mut command = Command::new(python);
    command.arg(root().join("crates/xtask/python").join(name));
    // The checkout stays clean.
    command.env("PYTHONDONTWRITEBYTECODE", "1");
    command
}

/// The Python of the peer's virtual environment, made on first use.
fn environment() -> Result<PathBuf, Error> {
    let folder = target_dir().join("bench-venv");
    let python = folder.join("bin/python");
    let has_peer = |python: &Path| output(&python.to_string_lossy(), &["-c", "import pycolmap, numpy"]).is_some();
    if has_peer(&python) {
        return Ok(python);
    }
    println!("setting up {PEER} in {}", folder.display());
    let advice = "install Python 3.9 or newer with venv, on Debian `sudo apt-get install python3-venv`";
    process::run(Command::new("python3").args(["-m", "venv"]).arg(&folder), advice)?;
    let advice = "PyPI must be reachable once";
    process::run(Command::new(&python).args(["-m", "pip", "install", "--quiet", PEER, "numpy"]), advice)?;
    Ok(python)
}
