// Where the scene is looked at from: orbit around a target, fly, and glide to a place.

import { distanceOf } from "./frame.js";
import { add, cross, mix, orthographic, perspective, product, scale, sub, turn, unit, viewMatrix } from "./linear.js";

/** @typedef {import("./linear.js").Vec3} Vec3 */

const FOV_Y = (50 * Math.PI) / 180;
/** Nearer to the pole than this the picture would spin. */
const POLE = 0.02;
const GLIDE_MS = 450;

export class Camera {
  constructor() {
    /** @type {Vec3} */ this.target = [0, 0, 0];
    /** @type {Vec3} */ this.up = [0, -1, 0];
    /** @type {Vec3} */ this.forward = unit([0.3, 0.35, 1]);
    this.distance = 5;
    this.extent = 1;
    this.orthographic = false;
    /** Share of the picture's height that something covers from below: the scene keeps to what is above. */
    this.covered = 0;
    /** @type {{from: Camera, to: {target: Vec3, forward: Vec3, distance: number}, start: number}|null} */
    this.gliding = null;
  }

  /** @returns {Vec3} */
  get eye() {
    return sub(this.target, scale(this.forward, this.distance));
  }

  /** @param {number} dx rad @param {number} dy rad */
  orbit(dx, dy) {
    this.gliding = null;
    let forward = turn(this.forward, this.up, -dx);
    const right = unit(cross(forward, this.up));
    const tilted = turn(forward, right, -dy);
    if (Math.hypot(...cross(tilted, this.up)) > POLE) forward = tilted;
    this.forward = unit(forward);
  }

  /** Turns on the spot. @param {number} dx rad @param {number} dy rad */
  look(dx, dy) {
    const eye = this.eye;
    this.orbit(-dx, -dy);
    this.target = add(eye, scale(this.forward, this.distance));
  }

  /** Moves in the picture's plane, in heights of the picture. @param {number} dx @param {number} dy */
  pan(dx, dy) {
    this.gliding = null;
    const right = unit(cross(this.forward, this.up));
    const top = cross(right, this.forward);
    const size = 2 * this.distance * Math.tan(FOV_Y / 2);
    this.target = add(this.target, add(scale(right, -dx * size), scale(top, dy * size)));
  }

  /** @param {number} factor */
  zoom(factor) {
    this.gliding = null;
    this.distance = Math.min(Math.max(this.distance * factor, this.extent * 1e-4), this.extent * 50);
  }

  /** Flies along the view's own axes, in shares of the distance. @param {Vec3} step right, up, forward */
  fly(step) {
    this.gliding = null;
    const right = unit(cross(this.forward, this.up));
    const top = cross(right, this.forward);
    const move = add(add(scale(right, step[0]), scale(top, step[1])), scale(this.forward, step[2]));
    this.target = add(this.target, scale(move, this.distance));
  }

  /** Sees the whole scene. @param {import("./frame.js").Frame} frame @param {number} aspect */
  frame(frame, aspect) {
    this.gliding = null;
    this.up = frame.up;
    this.extent = frame.radius;
    this.forward = frame.forward;
    this.target = frame.center;
    this.distance = distanceOf(frame, aspect / (1 - this.covered), Math.tan(FOV_Y / 2) * (1 - this.covered));
  }

  /**
   * Stays where it is in a scene that was moved and scaled under it: solving fixes neither origin nor unit.
   * @param {import("./frame.js").Frame} before @param {import("./frame.js").Frame} after
   */
  follow(before, after) {
    const grown = after.radius / before.radius;
    this.target = add(after.center, scale(sub(this.target, before.center), grown));
    this.distance *= grown;
    this.extent = after.radius;
    this.gliding = null;
  }

  /** Glides to a place. @param {Vec3} target @param {Vec3} forward @param {number} distance @param {number} now ms @param {boolean} still without motion */
  glide(target, forward, distance, now, still) {
    const to = { target, forward: unit(forward), distance };
    if (still) {
      Object.assign(this, to);
      return;
    }
    const from = Object.assign(new Camera(), { target: this.target, forward: this.forward, distance: this.distance });
    this.gliding = { from, to, start: now };
  }

  /** Moves on with a glide; whether there is more to come. @param {number} now ms */
  advance(now) {
    if (!this.gliding) return false;
    const { from, to, start } = this.gliding;
    const t = Math.min(1, (now - start) / GLIDE_MS);
    const ease = t * t * (3 - 2 * t);
    const eye = mix(from.eye, sub(to.target, scale(to.forward, to.distance)), ease);
    this.forward = unit(mix(from.forward, to.forward, ease));
    this.distance = from.distance + (to.distance - from.distance) * ease;
    this.target = add(eye, scale(this.forward, this.distance));
    if (t >= 1) this.gliding = null;
    return true;
  }

  /** World to clip space. @param {number} aspect */
  matrix(aspect) {
    const eye = this.eye;
    const far = this.distance + 20 * this.extent;
    const near = Math.max(this.distance * 1e-3, far * 1e-6);
    const projection = this.orthographic
      ? orthographic(this.distance * Math.tan(FOV_Y / 2), aspect, -far, far)
      : perspective(FOV_Y, aspect, near, far);
    const clip = product(projection, viewMatrix(eye, this.forward, this.up));
    // The middle of the picture moves to the middle of what is not covered.
    for (let c = 0; c < 4; c += 1) clip[4 * c + 1] += this.covered * clip[4 * c + 3];
    return clip;
  }
}
