//! `cargo xtask bench backends`: the same scenes reconstructed on the GPU and on the CPU, held to the same accuracy.

use std::path::{Path, PathBuf};
use std::process::Command;
use std::time::Instant;

use clap::Args;

use crate::error::Error;
use crate::process::{self, cargo, root, target_dir};

/// The scenes of the goal, and whether their intrinsics are known.
const SCENES: [(&str, bool); 5] = [
    ("strecha_castle-P19", false),
    ("strecha_Herz-Jesus-P8", false),
    ("lund_door", false),
    ("middlebury_templering19", true),
    ("sevenscenes", false),
];

/// AUC@1 may differ by this much, of 100.
const MAX_AUC_DIFFERENCE: f64 = 0.3;
/// On sevenscenes, whose AUC@1 says nothing, the trajectory error may differ by this much.
const MAX_ATE_DIFFERENCE_M: f64 = 1e-3;

#[derive(Args)]
pub(crate) struct Arguments {
    /// Scenes below the data folder; all five of the goal if none is given.
    scenes: Vec<String>,
    /// Where the real scenes are.
    #[arg(long, value_name = "DIR")]
    data: Option<PathBuf>,
}

/// What one backend made of a scene.
struct Found {
    auc_at_1: f64,
    ate: f64,
    seconds: f64,
}

pub(crate) fn run(arguments: &Arguments) -> Result<(), Error> {
    let data = arguments.data.clone().unwrap_or_else(|| root().join("../shared/data"));
    process::run(&mut cargo(&["build", "--release", "--package", "epipole", "--features", "gpu"]), "")?;
    let out = target_dir().join("backends");
    let mut apart = Vec::new();
    println!("scene                       AUC@1 cpu    gpu |   ATE cpu       gpu | seconds cpu     gpu");
    for (scene, known) in SCENES {
        if !arguments.scenes.is_empty() && !arguments.scenes.iter().any(|asked| asked == scene) {
            continue;
        }
        let folder = data.join(scene);
        if !folder.is_dir() {
            println!("{scene}: SKIPPED, {} is not there", folder.display());
            continue;
        }
        let on = |backend| reconstruct(&folder, known, backend, &out.join(format!("{scene}-{backend}")));
        let (cpu, gpu) = (on("cpu")?, on("gpu")?);
        println!(
            "{scene:<26} {:>10.2} {:>6.2} | {:>9.6} {:>9.6} | {:>11.2} {:>7.2}",
            cpu.auc_at_1, gpu.auc_at_1, cpu.ate, gpu.ate, cpu.seconds, gpu.seconds
        );
        let agree = match scene {
            "sevenscenes" => (cpu.ate - gpu.ate).abs() <= MAX_ATE_DIFFERENCE_M,
            _ => (cpu.auc_at_1 - gpu.auc_at_1).abs() <= MAX_AUC_DIFFERENCE,
        };
        if !agree {
            apart.push(scene);
        }
    }
    match apart.is_empty() {
        true => Ok(()),
        false => Err(Error::Apart(format!("CPU and GPU disagree on {}", apart.join(", ")))),
    }
}

fn reconstruct(scene: &Path, known_intrinsics: bool, backend: &str, out: &Path) -> Result<Found, Error> {
    let epipole = target_dir().join("release/epipole");
    let mut command = Command::new(&epipole);
    command.arg("reconstruct").arg(scene.join("database.db")).arg("--output").arg(out).args(["--backend", backend]);
    if known_intrinsics {
        command.args(["--intrinsics", "fixed"]);
    }
    let start = Instant::now();
    text_of(&mut command)?;
    let seconds = start.elapsed().as_secs_f64();
    let text = text_of(Command::new(&epipole).arg("evaluate").arg(out).arg(scene.join("gt/sparse")))?;
    let number = |line: &str, after: &str| {
        let found = text.lines().find_map(|l| l.strip_prefix(line)?.split_once(after));
        let number = found.and_then(|(_, rest)| rest.split_whitespace().next()?.trim_end_matches(',').parse().ok());
        number
            .ok_or_else(|| Error::Apart(format!("`epipole evaluate` printed no line `{line}…{after} NUMBER`:\n{text}")))
    };
    Ok(Found { auc_at_1: number("AUC@1", ":")?, ate: number("ATE, similarity:", "RMSE")?, seconds })
}

/// Standard output of a command that succeeds; what it says on the way is shown when it fails.
fn text_of(command: &mut Command) -> Result<String, Error> {
    let shown = process::shown(command);
    let output = command.output().map_err(|source| Error::NotStarted {
        program: shown.clone(),
        source,
        advice: "it should have been built just now".into(),
    })?;
    if output.status.success() {
        return Ok(String::from_utf8_lossy(&output.stdout).into_owned());
    }
    let advice = format!("\n{}", String::from_utf8_lossy(&output.stderr).trim_end());
    Err(Error::Failed { command: shown, status: output.status.to_string(), advice })
}
