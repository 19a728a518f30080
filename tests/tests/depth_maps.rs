//! Depth maps of a synthetic scene: written, found by name, sampled, and what of them arrives at the keypoints.

use epipole_formats::depth::attach_depths;
use epipole_geometry::camera::CameraModel;
use epipole_scene::depth::DepthOptions;
use epipole_tests::synth::{DepthModel, MapFiles, Options, Scene, generate, give_depths, write_depth_maps};

fn scene(models: Vec<CameraModel>) -> Scene {
    let options = Options {
        num_images: 6,
        num_points: 120,
        image_size_px: [320, 240],
        noise_px: 0.0,
        models,
        depth: true,
        ..Options::default()
    };
    generate(&options).expect("a scene")
}

#[test]
fn maps_bring_back_the_depths_they_were_made_of() {
    let mut scene = scene(vec![CameraModel::SimpleRadial]);
    let model = DepthModel { share: 0.7, relative_noise: 0.02, missing_map_share: 0.4, seed: 3, ..Default::default() };
    give_depths(&mut scene, &model).expect("depths");
    let folder = tempfile::tempdir().expect("a folder");
    write_depth_maps(&scene, folder.path(), &MapFiles::default()).expect("written");
    let mut graph = scene.graph.clone();
    graph.images.iter_mut().for_each(|image| image.depths = None);
    let options = DepthOptions::default();
    let input = attach_depths(&mut graph, folder.path(), None, &options, &mut |_, _| true).expect("a folder");
    let missing: Vec<&str> =
        scene.graph.images.iter().filter(|i| i.depths.is_none()).map(|i| i.name.as_str()).collect();
    assert!(!missing.is_empty() && missing.len() < 6, "the seed leaves some");
    assert_eq!(input.missing, missing);
    assert_eq!((input.maps, input.unreadable.len()), (6 - missing.len(), 0));
    let (mut given, mut found) = (0, 0);
    for (read, made) in graph.images.iter().zip(&scene.graph.images) {
        let (Some(read), Some(made)) = (&read.depths, &made.depths) else { continue };
        for (read, made) in read.iter().zip(made.iter()) {
            given += usize::from(made.is_some());
            if let (Some(read), Some(made)) = (read, made) {
                found += 1;
                assert!((read.z_m / made.z_m - 1.0).abs() < 1e-6, "{read:?} of {made:?}");
            }
        }
    }
    assert_eq!(input.keypoints_with_depth, found, "no depth comes from nothing");
    assert!(found * 10 > given * 6, "{found} of {given}; the others stand beside another depth");
}

/// What the depth's errors are asked to be, they are; the ray length of a wide camera's z-depth ends at the point.
#[test]
fn errors_are_as_asked_and_rays_end_at_points() {
    let mut scene = scene(vec![CameraModel::OpenCvFisheye]);
    give_depths(&mut scene, &DepthModel::default()).expect("depths");
    let truth = scene.depth_m.clone().expect("asked for");
    for point in &scene.truth.points {
        for o in &point.observations {
            let image = &scene.truth.images[o.image as usize];
            let in_cam = image.cam_from_world.transform_point(point.position);
            let depth = scene.graph.images[o.image as usize].depths.as_ref().and_then(|d| d.get(o.keypoint as usize));
            let ray_length_m = depth.expect("a depth").ray_length_m(in_cam.truncate() / in_cam.z);
            assert!((ray_length_m / in_cam.length() - 1.0).abs() < 1e-6);
        }
    }
    let model = DepthModel { share: 0.5, gross_share: 0.1, relative_noise: 0.01, ..Default::default() };
    give_depths(&mut scene, &model).expect("depths");
    let (mut real, mut known, mut gross) = (0u32, 0u32, 0u32);
    for (image, truth) in scene.graph.images.iter().zip(&truth) {
        let depths = image.depths.as_ref().expect("no map is missing");
        for (depth, truth) in depths.iter().zip(truth).filter(|(_, truth)| !truth.is_nan()) {
            real += 1;
            known += u32::from(depth.is_some());
            gross += u32::from(depth.is_some_and(|d| (d.z_m / truth - 1.0).abs() > 0.05));
        }
    }
    let (share, gross_share) = (f64::from(known) / f64::from(real), f64::from(gross) / f64::from(known));
    assert!((share - 0.5).abs() < 0.08 && (gross_share - 0.1).abs() < 0.06, "{share} of {real}, {gross_share}");
    for wrong in [
        DepthModel { share: 1.5, ..model },
        DepthModel { relative_noise: f64::NAN, ..model },
        DepthModel { bias: -1.0, ..model },
    ] {
        assert!(give_depths(&mut scene, &wrong).is_err(), "{wrong:?}");
    }
    let mut without = Scene { depth_m: None, ..scene };
    assert!(give_depths(&mut without, &model).is_err());
}
