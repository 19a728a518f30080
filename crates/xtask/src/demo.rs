//! `cargo xtask demo`: from nothing to a reconstruction, on a real scene where there is one and on the fixture elsewhere.

use std::path::PathBuf;
use std::process::Command;

use clap::Args;

use crate::error::Error;
use crate::process::{self, cargo, root, target_dir};
use crate::setup;

/// A real scene that reconstructs in a second and has a ground truth.
const SCENE: &str = "../shared/data/strecha_castle-P19";

#[derive(Args)]
pub(crate) struct Arguments {
    /// Where the model goes; replaced if an earlier run made it.
    #[arg(long, default_value = "out/demo", value_name = "DIR")]
    output: PathBuf,
}

pub(crate) fn run(arguments: &Arguments) -> Result<(), Error> {
    setup::run()?;
    process::run(&mut cargo(&["build", "--release", "--locked", "--package", "epipole"]), "")?;
    let epipole = target_dir().join("release/epipole");
    let scene = root().join(SCENE);
    let (database, images, truth) = if scene.is_dir() {
        (scene.join("database.db"), Some(scene.join("images")), scene.join("gt/sparse"))
    } else {
        println!("no {SCENE} beside the checkout: the synthetic fixture instead");
        let fixture = root().join("tests/fixtures/orbit");
        (fixture.join("database.db"), None, fixture.join("truth"))
    };
    let mut reconstruct = Command::new(&epipole);
    reconstruct.arg("reconstruct").arg(database).arg("--output").arg(&arguments.output);
    if let Some(images) = images {
        reconstruct.arg("--images").arg(images);
    }
    process::run(&mut reconstruct, "")?;
    process::run(Command::new(&epipole).arg("evaluate").arg(arguments.output.join("0")).arg(truth), "")?;
    println!("the model is in {}; COLMAP, pycolmap and 3D Gaussian splat trainers open it", arguments.output.display());
    Ok(())
}
