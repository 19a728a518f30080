// The selected point: how well it is known, and where every photograph sees it, with a crop of each that is at hand.

import { el, hide, sharpContext, token } from "../ui/dom.js";
import { pixels, plural } from "../ui/format.js";

/** Side of a crop, px of the photograph: enough to tell what it is. */
const CROP_PX = 64;
/** Crops at most: each decodes a whole photograph. */
const MAX_CROPS = 24;

/**
 * @typedef {{ image: number, keypoint: number, errorPx: number, observed?: [number, number], projected?: [number, number] }} Observation
 * @typedef {{ position: number[], errorPx: number, angleDeg: number, observations: Observation[] }} Track
 */

/**
 * @param {import("../store.js").Store} store @param {import("../engine/client.js").Engine} engine
 * @param {import("../inputs/pictures.js").Pictures} pictures @param {(seenBy: number[]) => void} seen
 */
export function inspector(store, engine, pictures, seen) {
  const node = el("aside", { class: "inspector hidden", "aria-label": "Selected point" });
  let asked = 0;

  /** @param {Observation} observation @param {HTMLCanvasElement} canvas @param {number} mine */
  async function crop(observation, canvas, mine) {
    const info = store.state.opened?.images[observation.image];
    if (!info || !observation.observed) return;
    const [x, y] = observation.observed;
    const bitmap = await pictures.crop(info.name, x - CROP_PX / 2, y - CROP_PX / 2, CROP_PX, info.width);
    if (mine !== asked || !canvas.isConnected) {
      bitmap?.close();
      return;
    }
    const { context, width } = sharpContext(canvas);
    const zoom = width / CROP_PX;
    context.fillStyle = token("--ground");
    context.fillRect(0, 0, width, width);
    if (bitmap) context.drawImage(bitmap, 0, 0, width, width);
    bitmap?.close();
    // Observed in the middle, green; where the model puts it, red.
    const ring = (/** @type {string} */ color, /** @type {number} */ dx, /** @type {number} */ dy, /** @type {number} */ r) => {
      context.strokeStyle = color;
      context.lineWidth = 1.5;
      context.beginPath();
      context.arc(width / 2 + dx * zoom, width / 2 + dy * zoom, r, 0, 7);
      context.stroke();
    };
    ring(token("--good"), 0, 0, 6);
    if (observation.projected) ring(token("--bad"), observation.projected[0] - x, observation.projected[1] - y, 2.5);
  }

  async function update() {
    const { selection } = store.state;
    const mine = (asked += 1);
    hide(node, selection.kind !== "point");
    if (selection.kind !== "point") return;
    /** @type {Track|null} */
    const track = await engine.ask({ type: "track", point: selection.point ?? 0 }).catch(() => null);
    if (mine !== asked) return;
    const close = el("button", { type: "button", class: "icon", "aria-label": "Close", onclick: () => store.set({ selection: { kind: "none" } }) }, "×");
    if (!track) {
      node.replaceChildren(el("div", { class: "heading" }, el("h2", {}, "Point"), close), el("p", { class: "quiet" }, "What sees it is known when the run is over."));
      return;
    }
    seen(track.observations.map(({ image }) => image));
    const withCrops = pictures.files.size > 0 && track.observations.some(({ observed }) => observed);
    const rows = track.observations.map((observation, k) => {
      const name = store.state.opened?.images[observation.image]?.name.split("/").at(-1) ?? "";
      const canvas = withCrops && k < MAX_CROPS ? el("canvas", { class: "crop", "aria-hidden": "true" }) : null;
      if (canvas) crop(observation, canvas, mine);
      return el("li", {}, canvas,
        el("button", { type: "button", class: "link", onclick: () => store.set({ selection: { kind: "image", image: observation.image } }) }, name),
        el("span", { class: "quiet" }, pixels(observation.errorPx)));
    });
    node.replaceChildren(
      el("div", { class: "heading" }, el("h2", {}, "Point"), close),
      el("p", {}, `Seen ${plural(track.observations.length, "time")} · ${pixels(track.errorPx)} · rays up to ${track.angleDeg.toFixed(1)}° apart`),
      el("p", { class: "quiet" }, track.position.map((x) => x.toFixed(3)).join(", ")),
      el("ul", { class: "observations" }, ...rows),
      withCrops ? el("p", { class: "quiet small" }, el("i", { class: "dot good" }), " observed ", el("i", { class: "dot bad" }), " where the model puts it") : "");
    node.scrollTop = 0;
  }
  store.on(["selection"], update);
  return { node };
}
