// What photographs taken all round a thing look at together: the middle of the scene, whatever lies behind it.

import { cross, dot, quantile, sub } from "./linear.js";

/** @typedef {import("./linear.js").Vec3} Vec3 */

/** Directions that differ by more than this, as one minus the length of their mean, look at something between them. */
const AROUND = 0.35;

/**
 * What the cameras look at together: where their axes come closest, if they stand round it. @param {Float32Array} cameras
 * @param {Vec3} ahead mean of their directions @returns {{ center: Vec3, radius: number }|null}
 */
export function focusOf(cameras, ahead) {
  const numCameras = cameras.length / 12;
  if (numCameras < 4 || Math.hypot(...ahead) > 1 - AROUND) return null;
  const m = [0, 0, 0, 0, 0, 0, 0, 0, 0];
  const right = [0, 0, 0];
  const eye = (/** @type {number} */ c) => /** @type {Vec3} */ ([3, 7, 11].map((k) => cameras[12 * c + k]));
  const axis = (/** @type {number} */ c) => /** @type {Vec3} */ ([2, 6, 10].map((k) => cameras[12 * c + k]));
  for (let c = 0; c < numCameras; c += 1) {
    const [e, f] = [eye(c), axis(c)];
    for (let a = 0; a < 3; a += 1) {
      for (let b = 0; b < 3; b += 1) {
        const square = (a === b ? 1 : 0) - f[a] * f[b];
        m[3 * a + b] += square;
        right[a] += square * e[b];
      }
    }
  }
  const columns = /** @type {[Vec3, Vec3, Vec3]} */ ([0, 1, 2].map((k) => [m[k], m[3 + k], m[6 + k]]));
  const determinant = dot(columns[0], cross(columns[1], columns[2]));
  if (Math.abs(determinant) < 1e-6 * numCameras ** 3) return null;
  const center = /** @type {Vec3} */ ([0, 1, 2].map((k) => {
    const [a, b] = [columns[(k + 1) % 3], columns[(k + 2) % 3]];
    return dot(/** @type {Vec3} */ (right), cross(a, b)) / determinant;
  }));
  const distances = Array.from({ length: numCameras }, (_, c) => dot(sub(center, eye(c)), axis(c)));
  const inFront = distances.filter((distance) => distance > 0).length;
  // Cameras that turn on the spot look away from one another: there is nothing between them.
  return inFront > 0.8 * numCameras ? { center, radius: quantile(distances, 0.5) } : null;
}
