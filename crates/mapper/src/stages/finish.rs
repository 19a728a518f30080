//! The last touch: what a model needs to be written. Errors and colours of points, no empty images, stable ids.

use std::fmt;
use std::pin::Pin;

use epipole_geometry::Similarity3;
use epipole_scene::{Reconstruction, statistics};
use glam::{DQuat, DVec2, DVec3};
use image::RgbImage;
use serde::{Deserialize, Serialize};

use crate::component::Component;
use crate::error::MapperError;
use crate::event::{Event, Observer, Stage, breath};
use crate::parallel;

/// Names of missing images that a warning lists; more would hide the rest of the output.
const LISTED_NAMES: usize = 3;

/// Colours, statistics and the frame of the result.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct Options {
    /// Move and scale the scene so that the box of camera centres has a diagonal of 10 around the origin, as COLMAP's
    /// global mapper leaves it (algorithms.md §2.11); where depth maps give metres the scale stays. Off: the frame stays as bundle adjustment left it.
    pub normalize: bool,
    /// Turn the scene so that the mean direction in which the cameras' images point down is +y, as COLMAP's aligned
    /// models have it. Right where photographs were mostly taken upright, and meaningless where they were not.
    pub align_up: bool,
    /// Colour the points, where images are at hand.
    pub colors: bool,
}

impl Default for Options {
    fn default() -> Self {
        Self { normalize: true, align_up: false, colors: true }
    }
}

/// Where the pixels come from; the mapper itself opens no file.
pub trait ImageSource {
    /// The image of a name as the database writes it, or `None` if there is none or it cannot be decoded. It may be
    /// smaller than the image that the keypoints were found in. A browser decodes on its own time.
    fn load<'a>(&'a mut self, name: &'a str) -> Loading<'a>;
}

/// An image on its way.
pub type Loading<'a> = Pin<Box<dyn Future<Output = Option<RgbImage>> + 'a>>;

/// What the stage did.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Summary {
    /// Points that fewer than two observations were left of.
    pub dropped_points: usize,
    /// Images without observations that were taken out: indices into the view graph, ascending.
    pub dropped_images: Vec<usize>,
    /// Points with a colour.
    pub colored_points: usize,
    /// Images that the source did not deliver.
    pub missing_images: usize,
    /// Posed images that are left.
    pub images: usize,
    /// Points that are left.
    pub points: usize,
    /// Their observations.
    pub observations: usize,
    /// Mean over points of their mean reprojection error, px (COLMAP's `ComputeMeanReprojectionError`).
    pub mean_reprojection_error_px: f64,
}

impl fmt::Display for Summary {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let Self { images, points, observations, mean_reprojection_error_px: error, .. } = self;
        write!(
            f,
            "{images} images, {points} points, {observations} observations, mean reprojection error {error:.3} px"
        )?;
        if !self.dropped_images.is_empty() {
            write!(f, "; {} images without observations left out", self.dropped_images.len())?;
        }
        if self.colored_points > 0 {
            write!(f, "; {} points coloured", self.colored_points)?;
        }
        Ok(())
    }
}

/// Makes the component ready to be written: drops points with fewer than two observations, images without any and
/// cameras without images (camera indices change), sets the frame, the errors and the colours, and numbers the points
/// from 1. Images keep the order of the view graph, which is by id. Asked to stop, it leaves out the remaining colours.
pub async fn run(
    component: &mut Component,
    images: Option<&mut dyn ImageSource>,
    options: &Options,
    observer: &mut dyn Observer,
) -> Result<Summary, MapperError> {
    let mut summary = Summary::default();
    let before = component.reconstruction.points.len();
    component.reconstruction.points.retain(|point| point.observations.len() >= 2);
    summary.dropped_points = before - component.reconstruction.points.len();
    let mut seen = vec![false; component.reconstruction.images.len()];
    for o in component.reconstruction.points.iter().flat_map(|point| &point.observations) {
        seen[o.image as usize] = true;
    }
    if seen.contains(&false) {
        summary.dropped_images = component.retain_images(&seen);
    }
    // Where bundle adjustment does not hold the scale, this last fit does.
    component.metric.refit(&mut component.reconstruction);
    drop_unused_cameras(&mut component.reconstruction);
    if options.align_up {
        let new_from_old = upright(&component.reconstruction);
        component.reconstruction.transform(&new_from_old);
    }
    if options.normalize {
        component.normalize();
    }
    let reconstruction = &mut component.reconstruction;
    update_errors(reconstruction);
    for (i, point) in reconstruction.points.iter_mut().enumerate() {
        point.id = i as u64 + 1;
    }
    if let Some(source) = images.filter(|_| options.colors) {
        (summary.colored_points, summary.missing_images) = color(reconstruction, source, observer).await;
    }
    let statistics = statistics::Statistics::of(reconstruction);
    summary.images = statistics.images;
    summary.points = statistics.points;
    summary.observations = statistics.observations;
    summary.mean_reprojection_error_px = statistics.mean_reprojection_error_px;
    Ok(summary)
}

fn drop_unused_cameras(reconstruction: &mut Reconstruction) {
    let mut used = vec![false; reconstruction.cameras.len()];
    for image in &reconstruction.images {
        used[image.camera] = true;
    }
    let mut kept = 0;
    let new_index: Vec<usize> = used
        .iter()
        .map(|&used| {
            kept += usize::from(used);
            kept.saturating_sub(1)
        })
        .collect();
    let mut used = used.into_iter();
    reconstruction.cameras.retain(|_| used.next() == Some(true));
    for image in &mut reconstruction.images {
        image.camera = new_index[image.camera];
    }
}

/// The rotation that takes the mean of the cameras' downward axes to +y; none where they cancel.
fn upright(reconstruction: &Reconstruction) -> Similarity3 {
    let down_in_world = |image: &epipole_scene::Image| image.cam_from_world.rotation.conjugate() * DVec3::Y;
    let sum: DVec3 = reconstruction.images.iter().map(down_in_world).sum();
    // A sum shorter than a tenth of the cameras says that they hold no common direction.
    let agree = sum.length() > 0.1 * reconstruction.images.len() as f64;
    if !agree {
        return Similarity3::IDENTITY;
    }
    let rotation = DQuat::from_rotation_arc(sum.normalize(), DVec3::Y);
    Similarity3 { scale: 1.0, rotation, translation: DVec3::ZERO }
}

fn update_errors(reconstruction: &mut Reconstruction) {
    let Reconstruction { cameras, images, points, .. } = reconstruction;
    parallel::for_each_mut(points, |_, point| {
        point.error_px = statistics::point_error_px(cameras, images, point);
    });
}

/// Gives every point the mean colour of its keypoints, one image in memory at a time. Returns the numbers of coloured
/// points and of missing images.
pub async fn color(
    reconstruction: &mut Reconstruction,
    source: &mut dyn ImageSource,
    observer: &mut dyn Observer,
) -> (usize, usize) {
    let total = reconstruction.images.len();
    let mut seen_by: Vec<Vec<(u32, u32)>> = vec![Vec::new(); total];
    for (p, point) in reconstruction.points.iter().enumerate() {
        for o in &point.observations {
            seen_by[o.image as usize].push((p as u32, o.keypoint));
        }
    }
    let mut sums = vec![(DVec3::ZERO, 0u32); reconstruction.points.len()];
    let mut missing: Vec<&str> = Vec::new();
    for (done, (image, observations)) in reconstruction.images.iter().zip(&seen_by).enumerate() {
        observer.event(&Event::Progress { stage: Stage::Finish, done, total });
        if observer.should_stop() {
            break;
        }
        breath(observer).await;
        let Some(pixels) = source.load(&image.name).await else {
            missing.push(&image.name);
            continue;
        };
        let camera = &reconstruction.cameras[image.camera];
        // The folder may hold smaller copies of the images that the keypoints were found in.
        let scale = DVec2::new(
            f64::from(pixels.width()) / camera.width_px.max(1) as f64,
            f64::from(pixels.height()) / camera.height_px.max(1) as f64,
        );
        for &(p, keypoint) in observations {
            if let Some(rgb) = bilinear(&pixels, image.keypoints_px[keypoint as usize] * scale) {
                let (sum, count) = &mut sums[p as usize];
                *sum += rgb;
                *count += 1;
            }
        }
    }
    if let [first, ..] = missing[..] {
        let names = missing[..missing.len().min(LISTED_NAMES)].join(", ");
        let more = if missing.len() > LISTED_NAMES { ", …" } else { "" };
        observer.event(&Event::Warning {
            message: format!(
                "{} of {total} images could not be read for colours ({names}{more}): add the folder in which '{first}' \
                 lies (on the command line --images)",
                missing.len()
            ),
        });
    }
    observer.event(&Event::Progress { stage: Stage::Finish, done: total, total });
    let missing = missing.len();
    let mut colored = 0;
    for (point, (sum, count)) in reconstruction.points.iter_mut().zip(sums) {
        if count > 0 {
            point.rgb = (sum / f64::from(count)).to_array().map(|c| c.round() as u8);
            colored += 1;
        }
    }
    (colored, missing)
}

/// The colour at a place in the image, px with the first pixel's centre at (0.5, 0.5); `None` outside the outer centres.
fn bilinear(pixels: &RgbImage, at_px: DVec2) -> Option<DVec3> {
    let at = at_px - 0.5;
    let inside = |v: f64, size: u32| v >= 0.0 && v <= f64::from(size) - 1.0;
    if !inside(at.x, pixels.width()) || !inside(at.y, pixels.height()) {
        return None;
    }
    let low = at.floor();
    let f = at - low;
    let (x, y) = (low.x as u32, low.y as u32);
    let (right, below) = ((x + 1).min(pixels.width() - 1), (y + 1).min(pixels.height() - 1));
    let value = |x: u32, y: u32| DVec3::from_array(pixels.get_pixel(x, y).0.map(f64::from));
    let upper = value(x, y).lerp(value(right, y), f.x);
    let lower = value(x, below).lerp(value(right, below), f.x);
    Some(upper.lerp(lower, f.y))
}

#[cfg(test)]
mod tests;
