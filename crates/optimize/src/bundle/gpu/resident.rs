//! A problem's buffers on a device, and its kernels bound to them.

use super::layout::Layout;
use super::records::Params;
use crate::gpu::kernels::{self, Kernel};
use crate::gpu::{Bound, Device, GpuError, Pipelines};

/// Points that one workgroup handles.
const POINT_GROUP: u64 = 64;
/// Rows of sums that the host adds in `f64` at most (source: `solver.md` §1.4).
const HOST_ROWS: u64 = 1024;
/// Rows that one workgroup of the second stage sums at least: one a lane.
const MIN_SPAN: u64 = 64;
/// vec4f of state and of a section's unit, as in `vectors.wgsl`.
const STATE_VEC4: u64 = 4;
const SECTIONS: u64 = 8;
/// Bytes of a row of eight sums.
pub(super) const ROW_BYTES: u64 = 32;

/// How many workgroups each kind of kernel takes.
#[derive(Clone, Copy, Debug)]
pub(super) struct Groups {
    pub(super) points: u64,
    pub(super) observations: u64,
    pub(super) units: u64,
    pub(super) unit_groups: u64,
    pub(super) segments: u64,
    /// Rows of the second stage.
    pub(super) reduced: u64,
}

/// Buffers.
#[derive(Debug)]
pub(super) struct Buffers {
    pub(super) params: wgpu::Buffer,
    pub(super) reduce_params: wgpu::Buffer,
    pub(super) views: wgpu::Buffer,
    pub(super) intrinsics: wgpu::Buffer,
    pub(super) points: wgpu::Buffer,
    pub(super) tracks: wgpu::Buffer,
    pub(super) by_point: wgpu::Buffer,
    pub(super) by_image: wgpu::Buffer,
    pub(super) image_order: wgpu::Buffer,
    pub(super) pixels: wgpu::Buffer,
    pub(super) residuals: wgpu::Buffer,
    pub(super) segments: wgpu::Buffer,
    pub(super) topology: wgpu::Buffer,
    pub(super) freedom: wgpu::Buffer,
    pub(super) blocks: wgpu::Buffer,
    pub(super) changes: wgpu::Buffer,
    pub(super) partials: wgpu::Buffer,
    pub(super) block_sums: wgpu::Buffer,
    pub(super) inverses: wgpu::Buffer,
    pub(super) vectors: wgpu::Buffer,
    /// Sums of the operator, of the back-substitution and of the trial (or refresh).
    pub(super) product_sums: wgpu::Buffer,
    pub(super) step_sums: wgpu::Buffer,
    pub(super) trial_sums: wgpu::Buffer,
    pub(super) step_reduced: wgpu::Buffer,
    pub(super) trial_reduced: wgpu::Buffer,
}

/// A problem on a device.
#[derive(Debug)]
pub(super) struct Resident {
    pub(super) buffers: Buffers,
    pub(super) groups: Groups,
    pub(super) params: Params,
    bound: Vec<(&'static str, Bound)>,
}

impl Resident {
    pub(super) fn new(device: &Device, layout: &Layout, mut params: Params) -> Result<Self, GpuError> {
        let (points, observations) = (layout.points.len() as u64, layout.by_point.len() as u64);
        let (images, cameras) = (layout.views.len() as u64, layout.intrinsics.len() as u64);
        let units = images + cameras;
        let point_groups = points.div_ceil(POINT_GROUP);
        let span = point_groups.div_ceil(HOST_ROWS).max(MIN_SPAN);
        let groups = Groups {
            points: point_groups,
            observations: observations.div_ceil(64),
            units,
            unit_groups: units.div_ceil(64),
            segments: layout.segments.len() as u64,
            reduced: point_groups.div_ceil(span),
        };
        params.points = points as u32;
        params.observations = observations as u32;
        params.images = images as u32;
        params.cameras = cameras as u32;
        params.segments = groups.segments as u32;
        params.cell = layout.lattice.cell as f32;
        params.point_groups = point_groups as u32;
        params.big_cameras = layout.big_cameras as u32;
        let sums = |name| device.zeroed(name, point_groups * ROW_BYTES);
        let buffers = Buffers {
            params: device.uniform("params", &params.words())?,
            reduce_params: device.uniform("reduce params", &[point_groups as u32, span as u32, 0, 0])?,
            views: device.storage("views", &layout.views.repeat(3))?,
            intrinsics: device.storage("intrinsics", &layout.intrinsics.repeat(3))?,
            points: device.storage("points", &layout.points)?,
            tracks: device.storage("tracks", &layout.tracks)?,
            by_point: device.storage("observations by point", &layout.by_point)?,
            by_image: device.storage("observations by image", &layout.by_image)?,
            image_order: device.storage("image order", &layout.image_order)?,
            pixels: device.storage("pixels", &layout.pixels)?,
            residuals: device.zeroed("residuals", observations * 16)?,
            segments: device.storage("segments", &layout.segments)?,
            topology: device.storage("topology", &layout.topology)?,
            freedom: device.storage("freedom", &layout.freedom)?,
            blocks: device.zeroed("point blocks", points * 96)?,
            changes: device.zeroed("point changes", points * 16)?,
            partials: device.zeroed("camera sums", groups.segments * 64)?,
            block_sums: device.zeroed("block sums", groups.segments * 480)?,
            inverses: device.zeroed("inverse blocks", units * 784)?,
            vectors: device.zeroed("vectors", 16 * (STATE_VEC4 + SECTIONS * 2 * units))?,
            product_sums: sums("product sums")?,
            step_sums: sums("step sums")?,
            trial_sums: sums("trial sums")?,
            step_reduced: device.zeroed("reduced step sums", groups.reduced * ROW_BYTES)?,
            trial_reduced: device.zeroed("reduced trial sums", groups.reduced * ROW_BYTES)?,
        };
        let pipelines = Pipelines::for_variant(device, kernels::BUNDLE, layout.variant)?;
        let mut bound = Vec::new();
        for kernel in kernels::BUNDLE.iter().filter(|k| k.name != kernels::REDUCE.name) {
            bound.push((kernel.name, pipelines.bind(device, kernel, &buffers.of(kernel))?));
        }
        for (name, rows, sums) in [
            ("reduce step", &buffers.step_sums, &buffers.step_reduced),
            ("reduce trial", &buffers.trial_sums, &buffers.trial_reduced),
        ] {
            bound.push((name, pipelines.bind(device, &kernels::REDUCE, &[&buffers.reduce_params, rows, sums])?));
        }
        Ok(Self { buffers, groups, params, bound })
    }

    /// Records a kernel over `groups` workgroups.
    pub(super) fn record(
        &self,
        encoder: &mut wgpu::CommandEncoder,
        name: &'static str,
        groups: u64,
    ) -> Result<(), GpuError> {
        let found = self.bound.iter().find(|(n, _)| *n == name);
        let missing = || GpuError::Refused { reason: format!("kernel `{name}` is not bound") };
        found.ok_or_else(missing)?.1.dispatch(encoder, groups)
    }

    /// Bytes of all buffers, for reports.
    pub(super) fn bytes(&self) -> u64 {
        self.buffers.all().iter().map(|b| b.size()).sum()
    }
}

impl Buffers {
    /// A kernel's buffers by the names of its variables. `sums` is the one name with a meaning by kernel.
    fn of(&self, kernel: &Kernel) -> Vec<&wgpu::Buffer> {
        let sums = match kernel.name {
            "product_point" | "pcg_step" => &self.product_sums,
            "back_substitute" => &self.step_sums,
            _ => &self.trial_sums,
        };
        let named = [
            ("params", &self.params),
            ("views", &self.views),
            ("intrinsics", &self.intrinsics),
            ("points", &self.points),
            ("tracks", &self.tracks),
            ("by_point", &self.by_point),
            ("by_image", &self.by_image),
            ("image_order", &self.image_order),
            ("pixels", &self.pixels),
            ("residuals", &self.residuals),
            ("segments", &self.segments),
            ("topology", &self.topology),
            ("freedom", &self.freedom),
            ("blocks", &self.blocks),
            ("changes", &self.changes),
            ("partials", &self.partials),
            ("block_sums", &self.block_sums),
            ("inverses", &self.inverses),
            ("vectors", &self.vectors),
            ("sums", sums),
        ];
        kernel.bindings.iter().filter_map(|b| named.iter().find(|(name, _)| *name == b.name)).map(|n| n.1).collect()
    }

    fn all(&self) -> [&wgpu::Buffer; 25] {
        [
            &self.params,
            &self.reduce_params,
            &self.views,
            &self.intrinsics,
            &self.points,
            &self.tracks,
            &self.by_point,
            &self.by_image,
            &self.image_order,
            &self.pixels,
            &self.residuals,
            &self.segments,
            &self.topology,
            &self.freedom,
            &self.blocks,
            &self.changes,
            &self.partials,
            &self.block_sums,
            &self.inverses,
            &self.vectors,
            &self.product_sums,
            &self.step_sums,
            &self.trial_sums,
            &self.step_reduced,
            &self.trial_reduced,
        ]
    }
}
