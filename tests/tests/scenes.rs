//! The synthesiser's own promises: its truth explains its keypoints, and its matches are what the options say.

use epipole_geometry::camera::CameraModel;
use epipole_scene::PairConfig;
use epipole_scene::statistics::Statistics;
use epipole_tests::synth::{FocalKnowledge, Kind, Options, Scene, StoredPoses, generate};

const KINDS: [Kind; 4] = [Kind::Orbit, Kind::Street, Kind::Facade, Kind::Internet];

fn make(options: Options) -> Scene {
    generate(&options).expect("a scene")
}

/// Share of verified matches whose keypoints see the same point.
fn right_share(scene: &Scene) -> f64 {
    let point_of = scene.truth.point_of_keypoint();
    let (mut right, mut all) = (0usize, 0usize);
    for pair in &scene.graph.pairs {
        for m in &pair.inliers {
            let points = [point_of[pair.image1][m[0] as usize], point_of[pair.image2][m[1] as usize]];
            right += usize::from(points[0].is_some() && points[0] == points[1]);
            all += 1;
        }
    }
    right as f64 / all as f64
}

#[test]
fn the_truth_explains_the_keypoints() {
    for kind in KINDS {
        let scene = make(Options { kind, num_images: 12, num_points: 1500, noise_px: 0.5, ..Options::default() });
        // The mean length of a normal 2-vector with σ = 0.5 px is 0.5 √(π/2) = 0.627 px.
        let error = Statistics::of(&scene.truth).mean_reprojection_error_px;
        assert!((0.6..0.65).contains(&error), "{kind:?}: {error} px");
        let exact = make(Options { kind, num_images: 12, num_points: 300, noise_px: 0.0, ..Options::default() });
        assert!(Statistics::of(&exact.truth).mean_reprojection_error_px < 1e-4, "f32 keypoints are exact to 1e-4 px");
    }
}

#[test]
fn every_model_projects_and_has_pairs() {
    for model in CameraModel::ALL {
        let scene = make(Options { models: vec![model], num_images: 10, num_points: 800, ..Options::default() });
        assert!(scene.truth.points.len() > 200, "{model:?}: {} points", scene.truth.points.len());
        assert!(scene.graph.pairs.len() >= 10, "{model:?}: {} pairs", scene.graph.pairs.len());
        assert!(Statistics::of(&scene.truth).mean_reprojection_error_px < 0.7, "{model:?}");
        let angle = |p: &epipole_scene::Pair| {
            let truth =
                scene.truth.images[p.image2].cam_from_world * scene.truth.images[p.image1].cam_from_world.inverse();
            p.cam2_from_cam1.map_or(f64::INFINITY, |pose| pose.rotation.angle_between(truth.rotation).to_degrees())
        };
        let mut errors: Vec<f64> = scene.graph.pairs.iter().map(angle).collect();
        errors.sort_by(f64::total_cmp);
        let median = errors[errors.len() / 2];
        // Half a pixel of noise in some dozens of matches: a few tenths of a degree, and not exactly none.
        assert!(median > 1e-4 && median < 1.5, "{model:?}: median rotation error {median}°");
    }
}

#[test]
fn outlier_shares_are_as_asked() {
    for share in [0.0, 0.1, 0.3] {
        let scene = make(Options { outlier_share: share, num_images: 12, num_points: 2000, ..Options::default() });
        let right = right_share(&scene);
        assert!((right - (1.0 - share)).abs() < 0.03, "asked for {share} wrong, {right} are right");
    }
    let scene = make(Options { wrong_pair_share: 0.2, num_images: 20, ..Options::default() });
    let plain = make(Options { num_images: 20, ..Options::default() });
    let (with, without) = (scene.graph.pairs.len() as f64, plain.graph.pairs.len() as f64);
    assert!((with / without - 1.2).abs() < 0.02, "{with} pairs, {without} without wrong ones");
}

#[test]
fn focal_knowledge_decides_the_pairs() {
    let guessed = make(Options { focal: FocalKnowledge::Guessed, ..Options::default() });
    assert!(guessed.graph.cameras.iter().all(|c| !c.has_prior_focal && c.mean_focal_px() == 1.2 * 1600.0));
    assert!(
        guessed
            .graph
            .pairs
            .iter()
            .all(|p| { p.config == PairConfig::Uncalibrated && p.fundamental.is_some() && p.cam2_from_cam1.is_none() })
    );
    let exif = make(Options { focal: FocalKnowledge::Exif { relative_error: 0.02 }, ..Options::default() });
    let (believed, true_focal) = (exif.graph.cameras[0].mean_focal_px(), exif.truth.cameras[0].mean_focal_px());
    assert!(exif.graph.cameras[0].has_prior_focal && believed != true_focal);
    assert!((believed / true_focal - 1.0).abs() < 0.1);
    let absent = make(Options { poses: StoredPoses::Absent, ..Options::default() });
    assert!(absent.graph.pairs.iter().all(|p| p.cam2_from_cam1.is_none() && p.essential.is_some()));
}

#[test]
fn a_closed_street_joins_its_ends() {
    let options = Options { kind: Kind::Street, num_images: 40, num_points: 6000, ..Options::default() };
    let joins = |scene: &Scene| scene.graph.pairs.iter().any(|p| p.image2 - p.image1 > 30);
    assert!(!joins(&make(options.clone())));
    assert!(joins(&make(Options { loop_closure: true, ..options })));
}

#[test]
fn depths_belong_to_points_and_distractors_have_none() {
    let scene = make(Options { depth: true, num_images: 6, num_points: 400, ..Options::default() });
    let depth_m = scene.depth_m.as_ref().expect("asked for");
    for point in &scene.truth.points {
        for o in &point.observations {
            let z = scene.truth.images[o.image as usize].cam_from_world.transform_point(point.position).z;
            assert!((depth_m[o.image as usize][o.keypoint as usize] - z).abs() < 1e-12);
        }
    }
    assert!(depth_m.iter().flatten().any(|d| d.is_nan()));
}

#[test]
fn options_out_of_range_are_refused() {
    let refused = |options: Options| generate(&options).expect_err("must be refused").to_string();
    assert!(refused(Options { noise_px: f64::NAN, ..Options::default() }).contains("noise_px"));
    assert!(refused(Options { outlier_share: 1.0, ..Options::default() }).contains("outlier_share"));
    assert!(refused(Options { models: vec![], ..Options::default() }).contains("models"));
    assert!(refused(Options { image_size_px: [0, 480], ..Options::default() }).contains("image_size_px"));
    for num_images in [0, 1] {
        let scene = make(Options { num_images, ..Options::default() });
        assert!(scene.graph.pairs.is_empty() && scene.graph.images.len() == num_images);
    }
}
