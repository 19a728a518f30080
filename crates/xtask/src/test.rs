//! `cargo xtask test`: the whole suite, in the order in which failures are cheapest.

use std::thread;
use std::time::Instant;

use clap::Args;

use crate::browser;
use crate::error::Error;
use crate::process::{self, cargo, output};
use crate::shaders::{self, WITH_GPU};
use crate::web;

#[derive(Args)]
pub(crate) struct Arguments {
    /// Only the tests: no formatting, no lints.
    #[arg(long)]
    quick: bool,
}

pub(crate) fn run(arguments: &Arguments) -> Result<(), Error> {
    if !arguments.quick {
        checked("fmt", &["fmt", "--all", "--check"], "run `cargo fmt --all`")?;
        let lints = ["--all-targets", "--", "-D", "warnings"];
        // Without wgpu too: what only one of the two uses would else be missed.
        let plain = ["clippy", "--locked", "--workspace", "--exclude", "epipole-bindgen"];
        checked("clippy", &[&plain[..], &lints[..]].concat(), "")?;
        checked("clippy", &[&["clippy"], &WITH_GPU[..], &lints[..]].concat(), "")?;
    }
    if let Some(missing) = browser::missing() {
        println!("LEFT OUT: neither the page nor Chromium's shader compiler will be tested, there is no {missing}");
        return native();
    }
    // Both builds have long stretches in which one processor is enough: together they take little more than the longer one.
    let page = thread::spawn(|| web::build(&web::Arguments::default()));
    let tested = native();
    let built = page.join().unwrap_or_else(|_| Err(Error::Missing("building the page panicked".into())));
    tested?;
    shaders::run_in_tests()?;
    built?;
    let start = Instant::now();
    browser::run(&browser::Arguments::built())?;
    println!("the page's tests took {:.0} s", start.elapsed().as_secs_f64());
    Ok(())
}

/// All tests that need no browser.
fn native() -> Result<(), Error> {
    step(&[&["test"], &WITH_GPU[..], &["--no-fail-fast"]].concat(), "")
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
