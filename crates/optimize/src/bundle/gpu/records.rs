//! How plain data becomes the kernels' records: words, laid out as `shaders/bundle/types.wgsl` declares them.

use epipole_geometry::camera::CameraModel;

use crate::gpu::GpuError;
use crate::loss::Loss;

/// `View`: three rows of rotation and centre offset, the centre's cell, the camera.
pub(super) type View = [u32; 16];
/// `Intrinsics`: fx, fy, cx, cy, k1, k2, p1, p2, then whether one focal length serves both axes.
pub(super) type Intrinsics = [u32; 12];
/// The word of [`Intrinsics`] that says whether the preconditioner has an exact block for the camera.
pub(super) const EXACT_WORD: usize = 11;
/// `Point`: offset, packed cell, four words of work space.
pub(super) type Point = [u32; 8];

/// Set in an observation's image where it does not count.
pub(super) const OUT: u32 = 1 << 31;
/// Unknowns of a camera: the eight parameters of the widest model that the kernels know.
pub(super) const CAMERA_UNKNOWNS: usize = 8;

/// The uniform `Params` of every kernel.
#[derive(Clone, Copy, Debug, Default)]
pub(super) struct Params {
    pub(super) points: u32,
    pub(super) observations: u32,
    pub(super) images: u32,
    pub(super) cameras: u32,
    pub(super) segments: u32,
    pub(super) cell: f32,
    pub(super) loss: (u32, f32),
    pub(super) lambda: f32,
    pub(super) check_depth: bool,
    pub(super) fixed_points: bool,
    pub(super) eta: f32,
    pub(super) iterations: (u32, u32),
    pub(super) point_groups: u32,
    pub(super) big_cameras: u32,
}

impl Params {
    pub(super) const WORDS: usize = 16;

    pub(super) fn words(&self) -> [u32; Self::WORDS] {
        [
            self.points,
            self.observations,
            self.images,
            self.cameras,
            self.segments,
            self.cell.to_bits(),
            self.loss.0,
            self.loss.1.to_bits(),
            self.lambda.to_bits(),
            u32::from(self.check_depth),
            u32::from(self.fixed_points),
            self.eta.to_bits(),
            self.iterations.0,
            self.iterations.1,
            self.point_groups,
            self.big_cameras,
        ]
    }
}

/// Number and scale of a loss in `shaders/common/loss.wgsl`.
pub(super) fn loss_words(loss: Loss) -> (u32, f32) {
    match loss {
        Loss::Squared => (0, 1.0),
        Loss::Huber(scale) => (1, scale as f32),
        Loss::Cauchy(scale) => (2, scale as f32),
        Loss::GemanMcClure(scale) => (3, scale as f32),
    }
}

/// For each parameter of a model, its place among the eight of `shaders/common/perspective.wgsl`.
pub(super) fn param_slots(model: CameraModel) -> Result<&'static [usize], GpuError> {
    match model {
        CameraModel::SimplePinhole => Ok(&[0, 2, 3]),
        CameraModel::Pinhole => Ok(&[0, 1, 2, 3]),
        CameraModel::SimpleRadial => Ok(&[0, 2, 3, 4]),
        CameraModel::Radial => Ok(&[0, 2, 3, 4, 5]),
        CameraModel::OpenCv => Ok(&[0, 1, 2, 3, 4, 5, 6, 7]),
        _ => Err(GpuError::Unsupported { what: "a camera model other than pinhole, radial and OPENCV" }),
    }
}

/// The eight parameters of a camera; one focal length is written to both axes.
pub(super) fn intrinsics(model: CameraModel, params: &[f64]) -> Result<Intrinsics, GpuError> {
    let mut out = [0u32; 12];
    for (&slot, &value) in param_slots(model)?.iter().zip(params) {
        out[slot] = (value as f32).to_bits();
    }
    if model.focal_params().len() == 1 {
        out[1] = out[0];
        out[8] = 1;
    }
    Ok(out)
}
