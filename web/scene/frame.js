// Where a scene lies, which way is up, and from where it is first looked at: from its cameras and points.

import { focusOf } from "./focus.js";
import { across, cross, dot, quantile, scale, sub, unit } from "./linear.js";

/** @typedef {import("./linear.js").Vec3} Vec3 */
/** @typedef {import("../engine/protocol.js").Snapshot} Snapshot */

/** Points that are looked at: enough for quantiles, few enough for ten times a second. */
const SAMPLE = 8000;
/** How much the photographs' mean up direction counts against their horizons: it decides only where these do not. */
const MEAN_UP_WEIGHT = 0.05;
/** The first view looks down by this much, rad. */
const TILT = 0.42;

/**
 * Up: people hold cameras level but point them up and down, so up is what is most square to the pictures' own x axes; the mean
 * of their up directions gives the sign. A few turned by a quarter do not matter.
 * @param {Float32Array} cameras @returns {Vec3}
 */
export function upOf(cameras) {
  const numCameras = cameras.length / 12;
  /** @type {Vec3} */ let mean = [0, 0, 0];
  const m = [0, 0, 0, 0, 0, 0, 0, 0, 0];
  for (let c = 0; c < numCameras; c += 1) {
    const x = [0, 4, 8].map((row) => cameras[12 * c + row]);
    mean = /** @type {Vec3} */ (mean.map((sum, k) => sum - cameras[12 * c + 4 * k + 1] / numCameras));
    for (let a = 0; a < 3; a += 1) for (let b = 0; b < 3; b += 1) m[3 * a + b] += (x[a] * x[b]) / numCameras;
  }
  if (Math.hypot(...mean) < 1e-6) return [0, -1, 0];
  const guess = unit(mean);
  // The least eigenvector of Σxxᵀ − w·uuᵀ, by powers of its reflection 2·1 − M.
  for (let a = 0; a < 3; a += 1) for (let b = 0; b < 3; b += 1) m[3 * a + b] -= MEAN_UP_WEIGHT * guess[a] * guess[b];
  let up = guess;
  for (let round = 0; round < 60; round += 1) {
    const next = up;
    up = unit(/** @type {Vec3} */ ([0, 1, 2].map((a) => 2 * next[a] - m[3 * a] * next[0] - m[3 * a + 1] * next[1] - m[3 * a + 2] * next[2])));
  }
  return dot(up, guess) < 0 ? scale(up, -1) : up;
}

/**
 * @typedef {object} Frame
 * @property {Vec3} center @property {number} radius of the bulk: stray points must not shrink the scene to a dot
 * @property {Vec3} up @property {Vec3} forward of the first view
 * @property {number} spacing a fitting size of a frustum
 * @property {Float64Array} points xyz, a sample @property {Float64Array} eyes xyz of the cameras
 */

/** @param {Snapshot} snapshot @returns {Frame|null} null: there is nothing */
export function frameOf(snapshot) {
  const { positions, cameras } = snapshot;
  const [numPoints, numCameras] = [positions.length / 3, cameras.length / 12];
  if (numPoints + numCameras === 0) return null;
  const step = Math.max(1, Math.ceil(numPoints / SAMPLE));
  const sampled = Math.ceil(numPoints / step);
  // All cameras together weigh as much as a tenth of all points, so that the path is in the picture too.
  const copies = Math.max(1, Math.round(sampled / 10 / Math.max(numCameras, 1)));
  const axes = [0, 1, 2].map((k) => {
    const axis = new Float64Array(sampled + copies * numCameras);
    for (let p = 0, at = 0; p < numPoints; p += step, at += 1) axis[at] = positions[3 * p + k];
    for (let c = 0; c < numCameras; c += 1) axis.fill(cameras[12 * c + 4 * k + 3], sampled + c * copies, sampled + (c + 1) * copies);
    return axis;
  });
  const low = axes.map((axis) => quantile(axis, 0.05));
  const high = axes.map((axis) => quantile(axis, 0.95));
  const center = /** @type {Vec3} */ (low.map((from, k) => (from + high[k]) / 2));
  const radius = Math.hypot(...low.map((from, k) => high[k] - from)) / 2 || 1;
  const up = upOf(cameras);
  /** @type {Vec3} */ let ahead = [0, 0, 0];
  for (let c = 0; c < numCameras; c += 1) ahead = /** @type {Vec3} */ (ahead.map((sum, k) => sum + cameras[12 * c + 4 * k + 2] / numCameras));
  const level = sub(ahead, scale(up, dot(ahead, up)));
  // Cameras all round a thing look everywhere: then the first one's side is as good as any.
  const first = numCameras > 0 ? /** @type {Vec3} */ ([cameras[2], cameras[6], cameras[10]]) : across(up);
  const side = sub(first, scale(up, dot(first, up)));
  const flat = Math.hypot(...level) > 0.3 ? unit(level) : Math.hypot(...side) > 0.1 ? unit(side) : across(up);
  // A little from the side as well: a wall seen square on has no depth.
  const turned = unit(sub(flat, scale(cross(flat, up), 0.3)));
  const forward = unit(sub(scale(turned, Math.cos(TILT)), scale(up, Math.sin(TILT))));
  /** @type {number[]} */
  const points = [];
  const focus = focusOf(cameras, ahead);
  for (let p = 0; p < sampled; p += 1) {
    const at = /** @type {Vec3} */ ([axes[0][p], axes[1][p], axes[2][p]]);
    // What lies behind the thing that all look at is background.
    if (!focus || Math.hypot(...sub(at, focus.center)) < focus.radius) points.push(...at);
  }
  const eyes = Float64Array.from({ length: 3 * numCameras }, (_, k) => cameras[12 * Math.floor(k / 3) + 4 * (k % 3) + 3]);
  const extent = focus ? focus.radius : radius;
  return { center: focus?.center ?? center, radius: extent, up, forward, spacing: (extent / Math.sqrt(Math.max(numCameras, 1))) * 0.35, points: Float64Array.from(points), eyes };
}

/** Shares of points and of cameras that the first view holds: points stray, cameras seldom do. */
const HELD = { points: 0.95, eyes: 0.98 };
/** Room for frusta, which reach beyond their cameras. */
const MARGIN = 1.15;
/** Cameras may push the view back by so much, no more: the scene itself comes first. */
const MOST_FOR_CAMERAS = 5;

/**
 * How far from the centre one must stand to see nearly all of it. @param {Frame} frame @param {number} aspect @param {number} tanHalfY
 */
export function distanceOf({ center, forward, up, points, eyes, radius }, aspect, tanHalfY) {
  const right = unit(cross(forward, up));
  const top = cross(right, forward);
  const needed = (/** @type {Float64Array} */ places) => Float64Array.from({ length: places.length / 3 }, (_, p) => {
    const from = sub([places[3 * p], places[3 * p + 1], places[3 * p + 2]], center);
    return Math.max(Math.abs(dot(from, right)) / (tanHalfY * aspect), Math.abs(dot(from, top)) / tanHalfY) - dot(from, forward);
  });
  const forPoints = Math.max(quantile(needed(points), HELD.points), 0.2 * radius);
  const forEyes = Math.min(quantile(needed(eyes), HELD.eyes), points.length > 0 ? MOST_FOR_CAMERAS * forPoints : Infinity);
  return MARGIN * Math.max(forPoints, forEyes);
}
