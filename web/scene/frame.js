// Where a scene lies and which way is up, from its cameras and points.

/** @typedef {import("./linear.js").Vec3} Vec3 */
/** @typedef {import("../engine/protocol.js").Snapshot} Snapshot */

/** @param {number[]} values @param {number} share */
function quantile(values, share) {
  const sorted = Float64Array.from(values).sort();
  return sorted[Math.min(sorted.length - 1, Math.floor(share * sorted.length))] ?? 0;
}

/**
 * Centre and radius of the bulk: stray points must not shrink the scene to a dot. Up is what the photographs call up.
 * @param {Snapshot} snapshot @returns {{ center: Vec3, radius: number, up: Vec3, forward: Vec3|null, spacing: number }}
 */
export function frameOf(snapshot) {
  const { positions, cameras } = snapshot;
  /** @type {number[][]} */
  const axes = [[], [], []];
  const step = Math.max(1, Math.floor(positions.length / 3 / 20_000));
  for (let p = 0; p < positions.length / 3; p += step) for (const k of [0, 1, 2]) axes[k].push(positions[3 * p + k]);
  const numCameras = cameras.length / 12;
  /** @type {Vec3} */ const up = [0, 0, 0];
  /** @type {Vec3} */ const forward = [0, 0, 0];
  for (let c = 0; c < numCameras; c += 1) {
    for (const k of [0, 1, 2]) {
      up[k] -= cameras[12 * c + 4 * k + 1];
      forward[k] += cameras[12 * c + 4 * k + 2];
      // A camera weighs as much as a hundredth of all points, so that the path is in the picture too.
      for (let copy = 0; copy < Math.ceil(axes[k].length / 100 / Math.max(numCameras, 1)); copy += 1) axes[k].push(cameras[12 * c + 4 * k + 3]);
    }
  }
  const low = axes.map((axis) => quantile(axis, 0.05));
  const high = axes.map((axis) => quantile(axis, 0.95));
  const center = /** @type {Vec3} */ (low.map((from, k) => (from + high[k]) / 2));
  const radius = Math.hypot(...low.map((from, k) => high[k] - from)) / 2 || 1;
  const length = Math.hypot(...forward);
  return {
    center,
    radius,
    up: Math.hypot(...up) > 1e-6 ? up : [0, -1, 0],
    // Cameras all round a thing look everywhere: then no direction is better than another.
    forward: length > 0.3 * numCameras ? forward : null,
    spacing: (radius / Math.sqrt(Math.max(numCameras, 1))) * 0.35,
  };
}
