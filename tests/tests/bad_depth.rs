//! Broken depth maps end in a typed error or in a report that names them; nothing panics, and the other maps still give metres.

mod common;

use std::panic::{AssertUnwindSafe, catch_unwind};
use std::path::Path;

use common::{check_consistent, compare};
use epipole_formats::depth::attach_depths;
use epipole_formats::{ReadOptions, read_database, read_model};
use epipole_mapper::{Options, reconstruct_blocking};
use epipole_optimize::Engine;
use epipole_scene::Reconstruction;
use epipole_tests::depth_damage::{self, DepthDamage, Verdict};
use epipole_tests::fixtures;

/// What a person is told, and what came out.
#[derive(Debug)]
struct Told {
    missing: Vec<String>,
    unreadable: Vec<String>,
    warnings: Vec<String>,
    biased_maps: Vec<String>,
    keypoints_with_depth: usize,
    is_metric: bool,
    scale_error: f64,
}

fn pipeline(depth: &Path, truth: &Reconstruction) -> Result<Told, String> {
    let database = fixtures::folder().join("orbit/database.db");
    let mut graph = read_database(&database, &ReadOptions::default()).map_err(|e| e.to_string())?.value;
    let options = Options::default();
    let input = attach_depths(&mut graph, depth, None, &options.depth, &mut |_, _| true).map_err(|e| e.to_string())?;
    let outcome = reconstruct_blocking(graph, &options, &mut Engine::Cpu, None, &mut common::Listener::default())
        .map_err(|e| e.to_string())?;
    outcome.reconstructions.iter().for_each(check_consistent);
    assert_eq!(outcome.report.num_registered, truth.images.len(), "depths cost no image");
    let metric = &outcome.report.components[0].metric;
    Ok(Told {
        missing: input.missing,
        unreadable: input.unreadable.iter().map(|u| format!("{}: {}", u.image, u.message)).collect(),
        warnings: outcome.report.warnings,
        biased_maps: metric.as_ref().map(|m| m.biased_maps.clone()).unwrap_or_default(),
        keypoints_with_depth: input.keypoints_with_depth,
        is_metric: metric.is_some(),
        scale_error: compare(&outcome.reconstructions[0], truth).scale_error.expect("enough images"),
    })
}

/// Whether the outcome is the one that was to be.
fn is_right(damage: &DepthDamage, result: &Result<Told, String>, sound: &Told) -> bool {
    let says = |text: &str| damage.mentions.iter().all(|word| text.contains(word));
    let told = match (result, damage.verdict) {
        (Err(error), verdict) => return verdict == Verdict::Error && says(error) && error.len() > 20,
        (Ok(_), Verdict::Error) => return false,
        (Ok(told), _) => told,
    };
    // The other maps say what they said before.
    let is_metric = told.is_metric && told.scale_error.abs() < 0.01;
    let is_quiet = is_metric && told.warnings.is_empty();
    let more_missing = told.missing.len() - sound.missing.len();
    let is_as_sound = more_missing == 0 && told.unreadable.is_empty();
    let names_images = |names: &[String]| damage.mentions.iter().all(|name| names.iter().any(|n| n == name));
    match damage.verdict {
        Verdict::Error => false,
        Verdict::Unreadable => is_quiet && matches!(&told.unreadable[..], [one] if says(one)),
        Verdict::Missing => is_quiet && more_missing == 1 && names_images(&told.missing),
        // Positioning, which comes before maps are compared, may warn of the image.
        Verdict::SetApart => is_metric && is_as_sound && names_images(&told.biased_maps),
        Verdict::Accepted => is_quiet && is_as_sound,
        // Why not is said: by a warning, or by the count of depths being zero.
        Verdict::NotMetric => {
            !told.is_metric
                && says(&told.warnings.join("\n"))
                && (told.keypoints_with_depth == 0) == told.warnings.is_empty()
        }
    }
}

#[test]
fn every_damage_to_depth_maps_has_its_verdict() {
    let truth = read_model(&fixtures::folder().join("orbit/truth")).expect("the truth").value;
    let sound = pipeline(&fixtures::folder().join("orbit/depth"), &truth).expect("the fixture is sound");
    println!("sound: {sound:?}");
    assert!(sound.is_metric && sound.unreadable.is_empty() && sound.warnings.is_empty());
    assert!(sound.biased_maps.is_empty() && !sound.missing.is_empty(), "the fixture lacks maps, and no map is wrong");
    let mut wrong = Vec::new();
    for damage in depth_damage::ALL {
        let folder = tempfile::tempdir().expect("a temporary folder");
        let depth = folder.path().join("depth");
        fixtures::copy_depth_maps(&depth).expect("the fixture");
        damage.apply(&depth).expect("damage");
        match catch_unwind(AssertUnwindSafe(|| pipeline(&depth, &truth))) {
            Err(_) => wrong.push(format!("{}: it panicked", damage.name)),
            Ok(result) => {
                println!("{}: {result:?}", damage.name);
                if !is_right(damage, &result, &sound) {
                    wrong.push(format!(
                        "{}: {result:?} instead of {:?} mentioning {:?}",
                        damage.name, damage.verdict, damage.mentions
                    ));
                }
            }
        }
    }
    assert!(wrong.is_empty(), "{}", wrong.join("\n"));
}
