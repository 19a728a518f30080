// One image with its keypoints, their errors, or its matches to another image.

import { el, heading, hide, perFrame, sharpContext, token } from "../ui/dom.js";
import { count, pixels } from "../ui/format.js";
import { ramp } from "../scene/colors.js";

/** Errors beyond this are drawn red, px: COLMAP's and our filters take observations out at a few pixels. */
const LARGE_ERROR_PX = 2;
/** More crosses than this hide the picture they lie on. */
const MAX_MARKS = 4000;

/**
 * @param {import("../store.js").Store} store @param {import("../engine/client.js").Engine} engine
 * @param {import("./pictures.js").Pictures} pictures @param {(image: number, other: number|undefined) => void} select
 */
export function imageView(store, engine, pictures, select) {
  const { node: head, note } = heading("Image");
  const canvas = el("canvas", { class: "image-view", role: "img" });
  const caption = el("p", { class: "quiet caption" });
  const neighbours = el("select", { "aria-label": "Show matches with", onchange: () => choose() });
  const neighbourRow = el("label", { class: "neighbour" }, el("span", { class: "quiet" }, "Matches with"), neighbours);
  const node = el("div", { class: "block hidden" }, head, canvas, caption, neighbourRow);
  /** @type {{ keypoints: Float32Array, residuals: Float32Array|null, matches: Float32Array|null, picture: ImageBitmap|null, other: ImageBitmap|null }|null} */
  let shown = null;
  let asked = 0;

  function choose() {
    const { selection } = store.state;
    if (selection.image !== undefined) select(selection.image, neighbours.value === "" ? undefined : Number(neighbours.value));
  }

  async function load() {
    const { opened, selection, report } = store.state;
    const mine = (asked += 1);
    const image = selection.kind === "image" || selection.kind === "pair" ? selection.image : undefined;
    hide(node, image === undefined || !opened);
    if (image === undefined || !opened) {
      shown = null;
      return;
    }
    const info = opened.images[image];
    const other = selection.kind === "pair" ? selection.other : undefined;
    listNeighbours(image, other);
    const widthPx = Math.min(info.width || 640, 2 * (canvas.clientWidth || 290));
    /** @type {[Float32Array, Float32Array|null, Float32Array|null, ImageBitmap|null, ImageBitmap|null]} */
    const [keypoints, residuals, matches, picture, second] = await Promise.all([
      engine.ask({ type: "keypoints", image }),
      report?.images[image]?.component !== null && report ? engine.ask({ type: "residuals", image }) : null,
      other === undefined ? null : engine.ask({ type: "matches", image, other }),
      pictures.picture(info.name, widthPx),
      other === undefined ? null : pictures.picture(opened.images[other].name, widthPx),
    ]).catch(() => /** @type {any} */ ([new Float32Array(), null, null, null, null]));
    if (mine !== asked) {
      picture?.close();
      second?.close();
      return;
    }
    shown?.picture?.close();
    shown?.other?.close();
    shown = { keypoints, residuals, matches, picture, other: second };
    const result = report?.images[image];
    note.textContent = `${info.width} × ${info.height}`;
    const parts = [info.name.split("/").at(-1), `${count(info.keypoints)} keypoints`];
    if (result?.component !== null && result) parts.push(`${count(result.points)} points`, pixels(result.mean_reprojection_error_px));
    if (matches) parts.push(`${count(matches.length / 5)} matches`);
    caption.textContent = parts.join(" · ");
    canvas.setAttribute("aria-label", caption.textContent);
    draw();
  }

  /** @param {number} image @param {number|undefined} other */
  function listNeighbours(image, other) {
    const { opened } = store.state;
    if (!opened) return;
    /** @type {[number, number][]} */
    const list = [];
    for (let k = 0; k < opened.pairs.length; k += 3) {
      const [a, b, matches] = opened.pairs.subarray(k, k + 3);
      if (a === image) list.push([b, matches]);
      else if (b === image) list.push([a, matches]);
    }
    list.sort((x, y) => y[1] - x[1]);
    neighbours.replaceChildren(
      el("option", { value: "" }, list.length === 0 ? "no other image" : "choose an image"),
      ...list.map(([k, matches]) => el("option", { value: String(k), selected: k === other }, `${opened.images[k].name.split("/").at(-1)} (${count(matches)})`)),
    );
    neighbours.disabled = list.length === 0;
  }

  const draw = perFrame(() => {
    const { opened, selection } = store.state;
    if (!opened || !shown || selection.image === undefined) return;
    const info = opened.images[selection.image];
    const other = selection.kind === "pair" && selection.other !== undefined ? opened.images[selection.other] : null;
    const aspect = (info.height || 3) / (info.width || 4);
    const heightShare = other ? aspect + (other.height || 3) / (other.width || 4) : aspect;
    canvas.style.aspectRatio = String(1 / heightShare);
    const { context, width } = sharpContext(canvas);
    const drawn = shown;
    /** @param {ImageBitmap|null} picture @param {number} top @param {number} height */
    const place = (picture, top, height) => {
      context.fillStyle = token("--ground");
      context.fillRect(0, top, width, height);
      if (picture) context.drawImage(picture, 0, top, width, height);
    };
    place(drawn.picture, 0, width * aspect);
    const zoom = width / (info.width || 1);
    if (other && drawn.matches) {
      const top = width * aspect;
      place(drawn.other, top, width * (heightShare - aspect));
      const zoomOther = width / (other.width || 1);
      context.strokeStyle = token("--good");
      context.globalAlpha = Math.max(0.15, Math.min(0.8, 150 / (drawn.matches.length / 5)));
      context.beginPath();
      // Five numbers a match: x, y here; x, y there; whether it became part of a point.
      for (let k = 0; k < drawn.matches.length; k += 5) {
        context.moveTo(drawn.matches[k] * zoom, drawn.matches[k + 1] * zoom);
        context.lineTo(drawn.matches[k + 2] * zoomOther, top + drawn.matches[k + 3] * zoomOther);
      }
      context.stroke();
      context.globalAlpha = 1;
      return;
    }
    const step = Math.max(1, Math.ceil(drawn.keypoints.length / 2 / MAX_MARKS));
    for (let k = 0; 2 * k < drawn.keypoints.length; k += step) {
      const error = drawn.residuals?.[k];
      const used = error !== undefined && error >= 0;
      const [r, g, b] = used ? ramp(error / LARGE_ERROR_PX) : [150, 160, 175];
      context.fillStyle = `rgb(${r} ${g} ${b})`;
      context.globalAlpha = used ? 0.95 : 0.4;
      const side = used ? 2.4 : 1.4;
      context.fillRect(drawn.keypoints[2 * k] * zoom - side / 2, drawn.keypoints[2 * k + 1] * zoom - side / 2, side, side);
    }
    context.globalAlpha = 1;
  });

  store.on(["selection", "report", "opened"], load);
  new ResizeObserver(draw).observe(canvas);
  return { node, reload: load, redraw: draw };
}
