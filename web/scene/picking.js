// What lies under the pointer: the nearest point or camera on the screen, found by projecting them all. A million points
// take some ten milliseconds, in the worker that draws.

/** Pixels around the pointer that count as a hit. */
const REACH = 9;
/** A camera's own sign is larger than a point's: it wins from further away. */
const CAMERA_REACH = 16;

/**
 * @param {import("../engine/protocol.js").Snapshot} snapshot @param {Uint8Array} pointColors alpha 0: not shown
 * @param {Float32Array} m clip_from_world @param {number} x @param {number} y px @param {number} width @param {number} height px
 * @param {boolean} withCameras
 * @returns {{ point: number|null, camera: number|null }}
 */
export function pick(snapshot, pointColors, m, x, y, width, height, withCameras) {
  /** @param {number} px @param {number} py @param {number} pz */
  const project = (px, py, pz) => {
    const w = m[3] * px + m[7] * py + m[11] * pz + m[15];
    if (w <= 0) return null;
    const sx = ((m[0] * px + m[4] * py + m[8] * pz + m[12]) / w) * 0.5 + 0.5;
    const sy = 0.5 - ((m[1] * px + m[5] * py + m[9] * pz + m[13]) / w) * 0.5;
    const depth = (m[2] * px + m[6] * py + m[10] * pz + m[14]) / w;
    return { away: Math.hypot(sx * width - x, sy * height - y), depth };
  };
  if (withCameras) {
    let [best, camera] = [CAMERA_REACH, -1];
    for (let k = 0; k < snapshot.cameras.length / 12; k += 1) {
      const hit = project(snapshot.cameras[12 * k + 3], snapshot.cameras[12 * k + 7], snapshot.cameras[12 * k + 11]);
      if (hit && hit.away < best) [best, camera] = [hit.away, k];
    }
    if (camera >= 0) return { point: null, camera };
  }
  // Among points within reach the one in front: what one sees is what one means.
  let [nearest, point] = [Infinity, -1];
  const { positions } = snapshot;
  for (let p = 0; p < positions.length / 3; p += 1) {
    if (pointColors[4 * p + 3] === 0) continue;
    const hit = project(positions[3 * p], positions[3 * p + 1], positions[3 * p + 2]);
    if (!hit || hit.away > REACH) continue;
    const cost = hit.depth + hit.away * 1e-5;
    if (cost < nearest) [nearest, point] = [cost, p];
  }
  return { point: point >= 0 ? point : null, camera: null };
}
