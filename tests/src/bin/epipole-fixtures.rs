//! The synthesiser on the command line; `cargo xtask synth`, `damage` and `fixtures` call it.

use std::path::{Path, PathBuf};
use std::process::ExitCode;

use clap::{Args, Parser, Subcommand};
use epipole_geometry::camera::CameraModel;
use epipole_scene::statistics::Statistics;
use epipole_tests::fixtures::Bulk;
use epipole_tests::synth::{
    BalPerturbation, DepthModel, FocalKnowledge, Kind, MapFiles, MapFormat, Options, Scene, StoredPoses, generate,
    give_depths, write_bal, write_depth_maps, write_scene,
};
use epipole_tests::{damage, depth_damage, fixtures};

/// Makes synthetic scenes with a known truth, and broken databases.
#[derive(Parser)]
#[command(name = "epipole-fixtures")]
struct Cli {
    #[command(subcommand)]
    command: Command,
}

#[derive(Subcommand)]
enum Command {
    /// A scene as a COLMAP database with its truth as a COLMAP text model, and as a BAL file if asked.
    Synth(Box<Synth>),
    /// The repository's fixture in every broken state, one database each, beside it NAME.maps where depth maps are broken.
    Damage {
        /// Where to write them.
        #[arg(long, value_name = "DIR")]
        output: PathBuf,
    },
    /// The fixture with descriptors beside its keypoints, which is what makes real databases large, or with matches.
    Large {
        /// The database.
        #[arg(long, value_name = "FILE")]
        output: PathBuf,
        /// Its size at least.
        #[arg(long)]
        bytes: u64,
        /// Make it large of verified matches: a scene that asks for memory.
        #[arg(long)]
        matches: bool,
    },
    /// Writes the repository's fixtures again.
    Fixtures {
        /// Where to write them.
        #[arg(long, value_name = "DIR", default_value = concat!(env!("CARGO_MANIFEST_DIR"), "/fixtures"))]
        output: PathBuf,
    },
}

#[derive(Args)]
struct Synth {
    /// orbit, street, facade or internet.
    #[arg(long, default_value = "orbit")]
    kind: Kind,
    /// Number of images.
    #[arg(long, default_value_t = 20)]
    images: usize,
    /// Points in the world.
    #[arg(long, default_value_t = 2000)]
    points: usize,
    /// Everything random follows from it.
    #[arg(long, default_value_t = 0)]
    seed: u64,
    /// Image width and height, px.
    #[arg(long, value_name = "WIDTHxHEIGHT", default_value = "1600x1200", value_parser = parse_size)]
    size_px: [u64; 2],
    /// Standard deviation of the keypoints, px.
    #[arg(long, default_value_t = 0.5)]
    noise_px: f64,
    /// Share of verified matches that are wrong.
    #[arg(long, default_value_t = 0.02)]
    outliers: f64,
    /// Share of raw matches that are wrong.
    #[arg(long, default_value_t = 0.2)]
    raw_outliers: f64,
    /// Wrong pairs, as a share of the right ones.
    #[arg(long, default_value_t = 0.0)]
    wrong_pairs: f64,
    /// Number of cameras; 0 for one per image.
    #[arg(long, default_value_t = 1)]
    cameras: usize,
    /// COLMAP's camera models, given to the cameras in turn.
    #[arg(long, value_delimiter = ',', default_value = "SIMPLE_RADIAL", value_parser = parse_model)]
    models: Vec<CameraModel>,
    /// Focal length over the larger side of an image; 0.9 is a typical photograph, 0.4 a wide lens.
    #[arg(long, default_value_t = 0.9)]
    focal_ratio: f64,
    /// The database guesses the focal lengths.
    #[arg(long, conflicts_with = "exif_error")]
    guess_focal: bool,
    /// Relative error of the database's focal lengths, which then come without distortion.
    #[arg(long)]
    exif_error: Option<f64>,
    /// Store no relative poses.
    #[arg(long)]
    no_poses: bool,
    /// Each image keeps only this many pairs with later images.
    #[arg(long)]
    pairs_per_image: Option<usize>,
    /// A street that ends where it began.
    #[arg(long)]
    loop_closure: bool,
    /// Folder for `database.db` and `truth/`.
    #[arg(long, value_name = "DIR")]
    output: PathBuf,
    #[command(flatten)]
    depth: Depth,
    /// Also write a perturbed BAL problem.
    #[arg(long, value_name = "FILE")]
    bal: Option<PathBuf>,
}

/// Depth maps beside the database, in `depth/`.
#[derive(Args)]
struct Depth {
    /// Write depth maps.
    #[arg(long)]
    depth: bool,
    /// Share of the keypoints with depth.
    #[arg(long, requires = "depth", default_value_t = 1.0)]
    depth_share: f64,
    /// Standard deviation of the depths' relative error.
    #[arg(long, requires = "depth", default_value_t = 0.02)]
    depth_noise: f64,
    /// Share of the depths that are anything between a quarter and four times the truth.
    #[arg(long, requires = "depth", default_value_t = 0.0)]
    depth_outliers: f64,
    /// Share of the maps whose depths are all too large.
    #[arg(long, requires = "depth", default_value_t = 0.0)]
    depth_biased_maps: f64,
    /// By how much, as a share of the depth.
    #[arg(long, requires = "depth", default_value_t = 0.1, allow_negative_numbers = true)]
    depth_bias: f64,
    /// Share of the images without a map.
    #[arg(long, requires = "depth", default_value_t = 0.0)]
    depth_missing_maps: f64,
    /// The maps' pixels are this many times as large as the images'.
    #[arg(long, requires = "depth", default_value_t = 1, value_parser = clap::value_parser!(u64).range(1..))]
    depth_shrink: u64,
    /// npy in metres or png in millimetres.
    #[arg(long, requires = "depth", default_value = "png", value_parser = parse_map_format)]
    depth_format: MapFormat,
}

fn parse_map_format(text: &str) -> Result<MapFormat, String> {
    match text {
        "npy" => Ok(MapFormat::Npy),
        "png" => Ok(MapFormat::Png),
        _ => Err(format!("`{text}` is not a format of depth maps; write npy or png")),
    }
}

fn parse_size(text: &str) -> Result<[u64; 2], String> {
    let sides = text.split_once('x').and_then(|(w, h)| Some([w.parse().ok()?, h.parse().ok()?]));
    sides.ok_or_else(|| format!("`{text}` is not a size; write 1600x1200"))
}

fn parse_model(text: &str) -> Result<CameraModel, String> {
    CameraModel::from_name(text).ok_or_else(|| format!("`{text}` is not a camera model; write for instance OPENCV"))
}

fn main() -> ExitCode {
    let result = match Cli::parse().command {
        Command::Synth(arguments) => synth(&arguments),
        Command::Damage { output } => damage_all(&output),
        Command::Large { output, bytes, matches } => {
            let bulk = if matches { Bulk::Matches } else { Bulk::Descriptors };
            fixtures::write_large(&output, bulk, bytes).map_err(Into::into)
        }
        Command::Fixtures { output } => fixtures::write_all(&output).map_err(Into::into),
    };
    match result {
        Ok(()) => ExitCode::SUCCESS,
        Err(e) => {
            eprintln!("error: {e}");
            ExitCode::from(2)
        }
    }
}

type AnyError = Box<dyn std::error::Error>;

fn synth(arguments: &Synth) -> Result<(), AnyError> {
    let mut scene = generate(&Options {
        kind: arguments.kind,
        num_images: arguments.images,
        num_points: arguments.points,
        seed: arguments.seed,
        image_size_px: arguments.size_px,
        noise_px: arguments.noise_px,
        outlier_share: arguments.outliers,
        raw_outlier_share: arguments.raw_outliers,
        wrong_pair_share: arguments.wrong_pairs,
        max_pairs_per_image: arguments.pairs_per_image,
        num_cameras: arguments.cameras,
        models: arguments.models.clone(),
        focal_ratio: arguments.focal_ratio,
        focal: match (arguments.guess_focal, arguments.exif_error) {
            (true, _) => FocalKnowledge::Guessed,
            (false, Some(relative_error)) => FocalKnowledge::Exif { relative_error },
            (false, None) => FocalKnowledge::Exact,
        },
        poses: if arguments.no_poses { StoredPoses::Absent } else { StoredPoses::Estimated },
        loop_closure: arguments.loop_closure,
        depth: arguments.depth.depth,
        ..Options::default()
    })?;
    write_scene(&scene, &arguments.output)?;
    if arguments.depth.depth {
        depth_maps(&mut scene, arguments)?;
    }
    let (truth, graph) = (&scene.truth, &scene.graph);
    println!(
        "{}: {} images, {} cameras, {} pairs with {} verified matches; truth: {} points, {} observations, {:.3} px",
        arguments.output.display(),
        graph.images.len(),
        graph.cameras.len(),
        graph.pairs.len(),
        graph.pairs.iter().map(|p| p.inliers.len()).sum::<usize>(),
        truth.points.len(),
        truth.num_observations(),
        Statistics::of(truth).mean_reprojection_error_px
    );
    if let Some(path) = &arguments.bal {
        write_bal(&scene, &BalPerturbation { seed: arguments.seed, ..BalPerturbation::default() }, path)?;
        println!("{}: the same scene, perturbed", path.display());
    }
    Ok(())
}

fn depth_maps(scene: &mut Scene, arguments: &Synth) -> Result<(), AnyError> {
    let depth = &arguments.depth;
    give_depths(
        scene,
        &DepthModel {
            share: depth.depth_share,
            relative_noise: depth.depth_noise,
            gross_share: depth.depth_outliers,
            biased_map_share: depth.depth_biased_maps,
            bias: depth.depth_bias,
            missing_map_share: depth.depth_missing_maps,
            seed: arguments.seed,
            ..DepthModel::default()
        },
    )?;
    let folder = arguments.output.join("depth");
    write_depth_maps(scene, &folder, &MapFiles { format: depth.depth_format, shrink: depth.depth_shrink })?;
    let maps = scene.graph.images.iter().filter_map(|image| image.depths.as_ref());
    println!(
        "{}: {} depth maps, {} keypoints with depth",
        folder.display(),
        maps.clone().count(),
        maps.map(|depths| depths.num_known()).sum::<usize>()
    );
    Ok(())
}

fn damage_all(output: &Path) -> Result<(), AnyError> {
    std::fs::create_dir_all(output)?;
    for damage in damage::ALL {
        let path = output.join(format!("{}.db", damage.name));
        std::fs::copy(fixtures::folder().join("orbit/database.db"), &path)?;
        damage.apply(&path)?;
        println!("{}", path.display());
    }
    for damage in depth_damage::ALL {
        let path = output.join(format!("depth_{}.db", damage.name));
        std::fs::copy(fixtures::folder().join("orbit/database.db"), &path)?;
        let maps = path.with_extension("maps");
        fixtures::copy_depth_maps(&maps)?;
        damage.apply(&maps)?;
        println!("{}", maps.display());
    }
    Ok(())
}
