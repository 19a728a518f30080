//! The `.txt` files of a model.

use std::str::{FromStr, SplitAsciiWhitespace};

use epipole_geometry::camera::{Camera, CameraModel};
use epipole_scene::{Frame, NO_POINT, Rig, RigSensor, SensorId};
use glam::{DVec2, DVec3};

use super::raw::{Model, RawImage, RawPoint, motion};
use crate::error::{FormatError, Location, Problem};

/// Longest piece of a line that is quoted in a message.
const QUOTED_CHARS: usize = 60;

/// Reads one file into the model.
pub(super) fn part(model: &mut Model, part: &str, bytes: &[u8], place: &Location) -> Result<(), FormatError> {
    let advice = "correct the line or write the model anew";
    let text = std::str::from_utf8(bytes).map_err(|e| {
        let problem = Problem::WrongKind { expected: "UTF-8 text", reason: e.to_string() };
        FormatError::invalid(place.clone(), problem, advice)
    })?;
    // Numbered from 1; comments and empty lines are skipped where a record begins.
    let mut lines = text.lines().enumerate().map(|(i, line)| (i + 1, line));
    while let Some((number, line)) = lines.next() {
        let line = line.trim();
        if line.is_empty() || line.starts_with('#') {
            continue;
        }
        let result = match part {
            "cameras" => camera(Words::new(line)).map(|c| model.cameras.push(c)),
            "rigs" => rig(Words::new(line)).map(|r| model.rigs.push(r)),
            "frames" => frame(Words::new(line)).map(|f| model.frames.push(f)),
            // The second line of an image may be empty, and missing at the end of the file.
            "images" => image(line, lines.next().map_or("", |(_, line)| line)).map(|i| model.images.push(i)),
            _ => point(Words::new(line)).map(|p| model.points.push(p)),
        };
        result.map_err(|p| FormatError::invalid(place.clone().row(format!("line {number}")), p, advice))?;
    }
    Ok(())
}

/// The words of a line.
struct Words<'a> {
    words: SplitAsciiWhitespace<'a>,
}

impl<'a> Words<'a> {
    fn new(line: &'a str) -> Self {
        Self { words: line.split_ascii_whitespace() }
    }

    fn next_if_any<T: FromStr>(&mut self, what: &'static str) -> Result<Option<T>, Problem> {
        let Some(word) = self.words.next() else { return Ok(None) };
        let found = || word.chars().take(QUOTED_CHARS).collect();
        word.parse().map(Some).map_err(|_| Problem::Syntax { what, found: found() })
    }

    fn next<T: FromStr>(&mut self, what: &'static str) -> Result<T, Problem> {
        self.next_if_any(what)?.ok_or_else(|| Problem::Syntax { what, found: "the end of the line".into() })
    }

    fn numbers<const N: usize>(&mut self, what: &'static str) -> Result<[f64; N], Problem> {
        let mut out = [0.0; N];
        for value in &mut out {
            *value = self.next(what)?;
        }
        Ok(out)
    }

    fn end(mut self) -> Result<(), Problem> {
        match self.words.next() {
            None => Ok(()),
            Some(word) => {
                Err(Problem::Syntax { what: "the end of the line", found: word.chars().take(QUOTED_CHARS).collect() })
            }
        }
    }

    fn sensor(&mut self) -> Result<SensorId, Problem> {
        let kind: String = self.next("a sensor type")?;
        let kind = match kind.as_str() {
            "CAMERA" => 0,
            "IMU" => 1,
            "INVALID" => -1,
            _ => {
                return Err(Problem::Syntax {
                    what: "a sensor type",
                    found: kind.chars().take(QUOTED_CHARS).collect(),
                });
            }
        };
        Ok(SensorId { kind, id: self.next("a sensor id")? })
    }
}

fn camera(mut words: Words<'_>) -> Result<Camera, Problem> {
    let id = words.next("a camera id")?;
    let name: String = words.next("a camera model")?;
    let model = CameraModel::from_name(&name)
        .ok_or_else(|| Problem::UnknownCameraModel(name.chars().take(QUOTED_CHARS).collect()))?;
    let (width_px, height_px) = (words.next("a width")?, words.next("a height")?);
    let params = (0..model.num_params()).map(|_| words.next("a camera parameter")).collect::<Result<_, _>>()?;
    words.end()?;
    Ok(Camera { id, model, width_px, height_px, params, has_prior_focal: false })
}

fn rig(mut words: Words<'_>) -> Result<Rig, Problem> {
    let id = words.next("a rig id")?;
    let count: u32 = words.next("a number of sensors")?;
    let reference = if count > 0 { Some(words.sensor()?) } else { None };
    let mut sensors = Vec::new();
    for _ in 1..count {
        let sensor = words.sensor()?;
        let has_pose: u8 = words.next("whether the pose is known (0 or 1)")?;
        let sensor_from_rig = if has_pose != 0 { Some(motion(words.numbers("a pose")?)) } else { None };
        sensors.push(RigSensor { sensor, sensor_from_rig });
    }
    words.end()?;
    Ok(Rig { id, reference, sensors })
}

fn frame(mut words: Words<'_>) -> Result<Frame, Problem> {
    let (id, rig_id) = (words.next("a frame id")?, words.next("a rig id")?);
    let rig_from_world = motion(words.numbers("a pose")?);
    let count: u32 = words.next("a number of data ids")?;
    let mut data = Vec::new();
    for _ in 0..count {
        data.push((words.sensor()?, words.next("a data id")?));
    }
    words.end()?;
    Ok(Frame { id, rig_id, rig_from_world, data })
}

fn image(first: &str, second: &str) -> Result<RawImage, Problem> {
    // The name is the rest of the line: it may hold spaces (which COLMAP itself does not read).
    let mut fields = first.splitn(10, ' ');
    let head: Vec<&str> = fields.by_ref().take(9).collect();
    let head = head.join(" ");
    let mut words = Words::new(&head);
    let id = words.next("an image id")?;
    let cam_from_world = motion(words.numbers("a pose")?);
    let camera_id = words.next("a camera id")?;
    words.end()?;
    let name = fields.next().map(str::trim).filter(|n| !n.is_empty());
    let name = name.ok_or_else(|| Problem::Syntax { what: "a file name", found: "the end of the line".into() })?;
    let mut words = Words::new(second);
    let (mut keypoints_px, mut point_ids) = (Vec::new(), Vec::new());
    while let Some(x) = words.next_if_any("a keypoint")? {
        keypoints_px.push(DVec2::new(x, words.next("a keypoint")?));
        let id: i128 = words.next("a point id")?;
        // COLMAP writes −1 for none; older writers the unsigned number itself.
        let id = if id == -1 { NO_POINT } else { u64::try_from(id).map_err(|_| bad_point_id(id))? };
        point_ids.push(id);
    }
    Ok(RawImage { id, name: name.to_owned(), camera_id, cam_from_world, keypoints_px, point_ids })
}

fn bad_point_id(id: i128) -> Problem {
    let expected = "-1 or a 64-bit id".into();
    Problem::OutOfRange { what: "a point id".into(), found: id.to_string(), expected }
}

fn point(mut words: Words<'_>) -> Result<RawPoint, Problem> {
    let id = words.next("a point id")?;
    let position = DVec3::from_array(words.numbers("a position")?);
    let rgb = [words.next("a colour")?, words.next("a colour")?, words.next("a colour")?];
    let error_px = words.next("an error")?;
    let mut track = Vec::new();
    while let Some(image_id) = words.next_if_any("an image id")? {
        track.push((image_id, words.next("a keypoint index")?));
    }
    Ok(RawPoint { id, position, rgb, error_px, track })
}
