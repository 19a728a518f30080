//! Puts a shader together from files: a line `#import "path"` stands for that file, once; lines between `#if FLAG` and
//! `#else` or `#endif` are there only in variants with that flag.
//!
//! The files are part of the program, so that nothing has to be found at run time.

use super::error::GpuError;
use super::variant::Variant;

/// As it is, so that compilers' messages have the lines of the file.
#[cfg(not(target_family = "wasm"))]
macro_rules! source {
    ($path:expr) => {
        include_str!($path)
    };
}

/// Without comments: a visitor loads it.
#[cfg(target_family = "wasm")]
macro_rules! source {
    ($path:expr) => {{
        const TEXT: &str = include_str!($path);
        const BYTES: [u8; super::strip::kept(TEXT)] = super::strip::strip(TEXT);
        match str::from_utf8(&BYTES) {
            Ok(text) => text,
            Err(_) => TEXT,
        }
    }};
}

macro_rules! shaders {
    ($($path:literal),* $(,)?) => {
        /// Every file of `shaders/`: path below that folder, and text.
        pub const SOURCES: &[(&str, &str)] =
            &[$(($path, source!(concat!(env!("CARGO_MANIFEST_DIR"), "/../../shaders/", $path)))),*];
    };
}

shaders![
    "bench/stream_read.wgsl",
    "bundle/back_substitute.wgsl",
    "bundle/block.wgsl",
    "bundle/block_sums.wgsl",
    "bundle/change_camera.wgsl",
    "bundle/change_point.wgsl",
    "bundle/coarse.wgsl",
    "bundle/coarse_base.wgsl",
    "bundle/coarse_entry.wgsl",
    "bundle/coarse_modes.wgsl",
    "bundle/coarse_pair.wgsl",
    "bundle/coarse_subtract.wgsl",
    "bundle/commit_camera.wgsl",
    "bundle/commit_point.wgsl",
    "bundle/compact_image.wgsl",
    "bundle/compact_point.wgsl",
    "bundle/cost.wgsl",
    "bundle/damp_point.wgsl",
    "bundle/linearize_camera.wgsl",
    "bundle/linearize_point.wgsl",
    "bundle/modes.wgsl",
    "bundle/observation.wgsl",
    "bundle/pcg.wgsl",
    "bundle/pcg_start.wgsl",
    "bundle/pcg_step.wgsl",
    "bundle/precondition_camera.wgsl",
    "bundle/precondition_factor.wgsl",
    "bundle/precondition_group.wgsl",
    "bundle/prior_camera.wgsl",
    "bundle/product_camera.wgsl",
    "bundle/product_point.wgsl",
    "bundle/refresh.wgsl",
    "bundle/revive.wgsl",
    "bundle/reweight.wgsl",
    "bundle/row.wgsl",
    "bundle/scale_camera.wgsl",
    "bundle/segment_tree.wgsl",
    "bundle/sight.wgsl",
    "bundle/step_camera.wgsl",
    "bundle/store_unit.wgsl",
    "bundle/topology.wgsl",
    "bundle/trial.wgsl",
    "bundle/types.wgsl",
    "bundle/vectors.wgsl",
    "common/camera/angles.wgsl",
    "common/camera/difference.wgsl",
    "common/camera/distortion.wgsl",
    "common/camera/division.wgsl",
    "common/camera/equirectangular.wgsl",
    "common/camera/eucm.wgsl",
    "common/camera/fov.wgsl",
    "common/camera/functions.wgsl",
    "common/camera/models.wgsl",
    "common/camera/polynomial.wgsl",
    "common/camera/tilted.wgsl",
    "common/camera_probe.wgsl",
    "common/dispatch.wgsl",
    "common/loss.wgsl",
    "common/perspective.wgsl",
    "common/probe.wgsl",
    "common/reduce.wgsl",
    "common/tree.wgsl",
    "common/triangle.wgsl",
    "common/unit.wgsl",
    "positioning/block.wgsl",
    "positioning/commit_camera.wgsl",
    "positioning/commit_point.wgsl",
    "positioning/damp.wgsl",
    "positioning/factor.wgsl",
    "positioning/gauge.wgsl",
    "positioning/linearize.wgsl",
    "positioning/model.wgsl",
    "positioning/pcg.wgsl",
    "positioning/pcg_start.wgsl",
    "positioning/pcg_step.wgsl",
    "positioning/precondition.wgsl",
    "positioning/product_camera.wgsl",
    "positioning/product_point.wgsl",
    "positioning/row.wgsl",
    "positioning/sample.wgsl",
    "positioning/spread.wgsl",
    "positioning/step_camera.wgsl",
    "positioning/step_point.wgsl",
    "positioning/types.wgsl",
    "positioning/vectors.wgsl",
];

const IMPORT: &str = "#import ";

/// A shader in the making.
struct Composer {
    variant: Variant,
    /// Files so far, each before those it imports.
    files: Vec<String>,
    text: String,
    /// Flags that any condition named, met or not.
    flags: Variant,
}

/// The text of a file in one variant, with its imports before it, each once, in the order in which they are first named.
///
/// # Errors
/// An import that is not among [`SOURCES`], a flag that no [`Variant`] has, `#if` and `#endif` that do not pair up.
pub fn compose(file: &str, variant: Variant) -> Result<String, GpuError> {
    Composer::run(file, variant).map(|done| done.text)
}

/// The files of which [`compose`] makes a shader.
pub fn files(file: &str, variant: Variant) -> Result<Vec<String>, GpuError> {
    Composer::run(file, variant).map(|done| done.files)
}

/// The variants in which a shader's text can differ, the plain one first. A problem's variant, less the flags that the
/// shader does not ask for, is one of them.
pub fn variants(file: &str) -> Result<Vec<Variant>, GpuError> {
    let mut flags = Variant::default();
    // A file that is imported on a condition may ask for further flags.
    for variant in Variant::ALL_FLAGS.subsets() {
        flags = flags.with(Composer::run(file, variant)?.flags);
    }
    Ok(flags.subsets().collect())
}

impl Composer {
    fn run(file: &str, variant: Variant) -> Result<Self, GpuError> {
        let mut composer = Self { variant, files: Vec::new(), text: String::new(), flags: Variant::default() };
        composer.append(file)?;
        Ok(composer)
    }

    fn append(&mut self, file: &str) -> Result<(), GpuError> {
        if self.files.iter().any(|done| done == file) {
            return Ok(());
        }
        self.files.push(file.to_string());
        let source = SOURCES.iter().find(|(path, _)| *path == file);
        let (_, text) = source.ok_or_else(|| GpuError::UnknownShader { file: file.to_string() })?;
        let lines = self.select(file, text)?;
        for path in lines.iter().filter_map(|line| line.strip_prefix(IMPORT)) {
            self.append(path.trim().trim_matches('"'))?;
        }
        for line in lines.iter().filter(|line| !line.starts_with(IMPORT)) {
            self.text.push_str(line);
            self.text.push('\n');
        }
        Ok(())
    }

    /// The lines of a file that its conditions let through.
    fn select<'t>(&mut self, file: &str, text: &'t str) -> Result<Vec<&'t str>, GpuError> {
        let mut lines = Vec::new();
        // Of every open `#if`: whether its lines are in, and whether its `#else` was met.
        let mut open: Vec<(bool, bool)> = Vec::new();
        for (line, number) in text.lines().zip(1..) {
            let unbalanced = || GpuError::UnbalancedCondition { file: file.to_string(), line: number };
            let mut words = line.split_whitespace();
            match (words.next(), words.next()) {
                (Some("#if"), Some(name)) => {
                    let unknown =
                        || GpuError::UnknownFlag { file: file.to_string(), line: number, flag: name.to_string() };
                    let flag = Variant::from_flag(name).ok_or_else(unknown)?;
                    self.flags = self.flags.with(flag);
                    open.push((self.variant.has(flag), false));
                }
                (Some("#else"), None) => match open.last_mut() {
                    Some((inside, met @ false)) => (*inside, *met) = (!*inside, true),
                    _ => return Err(unbalanced()),
                },
                (Some("#endif"), None) => {
                    open.pop().ok_or_else(unbalanced)?;
                }
                (Some("#if" | "#else" | "#endif"), _) => return Err(unbalanced()),
                _ if open.iter().all(|(inside, _)| *inside) => lines.push(line),
                _ => {}
            }
        }
        let unclosed = GpuError::UnbalancedCondition { file: file.to_string(), line: text.lines().count() };
        if open.is_empty() { Ok(lines) } else { Err(unclosed) }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn select(variant: Variant, text: &str) -> Result<Vec<&str>, GpuError> {
        let mut composer = Composer { variant, files: Vec::new(), text: String::new(), flags: Variant::default() };
        composer.select("here.wgsl", text)
    }

    #[test]
    fn conditions_nest() {
        let text = "a\n#if wide\nb\n  #if depth\nc\n  #else\nd\n  #endif\n#else\ne\n#endif\nf";
        let both = Variant::WIDE.with(Variant::DEPTH);
        for (variant, wanted) in
            [(Variant::default(), "aef"), (Variant::WIDE, "abdf"), (Variant::DEPTH, "aef"), (both, "abcf")]
        {
            assert_eq!(select(variant, text).map(|lines| lines.concat()), Ok(wanted.to_string()));
        }
    }

    #[test]
    fn conditions_that_do_not_pair_up_and_unknown_flags_are_errors_that_name_the_line() {
        for (text, line) in [
            ("#if wide\na", 2),
            ("a\n#endif", 2),
            ("#else\n#endif", 1),
            ("#if wide\n#else\n#else\n#endif", 3),
            ("#if", 1),
            ("#if wide\n#endif wide", 2),
        ] {
            let wanted = GpuError::UnbalancedCondition { file: "here.wgsl".into(), line };
            assert_eq!(select(Variant::WIDE, text), Err(wanted), "{text}");
        }
        let wanted = GpuError::UnknownFlag { file: "here.wgsl".into(), line: 2, flag: "broad".into() };
        assert_eq!(select(Variant::WIDE, "\n#if broad\n#endif"), Err(wanted));
    }

    #[test]
    fn a_shader_without_conditions_has_one_variant() {
        assert_eq!(variants("common/reduce.wgsl"), Ok(vec![Variant::default()]));
    }
}
