//! Puts a shader together from files: a line `#import "path"` stands for that file, once.
//!
//! The files are part of the program, so that nothing has to be found at run time.

use super::error::GpuError;

macro_rules! shaders {
    ($($path:literal),* $(,)?) => {
        /// Every file of `shaders/`: path below that folder, and text.
        pub const SOURCES: &[(&str, &str)] =
            &[$(($path, include_str!(concat!(env!("CARGO_MANIFEST_DIR"), "/../../shaders/", $path)))),*];
    };
}

shaders!["common/dispatch.wgsl", "common/probe.wgsl", "common/reduce.wgsl", "common/tree.wgsl"];

const IMPORT: &str = "#import ";

/// The text of a file with its imports before it, each once, in the order in which they are first named.
pub fn compose(file: &str) -> Result<String, GpuError> {
    let mut done = Vec::new();
    let mut out = String::new();
    append(file, &mut done, &mut out)?;
    Ok(out)
}

fn append(file: &str, done: &mut Vec<String>, out: &mut String) -> Result<(), GpuError> {
    if done.iter().any(|d| d == file) {
        return Ok(());
    }
    done.push(file.to_string());
    let source = SOURCES.iter().find(|(path, _)| *path == file);
    let (_, text) = source.ok_or_else(|| GpuError::UnknownShader { file: file.to_string() })?;
    for line in text.lines() {
        if let Some(path) = line.strip_prefix(IMPORT) {
            append(path.trim().trim_matches('"'), done, out)?;
        }
    }
    for line in text.lines().filter(|line| !line.starts_with(IMPORT)) {
        out.push_str(line);
        out.push('\n');
    }
    Ok(())
}
