// The grid of photographs with their state. Only the rows in sight exist: scenes have thousands of images. Without photographs
// the keypoints stand in for them.

import { el, perFrame, sharpContext, token } from "../ui/dom.js";
import { median, standing } from "./reasons.js";

const LABEL = { pending: "not solved yet", solving: "has a camera so far", placed: "placed", weak: "weak", missing: "not placed" };
const DOT = { pending: "", solving: "accent", placed: "good", weak: "fair", missing: "bad" };
const CELL_PX = 64;
const GAP_PX = 5;
/** Rows kept beyond the edges, so that slow scrolling shows no holes. */
const SPARE_ROWS = 2;
/** Keypoints drawn in a cell: enough for the picture's shape. */
const SKETCH = 350;

/**
 * @param {import("../store.js").Store} store @param {import("./pictures.js").Pictures} pictures
 * @param {(image: number) => Promise<Float32Array>} keypoints
 * @param {{ select: (image: number) => void, snap: (image: number) => void }} on
 */
export function thumbnails(store, pictures, keypoints, on) {
  const space = el("div", { class: "space" });
  const grid = el("div", { class: "thumbnails", role: "listbox", "aria-label": "Images", tabIndex: 0 }, space);
  /** Images that pass the filter, in order. @type {number[]} */
  let listed = [];
  /** Cells in sight by image. @type {Map<number, HTMLElement>} */
  let cells = new Map();
  /** @type {Map<number, Float32Array>} */
  const sketches = new Map();
  let active = 0;
  let medianError = 0;
  let columns = 1;
  let side = CELL_PX;

  const stateOf = (/** @type {number} */ image) => {
    const { report, placed, phase } = store.state;
    const is = standing(report?.images[image], medianError);
    const solving = is.standing === "pending" && phase !== "ready" && placed.has(image);
    return { standing: solving ? /** @type {const} */ ("solving") : is.standing, why: is.why };
  };

  /** @param {HTMLElement} cell @param {number} image */
  async function draw(cell, image) {
    const info = store.state.opened?.images[image];
    if (!info) return;
    const canvas = /** @type {HTMLCanvasElement} */ (cell.firstElementChild);
    const bitmap = await pictures.thumbnail(info.name);
    if (!canvas.isConnected) return;
    if (bitmap) {
      const { context, width, height } = sharpContext(canvas);
      const fill = Math.max(width / bitmap.width, height / bitmap.height);
      context.drawImage(bitmap, (width - bitmap.width * fill) / 2, (height - bitmap.height * fill) / 2, bitmap.width * fill, bitmap.height * fill);
      return;
    }
    if (!sketches.has(image)) {
      const { opened } = store.state;
      const all = await keypoints(image).catch(() => null);
      if (!all || opened !== store.state.opened) return;
      const step = Math.max(1, Math.ceil(all.length / 2 / SKETCH));
      sketches.set(image, Float32Array.from({ length: 2 * Math.floor(all.length / 2 / step) }, (_, k) => all[2 * step * (k >> 1) + (k & 1)]));
    }
    if (!canvas.isConnected) return;
    const { context, width, height } = sharpContext(canvas);
    const points = sketches.get(image) ?? new Float32Array();
    context.fillStyle = token("--quiet");
    const fill = Math.max(width / (info.width || 1), height / (info.height || 1));
    for (let k = 0; k < points.length; k += 2) {
      context.fillRect((points[k] - info.width / 2) * fill + width / 2, (points[k + 1] - info.height / 2) * fill + height / 2, 1, 1);
    }
  }

  /** @param {HTMLElement} cell @param {number} image @param {number} position */
  function mark(cell, image, position) {
    const { opened, selection, seenBy } = store.state;
    const is = stateOf(image);
    const label = `${opened?.images[image]?.name}, ${LABEL[is.standing]}${is.why ? `: ${is.why}` : ""}`;
    cell.title = label;
    cell.setAttribute("aria-label", label);
    cell.setAttribute("aria-setsize", String(listed.length));
    cell.setAttribute("aria-posinset", String(position + 1));
    const isSelected = (selection.kind === "image" || selection.kind === "pair") && selection.image === image;
    cell.setAttribute("aria-selected", String(isSelected));
    cell.classList.toggle("partner", (selection.kind === "pair" && selection.other === image) || (selection.kind === "point" && seenBy.includes(image)));
    cell.classList.toggle("active", position === active);
    /** @type {HTMLElement} */ (cell.lastElementChild).className = `dot ${DOT[is.standing]}`;
  }

  /** Brings the cells in line with what is listed and where it is scrolled to. */
  function lay() {
    const width = grid.clientWidth - 6;
    if (width <= 0) return;
    columns = Math.max(1, Math.floor((width + GAP_PX) / (CELL_PX + GAP_PX)));
    side = (width - (columns - 1) * GAP_PX) / columns;
    const pitch = (side * 2) / 3 + GAP_PX;
    const rows = Math.ceil(listed.length / columns);
    space.style.height = `${Math.max(0, rows * pitch - GAP_PX)}px`;
    const first = Math.max(0, Math.floor(grid.scrollTop / pitch) - SPARE_ROWS) * columns;
    const last = Math.min(listed.length, (Math.ceil((grid.scrollTop + grid.clientHeight) / pitch) + SPARE_ROWS) * columns);
    const before = cells;
    cells = new Map();
    for (let at = first; at < last; at += 1) {
      const image = listed[at];
      let cell = before.get(image);
      const isNew = !cell;
      cell ??= el("div", { class: "thumbnail", role: "option", id: `image-${image}` }, el("canvas", { "aria-hidden": "true" }), el("i", { class: "dot" }));
      before.delete(image);
      const [row, column] = [Math.floor(at / columns), at % columns];
      Object.assign(cell.style, { width: `${side}px`, height: `${(side * 2) / 3}px`, transform: `translate(${column * (side + GAP_PX)}px, ${row * pitch}px)` });
      mark(cell, image, at);
      cells.set(image, cell);
      if (isNew) {
        space.append(cell);
        draw(cell, image);
      }
    }
    for (const gone of before.values()) gone.remove();
    const current = cells.get(listed[active]);
    if (current) grid.setAttribute("aria-activedescendant", current.id);
    else grid.removeAttribute("aria-activedescendant");
  }
  const later = perFrame(lay);

  /** @param {number} position */
  function reveal(position) {
    const pitch = (side * 2) / 3 + GAP_PX;
    const top = Math.floor(position / columns) * pitch;
    if (top < grid.scrollTop) grid.scrollTop = top;
    else if (top + pitch > grid.scrollTop + grid.clientHeight) grid.scrollTop = top + pitch - grid.clientHeight;
  }

  function list() {
    const { opened, report, imageFilter } = store.state;
    medianError = median((report?.images ?? []).map((image) => image.mean_reprojection_error_px));
    listed = (opened?.images ?? []).map((_, image) => image).filter((image) => imageFilter === "all" || stateOf(image).standing === imageFilter);
    active = Math.min(active, Math.max(0, listed.length - 1));
    later();
  }

  function restart() {
    for (const cell of cells.values()) cell.remove();
    cells = new Map();
    // What it names has gone with them.
    grid.removeAttribute("aria-activedescendant");
    later();
  }

  const imageAt = (/** @type {Event} */ event) => {
    const cell = /** @type {HTMLElement} */ (event.target).closest(".thumbnail");
    return cell ? Number(cell.id.slice("image-".length)) : null;
  };
  grid.addEventListener("click", (event) => {
    const image = imageAt(event);
    if (image !== null) on.select(image);
  });
  grid.addEventListener("dblclick", (event) => {
    const image = imageAt(event);
    if (image !== null) on.snap(image);
  });
  grid.addEventListener("scroll", later, { passive: true });
  grid.addEventListener("keydown", (event) => {
    const step = { ArrowLeft: -1, ArrowRight: 1, ArrowUp: -columns, ArrowDown: columns, Home: -Infinity, End: Infinity }[event.key];
    if (step !== undefined) {
      active = Math.min(Math.max(active + step, 0), listed.length - 1);
      reveal(active);
      later();
    } else if ((event.key === "Enter" || event.key === " ") && listed[active] !== undefined) on.select(listed[active]);
    else return;
    event.preventDefault();
    event.stopPropagation();
  });

  store.on(["opened"], () => {
    sketches.clear();
    active = 0;
    grid.scrollTop = 0;
    restart();
  });
  store.on(["opened", "report", "imageFilter"], list);
  store.on(["placed", "phase", "seenBy"], later);
  store.on(["selection"], () => {
    const at = listed.indexOf(store.state.selection.image ?? -1);
    if (at >= 0 && at !== active) {
      active = at;
      reveal(at);
    }
    later();
  });
  new ResizeObserver(restart).observe(grid);
  return { node: grid, redraw: restart };
}
