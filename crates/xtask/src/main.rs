//! `cargo xtask …`: everything a script would do, in the language everybody here has.

mod bench;
mod browser;
mod demo;
mod error;
mod experiments;
mod fixtures;
mod process;
mod serve;
mod setup;
mod shaders;
mod test;
mod web;

use std::process::ExitCode;

use clap::{Parser, Subcommand};

/// The project's chores.
#[derive(Parser)]
#[command(name = "cargo xtask")]
struct Cli {
    #[command(subcommand)]
    command: Command,
}

#[derive(Subcommand)]
enum Command {
    /// Brings a bare Debian machine to where everything builds; does nothing where that is so already.
    Setup,
    /// Sets up, builds and reconstructs a scene: the first thing to try.
    Demo(demo::Arguments),
    /// Formatting, lints and all tests.
    Test(test::Arguments),
    /// Makes a synthetic scene with known truth (`cargo xtask synth --help` lists the options).
    Synth(fixtures::PassedOn),
    /// Writes the fixture in every broken state and runs `epipole reconstruct` on each.
    Damage(fixtures::DamageArguments),
    /// Writes `tests/fixtures` again.
    Fixtures,
    /// Checks every WebGPU kernel with Naga and compiles each in headless Chromium.
    Shaders(shaders::Arguments),
    /// Builds the page: the engine as WebAssembly, and how large it is.
    Web(web::Arguments),
    /// Builds the page and serves it to this machine: the first thing to try.
    Serve(serve::Arguments),
    /// Drives the page in headless Chromium: `tests/browser`.
    Browser(browser::Arguments),
    /// Settles what can be settled about the GPU design on this machine: `docs/gpu-experiments.md`.
    Experiments(experiments::Arguments),
    /// Measures Epipole against pycolmap on the same inputs, in turn; `bench gpu` and `bench backends` need no peer.
    Bench(bench::Arguments),
}

fn main() -> ExitCode {
    let result = match Cli::parse().command {
        Command::Setup => setup::run(),
        Command::Demo(arguments) => demo::run(&arguments),
        Command::Test(arguments) => test::run(&arguments),
        Command::Synth(passed_on) => fixtures::synth(&passed_on),
        Command::Damage(arguments) => fixtures::damage(&arguments),
        Command::Fixtures => fixtures::regenerate(),
        Command::Shaders(arguments) => shaders::run(&arguments),
        Command::Browser(arguments) => browser::run(&arguments),
        Command::Experiments(arguments) => experiments::run(&arguments),
        Command::Web(arguments) => web::build(&arguments),
        Command::Serve(arguments) => serve::run(&arguments),
        Command::Bench(arguments) => bench::run(&arguments),
    };
    match result {
        Ok(()) => ExitCode::SUCCESS,
        Err(e) => {
            eprintln!("error: {e}");
            ExitCode::FAILURE
        }
    }
}

#[cfg(test)]
mod tests {
    use clap::CommandFactory;

    use super::*;

    #[test]
    fn the_command_line_is_sound() {
        Cli::command().debug_assert();
    }
}
