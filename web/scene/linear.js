// The little linear algebra that looking at a scene takes. Vectors are arrays of three, matrices 4 × 4 by columns.

/** @typedef {[number, number, number]} Vec3 */

/** @param {Vec3} a @param {Vec3} b @returns {Vec3} */
export const add = (a, b) => [a[0] + b[0], a[1] + b[1], a[2] + b[2]];
/** @param {Vec3} a @param {Vec3} b @returns {Vec3} */
export const sub = (a, b) => [a[0] - b[0], a[1] - b[1], a[2] - b[2]];
/** @param {Vec3} a @param {number} k @returns {Vec3} */
export const scale = (a, k) => [a[0] * k, a[1] * k, a[2] * k];
/** @param {Vec3} a @param {Vec3} b */
export const dot = (a, b) => a[0] * b[0] + a[1] * b[1] + a[2] * b[2];
/** @param {Vec3} a @param {Vec3} b @returns {Vec3} */
export const cross = (a, b) => [a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]];
/** @param {Vec3} a @returns {Vec3} */
export const unit = (a) => scale(a, 1 / (Math.hypot(...a) || 1));
/** @param {Vec3} a @param {Vec3} b @param {number} t @returns {Vec3} */
export const mix = (a, b, t) => add(scale(a, 1 - t), scale(b, t));

/** Rotation of `v` about a unit `axis`. @param {Vec3} v @param {Vec3} axis @param {number} angle @returns {Vec3} */
export function turn(v, axis, angle) {
  const [c, s] = [Math.cos(angle), Math.sin(angle)];
  return add(add(scale(v, c), scale(cross(axis, v), s)), scale(axis, dot(axis, v) * (1 - c)));
}

/** A unit vector square to `a`. @param {Vec3} a @returns {Vec3} */
export const across = (a) => unit(cross(a, Math.abs(a[0]) < 0.9 ? [1, 0, 0] : [0, 1, 0]));

/** World to view: looks along `forward`, which becomes −z. @param {Vec3} eye @param {Vec3} forward @param {Vec3} up */
export function viewMatrix(eye, forward, up) {
  const right = unit(cross(forward, up));
  const top = cross(right, forward);
  return new Float32Array([
    right[0], top[0], -forward[0], 0,
    right[1], top[1], -forward[1], 0,
    right[2], top[2], -forward[2], 0,
    -dot(right, eye), -dot(top, eye), dot(forward, eye), 1,
  ]);
}

/** @param {number} fovY rad @param {number} aspect @param {number} near @param {number} far */
export function perspective(fovY, aspect, near, far) {
  const f = 1 / Math.tan(fovY / 2);
  return new Float32Array([f / aspect, 0, 0, 0, 0, f, 0, 0, 0, 0, (far + near) / (near - far), -1, 0, 0, (2 * far * near) / (near - far), 0]);
}

/** @param {number} halfHeight @param {number} aspect @param {number} near @param {number} far */
export function orthographic(halfHeight, aspect, near, far) {
  return new Float32Array([1 / (halfHeight * aspect), 0, 0, 0, 0, 1 / halfHeight, 0, 0, 0, 0, 2 / (near - far), 0, 0, 0, (far + near) / (near - far), 1]);
}

/** a · b. @param {Float32Array} a @param {Float32Array} b */
export function product(a, b) {
  const out = new Float32Array(16);
  for (let c = 0; c < 4; c += 1) {
    for (let r = 0; r < 4; r += 1) {
      let sum = 0;
      for (let k = 0; k < 4; k += 1) sum += a[4 * k + r] * b[4 * c + k];
      out[4 * c + r] = sum;
    }
  }
  return out;
}

/** @param {ArrayLike<number>} values @param {number} share of them that are smaller */
export function quantile(values, share) {
  const sorted = Float64Array.from(values).sort();
  return sorted[Math.min(sorted.length - 1, Math.floor(share * sorted.length))] ?? 0;
}
