//! What can be typed: commands and their options.

use std::path::PathBuf;

use clap::{Args, Parser, Subcommand, ValueEnum};

/// Global structure from motion: camera poses and points from matched images.
#[derive(Debug, Parser)]
#[command(name = "epipole", version, about, after_help = EXIT_CODES)]
pub(crate) struct Cli {
    #[command(subcommand)]
    pub(crate) command: Command,
}

/// The contract with scripts.
const EXIT_CODES: &str = "Exit codes:
  0  done
  1  the reconstruction or the solve failed, was stopped before its end (what was finished is kept), or its result
     could not be written
  2  bad usage or bad input: nothing was computed";

#[derive(Debug, Subcommand)]
pub(crate) enum Command {
    /// Reconstruct cameras and points from a COLMAP database.
    #[command(after_help = EXIT_CODES)]
    Reconstruct(ReconstructArgs),
    /// Compare a model with a reference: pose AUC, trajectory error, distance to a point cloud.
    #[command(after_help = EXIT_CODES)]
    Evaluate(EvaluateArgs),
    /// Bundle adjustment of a BAL file or a COLMAP model.
    #[command(after_help = EXIT_CODES)]
    Bundle(BundleArgs),
    /// Say what a database, a model, a BAL file or a PLY file holds and what is wrong with it.
    #[command(after_help = EXIT_CODES)]
    Inspect(InspectArgs),
    /// Convert a COLMAP model to another format.
    #[command(after_help = EXIT_CODES)]
    Convert(ConvertArgs),
}

impl Command {
    /// Whether results go to standard output as JSON.
    pub(crate) fn json(&self) -> bool {
        match self {
            Self::Reconstruct(args) => args.json,
            Self::Evaluate(args) => args.json,
            Self::Bundle(args) => args.json,
            Self::Inspect(args) => args.json,
            Self::Convert(_) => false,
        }
    }
}

#[derive(Debug, Args)]
pub(crate) struct ReconstructArgs {
    /// COLMAP database (any version from 2016 on) with keypoints and matches; it is never modified.
    pub(crate) database: PathBuf,
    /// Folder for the models 0, 1, … (largest first, COLMAP binary) and report.json.
    #[arg(short, long, value_name = "DIR")]
    pub(crate) output: PathBuf,
    /// Folder of the images, for the colours of the points.
    #[arg(long, value_name = "DIR")]
    pub(crate) images: Option<PathBuf>,
    /// Folder of depth maps, matched to the images by name: 16-bit PNG, npy, npz, TIFF or COLMAP's dense
    /// format. Images
    /// without one are fine.
    #[arg(long, value_name = "DIR")]
    pub(crate) depth_dir: Option<PathBuf>,
    /// JSON file with the depth camera, if that is not the images' [default: DIR/depth.json, where it exists]
    #[arg(long, value_name = "FILE", requires = "depth_dir")]
    pub(crate) depth_sidecar: Option<PathBuf>,
    /// Metres a unit [default: 0.001 for whole numbers, 1 for floating-point numbers]
    #[arg(long, value_name = "M", requires = "depth_dir")]
    pub(crate) depth_scale: Option<f64>,
    /// What the numbers measure [default: z]
    #[arg(long, value_enum, requires = "depth_dir")]
    pub(crate) depth_kind: Option<DepthKindArg>,
    /// Standard deviation of a depth divided by the depth [default: 0.05]
    #[arg(long, value_name = "SHARE", requires = "depth_dir")]
    pub(crate) depth_sigma: Option<f64>,
    /// Larger depths count as unknown, metres [default: 10000]
    #[arg(long, value_name = "M", requires = "depth_dir")]
    pub(crate) depth_max: Option<f64>,
    /// Which stages see the depths [default: both]
    #[arg(long, value_enum, requires = "depth_dir")]
    pub(crate) depth_stages: Option<DepthStagesArg>,
    /// How depths weigh against pixels in bundle adjustment [default: uncertainty]
    #[arg(long, value_enum, requires = "depth_dir")]
    pub(crate) depth_weight: Option<DepthWeightArg>,
    /// Learn a scale and a shift of the inverse depth of every map, as maps of learned monocular models need.
    #[arg(long, requires = "depth_dir")]
    pub(crate) depth_affine: bool,
    /// What bundle adjustment may do to the intrinsics [default: refine]
    #[arg(long, value_enum)]
    pub(crate) intrinsics: Option<IntrinsicsArg>,
    /// Which matches to believe [default: verified]
    #[arg(long, value_enum)]
    pub(crate) matches: Option<MatchesArg>,
    /// Where to compute.
    #[arg(long, value_enum, default_value = "auto")]
    pub(crate) backend: Backend,
    /// Seed of all random choices; the same seed gives the same files [default: 0]
    #[arg(long)]
    pub(crate) seed: Option<u64>,
    /// Number of threads; does not change the result [default: all cores]
    #[arg(long, value_parser = clap::value_parser!(u16).range(1..))]
    pub(crate) threads: Option<u16>,
    /// How much time to spend [default: default]
    #[arg(long, value_enum)]
    pub(crate) preset: Option<PresetArg>,
    /// JSON file with any subset of the options (see `options` in a report.json); the flags above win over it.
    #[arg(long, value_name = "FILE")]
    pub(crate) settings: Option<PathBuf>,
    /// Print events to standard output, one JSON object a line.
    #[arg(long)]
    pub(crate) json: bool,
}

#[derive(Clone, Copy, Debug, ValueEnum)]
pub(crate) enum DepthKindArg {
    /// Distance along the optical axis.
    Z,
    /// Distance from the camera's centre.
    Ray,
}

impl DepthKindArg {
    /// The name in a settings file.
    pub(crate) fn name(self) -> &'static str {
        match self {
            Self::Z => "z",
            Self::Ray => "ray",
        }
    }
}

#[derive(Clone, Copy, Debug, ValueEnum)]
pub(crate) enum DepthStagesArg {
    /// None: the scale is free.
    Off,
    /// Global positioning.
    Positioning,
    /// Bundle adjustment.
    Bundle,
    /// Both.
    Both,
}

impl DepthStagesArg {
    /// The name in a settings file.
    pub(crate) fn name(self) -> &'static str {
        match self {
            Self::Off => "off",
            Self::Positioning => "positioning",
            Self::Bundle => "bundle",
            Self::Both => "both",
        }
    }
}

#[derive(Clone, Copy, Debug, ValueEnum)]
pub(crate) enum DepthWeightArg {
    /// One standard deviation of a depth as much as one pixel.
    Uncertainty,
    /// As the published code of InstantSfM: 0.1 on inverse metres, and a pull to infinity where no depth is known.
    Paper,
}

impl DepthWeightArg {
    /// The name in a settings file.
    pub(crate) fn name(self) -> &'static str {
        match self {
            Self::Uncertainty => "uncertainty",
            Self::Paper => "paper",
        }
    }
}

#[derive(Clone, Copy, Debug, ValueEnum)]
pub(crate) enum IntrinsicsArg {
    /// Focal lengths and distortion move freely.
    Refine,
    /// The database's values stay.
    Fixed,
    /// They move, held near the database's values.
    Prior,
}

impl IntrinsicsArg {
    /// The name in a settings file.
    pub(crate) fn name(self) -> &'static str {
        match self {
            Self::Refine => "refine",
            Self::Fixed => "fixed",
            Self::Prior => "prior",
        }
    }
}

#[derive(Clone, Copy, Debug, ValueEnum)]
pub(crate) enum MatchesArg {
    /// Verified matches and the poses stored with them.
    Verified,
    /// Raw matches; every relative pose is estimated again.
    Raw,
}

impl MatchesArg {
    /// The name in a settings file.
    pub(crate) fn name(self) -> &'static str {
        match self {
            Self::Verified => "verified",
            Self::Raw => "raw",
        }
    }
}

#[derive(Clone, Copy, Debug, ValueEnum)]
pub(crate) enum PresetArg {
    /// Fewer rounds, no retriangulation.
    Fast,
    /// What the published figures are measured with.
    Default,
    /// Tighter stops, more rounds.
    Accurate,
}

impl PresetArg {
    /// The name in a settings file.
    pub(crate) fn name(self) -> &'static str {
        match self {
            Self::Fast => "fast",
            Self::Default => "default",
            Self::Accurate => "accurate",
        }
    }
}

/// Where to compute.
#[derive(Clone, Copy, Debug, PartialEq, Eq, ValueEnum)]
pub(crate) enum Backend {
    /// A hardware GPU where there is one and the problem is large, else the processor; says which and why.
    Auto,
    /// The processor.
    Cpu,
    /// A WebGPU device in single precision, a software one if need be.
    Gpu,
}

#[derive(Debug, Args)]
pub(crate) struct EvaluateArgs {
    /// COLMAP model to judge (a folder; of a folder of models, its 0).
    pub(crate) model: PathBuf,
    /// COLMAP model to compare with, or a PLY point cloud in the same frame.
    pub(crate) reference: PathBuf,
    /// PLY point cloud in the frame of the reference, to measure the distance to after aligning the cameras.
    #[arg(long, value_name = "PLY")]
    pub(crate) cloud: Option<PathBuf>,
    /// Align by a rigid motion only, so that a wrong scale counts: for models in metres.
    #[arg(long)]
    pub(crate) no_scale: bool,
    /// Image names are compared by this part.
    #[arg(long, value_enum, default_value = "base")]
    pub(crate) match_by: MatchByArg,
    /// Print the result as JSON.
    #[arg(long)]
    pub(crate) json: bool,
}

#[derive(Clone, Copy, Debug, ValueEnum)]
pub(crate) enum MatchByArg {
    /// The whole name with folders.
    Name,
    /// The name without folders.
    Base,
    /// The name without folders and extension.
    Stem,
}

#[derive(Debug, Args)]
pub(crate) struct BundleArgs {
    /// BAL text file or folder of a COLMAP model.
    pub(crate) problem: PathBuf,
    /// Where to write the result: a BAL file for a BAL file, a model for a model.
    #[arg(short, long, value_name = "PATH")]
    pub(crate) output: Option<PathBuf>,
    /// Where to compute.
    #[arg(long, value_enum, default_value = "auto")]
    pub(crate) backend: Backend,
    /// Scalar of residuals and derivatives on the processor.
    #[arg(long, value_enum, default_value = "f64")]
    pub(crate) precision: Precision,
    /// Whether the intrinsics of a model move (those of a BAL file always do; principal points never).
    #[arg(long, value_enum, default_value = "refine")]
    pub(crate) intrinsics: BundleIntrinsics,
    /// Huber loss with this width, px, instead of least squares.
    #[arg(long, value_name = "PX")]
    pub(crate) huber: Option<f64>,
    /// At most this many steps.
    #[arg(long, default_value_t = 200)]
    pub(crate) max_iterations: usize,
    /// Converged when the cost falls by less than this share twice in a row.
    #[arg(long, default_value_t = 1e-9)]
    pub(crate) tolerance: f64,
    /// Number of threads; does not change the result [default: all cores]
    #[arg(long, value_parser = clap::value_parser!(u16).range(1..))]
    pub(crate) threads: Option<u16>,
    /// Print events to standard output, one JSON object a line.
    #[arg(long)]
    pub(crate) json: bool,
}

#[derive(Clone, Copy, Debug, PartialEq, Eq, ValueEnum)]
pub(crate) enum Precision {
    F32,
    F64,
}

#[derive(Clone, Copy, Debug, PartialEq, Eq, ValueEnum)]
pub(crate) enum BundleIntrinsics {
    Refine,
    Fixed,
}

#[derive(Debug, Args)]
pub(crate) struct InspectArgs {
    /// A COLMAP database, a model's folder, a BAL file or a PLY file.
    pub(crate) path: PathBuf,
    /// Print the result as JSON.
    #[arg(long)]
    pub(crate) json: bool,
}

#[derive(Debug, Args)]
pub(crate) struct ConvertArgs {
    /// COLMAP model (a folder; of a folder of models, its 0).
    pub(crate) model: PathBuf,
    /// Where to write: a folder, a .ply file, or a .json file for nerfstudio.
    pub(crate) out: PathBuf,
    /// The format [default: by the ending of OUT; binary for a folder]
    #[arg(long, value_enum)]
    pub(crate) format: Option<OutFormat>,
    /// Folder of the images as nerfstudio should see it, relative to its file.
    #[arg(long, default_value = "images")]
    pub(crate) image_folder: String,
}

#[derive(Clone, Copy, Debug, PartialEq, Eq, ValueEnum)]
pub(crate) enum OutFormat {
    /// COLMAP model, .bin
    Binary,
    /// COLMAP model, .txt
    Text,
    /// Points only.
    Ply,
    /// transforms.json
    Nerfstudio,
}

#[cfg(test)]
mod tests {
    use clap::CommandFactory;

    use super::*;

    #[test]
    fn the_command_line_is_consistent() {
        Cli::command().debug_assert();
    }
}
