//! The synthesiser on the command line; `cargo xtask synth`, `damage` and `fixtures` call it.

use std::path::{Path, PathBuf};
use std::process::ExitCode;

use clap::{Args, Parser, Subcommand};
use epipole_geometry::camera::CameraModel;
use epipole_scene::statistics::Statistics;
use epipole_tests::synth::{
    BalPerturbation, FocalKnowledge, Kind, Options, StoredPoses, generate, write_bal, write_scene,
};
use epipole_tests::{damage, fixtures};

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
    Synth(Synth),
    /// The repository's fixture in every broken state, one database each.
    Damage {
        /// Where to write them.
        #[arg(long, value_name = "DIR")]
        output: PathBuf,
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
    /// Also write a perturbed BAL problem.
    #[arg(long, value_name = "FILE")]
    bal: Option<PathBuf>,
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
    let scene = generate(&Options {
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
        focal: match (arguments.guess_focal, arguments.exif_error) {
            (true, _) => FocalKnowledge::Guessed,
            (false, Some(relative_error)) => FocalKnowledge::Exif { relative_error },
            (false, None) => FocalKnowledge::Exact,
        },
        poses: if arguments.no_poses { StoredPoses::Absent } else { StoredPoses::Estimated },
        loop_closure: arguments.loop_closure,
        ..Options::default()
    })?;
    write_scene(&scene, &arguments.output)?;
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

fn damage_all(output: &Path) -> Result<(), AnyError> {
    std::fs::create_dir_all(output)?;
    for damage in damage::ALL {
        let path = output.join(format!("{}.db", damage.name));
        std::fs::copy(fixtures::folder().join("orbit/database.db"), &path)?;
        damage.apply(&path)?;
        println!("{}", path.display());
    }
    Ok(())
}
