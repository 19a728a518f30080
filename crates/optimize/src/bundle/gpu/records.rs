//! How plain data becomes the kernels' records: words, laid out as `shaders/bundle/types.wgsl` declares them.

use epipole_geometry::camera::{CameraModel, MAX_PARAMS};

use crate::loss::Loss;

/// `View`: three rows of rotation and centre offset, the centre's cell, the camera.
pub(super) type View = [u32; 16];
/// `Intrinsics` of the widest variant: parameters, whether one focal length serves both axes, COLMAP's model id, one
/// unused, [`EXACT_WORD`]. [`Sizes`](super::sizes::Sizes) makes it shorter.
pub(super) type Intrinsics = [u32; MAX_PARAMS + 4];
/// The word of [`Intrinsics`] that says whether the preconditioner has an exact block for the camera.
pub(super) const EXACT_WORD: usize = MAX_PARAMS + 3;
/// `Point`: offset, packed cell, four words of work space.
pub(super) type Point = [u32; 8];

/// Set in an observation's image where it does not count.
pub(super) const OUT: u32 = 1 << 31;
/// Set in an observation's image where it is occluded.
pub(super) const HIDDEN: u32 = 1 << 30;
/// `params.activation` in `sight.wgsl`.
pub(super) const ALL: u32 = 0;
pub(super) const VALID_AT_START: u32 = 1;
pub(super) const TRUNCATED: u32 = 2;
/// `params.refresh_flags` in `sight.wgsl`.
pub(super) const FIRST_PASS: u32 = 1;
pub(super) const FROM_SCRATCH: u32 = 2;

/// Inverse depths this many standard deviations off cost what infinity would, as in `observation.wgsl`.
pub(super) const MAX_DEPTH_SIGMAS: f32 = 1e15;

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
    pub(super) activation: u32,
    pub(super) fixed_points: bool,
    pub(super) eta: f32,
    pub(super) iterations: (u32, u32),
    pub(super) point_groups: u32,
    pub(super) big_cameras: u32,
    pub(super) tau: f32,
    pub(super) refresh_flags: u32,
    pub(super) revive_all: bool,
    pub(super) compact: bool,
    pub(super) depth_loss: (u32, f32),
}

impl Params {
    pub(super) const WORDS: usize = 22;

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
            self.activation,
            u32::from(self.fixed_points),
            self.eta.to_bits(),
            self.iterations.0,
            self.iterations.1,
            self.point_groups,
            self.big_cameras,
            self.tau.to_bits(),
            self.refresh_flags,
            u32::from(self.revive_all),
            u32::from(self.compact),
            self.depth_loss.0,
            self.depth_loss.1.to_bits(),
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

/// The place of a model's parameter in a camera's record: fx, fy, cx, cy, then the distortion, in COLMAP's order. One
/// focal length takes the first place; its record repeats it in the second.
pub(super) fn param_slot(model: CameraModel, param: usize) -> usize {
    if param > 0 && model.focal_params().len() == 1 { param + 1 } else { param }
}

/// A camera's record.
pub(super) fn intrinsics(model: CameraModel, params: &[f64]) -> Intrinsics {
    let mut out = Intrinsics::default();
    for (param, &value) in params.iter().enumerate() {
        out[param_slot(model, param)] = (value as f32).to_bits();
    }
    if model.focal_params().len() == 1 {
        out[1] = out[0];
        out[MAX_PARAMS] = 1;
    }
    out[MAX_PARAMS + 1] = model.id().unsigned_abs();
    out
}
