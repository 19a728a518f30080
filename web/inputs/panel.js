// The left panel: what came in, image by image, and what is the matter with it.

import { el, heading, hide } from "../ui/dom.js";
import { count, plural } from "../ui/format.js";
import { imageView } from "./image-view.js";
import { matchMatrix } from "./match-matrix.js";
import { median, standing } from "./reasons.js";
import { thumbnails } from "./thumbnails.js";

const STATES = /** @type {const} */ ([["all", "all", ""], ["placed", "placed", "good"], ["weak", "weak", "fair"], ["missing", "not placed", "bad"]]);

/**
 * @param {HTMLElement} panel @param {import("../store.js").Store} store @param {import("../engine/client.js").Engine} engine
 * @param {import("./pictures.js").Pictures} pictures
 * @param {{ snap: (image: number) => void, pickFiles: () => void, pickFolder: () => void, sample: () => void, close: () => void }} on
 */
export function inputsPanel(panel, store, engine, pictures, on) {
  const { node: head, note } = heading("Inputs");
  const filters = el("div", { class: "filters hidden", role: "group", "aria-label": "Which images" });
  const grid = thumbnails(store, pictures, (image) => engine.ask({ type: "keypoints", image }), {
    select: (image) => store.set({ selection: store.state.selection.kind === "image" && store.state.selection.image === image ? { kind: "none" } : { kind: "image", image }, seenBy: [] }),
    snap: on.snap,
  });
  const pair = (/** @type {number} */ image, /** @type {number|undefined} */ other) => store.set({ selection: other === undefined ? { kind: "image", image } : { kind: "pair", image, other }, seenBy: [] });
  const view = imageView(store, engine, pictures, { select: pair, snap: on.snap });
  const matrix = matchMatrix(store, pair);
  const content = el("div", { class: "hidden" }, filters, el("div", { class: "block" }, grid.node), view.node, matrix.node);
  const empty = el("p", { class: "quiet" }, "No scene yet. Drop files anywhere on this page, or try the sample: a small scene made for the purpose.");
  const sample = el("button", { type: "button", onclick: on.sample }, "Sample");
  const close = el("button", { type: "button", title: "Close the scene and give its memory back", onclick: on.close }, "Close");
  const add = el("div", { class: "add" },
    el("button", { type: "button", title: "Choose files (O)", onclick: on.pickFiles }, "Files…"),
    el("button", { type: "button", onclick: on.pickFolder }, "Folder…"), sample, close);
  panel.append(el("div", { class: "pad" }, head, empty, content), el("div", { class: "actions-bar" }, add));

  function summary() {
    const { opened, report, imageFilter } = store.state;
    hide(content, !opened);
    hide(empty, Boolean(opened));
    hide(sample, Boolean(opened));
    hide(close, !opened);
    hide(matrix.node, !opened || opened.pairs.length === 0);
    if (!opened) {
      note.textContent = "";
      return;
    }
    const middle = median((report?.images ?? []).map((image) => image.mean_reprojection_error_px));
    const counts = { all: opened.images.length, placed: 0, weak: 0, missing: 0, pending: 0 };
    if (report) report.images.forEach((image) => (counts[standing(image, middle).standing] += 1));
    note.textContent = report ? `${count(counts.placed + counts.weak)} of ${plural(counts.all, "image")} placed` : plural(counts.all, "image");
    hide(filters, !report);
    // The buttons are made anew: whoever pressed one by key stays on it.
    const focused = [...filters.children].indexOf(/** @type {Element} */ (document.activeElement));
    filters.replaceChildren(...STATES.filter(([state]) => counts[state] > 0).map(([state, label, dot]) => el("button", {
      type: "button", class: "chip", "aria-pressed": String(imageFilter === state),
      onclick: () => store.set({ imageFilter: imageFilter === state ? "all" : state }),
    }, dot !== "" && el("i", { class: `dot ${dot}` }), state === "all" ? `all ${count(counts.all)}` : `${count(counts[state])} ${label}`)));
    /** @type {HTMLElement|undefined} */ (filters.children[focused])?.focus();
  }

  store.on(["opened", "report", "imageFilter"], summary);
  summary();
  return {
    picturesChanged: grid.redraw,
    redraw: () => {
      grid.redraw();
      view.redraw();
      matrix.redraw();
    },
  };
}
