// Draws the scene away from the page's thread and away from the solver: neither waits for the other.

import { Camera } from "./camera.js";
import { categorical, pointColors, ramp } from "./colors.js";
import { frameOf } from "./frame.js";
import { pick } from "./picking.js";
import { Renderer } from "./renderer.js";
import { histogram } from "./summary.js";

/** @typedef {import("../engine/protocol.js").Snapshot} Snapshot */

/** Few points are drawn large, many small: px at most so many points. */
const SIZES = /** @type {const} */ ([[2_000, 4.5], [15_000, 3.2], [80_000, 2.4], [Infinity, 1.7]]);
/** In a narrow picture the same points stand closer together: CSS px of width from which on the sizes hold, and the least share of them. */
const FULL_WIDTH_PX = 640;
const LEAST_SIZE = 0.6;
/** Figures for the page, ms apart at least while solving. */
const FIGURES_MS = 200;

const camera = new Camera();
/** @type {Renderer|null} */
let renderer = null;
/** @type {Snapshot|null} */
let snapshot = null;
/** @type {import("./frame.js").Frame|null} */
let frame = null;
/** @type {Uint8Array} */
let colors = new Uint8Array();
/** Whether the person moved the view: from then on it is theirs. */
let moved = false;
let pending = false;
let lastDraw = 0;
let lastFigures = -Infinity;
/** Of the scene that is shown, counted by the page. */
let generation = 0;
let size = { width: 1, height: 1, ratio: 1 };
const look = {
  /** @type {import("./colors.js").ColorBy} */ by: "rgb",
  filter: { maxErrorPx: Infinity, minTrack: 2 },
  /** @type {number|null} */ component: null,
  pointScale: 1,
  frustumScale: 1,
  /** @type {"plain"|"error"|"component"} */ frustaBy: "plain",
  /** @type {[number, number, number]} */ frustumColor: [217, 170, 74],
  /** @type {[number, number, number]} */ accent: [88, 166, 255],
  /** @type {[number, number, number]} */ plain: [190, 196, 206],
  still: false,
};
/** @type {{ image: number, partner: number, point: number, seenBy: number[] }} */
let selected = { image: -1, partner: -1, point: -1, seenBy: [] };
/** @type {{ image: number, picture: ImageBitmap }|null} */
let photo = null;
/** What keys held down ask for, a second. @type {{ fly: [number, number, number], orbit: [number, number] }} */
let drive = { fly: [0, 0, 0], orbit: [0, 0] };

const aspect = () => size.width / Math.max(size.height, 1);

function requestDraw() {
  if (pending) return;
  pending = true;
  requestAnimationFrame((now) => {
    pending = false;
    const seconds = Math.min((now - lastDraw) / 1000, 0.05);
    lastDraw = now;
    const driven = [...drive.fly, ...drive.orbit].some((speed) => speed !== 0);
    if (driven) {
      camera.fly(/** @type {any} */ (drive.fly.map((speed) => speed * seconds)));
      camera.orbit(drive.orbit[0] * seconds, drive.orbit[1] * seconds);
    }
    const gliding = camera.advance(now);
    renderer?.draw(camera.matrix(aspect()));
    if (gliding || driven) requestDraw();
  });
}

function paintPoints() {
  if (!snapshot || !renderer) return;
  const painted = pointColors(snapshot, look.by, look.filter, look.component, look.plain);
  colors = painted.colors;
  const now = performance.now();
  // Errors are known only between solves: such a picture is never left out.
  if (!snapshot.final && now - lastFigures < FIGURES_MS && !snapshot.errors.some((error) => error >= 0)) return;
  lastFigures = now;
  postMessage({
    type: "shown", generation, shown: painted.shown, points: snapshot.positions.length / 3, cameras: snapshot.cameraImage.length,
    legend: painted.legend, histogram: histogram(snapshot.errors, colors),
    cameraImage: snapshot.cameraImage.slice(), cameraErrors: snapshot.cameraErrors.slice(),
  });
}

function cameraColors() {
  const current = /** @type {Snapshot} */ (snapshot);
  const out = new Uint8Array(4 * current.cameraImage.length);
  const errors = Float32Array.from(current.cameraErrors).filter((e) => e >= 0).sort();
  const high = errors[Math.floor(0.98 * errors.length)] || 1;
  const seenBy = new Set(selected.seenBy);
  current.cameraImage.forEach((image, k) => {
    if (look.component !== null && current.cameraComponent[k] !== look.component) return;
    const rgb = image === selected.image || image === selected.partner || seenBy.has(image) ? look.accent
      : look.frustaBy === "component" ? categorical(current.cameraComponent[k])
      : look.frustaBy === "error" && current.cameraErrors[k] >= 0 ? ramp(current.cameraErrors[k] / high)
      : look.frustumColor;
    out.set([...rgb, 255], 4 * k);
  });
  return out;
}

/** Lines from the selected point to the cameras that see it. */
function rays() {
  if (!snapshot || selected.point < 0) return new Float32Array();
  const point = snapshot.positions.subarray(3 * selected.point, 3 * selected.point + 3);
  const cameras = snapshot.cameras;
  return new Float32Array(selected.seenBy.flatMap((image) => {
    const k = /** @type {Snapshot} */ (snapshot).cameraImage.indexOf(image);
    return k < 0 ? [] : [...point, cameras[12 * k + 3], cameras[12 * k + 7], cameras[12 * k + 11]];
  }));
}

/** The photograph of the selected camera, or none: it lies where the camera is now. */
function hang() {
  const k = photo && snapshot ? snapshot.cameraImage.indexOf(photo.image) : -1;
  if (!photo || !snapshot || k < 0 || photo.image !== selected.image) renderer?.setPhoto(null, new Float32Array(), new Float32Array());
  else renderer?.setPhoto(photo.picture, snapshot.cameras.slice(12 * k, 12 * k + 12), snapshot.cameraShape.slice(4 * k, 4 * k + 4));
}

function paintCameras() {
  if (!snapshot || !renderer) return;
  renderer.setCameraColors(cameraColors());
  renderer.setRays(rays(), look.accent);
}

function sizes() {
  if (!renderer) return;
  const numPoints = (snapshot?.positions.length ?? 0) / 3;
  const px = SIZES.find(([most]) => numPoints <= most)?.[1] ?? 2;
  renderer.pointSize = px * Math.min(1, Math.max(LEAST_SIZE, size.width / FULL_WIDTH_PX)) * look.pointScale * size.ratio;
  renderer.frustumSize = (frame?.spacing ?? 1) * look.frustumScale;
}

/** @param {Snapshot} next */
function show(next) {
  snapshot = next;
  paintPoints();
  const before = frame;
  frame = frameOf(next);
  if (frame && !moved) camera.frame(frame, aspect());
  else if (frame && before) camera.follow(before, frame);
  renderer?.setPoints(next.positions, colors);
  renderer?.setCameras(next.cameras, next.cameraShape, cameraColors());
  renderer?.setRays(rays(), look.accent);
  hang();
  sizes();
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
  resize({ width, height, ratio, coveredPx }) {
    size = { width, height, ratio };
    camera.covered = Math.min(coveredPx / Math.max(height, 1), 0.5);
    if (!renderer) return;
    renderer.canvas.width = Math.max(1, Math.round(width * ratio));
    renderer.canvas.height = Math.max(1, Math.round(height * ratio));
    sizes();
    if (frame && !moved) camera.frame(frame, aspect());
    requestDraw();
  },
  snapshot({ snapshot: next }) { show(next); },
  clear({ generation: next }) {
    generation = next;
    [snapshot, frame, moved, lastFigures] = [null, null, false, -Infinity];
    selected = { image: -1, partner: -1, point: -1, seenBy: [] };
    colors = new Uint8Array();
    renderer?.setPoints(new Float32Array(), colors);
    renderer?.setCameras(new Float32Array(), new Float32Array(), colors);
    renderer?.setRays(new Float32Array(), look.accent);
    photo?.picture.close();
    photo = null;
    hang();
    if (renderer) renderer.selectedPoint = -1;
    requestDraw();
  },
  look(change) {
    Object.assign(look, change.look);
    if (renderer && change.look.background) renderer.background = change.look.background;
    if (renderer) renderer.accent = look.accent;
    sizes();
    if (["by", "filter", "component", "plain"].some((name) => name in change.look)) {
      lastFigures = -Infinity;
      paintPoints();
      renderer?.setPointColors(colors);
    }
    paintCameras();
    requestDraw();
  },
  select({ image, partner, point, seenBy }) {
    selected = { image: image ?? -1, partner: partner ?? -1, point: point ?? -1, seenBy: seenBy ?? [] };
    if (renderer) renderer.selectedPoint = selected.point;
    paintCameras();
    hang();
    requestDraw();
  },
  photo({ image, picture }) {
    photo?.picture.close();
    photo = { image, picture };
    hang();
    requestDraw();
  },
  move({ how, amount }) {
    moved = true;
    if (how === "orbit") camera.orbit(amount[0], amount[1]);
    else if (how === "look") camera.look(amount[0], amount[1]);
    else if (how === "pan") camera.pan(amount[0], amount[1]);
    else camera.zoom(amount[0]);
    requestDraw();
  },
  drive(asked) {
    moved = true;
    drive = { fly: asked.fly, orbit: asked.orbit };
    lastDraw = performance.now();
    requestDraw();
  },
  frame() {
    moved = false;
    if (frame) camera.frame(frame, aspect());
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
    moved = true;
    const m = snapshot.cameras.subarray(12 * k, 12 * k + 12);
    const distance = camera.extent * 0.5;
    const [forward, center] = [[m[2], m[6], m[10]], [m[3], m[7], m[11]]];
    const target = center.map((c, axis) => c + forward[axis] * distance);
    camera.glide(/** @type {any} */ (target), /** @type {any} */ (forward), distance, performance.now(), look.still);
    requestDraw();
  },
  goTo({ point }) {
    if (!snapshot) return;
    moved = true;
    const target = /** @type {any} */ ([...snapshot.positions.subarray(3 * point, 3 * point + 3)]);
    camera.glide(target, camera.forward, Math.min(camera.distance, camera.extent * 0.3), performance.now(), look.still);
    requestDraw();
  },
  pick({ id, x, y }) {
    const hit = snapshot ? pick(snapshot, colors, camera.matrix(aspect()), x, y, size.width, size.height, look.frustumScale > 0) : { point: null, camera: null };
    const image = hit.camera === null || !snapshot ? null : snapshot.cameraImage[hit.camera];
    postMessage({ type: "picked", id, point: hit.point, image });
  },
};

addEventListener("message", ({ data }) => commands[data.type]?.(data));
