//! `epipole`: the command line. Parses, runs one command, and turns its result into an exit code.

mod args;
mod backend;
mod bundle;
mod convert;
mod depth;
mod error;
mod evaluate;
mod images;
mod inspect;
mod interrupt;
mod locate;
mod output;
mod progress;
mod reconstruct;
mod results;

use std::process::ExitCode;

use clap::Parser;

use args::{Cli, Command};

fn main() -> ExitCode {
    let cli = Cli::parse();
    let json = cli.command.json();
    let result = match cli.command {
        Command::Reconstruct(args) => reconstruct::run(&args),
        Command::Evaluate(args) => evaluate::run(&args),
        Command::Bundle(args) => bundle::run(&args),
        Command::Inspect(args) => inspect::run(&args),
        Command::Convert(args) => convert::run(&args),
    };
    match result {
        Ok(()) => ExitCode::SUCCESS,
        Err(error) => {
            if json {
                output::json_line(&serde_json::json!({
                    "event": "failed", "message": error.to_string(), "exit_code": error.exit_code(),
                }));
            }
            eprintln!("error: {error}");
            ExitCode::from(error.exit_code())
        }
    }
}
