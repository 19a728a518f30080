//! `epipole evaluate`: how well a model agrees with a reference.

use std::collections::HashMap;
use std::path::Path;

use epipole_formats::ply;
use epipole_geometry::Similarity3;
use epipole_scene::Reconstruction;
use epipole_scene::align::{align_rigid, align_similarity};
use epipole_scene::chamfer::{Chamfer, chamfer};
use epipole_scene::evaluate::{Auc, EvaluateOptions, Evaluation, MatchBy, evaluate};
use glam::DVec3;
use serde::Serialize;

use crate::args::{EvaluateArgs, MatchByArg};
use crate::error::CliError;
use crate::{locate, output};

#[derive(Serialize)]
struct Judgement {
    /// What the model was moved by before distances were taken: `similarity`, `rigid`, or `none` for a bare cloud.
    alignment: &'static str,
    #[serde(flatten, skip_serializing_if = "Option::is_none")]
    poses: Option<Evaluation>,
    #[serde(skip_serializing_if = "Option::is_none")]
    chamfer: Option<Chamfer>,
}

pub(crate) fn run(args: &EvaluateArgs) -> Result<(), CliError> {
    let model = locate::read(&args.model, args.json)?;
    let match_by = match args.match_by {
        MatchByArg::Name => MatchBy::Name,
        MatchByArg::Base => MatchBy::Base,
        MatchByArg::Stem => MatchBy::Stem,
    };
    let judgement = if is_ply(&args.reference) {
        if args.cloud.is_some() {
            return Err(CliError::Usage("REFERENCE is a point cloud already; give --cloud only with a model".into()));
        }
        Judgement { alignment: "none", poses: None, chamfer: Some(distance(&model, &args.reference, None)?) }
    } else {
        let reference = locate::read(&args.reference, args.json)?;
        let poses = evaluate(&model, &reference, &EvaluateOptions { match_by, ..EvaluateOptions::default() });
        let chamfer = match &args.cloud {
            None => None,
            Some(cloud) => {
                let motion = align(&model, &reference, match_by, args.no_scale).ok_or_else(|| {
                    let message = "fewer than three images in common: the cloud cannot be compared in one frame";
                    CliError::Usage(message.into())
                })?;
                Some(distance(&model, cloud, Some(motion))?)
            }
        };
        Judgement { alignment: if args.no_scale { "rigid" } else { "similarity" }, poses: Some(poses), chamfer }
    };
    if args.json {
        output::json_line(&judgement);
    } else {
        print(&judgement);
    }
    Ok(())
}

fn is_ply(path: &Path) -> bool {
    path.is_file() && path.extension().is_some_and(|e| e.eq_ignore_ascii_case("ply"))
}

/// The similarity, or without scale the rigid motion, that takes the model's camera centres to the reference's.
fn align(model: &Reconstruction, reference: &Reconstruction, by: MatchBy, no_scale: bool) -> Option<Similarity3> {
    let centers: HashMap<&str, DVec3> =
        model.images.iter().map(|i| (by.key(&i.name), i.cam_from_world.center())).collect();
    let common = reference.images.iter().filter_map(|i| {
        let center = centers.get(by.key(&i.name))?;
        Some((*center, i.cam_from_world.center()))
    });
    let (from, to): (Vec<DVec3>, Vec<DVec3>) = common.unzip();
    if no_scale { align_rigid(&from, &to) } else { align_similarity(&from, &to) }
}

fn distance(model: &Reconstruction, cloud: &Path, motion: Option<Similarity3>) -> Result<Chamfer, CliError> {
    let reference = ply::read_points(cloud).map_err(CliError::Input)?.positions;
    let points: Vec<DVec3> =
        model.points.iter().map(|p| motion.map_or(p.position, |m| m.transform_point(p.position))).collect();
    chamfer(&points, &reference).ok_or_else(|| {
        CliError::Usage("the model or the cloud has no points: there is no distance between them".into())
    })
}

fn print(judgement: &Judgement) {
    if let Some(e) = &judgement.poses {
        output::line(&format!(
            "images: {} in common, {} in the model, {} in the reference",
            e.common_images, e.estimate_images, e.reference_images
        ));
        let auc = |auc: &Auc| {
            let percent = [auc.at_1, auc.at_3, auc.at_5, auc.at_10].map(|share| format!("{share:6.2}"));
            percent.join(" ")
        };
        output::line(&format!("AUC@1/3/5/10, missing images count:  {}", auc(&e.auc_all)));
        if let Some(registered) = &e.auc_registered {
            output::line(&format!("AUC@1/3/5/10, common images only:    {}", auc(registered)));
        }
        let angle = |name: &str, angle: &Option<epipole_scene::evaluate::AngleSummary>| {
            if let Some(a) = angle {
                output::line(&format!("{name}: median {:.4}°, mean {:.4}°", a.median_deg, a.mean_deg));
            }
        };
        angle("relative rotation", &e.relative_rotation);
        angle("relative translation direction", &e.relative_direction);
        if let Some(a) = &e.absolute_rotation {
            output::line(&format!(
                "absolute rotation: median {:.4}°, mean {:.4}°, max {:.4}°",
                a.median_deg, a.mean_deg, a.max_deg
            ));
        }
        let mut alignments = vec![("rigid", &e.ate_rigid)];
        if judgement.alignment != "rigid" {
            alignments.splice(0..0, [("similarity", &e.ate), ("robust similarity", &e.ate_robust)]);
        }
        for (name, ate) in alignments.iter().filter_map(|(name, ate)| Some((name, ate.as_ref()?))) {
            output::line(&format!(
                "ATE, {name}: RMSE {:.6} ({:.4} % of the extent), median {:.6}, max {:.6}, scale {:.6}",
                ate.rmse,
                100.0 * ate.rmse_over_extent,
                ate.median,
                ate.max,
                ate.scale
            ));
        }
        if let Some(error) = e.scale_error {
            output::line(&format!("scale: {:.6} of the reference's (error {:+.3} %)", 1.0 + error, 100.0 * error));
        }
    }
    if let Some(c) = &judgement.chamfer {
        let directions =
            [("accuracy (model to cloud)", &c.accuracy), ("completeness (cloud to model)", &c.completeness)];
        for (name, d) in directions {
            output::line(&format!(
                "{name}: mean {:.6}, median {:.6}, 90 % within {:.6}, 95 % within {:.6}",
                d.mean, d.median, d.percentile_90, d.percentile_95
            ));
        }
        output::line(&format!("Chamfer: mean {:.6}, median {:.6}", c.mean, c.median));
    }
}
