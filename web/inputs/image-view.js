// The selected image: its keypoints and their errors, its matches to a neighbour, why it has no camera; large on demand.

import { ramp } from "../scene/colors.js";
import { el, heading, hide, perFrame } from "../ui/dom.js";
import { dialog } from "../ui/dialog.js";
import { count, pixels } from "../ui/format.js";
import { LARGE_ERROR_PX, drawImages, shapeOf } from "./image-drawing.js";
import { median, standing } from "./reasons.js";

/** @typedef {import("./image-drawing.js").Drawn} Drawn */

/** A wide window has no use for more, px. */
const LARGE_WIDTH_PX = 1600;

/**
 * @param {import("../store.js").Store} store @param {import("../engine/client.js").Engine} engine
 * @param {import("./pictures.js").Pictures} pictures
 * @param {{ select: (image: number, other: number|undefined) => void, snap: (image: number) => void }} on
 */
export function imageView(store, engine, pictures, on) {
  const { node: head, note } = heading("Image");
  const canvas = el("canvas", { class: "image-view", role: "img", onclick: () => enlarge() });
  const caption = el("p", { class: "caption" });
  const reason = el("p", { class: "reason hidden" });
  const scale = el("div", { class: "error-scale quiet small hidden" }, el("span", {}, "0"), el("span", { class: "bar-of-colour" }), el("span", {}, `${LARGE_ERROR_PX} px and more`));
  /** @type {HTMLElement} */ (scale.children[1]).style.background = `linear-gradient(90deg, ${[0, 1 / 3, 2 / 3, 1].map((t) => `rgb(${ramp(t).map(Math.round).join(" ")})`).join(", ")})`;
  const matchesLabel = el("span", { class: "quiet" });
  const neighbours = el("select", { "aria-label": "Show matches with", onchange: () => choose() });
  const snap = el("button", { type: "button", title: "Look through this camera (C)", onclick: () => on.snap(store.state.selection.image ?? 0) }, "Look through");
  const large = el("button", { type: "button", onclick: () => enlarge() }, "Enlarge");
  const node = el("div", { class: "block hidden" }, head, canvas, caption, reason, scale,
    el("label", { class: "neighbour" }, matchesLabel, neighbours),
    el("div", { class: "add" }, snap, large));
  /** @type {Drawn|null} */
  let shown = null;
  let asked = 0;

  function choose() {
    const { selection } = store.state;
    if (selection.image !== undefined) on.select(selection.image, neighbours.value === "" ? undefined : Number(neighbours.value));
  }

  function drop() {
    shown?.picture?.close();
    shown?.otherPicture?.close();
    shown = null;
  }

  /** What is to be drawn of the selection. @param {number} widthPx @returns {Promise<Drawn|null>} */
  async function gather(widthPx) {
    const { opened, selection, report } = store.state;
    const image = selection.kind === "image" || selection.kind === "pair" ? selection.image : undefined;
    if (image === undefined || !opened) return null;
    const other = selection.kind === "pair" ? selection.other : undefined;
    const solved = report ? report.images[image]?.component !== null : opened.kind === "model";
    const nothing = () => null;
    const [keypoints, residuals, matches, picture, otherPicture] = await Promise.all([
      /** @type {Promise<Float32Array|null>} */ (engine.ask({ type: "keypoints", image }).catch(nothing)),
      /** @type {Promise<Float32Array|null>} */ (solved ? engine.ask({ type: "residuals", image }).catch(nothing) : Promise.resolve(null)),
      /** @type {Promise<Float32Array|null>} */ (other === undefined ? Promise.resolve(null) : engine.ask({ type: "matches", image, other }).catch(nothing)),
      pictures.picture(opened.images[image].name, Math.min(opened.images[image].width || widthPx, widthPx)),
      other === undefined ? null : pictures.picture(opened.images[other].name, Math.min(opened.images[other].width || widthPx, widthPx)),
    ]);
    return { size: opened.images[image], otherSize: other === undefined ? null : opened.images[other], keypoints: keypoints ?? new Float32Array(), residuals, matches, picture, otherPicture };
  }

  async function load() {
    const { opened, selection, report, placed } = store.state;
    const mine = (asked += 1);
    const image = selection.kind === "image" || selection.kind === "pair" ? selection.image : undefined;
    hide(node, image === undefined || !opened);
    if (image === undefined || !opened) {
      drop();
      return;
    }
    const info = opened.images[image];
    listNeighbours(image, selection.kind === "pair" ? selection.other : undefined);
    const next = await gather(2 * (canvas.clientWidth || 290));
    if (mine !== asked || !next) {
      next?.picture?.close();
      next?.otherPicture?.close();
      return;
    }
    drop();
    shown = next;
    const result = report?.images[image];
    note.textContent = info.width > 0 ? `${info.width} × ${info.height}` : "";
    const parts = [info.name.split("/").at(-1) ?? info.name, `${count(info.keypoints)} keypoints`];
    if (result && result.component !== null) parts.push(`${count(result.points)} points`, pixels(result.mean_reprojection_error_px));
    if (next.matches) parts.push(`${count(next.matches.length / 5)} ${opened.kind === "model" ? "common points" : "matches"}`);
    caption.textContent = parts.join(" · ");
    canvas.setAttribute("aria-label", caption.textContent);
    const is = standing(result, median((report?.images ?? []).map((other) => other.mean_reprojection_error_px)));
    hide(reason, is.standing !== "missing" && is.standing !== "weak");
    reason.className = `reason${is.standing === "missing" ? " bad" : is.standing === "weak" ? " fair" : " hidden"}`;
    reason.textContent = is.standing === "missing" ? `Not placed: ${is.why}.` : `Weak: ${is.why}.`;
    hide(scale, !next.residuals?.some((error) => error >= 0) || next.matches !== null);
    snap.disabled = !placed.has(image);
    draw();
  }

  /** @param {number} image @param {number|undefined} other */
  function listNeighbours(image, other) {
    const { opened } = store.state;
    if (!opened) return;
    /** @type {[number, number][]} */
    const list = [];
    for (let k = 0; k < opened.pairs.length; k += 3) {
      if (opened.pairs[k] === image) list.push([opened.pairs[k + 1], opened.pairs[k + 2]]);
      else if (opened.pairs[k + 1] === image) list.push([opened.pairs[k], opened.pairs[k + 2]]);
    }
    matchesLabel.textContent = opened.kind === "model" ? "Shares points with" : "Matches with";
    list.sort((x, y) => y[1] - x[1]);
    neighbours.replaceChildren(
      el("option", { value: "" }, list.length === 0 ? "no other image" : `one of ${list.length} images`),
      ...list.map(([k, matches]) => el("option", { value: String(k), selected: k === other }, `${opened.images[k].name.split("/").at(-1)} (${count(matches)})`)),
    );
    neighbours.disabled = list.length === 0;
  }

  const draw = perFrame(() => {
    if (!shown || node.classList.contains("hidden")) return;
    canvas.style.aspectRatio = String(1 / shapeOf(shown, false));
    drawImages(canvas, shown, false);
  });

  async function enlarge() {
    const { opened, selection } = store.state;
    if (!opened || selection.image === undefined) return;
    const drawn = await gather(Math.min(LARGE_WIDTH_PX, devicePixelRatio * innerWidth));
    if (!drawn) return;
    const big = el("canvas", { class: "image-view", role: "img", "aria-label": caption.textContent ?? "" });
    const box = dialog({ title: caption.textContent ?? "", wide: true, closed: () => {
      resized.disconnect();
      drawn.picture?.close();
      drawn.otherPicture?.close();
    } }, big);
    // As large as the window holds, in its own shape.
    const beside = innerWidth > innerHeight;
    const shape = shapeOf(drawn, beside);
    big.style.aspectRatio = String(1 / shape);
    big.style.maxWidth = `calc(76vh / ${shape})`;
    const resized = new ResizeObserver(() => drawImages(big, drawn, beside));
    resized.observe(big);
    box.show();
  }

  store.on(["selection", "report", "opened", "pictures"], load);
  store.on(["phase"], () => {
    if (store.state.selection.image !== undefined && !node.classList.contains("hidden")) snap.disabled = !store.state.placed.has(store.state.selection.image);
  });
  new ResizeObserver(draw).observe(canvas);
  return { node, redraw: draw };
}
