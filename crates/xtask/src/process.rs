//! Starting other programs: shown before they run, checked after, with a time limit where they may hang.

use std::path::PathBuf;
use std::process::{Command, ExitStatus, Stdio};
use std::time::{Duration, Instant};

use crate::error::Error;

/// How often a program with a time limit is looked after.
const POLL: Duration = Duration::from_millis(100);

/// The workspace's root.
pub(crate) fn root() -> PathBuf {
    PathBuf::from(concat!(env!("CARGO_MANIFEST_DIR"), "/../.."))
}

/// Cargo's target folder, wherever the environment puts it.
pub(crate) fn target_dir() -> PathBuf {
    std::env::var_os("CARGO_TARGET_DIR").map_or_else(|| root().join("target"), |dir| root().join(dir))
}

/// The cargo that started us, in the workspace's root.
pub(crate) fn cargo(arguments: &[&str]) -> Command {
    let mut command = Command::new(std::env::var_os("CARGO").unwrap_or_else(|| "cargo".into()));
    command.args(arguments).current_dir(root());
    command
}

/// The command as a person would type it.
pub(crate) fn shown(command: &Command) -> String {
    let program = PathBuf::from(command.get_program());
    // The full path of cargo says nothing to a person.
    let name = program.file_name().map_or_else(|| program.display().to_string(), |n| n.to_string_lossy().into_owned());
    let arguments = command.get_args().map(|a| format!(" {}", a.to_string_lossy()));
    name + &arguments.collect::<String>()
}

/// Prints the command, runs it with our output, and fails if it fails.
pub(crate) fn run(command: &mut Command, advice: &str) -> Result<(), Error> {
    println!("$ {}", shown(command));
    let status = command.status().map_err(|source| not_started(command, source, advice))?;
    check(command, status, advice)
}

/// As [`run`], ended after `limit`.
pub(crate) fn run_within(command: &mut Command, limit: Duration, advice: &str) -> Result<(), Error> {
    println!("$ {} (at most {} s)", shown(command), limit.as_secs());
    let mut child = command.spawn().map_err(|source| not_started(command, source, advice))?;
    let start = Instant::now();
    loop {
        match child.try_wait() {
            Ok(Some(status)) => return check(command, status, advice),
            Ok(None) if start.elapsed() > limit => {
                // Already ended is as good as killed.
                let _ = child.kill();
                let _ = child.wait();
                return Err(Error::Failed {
                    command: shown(command),
                    status: format!("no end after {} s", limit.as_secs()),
                    advice: format!("; {advice}"),
                });
            }
            Ok(None) => std::thread::sleep(POLL),
            Err(source) => return Err(not_started(command, source, advice)),
        }
    }
}

/// Standard output of a program that is there and succeeds, without surrounding space; `None` otherwise.
pub(crate) fn output(program: &str, arguments: &[&str]) -> Option<String> {
    let output = Command::new(program).args(arguments).current_dir(root()).stderr(Stdio::null()).output().ok()?;
    output.status.success().then(|| String::from_utf8_lossy(&output.stdout).trim().to_string())
}

fn not_started(command: &Command, source: std::io::Error, advice: &str) -> Error {
    Error::NotStarted { program: shown(command), source, advice: advice.into() }
}

fn check(command: &Command, status: ExitStatus, advice: &str) -> Result<(), Error> {
    if status.success() {
        return Ok(());
    }
    let advice = if advice.is_empty() { String::new() } else { format!("; {advice}") };
    Err(Error::Failed { command: shown(command), status: status.to_string(), advice })
}
