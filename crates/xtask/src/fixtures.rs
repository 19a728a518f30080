//! `cargo xtask synth`, `damage` and `fixtures`: the test crate's synthesiser, built and started.

use std::path::{Path, PathBuf};
use std::process::{Command, Stdio};

use clap::Args;

use crate::error::Error;
use crate::process::{self, cargo, target_dir};

/// Arguments that the synthesiser itself understands.
#[derive(Args)]
#[command(disable_help_flag = true)]
pub(crate) struct PassedOn {
    /// See `cargo xtask synth --help`.
    #[arg(trailing_var_arg = true, allow_hyphen_values = true, value_name = "OPTIONS")]
    arguments: Vec<String>,
}

#[derive(Args)]
pub(crate) struct DamageArguments {
    /// Where the broken databases and the messages go.
    #[arg(long, value_name = "DIR", default_value = "out/damage")]
    output: PathBuf,
}

pub(crate) fn synth(passed_on: &PassedOn) -> Result<(), Error> {
    let mut arguments = vec!["synth"];
    arguments.extend(passed_on.arguments.iter().map(String::as_str));
    start_fixtures(&arguments)
}

pub(crate) fn regenerate() -> Result<(), Error> {
    start_fixtures(&["fixtures"])
}

/// One line a database: the exit code and what the program said. A panic, a crash or a half-written output fails.
pub(crate) fn damage(arguments: &DamageArguments) -> Result<(), Error> {
    let folder = std::path::absolute(&arguments.output)
        .map_err(|source| Error::Io { path: arguments.output.clone(), source })?;
    let path = folder.to_string_lossy().into_owned();
    start_fixtures(&["damage", "--output", &path])?;
    process::run(&mut cargo(&["build", "--quiet", "--release", "--package", "epipole"]), "")?;
    let program = target_dir().join("release/epipole");
    let mut databases = database_files(&folder)?;
    databases.sort();
    let mut bad = Vec::new();
    for database in &databases {
        let name = database.file_stem().unwrap_or_default().to_string_lossy().into_owned();
        let output = folder.join(format!("{name}.out"));
        // A leftover of an earlier run would be taken for this run's output.
        let _ = std::fs::remove_dir_all(&output);
        let mut command = Command::new(&program);
        command.arg("reconstruct").arg(database).arg("--output").arg(&output).stdin(Stdio::null());
        if name.starts_with("depth_") {
            command.arg("--depth-dir").arg(database.with_extension("maps"));
        }
        let result = command.output().map_err(|source| Error::NotStarted {
            program: program.display().to_string(),
            source,
            advice: "build it with `cargo build --release`".into(),
        })?;
        let said = String::from_utf8_lossy(&result.stderr);
        let message = said.lines().find(|l| l.contains("error") || l.contains("warning")).unwrap_or("(no complaint)");
        let code = result.status.code();
        println!("{name:32} exit {} {message}", code.map_or("-".to_string(), |c| c.to_string()));
        let clean = code == Some(0) || !output.join("0").exists();
        if said.contains("panicked") || !matches!(code, Some(0..=2)) || !clean {
            bad.push(name);
        }
    }
    if bad.is_empty() {
        println!("{} databases, no panic, nothing half-written", databases.len());
        return Ok(());
    }
    Err(Error::Missing(format!("a panic, a crash or a half-written output with: {}", bad.join(", "))))
}

fn database_files(folder: &Path) -> Result<Vec<PathBuf>, Error> {
    let io = |source| Error::Io { path: folder.to_owned(), source };
    let entries: Result<Vec<_>, _> = std::fs::read_dir(folder).map_err(io)?.collect();
    let paths = entries.map_err(io)?.into_iter().map(|entry| entry.path());
    Ok(paths.filter(|path| path.extension().is_some_and(|e| e == "db")).collect())
}

fn start_fixtures(arguments: &[&str]) -> Result<(), Error> {
    let mut all = vec!["run", "--quiet", "--package", "epipole-tests", "--bin", "epipole-fixtures", "--"];
    all.extend(arguments);
    // Paths in the arguments are the caller's.
    let mut command = cargo(&all);
    if let Ok(here) = std::env::current_dir() {
        command.current_dir(here);
    }
    process::run(&mut command, "")
}
