// The left panel: what came in, image by image, and what is the matter with it.

import { el, heading, hide } from "../ui/dom.js";
import { count, plural } from "../ui/format.js";
import { imageView } from "./image-view.js";
import { matchMatrix } from "./match-matrix.js";
import { median, standing } from "./reasons.js";
import { thumbnails } from "./thumbnails.js";

/**
 * @param {HTMLElement} panel @param {import("../store.js").Store} store @param {import("../engine/client.js").Engine} engine
 * @param {import("./pictures.js").Pictures} pictures
 * @param {{ snap: (image: number) => void, pickFiles: () => void, pickFolder: () => void }} on
 */
export function inputsPanel(panel, store, engine, pictures, on) {
  const { node: head, note } = heading("Inputs");
  const problems = el("div", { "aria-live": "polite" });
  const filters = el("div", { class: "filters hidden", role: "radiogroup", "aria-label": "Which images" });
  const grid = thumbnails(store, pictures, {
    select: (image) => store.set({ selection: store.state.selection.kind === "image" && store.state.selection.image === image ? { kind: "none" } : { kind: "image", image } }),
    snap: on.snap,
  });
  const view = imageView(store, engine, pictures, (image, other) => store.set({ selection: other === undefined ? { kind: "image", image } : { kind: "pair", image, other } }));
  const matrix = matchMatrix(store, (image, other) => store.set({ selection: { kind: "pair", image, other } }));
  const add = el("div", { class: "add" },
    el("button", { type: "button", onclick: on.pickFiles }, "Files…"),
    el("button", { type: "button", onclick: on.pickFolder }, "Folder…"));
  const content = el("div", { class: "hidden" }, filters, el("div", { class: "block" }, grid.node), view.node, matrix.node);
  const empty = el("p", { class: "quiet" }, "No scene yet. Drop a database.db, or a folder that holds one with its photographs and depth maps.");
  panel.append(el("div", { class: "pad" }, head, problems, empty, content, add));

  const STATES = /** @type {const} */ (["all", "placed", "weak", "missing"]);
  function summary() {
    const { opened, report, imageFilter } = store.state;
    hide(content, !opened);
    hide(empty, Boolean(opened));
    hide(matrix.node, !opened || opened.pairs.length === 0);
    if (!opened) {
      note.textContent = "";
      return;
    }
    const middle = median((report?.images ?? []).map((image) => image.mean_reprojection_error_px));
    const counts = { all: opened.images.length, placed: 0, weak: 0, missing: 0, pending: 0 };
    opened.images.forEach((_, k) => (counts[standing(report?.images[k], middle).standing] += 1));
    note.textContent = report ? `${count(counts.placed + counts.weak)} of ${plural(counts.all, "image")} placed` : plural(counts.all, "image");
    hide(filters, !report);
    filters.replaceChildren(...STATES.map((state) => el("button", {
      type: "button", class: "chip", role: "radio", "aria-checked": String(imageFilter === state),
      onclick: () => store.set({ imageFilter: state }),
    }, state !== "all" && el("i", { class: `dot ${{ placed: "good", weak: "fair", missing: "bad" }[state]}` }), `${count(counts[state])} ${state === "missing" ? "not placed" : state}`)));
  }

  store.on(["opened", "report", "imageFilter"], summary);
  store.on(["problems"], () => problems.replaceChildren(...store.state.problems.map(({ file, message, hint }) =>
    el("div", { class: "notice bad" }, el("b", {}, file), `: ${message}`, hint && el("p", {}, hint)))));
  summary();
  return {
    picturesChanged: () => {
      grid.redraw();
      view.reload();
    },
    redraw: () => {
      grid.redraw();
      view.redraw();
      matrix.redraw();
    },
  };
}
