//! Rigs and frames (COLMAP 3.12 and later): where an image's pose comes from, and what to write for images alone.

use std::borrow::Cow;
use std::collections::{HashMap, HashSet};

use epipole_geometry::Rigid3;
use epipole_scene::{Frame, Reconstruction, Rig, SensorId};

/// COLMAP's sensor type of a camera.
pub(super) const CAMERA: i32 = 0;
/// Two poses closer than this are the same pose rounded differently: then the stored bits stay.
const SAME_POSE: f64 = 1e-9;

/// Which frame shows each image, and through which sensor.
pub(super) struct Frames<'a> {
    rigs: HashMap<u32, &'a Rig>,
    of_image: HashMap<u64, (usize, SensorId)>,
    frames: &'a [Frame],
}

impl<'a> Frames<'a> {
    pub(super) fn new(rigs: &'a [Rig], frames: &'a [Frame]) -> Self {
        let mut of_image = HashMap::new();
        for (index, frame) in frames.iter().enumerate() {
            for &(sensor, data) in frame.data.iter().filter(|(sensor, _)| sensor.kind == CAMERA) {
                of_image.entry(data).or_insert((index, sensor));
            }
        }
        Self { rigs: rigs.iter().map(|r| (r.id, r)).collect(), of_image, frames }
    }

    /// The pose of an image by its frame and its camera's place in the rig; the error says what is missing.
    pub(super) fn cam_from_world(&self, image_id: u32, camera_id: u32) -> Result<Rigid3, String> {
        let &(frame, sensor) =
            self.of_image.get(&u64::from(image_id)).ok_or_else(|| format!("image {image_id} is in no frame"))?;
        let frame = &self.frames[frame];
        if sensor.id != camera_id {
            return Err(format!(
                "frame {} shows image {image_id} through camera {}, not {camera_id}",
                frame.id, sensor.id
            ));
        }
        let cam_from_rig = self.sensor_from_rig(frame.rig_id, sensor)?;
        if !frame.rig_from_world.is_finite() {
            return Err(format!("the pose of frame {} is not finite", frame.id));
        }
        Ok(cam_from_rig.map_or(frame.rig_from_world, |cam_from_rig| cam_from_rig * frame.rig_from_world))
    }

    /// The place of a sensor in its rig; `None` for the reference sensor, whose frame is the rig's.
    fn sensor_from_rig(&self, rig_id: u32, sensor: SensorId) -> Result<Option<Rigid3>, String> {
        let rig = self.rigs.get(&rig_id).ok_or_else(|| format!("rig {rig_id} does not exist"))?;
        if rig.reference == Some(sensor) {
            return Ok(None);
        }
        let found = rig.sensors.iter().find(|s| s.sensor == sensor);
        let found = found.ok_or_else(|| format!("camera {} is not in rig {rig_id}", sensor.id))?;
        let pose = found.sensor_from_rig.filter(Rigid3::is_finite);
        pose.map(Some).ok_or_else(|| format!("the pose of camera {} in rig {rig_id} is not known", sensor.id))
    }
}

/// Whether two poses differ by rounding only.
pub(super) fn same_pose(a: &Rigid3, b: &Rigid3) -> bool {
    let sign = if a.rotation.dot(b.rotation) < 0.0 { -1.0 } else { 1.0 };
    (a.rotation - b.rotation * sign).length() <= SAME_POSE
        && (a.translation - b.translation).length() <= SAME_POSE * (1.0 + b.translation.length())
}

/// The rigs and frames to write: the reconstruction's own where they cover its images and agree with their poses
/// (frames follow images that have moved), else one rig per camera and one frame per image.
pub(super) fn for_writing(reconstruction: &Reconstruction) -> (Cow<'_, [Rig]>, Cow<'_, [Frame]>) {
    if let Some(frames) = following_frames(reconstruction) {
        return (Cow::Borrowed(&reconstruction.rigs), frames);
    }
    let sensor = |id| SensorId { kind: CAMERA, id };
    let rig = |id| Rig { id, reference: Some(sensor(id)), sensors: Vec::new() };
    let mut rigs: Vec<Rig> = reconstruction.cameras.iter().map(|c| rig(c.id)).collect();
    rigs.sort_by_key(|r| r.id);
    let mut frames: Vec<Frame> = reconstruction
        .images
        .iter()
        .map(|image| {
            let rig_id = reconstruction.cameras[image.camera].id;
            let data = vec![(sensor(rig_id), u64::from(image.id))];
            Frame { id: image.id, rig_id, rig_from_world: image.cam_from_world, data }
        })
        .collect();
    frames.sort_by_key(|f| f.id);
    (Cow::Owned(rigs), Cow::Owned(frames))
}

fn following_frames(reconstruction: &Reconstruction) -> Option<Cow<'_, [Frame]>> {
    if reconstruction.rigs.is_empty() || reconstruction.frames.is_empty() {
        return None;
    }
    let agrees = |frames: &[Frame]| {
        let by_frame = Frames::new(&reconstruction.rigs, frames);
        reconstruction.images.iter().all(|image| {
            let pose = by_frame.cam_from_world(image.id, reconstruction.cameras[image.camera].id);
            pose.is_ok_and(|pose| same_pose(&pose, &image.cam_from_world))
        })
    };
    let sensors: HashSet<SensorId> = reconstruction
        .rigs
        .iter()
        .flat_map(|r| r.reference.into_iter().chain(r.sensors.iter().map(|s| s.sensor)))
        .collect();
    if !reconstruction.cameras.iter().all(|c| sensors.contains(&SensorId { kind: CAMERA, id: c.id })) {
        return None;
    }
    if agrees(&reconstruction.frames) {
        return Some(Cow::Borrowed(&reconstruction.frames));
    }
    let mut frames = reconstruction.frames.clone();
    let by_frame = Frames::new(&reconstruction.rigs, &reconstruction.frames);
    for image in &reconstruction.images {
        let &(index, sensor) = by_frame.of_image.get(&u64::from(image.id))?;
        let cam_from_rig = by_frame.sensor_from_rig(frames[index].rig_id, sensor).ok()?;
        frames[index].rig_from_world =
            cam_from_rig.map_or(image.cam_from_world, |cam_from_rig| cam_from_rig.inverse() * image.cam_from_world);
    }
    agrees(&frames).then_some(Cow::Owned(frames))
}
