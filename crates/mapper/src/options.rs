//! What a person can choose, twice: as written ([`Settings`], everything optional) and resolved ([`Options`]).

use epipole_scene::depth::DepthOptions;
use serde::{Deserialize, Serialize};
use serde_json::Value;

use crate::error::MapperError;
use crate::metric;
use crate::stages::{calibrate, finish, position, refine, relative_pose, retriangulate, rotation, tracks};

/// How much time to spend.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Preset {
    /// Fewer rounds, no retriangulation.
    Fast,
    /// What the accuracy figures are measured with.
    #[default]
    Default,
    /// Tighter stops and more rounds.
    Accurate,
}

/// What bundle adjustment may do to the intrinsics.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Intrinsics {
    /// Focal lengths and distortion move freely; principal points stay.
    #[default]
    Refine,
    /// Nothing moves.
    Fixed,
    /// As `Refine`, held near the database's values by soft priors.
    Prior,
}

/// Which matches the pipeline believes.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Matches {
    /// The verified inliers and stored poses of `two_view_geometries`.
    #[default]
    Verified,
    /// The raw matches; every relative pose is estimated again.
    Raw,
}

/// Everything the pipeline needs to know, every field set.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct Options {
    /// Seed of all random choices; the same seed gives the same bytes.
    pub seed: u64,
    /// What bundle adjustment may do to the intrinsics.
    pub intrinsics: Intrinsics,
    /// Which matches to use.
    pub matches: Matches,
    /// Reading of depth maps, where there are any.
    pub depth: DepthOptions,
    /// Depth inside the optimisation, where images have depth maps.
    pub metric: metric::Options,
    /// Smallest component that is reconstructed, images.
    pub min_component_images: usize,
    /// Focal lengths from the view graph.
    pub calibrate: calibrate::Options,
    /// Relative poses.
    pub relative_pose: relative_pose::Options,
    /// Rotation averaging.
    pub rotation: rotation::Options,
    /// Tracks.
    pub tracks: tracks::Options,
    /// Global positioning and the filters after it.
    pub position: position::Options,
    /// Bundle adjustment rounds.
    pub refine: refine::Options,
    /// Retriangulation.
    pub retriangulate: retriangulate::Options,
    /// Colours and statistics.
    pub finish: finish::Options,
}

impl Default for Options {
    fn default() -> Self {
        Self {
            seed: 0,
            intrinsics: Intrinsics::default(),
            matches: Matches::default(),
            depth: DepthOptions::default(),
            metric: metric::Options::default(),
            // COLMAP 4.2's smallest model (algorithms.md §2.11): two images have no redundancy.
            min_component_images: 3,
            calibrate: calibrate::Options::default(),
            relative_pose: relative_pose::Options::default(),
            rotation: rotation::Options::default(),
            tracks: tracks::Options::default(),
            position: position::Options::default(),
            refine: refine::Options::default(),
            retriangulate: retriangulate::Options::default(),
            finish: finish::Options::default(),
        }
    }
}

impl Options {
    /// The options of a preset.
    pub fn preset(preset: Preset) -> Self {
        let mut options = Self::default();
        match preset {
            Preset::Default => {}
            Preset::Fast => {
                options.refine.rounds = 2;
                options.retriangulate.enabled = false;
            }
            Preset::Accurate => {
                options.refine.rounds = 4;
                options.refine.relative_decrease_tolerance = 1e-5;
                options.refine.final_relative_decrease_tolerance = 1e-8;
            }
        }
        options
    }
}

/// Options as a person wrote them: a preset and any subset of [`Options`] as JSON, for instance
/// `{"preset": "fast", "seed": 7, "position": {"huber": 0.02}}`.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
#[serde(transparent)]
pub struct Settings(pub serde_json::Map<String, Value>);

impl Settings {
    /// Parses a settings file.
    pub fn from_json(text: &str) -> Result<Self, MapperError> {
        serde_json::from_str(text).map_err(|e| MapperError::InvalidOption {
            name: "settings".into(),
            value: format!("not a JSON object ({e})"),
            expected: "write an object such as {\"preset\": \"fast\"}".into(),
        })
    }

    /// Sets one top-level option, over what was there.
    pub fn set(&mut self, name: &str, value: impl Into<Value>) {
        self.0.insert(name.to_string(), value.into());
    }

    /// Sets one option of a section such as `depth`, over what was there.
    pub fn set_in(&mut self, section: &str, name: &str, value: impl Into<Value>) {
        // A section that is no object is left as it is: resolving refuses it with its name.
        if let Value::Object(section) = self.0.entry(section).or_insert_with(|| Value::Object(Default::default())) {
            section.insert(name.to_string(), value.into());
        }
    }

    /// Fills in everything that was not written; unknown names and values of the wrong type are errors that name them.
    pub fn resolve(&self) -> Result<Options, MapperError> {
        let invalid = |value: String, e: serde_json::Error| MapperError::InvalidOption {
            name: "settings".into(),
            value,
            expected: e.to_string(),
        };
        let mut written = self.0.clone();
        let preset = match written.remove("preset") {
            Some(value) => serde_json::from_value(value.clone()).map_err(|e| invalid(value.to_string(), e))?,
            None => Preset::default(),
        };
        let mut all = serde_json::to_value(Options::preset(preset)).map_err(|e| invalid("the preset".into(), e))?;
        merge(&mut all, &Value::Object(written.clone()));
        let options: Options =
            serde_json::from_value(all).map_err(|e| invalid(Value::Object(written).to_string(), e))?;
        options.check()?;
        Ok(options)
    }
}

/// Lays `over` on `base`, object by object.
fn merge(base: &mut Value, over: &Value) {
    match (base, over) {
        (Value::Object(base), Value::Object(over)) => {
            for (key, value) in over {
                merge(base.entry(key.clone()).or_insert(Value::Null), value);
            }
        }
        (base, over) => *base = over.clone(),
    }
}

impl Options {
    /// Refuses values outside their domain.
    fn check(&self) -> Result<(), MapperError> {
        let positive = [
            ("position.huber", self.position.huber),
            ("position.max_angular_error_deg", self.position.max_angular_error_deg),
            ("refine.huber_px", self.refine.huber_px),
            ("refine.max_normalized_error", self.refine.max_normalized_error),
            ("refine.relative_decrease_tolerance", self.refine.relative_decrease_tolerance),
            ("depth.scale", self.depth.scale.unwrap_or(1.0)),
            ("depth.relative_sigma", self.depth.relative_sigma),
            ("depth.max_m", self.depth.max_m),
            ("depth.max_jump", self.depth.max_jump),
            ("metric.affine_scale_sigma", self.metric.affine_scale_sigma),
            ("metric.affine_shift_sigma", self.metric.affine_shift_sigma),
        ];
        for (name, value) in positive {
            if !(value > 0.0 && value.is_finite()) {
                return Err(MapperError::InvalidOption {
                    name: name.into(),
                    value: value.to_string(),
                    expected: "a positive number".into(),
                });
            }
        }
        if !(0.0..=1.0).contains(&self.depth.min_confidence) {
            return Err(MapperError::InvalidOption {
                name: "depth.min_confidence".into(),
                value: self.depth.min_confidence.to_string(),
                expected: "a number from 0 to 1".into(),
            });
        }
        if self.min_component_images < 2 {
            return Err(MapperError::InvalidOption {
                name: "min_component_images".into(),
                value: self.min_component_images.to_string(),
                expected: "2 or more".into(),
            });
        }
        Ok(())
    }
}

#[cfg(test)]
mod tests {
    use epipole_scene::depth::DepthKind;

    use super::*;

    #[test]
    fn settings_fill_in_and_refuse() {
        let options = Settings::from_json(r#"{"preset": "fast", "seed": 7, "position": {"huber": 0.02}}"#)
            .and_then(|s| s.resolve())
            .expect("valid settings");
        assert_eq!(options.seed, 7);
        assert_eq!(options.position.huber, 0.02);
        assert_eq!(options.refine.rounds, Options::preset(Preset::Fast).refine.rounds);
        let mut settings = Settings::from_json(r#"{"depth": {"scale": 0.5, "kind": "ray"}}"#).expect("valid settings");
        settings.set_in("depth", "scale", 0.25);
        let depth = settings.resolve().expect("valid settings").depth;
        assert_eq!((depth.scale, depth.kind), (Some(0.25), DepthKind::Ray));
        for bad in [r#"{"depth": {"scale": 0}}"#, r#"{"depth": 1}"#, r#"{"depth": {"min_confidence": 2}}"#] {
            assert!(Settings::from_json(bad).and_then(|s| s.resolve()).is_err(), "{bad}");
        }
        for bad in [r#"{"seeed": 7}"#, r#"{"position": {"huber": -1}}"#, r#"{"seed": "x"}"#, "[]", r#"{"preset": 3}"#] {
            assert!(Settings::from_json(bad).and_then(|s| s.resolve()).is_err(), "{bad}");
        }
    }
}
