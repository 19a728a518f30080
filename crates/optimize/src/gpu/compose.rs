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

shaders![
    "bundle/back_substitute.wgsl",
    "bundle/block.wgsl",
    "bundle/change_camera.wgsl",
    "bundle/change_point.wgsl",
    "bundle/commit_camera.wgsl",
    "bundle/commit_point.wgsl",
    "bundle/damp_point.wgsl",
    "bundle/linearize_camera.wgsl",
    "bundle/linearize_point.wgsl",
    "bundle/pcg.wgsl",
    "bundle/pcg_start.wgsl",
    "bundle/pcg_step.wgsl",
    "bundle/precondition_camera.wgsl",
    "bundle/precondition_factor.wgsl",
    "bundle/product_camera.wgsl",
    "bundle/product_point.wgsl",
    "bundle/refresh.wgsl",
    "bundle/reweight.wgsl",
    "bundle/row.wgsl",
    "bundle/scale_camera.wgsl",
    "bundle/segment_tree.wgsl",
    "bundle/step_camera.wgsl",
    "bundle/topology.wgsl",
    "bundle/trial.wgsl",
    "bundle/types.wgsl",
    "bundle/vectors.wgsl",
    "common/dispatch.wgsl",
    "common/loss.wgsl",
    "common/perspective.wgsl",
    "common/probe.wgsl",
    "common/reduce.wgsl",
    "common/tree.wgsl",
];

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
