//! Tests of the finishing stage on a scene of three cameras in a row.

use std::sync::Arc;

use epipole_geometry::Rigid3;
use epipole_geometry::camera::{Camera, CameraModel};
use epipole_optimize::executor::block_on;
use epipole_scene::{Image, Observation, Point};
use image::Rgb;

use super::*;
use crate::event::Silent;

/// Cameras at x = 0, 1, 2 looking along +z; camera 1 of the list has no image. The second image sees nothing.
fn scene() -> Component {
    let camera = |id| Camera::with_focal(id, CameraModel::SimplePinhole, 40, 30, 50.0);
    let points = [DVec3::new(0.5, 0.2, 5.0), DVec3::new(1.0, -0.4, 6.0), DVec3::new(1.2, 0.1, 7.0)];
    let cameras = vec![camera(3), camera(5), camera(9)];
    let images = (0..3usize).map(|i| {
        let cam_from_world = Rigid3::from_rotation_and_center(DQuat::IDENTITY, DVec3::new(i as f64, 0.0, 0.0));
        let project = |&p: &DVec3| cameras[0].project(cam_from_world.transform_point(p)).unwrap();
        Image {
            id: 10 + i as u32,
            name: format!("{i}.png"),
            camera: if i == 2 { 2 } else { 0 },
            cam_from_world,
            keypoints_px: Arc::from(points.iter().map(project).collect::<Vec<_>>()),
            depths: None,
        }
    });
    let images: Vec<Image> = images.collect();
    let point = |p: usize, seen_by: &[u32]| Point {
        id: 100 + p as u64,
        position: points[p],
        rgb: [0; 3],
        error_px: -1.0,
        observations: seen_by.iter().map(|&image| Observation { image, keypoint: p as u32 }).collect(),
    };
    Component {
        metric: Default::default(),
        reconstruction: Reconstruction {
            cameras,
            images,
            points: vec![point(0, &[0, 2]), point(1, &[1]), point(2, &[0, 2])],
            ..Reconstruction::default()
        },
        graph_image: vec![4, 5, 6],
    }
}

const AS_IS: Options = Options { normalize: false, align_up: false, colors: true };

struct Gradient {
    loaded: Vec<String>,
    only: Option<&'static str>,
    size: (u32, u32),
}

impl ImageSource for Gradient {
    fn load<'a>(&'a mut self, name: &'a str) -> Loading<'a> {
        self.loaded.push(name.to_string());
        // Red is the column, green twice the row, so that bilinear samples are known exactly.
        let pixel = |x: u32, y: u32| Rgb([x as u8, 2 * y as u8, 7]);
        let image =
            self.only.is_none_or(|only| only == name).then(|| RgbImage::from_fn(self.size.0, self.size.1, pixel));
        Box::pin(std::future::ready(image))
    }
}

fn run(
    component: &mut Component,
    images: Option<&mut dyn ImageSource>,
    options: &Options,
    observer: &mut dyn Observer,
) -> Result<Summary, MapperError> {
    block_on(super::run(component, images, options, observer))
}

#[test]
fn what_observes_nothing_is_dropped_and_ids_are_compact() {
    let mut component = scene();
    let summary = run(&mut component, None, &AS_IS, &mut Silent).unwrap();
    assert_eq!((summary.dropped_points, summary.dropped_images.as_slice()), (1, [5].as_slice()));
    assert_eq!((summary.images, summary.points, summary.observations), (2, 2, 4));
    let r = &component.reconstruction;
    assert_eq!(component.graph_image, [4, 6]);
    assert_eq!(r.images.iter().map(|i| (i.id, i.camera)).collect::<Vec<_>>(), [(10, 0), (12, 1)]);
    assert_eq!(r.cameras.iter().map(|c| c.id).collect::<Vec<_>>(), [3, 9]);
    assert_eq!(r.points.iter().map(|p| p.id).collect::<Vec<_>>(), [1, 2]);
    assert!(r.points.iter().all(|p| p.observations.iter().map(|o| o.image).eq([0, 1])));
}

#[test]
fn errors_are_the_mean_over_the_track_and_the_mean_over_points() {
    let mut component = scene();
    let shifted = &mut component.reconstruction.images[2];
    let mut keypoints = shifted.keypoints_px.to_vec();
    keypoints[0] += DVec2::new(3.0, 4.0);
    shifted.keypoints_px = keypoints.into();
    let summary = run(&mut component, None, &AS_IS, &mut Silent).unwrap();
    let errors: Vec<f64> = component.reconstruction.points.iter().map(|p| p.error_px).collect();
    assert!((errors[0] - 2.5).abs() < 1e-12 && errors[1] < 1e-12, "{errors:?}");
    assert!((summary.mean_reprojection_error_px - 1.25).abs() < 1e-12);
    assert!(summary.to_string().contains("1.250 px"));
}

#[test]
fn normalising_does_not_change_the_errors_but_the_extent() {
    let mut component = scene();
    run(&mut component, None, &Options::default(), &mut Silent).unwrap();
    let r = &component.reconstruction;
    assert!((r.images[1].cam_from_world.center() - r.images[0].cam_from_world.center()).length() - 10.0 < 1e-9);
    assert!(r.points.iter().all(|p| p.error_px < 1e-9));
}

#[test]
fn colours_are_sampled_between_pixels_and_averaged() {
    let mut component = scene();
    let mut source = Gradient { loaded: Vec::new(), only: None, size: (40, 30) };
    let summary = run(&mut component, Some(&mut source), &AS_IS, &mut Silent).unwrap();
    assert_eq!(source.loaded, ["0.png", "2.png"]);
    assert_eq!((summary.colored_points, summary.missing_images), (2, 0));
    // Columns 25 and 5, row 17 in px; half a pixel less from the first centre.
    assert_eq!(component.reconstruction.points[0].rgb, [15, 33, 7]);
    let mut half = scene();
    let mut source = Gradient { loaded: Vec::new(), only: None, size: (20, 15) };
    run(&mut half, Some(&mut source), &AS_IS, &mut Silent).unwrap();
    // (12.5 − 0.5 + 2.5 − 0.5) / 2 and 2 (8.5 − 0.5).
    assert_eq!(half.reconstruction.points[0].rgb, [7, 16, 7]);
}

#[test]
fn missing_images_are_named_and_the_rest_is_used() {
    struct Warnings(Vec<String>);
    impl Observer for Warnings {
        fn event(&mut self, event: &Event) {
            if let Event::Warning { message } = event {
                self.0.push(message.clone());
            }
        }
    }
    let mut component = scene();
    let mut source = Gradient { loaded: Vec::new(), only: Some("2.png"), size: (40, 30) };
    let mut observer = Warnings(Vec::new());
    let summary = run(&mut component, Some(&mut source), &AS_IS, &mut observer).unwrap();
    assert_eq!((summary.colored_points, summary.missing_images), (2, 1));
    assert!(matches!(&observer.0[..], [one] if one.contains("1 of 2") && one.contains("0.png")), "{:?}", observer.0);
    assert_eq!(component.reconstruction.points[0].rgb, [5, 33, 7]);
}

#[test]
fn upright_turns_down_to_plus_y_and_keeps_the_errors() {
    let mut component = scene();
    let tilt = Similarity3 {
        scale: 1.0,
        rotation: DQuat::from_rotation_z(1.0) * DQuat::from_rotation_x(0.7),
        translation: DVec3::ONE,
    };
    component.reconstruction.transform(&tilt);
    run(&mut component, None, &Options { align_up: true, ..Options::default() }, &mut Silent).unwrap();
    for image in &component.reconstruction.images {
        assert!((image.cam_from_world.rotation.conjugate() * DVec3::Y - DVec3::Y).length() < 1e-12);
    }
    assert!(component.reconstruction.points.iter().all(|p| p.error_px < 1e-9));
}

#[test]
fn an_empty_component_stays_empty() {
    let mut component = Component::default();
    let summary = run(&mut component, None, &Options::default(), &mut Silent).unwrap();
    assert_eq!(summary, Summary::default());
}
