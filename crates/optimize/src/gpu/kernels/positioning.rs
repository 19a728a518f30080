//! The table's rows for global positioning, in the order in which a step runs them (source: `solver.md` §3.5).

use super::{Kernel, read, uniform, write};

/// Weights and scales of all rays, point blocks by Givens QR, and the objective.
pub const LINEARIZE: Kernel = Kernel {
    name: "position_linearize",
    file: "positioning/linearize.wgsl",
    workgroup_size: 64,
    bindings: &[
        uniform("params"),
        uniform("settings"),
        read("centers"),
        write("points"),
        read("tracks"),
        write("by_point"),
        read("rays"),
        write("blocks"),
        read("vectors"),
        write("sums"),
    ],
};

/// The same weights and scales in the cameras' order.
pub const SPREAD: Kernel = Kernel {
    name: "position_spread",
    file: "positioning/spread.wgsl",
    workgroup_size: 64,
    bindings: &[uniform("params"), read("by_point"), write("by_camera")],
};

/// Point blocks at one damping.
pub const DAMP: Kernel = Kernel {
    name: "position_damp",
    file: "positioning/damp.wgsl",
    workgroup_size: 64,
    bindings: &[uniform("params"), uniform("settings"), write("points"), write("blocks")],
};

/// Schur–Jacobi sums, right-hand side and diagonal, by segment.
pub const PRECONDITION: Kernel = Kernel {
    name: "position_precondition",
    file: "positioning/precondition.wgsl",
    workgroup_size: 64,
    bindings: &[
        uniform("params"),
        uniform("settings"),
        read("centers"),
        read("points"),
        read("segments"),
        read("by_camera"),
        read("rays"),
        read("blocks"),
        read("vectors"),
        write("block_sums"),
    ],
};

/// Inverses of the preconditioner's blocks.
pub const FACTOR: Kernel = Kernel {
    name: "position_factor",
    file: "positioning/factor.wgsl",
    workgroup_size: 64,
    bindings: &[uniform("settings"), read("block_sums"), read("topology"), write("vectors")],
};

/// PCG at zero.
pub const PCG_START: Kernel = Kernel {
    name: "position_pcg_start",
    file: "positioning/pcg_start.wgsl",
    workgroup_size: 256,
    bindings: &[uniform("settings"), write("vectors")],
};

/// First half of the reduced operator, by point.
pub const PRODUCT_POINT: Kernel = Kernel {
    name: "position_product_point",
    file: "positioning/product_point.wgsl",
    workgroup_size: 64,
    bindings: &[
        uniform("params"),
        uniform("settings"),
        read("centers"),
        write("points"),
        read("tracks"),
        read("by_point"),
        read("rays"),
        read("blocks"),
        read("vectors"),
        write("sums"),
    ],
};

/// Second half, by segment of a camera.
pub const PRODUCT_CAMERA: Kernel = Kernel {
    name: "position_product_camera",
    file: "positioning/product_camera.wgsl",
    workgroup_size: 64,
    bindings: &[
        uniform("params"),
        uniform("settings"),
        read("centers"),
        read("points"),
        read("segments"),
        read("by_camera"),
        read("rays"),
        read("vectors"),
        write("partials"),
    ],
};

/// The vector half of a PCG iteration.
pub const PCG_STEP: Kernel = Kernel {
    name: "position_pcg_step",
    file: "positioning/pcg_step.wgsl",
    workgroup_size: 256,
    bindings: &[uniform("settings"), write("vectors"), read("topology"), read("partials"), read("sums")],
};

/// Tried centres.
pub const STEP_CAMERA: Kernel = Kernel {
    name: "position_step_camera",
    file: "positioning/step_camera.wgsl",
    workgroup_size: 256,
    bindings: &[uniform("settings"), write("centers"), write("vectors")],
};

/// Tried points, and the objective there.
pub const STEP_POINT: Kernel = Kernel {
    name: "position_step_point",
    file: "positioning/step_point.wgsl",
    workgroup_size: 64,
    bindings: &[
        uniform("params"),
        uniform("settings"),
        read("centers"),
        write("points"),
        read("tracks"),
        read("by_point"),
        read("rays"),
        read("blocks"),
        read("vectors"),
        write("sums"),
    ],
};

/// Lengths and scales that medians are taken of.
pub const SAMPLE: Kernel = Kernel {
    name: "position_sample",
    file: "positioning/sample.wgsl",
    workgroup_size: 64,
    bindings: &[
        uniform("params"),
        uniform("settings"),
        read("centers"),
        read("points"),
        read("rays"),
        read("samples"),
        write("lengths"),
    ],
};

/// The similarity that brings the tried state into its gauge.
pub const GAUGE: Kernel = Kernel {
    name: "position_gauge",
    file: "positioning/gauge.wgsl",
    workgroup_size: 256,
    bindings: &[uniform("settings"), read("centers"), read("lengths"), write("vectors")],
};

/// Accepts the tried centres.
pub const COMMIT_CAMERA: Kernel = Kernel {
    name: "position_commit_camera",
    file: "positioning/commit_camera.wgsl",
    workgroup_size: 64,
    bindings: &[uniform("settings"), write("centers"), read("vectors")],
};

/// Accepts the tried points.
pub const COMMIT_POINT: Kernel = Kernel {
    name: "position_commit_point",
    file: "positioning/commit_point.wgsl",
    workgroup_size: 64,
    bindings: &[uniform("params"), write("points"), read("vectors")],
};

/// The kernels of global positioning; sums go through [`REDUCE`](super::REDUCE), which bundle adjustment lists.
pub const POSITIONING: &[Kernel] = &[
    LINEARIZE,
    SPREAD,
    DAMP,
    PRECONDITION,
    FACTOR,
    PCG_START,
    PRODUCT_POINT,
    PRODUCT_CAMERA,
    PCG_STEP,
    STEP_CAMERA,
    STEP_POINT,
    SAMPLE,
    GAUGE,
    COMMIT_CAMERA,
    COMMIT_POINT,
];
