//! `cargo xtask test`: the whole suite, in the order in which failures are cheapest.

use std::time::Instant;

use clap::Args;

use crate::error::Error;
use crate::process::{self, cargo, output};
use crate::shaders::{self, WITH_GPU};

#[derive(Args)]
pub(crate) struct Arguments {
    /// Only the tests: no formatting, no lints.
    #[arg(long)]
    quick: bool,
}

pub(crate) fn run(arguments: &Arguments) -> Result<(), Error> {
    if !arguments.quick {
        checked("fmt", &["fmt", "--all", "--check"], "run `cargo fmt --all`")?;
        let lints = ["clippy", "--workspace", "--all-targets", "--locked", "--", "-D", "warnings"];
        checked("clippy", &lints, "")?;
        let with_gpu = ["--package", "epipole", "--all-targets", "--", "-D", "warnings"];
        checked("clippy", &[&["clippy"], &WITH_GPU[..], &with_gpu[..]].concat(), "")?;
    }
    step(&["test", "--workspace", "--locked", "--no-fail-fast"], "")?;
    // Only here does wgpu come in: everything above compiles and runs without it.
    let names = ["gpu", "gpu_extraction", "preconditioner", "backends"];
    let targets = [&["--no-fail-fast", "--lib"][..], &names.map(|name| ["--test", name]).concat()].concat();
    step(&[&["test"], &WITH_GPU[..], &targets[..]].concat(), "")?;
    shaders::run_in_tests()
}

/// A step whose tool may be missing on a machine without rustup's components: then it is left out, loudly.
fn checked(tool: &str, arguments: &[&str], advice: &str) -> Result<(), Error> {
    if output("cargo", &[tool, "--version"]).is_none() {
        println!("LEFT OUT: cargo {tool} is not installed (`rustup component add rustfmt clippy`)");
        return Ok(());
    }
    step(arguments, advice)
}

fn step(arguments: &[&str], advice: &str) -> Result<(), Error> {
    let start = Instant::now();
    process::run(&mut cargo(arguments), advice)?;
    println!("cargo {} took {:.0} s", arguments[0], start.elapsed().as_secs_f64());
    Ok(())
}
