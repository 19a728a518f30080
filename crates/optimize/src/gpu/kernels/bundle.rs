//! The table's rows for bundle adjustment, in the order in which a step runs them (source: `solver.md` §2.5).

use super::{Kernel, REDUCE, read, uniform, write};

/// Residuals from scratch and their cost.
pub const REFRESH: Kernel = Kernel {
    name: "refresh",
    file: "bundle/refresh.wgsl",
    workgroup_size: 64,
    bindings: &[
        uniform("params"),
        read("views"),
        read("intrinsics"),
        read("points"),
        read("tracks"),
        write("by_point"),
        read("pixels"),
        write("residuals"),
        write("sums"),
    ],
};

/// Robust weights in both orders of the observations.
pub const REWEIGHT: Kernel = Kernel {
    name: "reweight",
    file: "bundle/reweight.wgsl",
    workgroup_size: 64,
    bindings: &[uniform("params"), read("residuals"), read("image_order"), write("by_point"), write("by_image")],
};

/// Undamped point blocks by Givens QR.
pub const LINEARIZE_POINT: Kernel = Kernel {
    name: "linearize_point",
    file: "bundle/linearize_point.wgsl",
    workgroup_size: 64,
    bindings: &[
        uniform("params"),
        read("views"),
        read("intrinsics"),
        read("points"),
        read("tracks"),
        read("by_point"),
        read("residuals"),
        write("blocks"),
    ],
};

/// Squared norms of the camera columns, by segment.
pub const LINEARIZE_CAMERA: Kernel = Kernel {
    name: "linearize_camera",
    file: "bundle/linearize_camera.wgsl",
    workgroup_size: 64,
    bindings: &[
        uniform("params"),
        read("views"),
        read("intrinsics"),
        read("points"),
        read("segments"),
        read("by_image"),
        write("partials"),
    ],
};

/// Column scales of the camera unknowns.
pub const SCALE_CAMERA: Kernel = Kernel {
    name: "scale_camera",
    file: "bundle/scale_camera.wgsl",
    workgroup_size: 64,
    bindings: &[
        uniform("params"),
        read("partials"),
        read("topology"),
        read("freedom"),
        read("intrinsics"),
        read("priors"),
        write("vectors"),
    ],
};

/// Point blocks at one damping.
pub const DAMP_POINT: Kernel = Kernel {
    name: "damp_point",
    file: "bundle/damp_point.wgsl",
    workgroup_size: 64,
    bindings: &[uniform("params"), write("points"), write("blocks")],
};

/// Schur–Jacobi sums and the right-hand side, by segment.
pub const PRECONDITION_CAMERA: Kernel = Kernel {
    name: "precondition_camera",
    file: "bundle/precondition_camera.wgsl",
    workgroup_size: 64,
    bindings: &[
        uniform("params"),
        read("views"),
        read("intrinsics"),
        read("points"),
        read("blocks"),
        read("segments"),
        read("by_image"),
        read("residuals"),
        write("block_sums"),
    ],
};

/// What the points take from the blocks of shared cameras.
pub const PRECONDITION_GROUP: Kernel = Kernel {
    name: "precondition_group",
    file: "bundle/precondition_group.wgsl",
    workgroup_size: 64,
    bindings: &[
        uniform("params"),
        read("views"),
        read("intrinsics"),
        read("points"),
        read("tracks"),
        read("by_point"),
        read("blocks"),
        read("topology"),
        write("group_sums"),
    ],
};

/// Inverses of the preconditioner's blocks.
pub const PRECONDITION_FACTOR: Kernel = Kernel {
    name: "precondition_factor",
    file: "bundle/precondition_factor.wgsl",
    workgroup_size: 64,
    bindings: &[
        uniform("params"),
        read("block_sums"),
        read("topology"),
        read("views"),
        write("vectors"),
        write("inverses"),
        read("group_sums"),
    ],
};

/// How clusters of images move, at the accepted state.
pub const COARSE_MODES: Kernel = Kernel {
    name: "coarse_modes",
    file: "bundle/coarse_modes.wgsl",
    workgroup_size: 64,
    bindings: &[uniform("params"), read("topology"), read("views"), read("vectors"), write("modes")],
};

/// The coarse matrix before points are eliminated.
pub const COARSE_BASE: Kernel = Kernel {
    name: "coarse_base",
    file: "bundle/coarse_base.wgsl",
    workgroup_size: 64,
    bindings: &[
        uniform("params"),
        read("topology"),
        read("modes"),
        read("block_sums"),
        read("vectors"),
        read("coarse_blocks"),
        write("coarse_matrix"),
    ],
};

/// What each point of a piece has to do with each row of blocks.
pub const COARSE_ENTRY: Kernel = Kernel {
    name: "coarse_entry",
    file: "bundle/coarse_entry.wgsl",
    workgroup_size: 64,
    bindings: &[
        uniform("params"),
        read("views"),
        read("intrinsics"),
        read("points"),
        read("by_point"),
        read("blocks"),
        read("modes"),
        read("coarse_entries"),
        write("coarse_factors"),
    ],
};

/// Sums over the pairs of a piece's entries.
pub const COARSE_PAIR: Kernel = Kernel {
    name: "coarse_pair",
    file: "bundle/coarse_pair.wgsl",
    workgroup_size: 64,
    bindings: &[
        read("coarse_piece"),
        read("coarse_entries"),
        read("coarse_factors"),
        read("coarse_blocks"),
        write("coarse_partials"),
    ],
};

/// Takes them from the coarse matrix.
pub const COARSE_SUBTRACT: Kernel = Kernel {
    name: "coarse_subtract",
    file: "bundle/coarse_subtract.wgsl",
    workgroup_size: 64,
    bindings: &[read("coarse_piece"), read("coarse_blocks"), read("coarse_partials"), write("coarse_matrix")],
};

/// PCG at zero.
pub const PCG_START: Kernel = Kernel {
    name: "pcg_start",
    file: "bundle/pcg_start.wgsl",
    workgroup_size: 256,
    bindings: &[
        uniform("params"),
        read("topology"),
        read("inverses"),
        write("vectors"),
        read("modes"),
        read("coarse_inverse"),
    ],
};

/// First half of the reduced operator, by point.
pub const PRODUCT_POINT: Kernel = Kernel {
    name: "product_point",
    file: "bundle/product_point.wgsl",
    workgroup_size: 64,
    bindings: &[
        uniform("params"),
        read("views"),
        read("intrinsics"),
        write("points"),
        read("tracks"),
        read("by_point"),
        read("blocks"),
        read("vectors"),
        write("sums"),
    ],
};

/// Second half, by segment of an image.
pub const PRODUCT_CAMERA: Kernel = Kernel {
    name: "product_camera",
    file: "bundle/product_camera.wgsl",
    workgroup_size: 64,
    bindings: &[
        uniform("params"),
        read("views"),
        read("intrinsics"),
        read("points"),
        read("segments"),
        read("by_image"),
        read("vectors"),
        write("partials"),
    ],
};

/// The vector half of a PCG iteration.
pub const PCG_STEP: Kernel = Kernel {
    name: "pcg_step",
    file: "bundle/pcg_step.wgsl",
    workgroup_size: 256,
    bindings: &[
        uniform("params"),
        read("topology"),
        read("inverses"),
        write("vectors"),
        read("modes"),
        read("coarse_inverse"),
        read("partials"),
        read("sums"),
    ],
};

/// Tried poses and intrinsics.
pub const STEP_CAMERA: Kernel = Kernel {
    name: "step_camera",
    file: "bundle/step_camera.wgsl",
    workgroup_size: 64,
    bindings: &[uniform("params"), read("vectors"), write("views"), write("intrinsics")],
};

/// Their change from the accepted state.
pub const CHANGE_CAMERA: Kernel = Kernel {
    name: "change_camera",
    file: "bundle/change_camera.wgsl",
    workgroup_size: 64,
    bindings: &[uniform("params"), write("views"), write("intrinsics")],
};

/// Tried points.
pub const BACK_SUBSTITUTE: Kernel = Kernel {
    name: "back_substitute",
    file: "bundle/back_substitute.wgsl",
    workgroup_size: 64,
    bindings: &[
        uniform("params"),
        read("views"),
        read("intrinsics"),
        write("points"),
        read("tracks"),
        read("by_point"),
        read("blocks"),
        read("vectors"),
        write("sums"),
    ],
};

/// Their change from the accepted state.
pub const CHANGE_POINT: Kernel = Kernel {
    name: "change_point",
    file: "bundle/change_point.wgsl",
    workgroup_size: 64,
    bindings: &[uniform("params"), read("points"), write("changes")],
};

/// Observations of a track that count before those that do not.
pub const COMPACT_POINT: Kernel = Kernel {
    name: "compact_point",
    file: "bundle/compact_point.wgsl",
    workgroup_size: 64,
    bindings: &[
        uniform("params"),
        write("tracks"),
        write("by_point"),
        write("by_image"),
        write("image_order"),
        write("pixels"),
        write("residuals"),
    ],
};

/// Observations of a segment that count before those that do not.
pub const COMPACT_IMAGE: Kernel = Kernel {
    name: "compact_image",
    file: "bundle/compact_image.wgsl",
    workgroup_size: 64,
    bindings: &[uniform("params"), write("segments"), write("by_image"), write("image_order")],
};

/// Points that miss observations, triangulated again.
pub const REVIVE: Kernel = Kernel {
    name: "revive",
    file: "bundle/revive.wgsl",
    workgroup_size: 64,
    bindings: &[
        uniform("params"),
        read("views"),
        read("intrinsics"),
        write("points"),
        read("tracks"),
        read("by_point"),
        read("pixels"),
        write("residuals"),
    ],
};

/// What the priors of camera parameters cost at the tried state.
pub const PRIOR_CAMERA: Kernel = Kernel {
    name: "prior_camera",
    file: "bundle/prior_camera.wgsl",
    workgroup_size: 256,
    bindings: &[uniform("params"), read("intrinsics"), read("priors"), write("vectors")],
};

/// Residuals at the tried state, as exact differences.
pub const TRIAL: Kernel = Kernel {
    name: "trial",
    file: "bundle/trial.wgsl",
    workgroup_size: 64,
    bindings: &[
        uniform("params"),
        read("views"),
        read("intrinsics"),
        read("points"),
        read("changes"),
        read("tracks"),
        read("by_point"),
        write("residuals"),
        write("sums"),
    ],
};

/// Accepts the tried poses and intrinsics.
pub const COMMIT_CAMERA: Kernel = Kernel {
    name: "commit_camera",
    file: "bundle/commit_camera.wgsl",
    workgroup_size: 64,
    bindings: &[uniform("params"), write("views"), write("intrinsics")],
};

/// Accepts the tried points and residuals.
pub const COMMIT_POINT: Kernel = Kernel {
    name: "commit_point",
    file: "bundle/commit_point.wgsl",
    workgroup_size: 64,
    bindings: &[uniform("params"), write("points"), read("tracks"), write("by_point"), write("residuals")],
};

/// The kernels of bundle adjustment.
pub const BUNDLE: &[Kernel] = &[
    REFRESH,
    REVIVE,
    COMPACT_POINT,
    COMPACT_IMAGE,
    REWEIGHT,
    LINEARIZE_POINT,
    LINEARIZE_CAMERA,
    SCALE_CAMERA,
    DAMP_POINT,
    PRECONDITION_CAMERA,
    PRECONDITION_GROUP,
    PRECONDITION_FACTOR,
    COARSE_MODES,
    COARSE_BASE,
    COARSE_ENTRY,
    COARSE_PAIR,
    COARSE_SUBTRACT,
    PCG_START,
    PRODUCT_POINT,
    PRODUCT_CAMERA,
    PCG_STEP,
    STEP_CAMERA,
    CHANGE_CAMERA,
    PRIOR_CAMERA,
    BACK_SUBSTITUTE,
    CHANGE_POINT,
    TRIAL,
    COMMIT_CAMERA,
    COMMIT_POINT,
    REDUCE,
];
