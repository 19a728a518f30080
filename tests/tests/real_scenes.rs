//! Real scenes reach what COLMAP's global mapper reaches on the same databases, with one set of defaults.
//!
//! The bounds are those of the project's goals: pycolmap 4.2.1's figure less the allowed margin (each scene's README and
//! `colmap_stats.json` hold the figure). Without the shared data the tests pass and say that they were skipped.

mod common;

use common::{compare, run};
use epipole_formats::{ReadOptions, read_database, read_model};
use epipole_mapper::{Intrinsics, Options, Outcome};
use epipole_scene::Reconstruction;
use epipole_scene::evaluate::Evaluation;
use epipole_scene::statistics::Statistics;
use epipole_tests::shared_data;

/// Reconstructs a scene with the defaults and compares the largest component with `truth`.
fn evaluated(scene: &str, truth: &str, intrinsics: Intrinsics) -> Option<(Outcome, Evaluation)> {
    let folder = shared_data::scene(scene)?;
    let graph = read_database(&folder.join("database.db"), &ReadOptions::default()).expect("the database").value;
    let outcome = run(&graph, &Options { intrinsics, ..Options::default() });
    let truth: Reconstruction = read_model(&folder.join(truth)).expect("the truth").value;
    let found = compare(&outcome.reconstructions[0], &truth);
    let auc = &found.auc_all;
    println!(
        "{scene}: {} of {} images, AUC@1/3/5/10 {:.1}/{:.1}/{:.1}/{:.1}, {:.3} px",
        found.common_images,
        found.reference_images,
        auc.at_1,
        auc.at_3,
        auc.at_5,
        auc.at_10,
        Statistics::of(&outcome.reconstructions[0]).mean_reprojection_error_px
    );
    Some((outcome, found))
}

fn assert_auc(scene: &str, intrinsics: Intrinsics, at_1: f64, at_5: f64) {
    let Some((_, found)) = evaluated(scene, "gt/sparse", intrinsics) else { return };
    let auc = &found.auc_all;
    assert!(auc.at_1 >= at_1, "{scene}: AUC@1 {} is below {at_1}", auc.at_1);
    assert!(auc.at_5 >= at_5, "{scene}: AUC@5 {} is below {at_5}", auc.at_5);
}

#[test]
fn castle_p19() {
    assert_auc("strecha_castle-P19", Intrinsics::Refine, 90.3 - 1.0, 98.1 - 1.0);
}

#[test]
fn herz_jesus_p25() {
    assert_auc("strecha_Herz-Jesus-P25", Intrinsics::Refine, 91.9 - 1.0, 98.4 - 1.0);
}

#[test]
fn herz_jesus_p8() {
    assert_auc("strecha_Herz-Jesus-P8", Intrinsics::Refine, 93.0 - 1.0, 98.6 - 1.0);
}

#[test]
fn lund_door() {
    assert_auc("lund_door", Intrinsics::Refine, 97.5 - 1.0, 99.5 - 1.0);
}

#[test]
fn templering19_with_known_intrinsics() {
    assert_auc("middlebury_templering19", Intrinsics::Fixed, 76.3 - 1.0, 95.3 - 1.0);
}

#[test]
fn colmap2017_db() {
    // The reference is the owner's model of 2017, not a truth: hence the wider margin.
    assert_auc("colmap2017_db", Intrinsics::Refine, 0.0, 86.7 - 2.0);
}

#[test]
fn kermit() {
    // Bundler's poses of 9 of the 11 images, as weak.
    assert_auc("kermit", Intrinsics::Refine, 0.0, 34.5 - 2.0);
}

#[test]
fn sceaux_castle() {
    let Some((_, found)) = evaluated("sceaux_castle", "colmap_global", Intrinsics::Refine) else { return };
    assert!(found.auc_all.at_5 >= 98.0, "AUC@5 {}", found.auc_all.at_5);
}

#[test]
fn sevenscenes() {
    let Some((outcome, found)) = evaluated("sevenscenes", "gt/sparse", Intrinsics::Refine) else { return };
    assert_eq!(outcome.reconstructions[0].images.len(), 100);
    let ate = found.ate.expect("a hundred images").rmse;
    println!("sevenscenes: ATE {ate:.4} m");
    assert!(ate <= 0.040, "ATE {ate} m");
}

#[test]
fn bonsai292() {
    let Some((outcome, found)) = evaluated("bonsai292", "colmap_global", Intrinsics::Refine) else { return };
    let model = &outcome.reconstructions[0];
    assert_eq!(model.images.len(), 292);
    assert!(found.auc_all.at_5 >= 97.0, "AUC@5 {}", found.auc_all.at_5);
    let error = Statistics::of(model).mean_reprojection_error_px;
    assert!(error <= 0.41, "{error} px");
}
