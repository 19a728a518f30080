//! From ids to indices: checks that the parts of a model refer to one another.

use std::collections::{HashMap, HashSet};
use std::path::Path;

use epipole_scene::{Image, NO_POINT, Observation, Point, Reconstruction};

use super::ModelFormat;
use super::raw::{Model, RawImage};
use super::rigs::{Frames, same_pose};
use crate::database;
use crate::error::{FormatError, Location, Problem, Warnings};

struct Assembler<'a> {
    folder: &'a Path,
    format: ModelFormat,
    warnings: &'a mut Warnings,
}

impl Assembler<'_> {
    fn place(&self, part: &str, row: String) -> Location {
        Location::file(&self.folder.join(self.format.file(part))).row(row)
    }

    /// Every id of a part once, or an error: with repeated ids no reference can be trusted.
    fn unique(&self, part: &str, what: &'static str, ids: impl Iterator<Item = u64>) -> Result<(), FormatError> {
        let mut seen = HashSet::new();
        for id in ids {
            if !seen.insert(id) {
                let problem = Problem::Duplicate { what, key: id.to_string() };
                let place = self.place(part, format!("{what} {id}"));
                return Err(FormatError::invalid(place, problem, "write the model anew; every id may occur once"));
            }
        }
        Ok(())
    }
}

/// The reconstruction that the files describe.
pub(super) fn assemble(
    model: Model,
    folder: &Path,
    format: ModelFormat,
    warnings: &mut Warnings,
) -> Result<Reconstruction, FormatError> {
    let mut to = Assembler { folder, format, warnings };
    to.unique("cameras", "camera", model.cameras.iter().map(|c| c.id.into()))?;
    to.unique("images", "image", model.images.iter().map(|i| i.id.into()))?;
    to.unique("points3D", "point", model.points.iter().map(|p| p.id))?;
    to.unique("rigs", "rig", model.rigs.iter().map(|r| r.id.into()))?;
    to.unique("frames", "frame", model.frames.iter().map(|f| f.id.into()))?;
    for camera in &model.cameras {
        database::check_camera(camera).map_err(|problem| {
            let place = to.place("cameras", format!("camera {}", camera.id));
            FormatError::invalid(place, problem, "correct the camera or write the model anew")
        })?;
    }
    let (images, point_ids) = to.images(&model)?;
    let points = to.points(&model, &images, point_ids);
    Ok(Reconstruction { cameras: model.cameras, images, points, rigs: model.rigs, frames: model.frames })
}

impl Assembler<'_> {
    /// The images that can be used, and for each the point ids of its keypoints.
    fn images<'m>(&mut self, model: &'m Model) -> Result<(Vec<Image>, Vec<&'m [u64]>), FormatError> {
        let camera_of: HashMap<u32, usize> = model.cameras.iter().enumerate().map(|(i, c)| (c.id, i)).collect();
        let frames = Frames::new(&model.rigs, &model.frames);
        let mut images = Vec::with_capacity(model.images.len());
        let mut point_ids = Vec::with_capacity(model.images.len());
        for raw in &model.images {
            let place = self.place("images", format!("image {} ({})", raw.id, raw.name));
            let Some(&camera) = camera_of.get(&raw.camera_id) else {
                let problem = Problem::Dangling { what: "camera", id: raw.camera_id.to_string() };
                self.warnings.push(place, problem, "the image is left out");
                continue;
            };
            let stored = raw.cam_from_world;
            let cam_from_world = if model.frames.is_empty() {
                stored
            } else {
                match frames.cam_from_world(raw.id, raw.camera_id) {
                    // Composition rounds: where the image's own pose says the same, its bits are the better ones.
                    Ok(pose) if same_pose(&pose, &stored) => stored,
                    Ok(pose) => pose,
                    Err(reason) => {
                        let consequence = "the pose in the image itself is used; write the model anew for COLMAP";
                        self.warnings.push(place.clone(), Problem::Inconsistent(reason), consequence);
                        stored
                    }
                }
            };
            if !cam_from_world.is_finite() || raw.name.is_empty() {
                let problem = if raw.name.is_empty() {
                    Problem::Nothing("characters in the name")
                } else {
                    Problem::NotFinite("the pose".into())
                };
                self.warnings.push(place, problem, "the image is left out");
                continue;
            }
            images.push(Image {
                id: raw.id,
                name: raw.name.clone(),
                camera,
                cam_from_world,
                keypoints_px: keypoints(raw),
                depths: None,
            });
            point_ids.push(&raw.point_ids[..]);
        }
        Ok((images, point_ids))
    }

    fn points(&mut self, model: &Model, images: &[Image], point_ids: Vec<&[u64]>) -> Vec<Point> {
        let image_of: HashMap<u32, u32> = images.iter().enumerate().map(|(i, image)| (image.id, i as u32)).collect();
        let mut claimed: Vec<Vec<bool>> = point_ids.iter().map(|ids| vec![false; ids.len()]).collect();
        let mut points = Vec::with_capacity(model.points.len());
        for raw in &model.points {
            if !raw.position.is_finite() || raw.id == NO_POINT {
                let problem = if raw.id == NO_POINT {
                    Problem::Inconsistent("the id is the one that means none".into())
                } else {
                    Problem::NotFinite("the position".into())
                };
                self.warnings.push(
                    self.place("points3D", format!("point {}", raw.id)),
                    problem,
                    "the point is left out",
                );
                continue;
            }
            let mut observations = Vec::with_capacity(raw.track.len());
            for &(image_id, keypoint) in &raw.track {
                let problem = match image_of.get(&image_id).map(|&i| (i, point_ids[i as usize].get(keypoint as usize)))
                {
                    None => Problem::Dangling { what: "image", id: image_id.to_string() },
                    Some((_, None)) => {
                        Problem::Dangling { what: "keypoint", id: format!("{keypoint} of image {image_id}") }
                    }
                    Some((image, Some(&id))) if id == raw.id => {
                        if !std::mem::replace(&mut claimed[image as usize][keypoint as usize], true) {
                            observations.push(Observation { image, keypoint });
                            continue;
                        }
                        Problem::Duplicate { what: "observation", key: format!("{keypoint} of image {image_id}") }
                    }
                    Some(_) => Problem::Inconsistent(format!(
                        "the track names keypoint {keypoint} of image {image_id}, which refers elsewhere"
                    )),
                };
                let place = self.place("points3D", format!("point {}", raw.id));
                self.warnings.push(place, problem, "the observation is left out");
            }
            let (id, position, rgb, error_px) = (raw.id, raw.position, raw.rgb, raw.error_px);
            points.push(Point { id, position, rgb, error_px, observations });
        }
        for ((image, ids), claimed) in images.iter().zip(&point_ids).zip(&claimed) {
            let stray = ids.iter().zip(claimed).filter(|&(&id, &claimed)| id != NO_POINT && !claimed).count();
            if stray > 0 {
                let problem = Problem::Inconsistent(format!("{stray} keypoints refer to points that do not name them"));
                let place = self.place("images", format!("image {} ({})", image.id, image.name));
                self.warnings.push(place, problem, "the references are left out");
            }
        }
        points
    }
}

fn keypoints(raw: &RawImage) -> std::sync::Arc<[glam::DVec2]> {
    raw.keypoints_px.as_slice().into()
}
