//! `epipole reconstruct`: from a database to models and a report.

use std::fs;

use epipole_formats::{FormatError, Loaded, ReadOptions, read_database};
use epipole_mapper::stages::finish::ImageSource;
use epipole_mapper::{Event, Matches, Observer, Options, Outcome, Settings};
use serde_json::json;

use crate::args::ReconstructArgs;
use crate::backend::{self, Size};
use crate::error::CliError;
use crate::images::ImageFolder;
use crate::progress::Progress;
use crate::results::ResultFolder;
use crate::{depth, interrupt, locate, output};

pub(crate) fn run(args: &ReconstructArgs) -> Result<(), CliError> {
    let options = options(args)?;
    let mut images = args.images.as_deref().map(ImageFolder::open).transpose()?;
    depth::check(args)?;
    locate::use_threads(args.threads)?;
    let read = ReadOptions { raw_matches: options.matches == Matches::Raw };
    let Loaded { value: mut graph, warnings } = read_database(&args.database, &read).map_err(CliError::Input)?;
    let mut progress = Progress::new(args.json);
    let mut all_warnings: Vec<String> = warnings.iter().map(ToString::to_string).collect();
    for message in &all_warnings {
        progress.event(&Event::Warning { message: message.clone() });
    }
    progress.say(&format!("{}: {} images, {} pairs", args.database.display(), graph.images.len(), graph.pairs.len()));
    let folder = ResultFolder::prepare(&args.output)?;
    interrupt::install();
    let keypoints = graph.images.iter().map(|image| image.keypoints_px.len()).sum();
    let mut engine = backend::engine(args.backend, Size::Keypoints(keypoints), false)?;
    let depth_input = depth::attach(args, &mut graph, &options, &mut progress, &mut all_warnings)?;
    let source = images.as_mut().map(|images| images as &mut dyn ImageSource);
    let mut outcome = epipole_mapper::reconstruct_blocking(graph, &options, &mut engine, source, &mut progress)?;
    all_warnings.append(&mut outcome.report.warnings);
    outcome.report.warnings = all_warnings;
    outcome.report.depth_input = depth_input;
    folder.write(&outcome)?;
    announce(args, &outcome, &progress);
    if outcome.report.stopped {
        let (kept, folder) = (outcome.reconstructions.len(), args.output.display());
        return Err(CliError::Stopped(format!("stopped before the end; the {kept} model(s) finished are in {folder}")));
    }
    Ok(())
}

fn announce(args: &ReconstructArgs, outcome: &Outcome, progress: &Progress) {
    let report = &outcome.report;
    if args.json {
        output::json_line(&json!({
            "event": "finished", "output": args.output, "models": outcome.reconstructions.len(),
            "images": report.num_images, "registered": report.num_registered, "stopped": report.stopped,
        }));
        return;
    }
    let models = match outcome.reconstructions.len() {
        1 => "1 model".to_owned(),
        n => format!("{n} models"),
    };
    progress.say(&format!(
        "{} of {} images in {models}: {}",
        report.num_registered,
        report.num_images,
        args.output.display()
    ));
    if report.num_registered < report.num_images {
        progress.say("report.json says of every other image why it is missing");
    }
}

/// The settings file with the flags laid over it.
fn options(args: &ReconstructArgs) -> Result<Options, CliError> {
    let mut settings = match &args.settings {
        None => Settings::default(),
        Some(path) => {
            let text = fs::read_to_string(path).map_err(|e| CliError::Input(FormatError::io(path, e)))?;
            Settings::from_json(&text)?
        }
    };
    if let Some(seed) = args.seed {
        settings.set("seed", seed);
    }
    if let Some(intrinsics) = args.intrinsics {
        settings.set("intrinsics", intrinsics.name());
    }
    if let Some(matches) = args.matches {
        settings.set("matches", matches.name());
    }
    if let Some(kind) = args.depth_kind {
        settings.set_in("depth", "kind", kind.name());
    }
    let depth = [("scale", args.depth_scale), ("relative_sigma", args.depth_sigma), ("max_m", args.depth_max)];
    for (name, value) in depth {
        if let Some(value) = value {
            settings.set_in("depth", name, value);
        }
    }
    if let Some(stages) = args.depth_stages {
        settings.set_in("metric", "stages", stages.name());
    }
    if let Some(weight) = args.depth_weight {
        settings.set_in("metric", "weight", weight.name());
    }
    if args.depth_affine {
        settings.set_in("metric", "affine", true);
    }
    if let Some(preset) = args.preset {
        settings.set("preset", preset.name());
    }
    Ok(settings.resolve()?)
}
