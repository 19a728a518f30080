// Draws the scene away from the page's thread and away from the solver: neither waits for the other.

import { Camera } from "./camera.js";
import { categorical, pointColors, ramp } from "./colors.js";
import { frameOf } from "./frame.js";
import { pick } from "./picking.js";
import { Renderer } from "./renderer.js";

/** @typedef {import("../engine/protocol.js").Snapshot} Snapshot */

const camera = new Camera();
/** @type {Renderer|null} */
let renderer = null;
/** @type {Snapshot|null} */
let snapshot = null;
/** @type {Uint8Array} */
let colors = new Uint8Array();
let framed = false;
let pending = false;
let size = { width: 1, height: 1, ratio: 1 };
let spacing = 1;
const look = {
  /** @type {import("./colors.js").ColorBy} */ by: "rgb",
  filter: { maxErrorPx: Infinity, minTrack: 2 },
  /** @type {number|null} */ component: null,
  pointSize: 2,
  frustumScale: 1,
  /** @type {"plain"|"error"|"component"} */ frustaBy: "plain",
  /** @type {[number, number, number]} */ frustumColor: [217, 170, 74],
  /** @type {[number, number, number]} */ accent: [88, 166, 255],
  /** @type {(number|null)[]} */ imageErrors: [],
  still: false,
};
let selectedImage = -1;

function requestDraw() {
  if (pending) return;
  pending = true;
  requestAnimationFrame((now) => {
    pending = false;
    const more = camera.advance(now);
    renderer?.draw(camera.matrix(size.width / size.height));
    if (more) requestDraw();
  });
}

function paintPoints() {
  if (!snapshot || !renderer) return;
  const painted = pointColors(snapshot, look.by, look.filter, look.component);
  colors = painted.colors;
  postMessage({ type: "shown", points: painted.shown, legend: painted.legend });
}

function cameraColors() {
  const current = /** @type {Snapshot} */ (snapshot);
  const out = new Uint8Array(4 * current.cameraImage.length);
  const errors = look.imageErrors.filter((e) => e !== null).map(Number).sort((a, b) => a - b);
  const high = errors[Math.floor(0.98 * errors.length)] || 1;
  current.cameraImage.forEach((image, k) => {
    if (look.component !== null && current.cameraComponent[k] !== look.component) return;
    const rgb = image === selectedImage ? look.accent
      : look.frustaBy === "component" ? categorical(current.cameraComponent[k])
      : look.frustaBy === "error" && look.imageErrors[image] !== null ? ramp(Number(look.imageErrors[image] ?? 0) / high)
      : look.frustumColor;
    out.set([...rgb, 255], 4 * k);
  });
  return out;
}

function paintCameras() {
  if (snapshot) renderer?.setCameraColors(cameraColors());
}

/** @param {Snapshot} next */
function show(next) {
  snapshot = next;
  paintPoints();
  renderer?.setPoints(next.positions, colors);
  renderer?.setCameras(next.cameras, next.cameraShape, cameraColors());
  const frame = frameOf(next);
  spacing = frame.spacing;
  if (renderer) renderer.frustumSize = spacing * look.frustumScale;
  // The person's own view is not taken away: framed once, and again when the result is there and nothing was moved.
  if (!framed && next.positions.length > 0) {
    camera.frame(frame.center, frame.radius, frame.up, frame.forward);
    framed = !next.final ? false : true;
  }
  requestDraw();
}

/** @type {Record<string, (data: any) => void>} */
const commands = {
  start({ canvas }) {
    try {
      renderer = new Renderer(canvas);
    } catch (error) {
      postMessage({ type: "unavailable", message: /** @type {Error} */ (error).message });
      return;
    }
    canvas.addEventListener("webglcontextlost", (/** @type {Event} */ event) => event.preventDefault());
    canvas.addEventListener("webglcontextrestored", () => {
      renderer?.restore();
      if (snapshot) show(snapshot);
    });
  },
  resize({ width, height, ratio }) {
    size = { width, height, ratio };
    if (!renderer) return;
    renderer.canvas.width = Math.max(1, Math.round(width * ratio));
    renderer.canvas.height = Math.max(1, Math.round(height * ratio));
    renderer.pointSize = look.pointSize * ratio;
    requestDraw();
  },
  snapshot({ snapshot: next }) { show(next); },
  clear() {
    snapshot = null;
    framed = false;
    selectedImage = -1;
    colors = new Uint8Array();
    renderer?.setPoints(new Float32Array(), colors);
    renderer?.setCameras(new Float32Array(), new Float32Array(), colors);
    if (renderer) renderer.selectedPoint = -1;
    requestDraw();
  },
  look(change) {
    Object.assign(look, change.look);
    if (renderer) {
      renderer.pointSize = look.pointSize * size.ratio;
      renderer.frustumSize = spacing * look.frustumScale;
      if (change.look.background) renderer.background = change.look.background;
    }
    if (["by", "filter", "component"].some((name) => name in change.look)) {
      paintPoints();
      renderer?.setPointColors(colors);
    }
    paintCameras();
    requestDraw();
  },
  select({ image, point }) {
    selectedImage = image ?? -1;
    if (renderer) renderer.selectedPoint = point ?? -1;
    paintCameras();
    requestDraw();
  },
  move({ how, amount }) {
    framed = true;
    if (how === "orbit") camera.orbit(amount[0], amount[1]);
    else if (how === "look") camera.look(amount[0], amount[1]);
    else if (how === "pan") camera.pan(amount[0], amount[1]);
    else if (how === "zoom") camera.zoom(amount[0]);
    else camera.fly(amount);
    requestDraw();
  },
  frame() {
    if (!snapshot) return;
    const { center, radius, up, forward } = frameOf(snapshot);
    camera.frame(center, radius, up, forward);
    requestDraw();
  },
  projection({ orthographic }) {
    camera.orthographic = orthographic;
    requestDraw();
  },
  /** Stands where a photograph was taken. */
  snap({ image }) {
    const k = snapshot?.cameraImage.indexOf(image) ?? -1;
    if (!snapshot || k < 0) return;
    framed = true;
    const m = snapshot.cameras.subarray(12 * k, 12 * k + 12);
    const distance = camera.extent * 0.5;
    const [forward, center] = [[m[2], m[6], m[10]], [m[3], m[7], m[11]]];
    camera.up = [-m[1], -m[5], -m[9]];
    const target = center.map((c, axis) => c + forward[axis] * distance);
    camera.glide(/** @type {any} */ (target), /** @type {any} */ (forward), distance, performance.now(), look.still);
    requestDraw();
  },
  goTo({ point }) {
    if (!snapshot) return;
    const target = /** @type {any} */ ([...snapshot.positions.subarray(3 * point, 3 * point + 3)]);
    camera.glide(target, camera.forward, Math.min(camera.distance, camera.extent * 0.3), performance.now(), look.still);
    requestDraw();
  },
  pick({ id, x, y }) {
    const hit = snapshot ? pick(snapshot, colors, camera.matrix(size.width / size.height), x, y, size.width, size.height, look.frustumScale > 0) : { point: null, camera: null };
    const image = hit.camera === null || !snapshot ? null : snapshot.cameraImage[hit.camera];
    postMessage({ type: "picked", id, point: hit.point, image });
  },
};

addEventListener("message", ({ data }) => commands[data.type]?.(data));
