//! The output folder: models 0, 1, …, and report.json, without traces of earlier or failed runs.

use std::fs;
use std::path::{Path, PathBuf};

use epipole_formats::{FormatError, atomic_write, remove_model, write_model_binary};
use epipole_mapper::Outcome;
use serde_json::Value;

use crate::error::CliError;

const REPORT: &str = "report.json";

/// A folder that results can be written to. One that did not exist disappears again if the run fails.
pub(crate) struct ResultFolder {
    path: PathBuf,
    /// Folders that were made for this run, innermost first.
    created: Vec<PathBuf>,
    is_written: bool,
}

impl ResultFolder {
    /// Makes sure, before any work is done, that the folder exists and can be written to.
    pub(crate) fn prepare(path: &Path) -> Result<Self, CliError> {
        let created = path.ancestors().take_while(|p| !p.as_os_str().is_empty() && !p.exists());
        let folder = Self { path: path.to_owned(), created: created.map(Path::to_owned).collect(), is_written: false };
        let refuse = |source| CliError::Input(FormatError::io(path, source));
        fs::create_dir_all(path).map_err(refuse)?;
        let trial = path.join(".epipole-trial");
        fs::write(&trial, b"").and_then(|()| fs::remove_file(&trial)).map_err(refuse)?;
        Ok(folder)
    }

    /// Writes the models and the report, and removes models that an earlier run left beyond them.
    pub(crate) fn write(mut self, outcome: &Outcome) -> Result<(), CliError> {
        self.is_written = true;
        let report_path = self.path.join(REPORT);
        let earlier = earlier_models(&report_path);
        // Models are about to change: the report of an earlier run must not stand beside them if this is cut short.
        if earlier > 0 {
            fs::remove_file(&report_path).map_err(|e| CliError::Output(FormatError::io(&report_path, e)))?;
        }
        for (number, reconstruction) in outcome.reconstructions.iter().enumerate() {
            write_model_binary(&self.path.join(number.to_string()), reconstruction).map_err(CliError::Output)?;
        }
        for number in outcome.reconstructions.len()..earlier {
            remove_model(&self.path.join(number.to_string())).map_err(CliError::Output)?;
        }
        let io = |e: serde_json::Error| FormatError::io(&report_path, e.into());
        let mut report = serde_json::to_value(&outcome.report).map_err(|e| CliError::Output(io(e)))?;
        drop_times(&mut report);
        atomic_write(&report_path, |writer| {
            serde_json::to_writer_pretty(&mut *writer, &report).map_err(io)?;
            writer.write_all(b"\n").map_err(|e| FormatError::io(&report_path, e))
        })
        .map_err(CliError::Output)
    }
}

impl Drop for ResultFolder {
    fn drop(&mut self) {
        if !self.is_written {
            // Only empty folders go; a folder that something else has been put into stays.
            self.created.iter().for_each(|folder| drop(fs::remove_dir(folder)));
        }
    }
}

/// How many models the report of an earlier run in this folder speaks of.
fn earlier_models(report: &Path) -> usize {
    let read = || serde_json::from_slice::<Value>(&fs::read(report).ok()?).ok();
    read().and_then(|report| report.get("components")?.as_array().map(Vec::len)).unwrap_or(0)
}

/// Wall times differ from run to run; without them the same seed gives the same file. They are in the events.
fn drop_times(report: &mut Value) {
    for stage in report.get_mut("stages").and_then(Value::as_array_mut).into_iter().flatten() {
        if let Some(stage) = stage.as_object_mut() {
            stage.remove("seconds");
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_failed_run_leaves_no_folder_behind() {
        let base = std::env::temp_dir().join(format!("epipole-results-{}", std::process::id()));
        let nested = base.join("a/b");
        drop(ResultFolder::prepare(&nested).expect("can be made"));
        assert!(!base.exists());
        fs::create_dir_all(&base).expect("mkdir");
        drop(ResultFolder::prepare(&nested).expect("can be made"));
        assert!(base.exists() && !base.join("a").exists(), "only what was made here goes");
        fs::remove_dir(&base).expect("empty");
    }

    #[test]
    fn reports_are_the_same_whatever_the_time() {
        let mut report = serde_json::json!({ "stages": [{ "stage": "tracks", "seconds": 1.5, "summary": "x" }] });
        drop_times(&mut report);
        assert_eq!(report, serde_json::json!({ "stages": [{ "stage": "tracks", "summary": "x" }] }));
    }
}
