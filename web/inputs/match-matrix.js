// Verified matches of every pair as a square picture: loops, gaps and lonely images show at a glance.

import { el, heading, perFrame, sharpContext, token } from "../ui/dom.js";
import { count, plural } from "../ui/format.js";

/** @param {import("../store.js").Store} store @param {(image: number, other: number) => void} select */
export function matchMatrix(store, select) {
  const { node: head, title, note } = heading("Matches");
  const canvas = el("canvas", { class: "matrix", role: "img" });
  const under = el("p", { class: "quiet small under", "aria-hidden": "true" }, "\u00a0");
  const node = el("div", { class: "block" }, head, canvas, under);
  /** The strongest pair of every cell of the picture; cells are images, or pixels where images are more. @type {Float32Array} */
  let cells = new Float32Array();
  let size = 0;
  let most = 1;

  const resolution = () => Math.max(1, Math.round(canvas.clientWidth * Math.min(devicePixelRatio || 1, 2)));

  function index() {
    const { opened } = store.state;
    size = Math.min(opened?.images.length ?? 0, resolution());
    cells = new Float32Array(size * size);
    most = 1;
    if (opened) {
      const { pairs, images } = opened;
      for (let k = 0; k < pairs.length; k += 3) {
        const [a, b] = [Math.floor((pairs[k] * size) / images.length), Math.floor((pairs[k + 1] * size) / images.length)];
        const strength = Math.max(cells[a * size + b], pairs[k + 2]);
        cells[a * size + b] = cells[b * size + a] = strength;
        most = Math.max(most, pairs[k + 2]);
      }
      title.textContent = opened.kind === "model" ? "Common points" : "Matches";
      note.textContent = `${plural(pairs.length / 3, "pair")}, up to ${count(most)}`;
      canvas.setAttribute("aria-label", `Matrix of ${plural(pairs.length / 3, "matched pair")} among ${plural(images.length, "image")}; the strongest has ${count(most)} ${opened.kind === "model" ? "common points" : "verified matches"}. The same pairs are listed under every image.`);
    }
    draw();
  }

  const draw = perFrame(() => {
    const { opened, selection } = store.state;
    if (!opened || size === 0) return;
    const { context, width } = sharpContext(canvas);
    context.fillStyle = token("--ground");
    context.fillRect(0, 0, width, width);
    const hex = Number.parseInt(token("--accent").slice(1), 16);
    const [r, g, b] = [(hex >> 16) & 255, (hex >> 8) & 255, hex & 255];
    const picture = new ImageData(size, size);
    for (let k = 0; k < cells.length; k += 1) {
      if (cells[k] > 0) picture.data.set([r, g, b, 255 * (0.12 + 0.88 * Math.sqrt(cells[k] / most))], 4 * k);
    }
    const small = new OffscreenCanvas(size, size);
    /** @type {OffscreenCanvasRenderingContext2D} */ (small.getContext("2d")).putImageData(picture, 0, 0);
    context.imageSmoothingEnabled = false;
    context.drawImage(small, 0, 0, width, width);
    if (selection.kind !== "image" && selection.kind !== "pair") return;
    const cell = width / opened.images.length;
    const k = selection.image ?? 0;
    context.fillStyle = token("--text");
    context.globalAlpha = 0.18;
    context.fillRect(0, k * cell, width, Math.max(cell, 1));
    context.fillRect(k * cell, 0, Math.max(cell, 1), width);
    context.globalAlpha = 1;
    if (selection.kind !== "pair" || selection.other === undefined) return;
    context.strokeStyle = token("--text");
    const side = Math.max(cell, 6);
    for (const [x, y] of [[k, selection.other], [selection.other, k]]) context.strokeRect((x + 0.5) * cell - side / 2, (y + 0.5) * cell - side / 2, side, side);
  });

  /** The pair under the pointer. @param {MouseEvent} event */
  const at = (event) => {
    const n = store.state.opened?.images.length ?? 0;
    const box = canvas.getBoundingClientRect();
    const place = (/** @type {number} */ x) => Math.min(n - 1, Math.max(0, Math.floor((x / box.width) * n)));
    return [place(event.clientY - box.top), place(event.clientX - box.left)];
  };
  canvas.addEventListener("click", (event) => {
    const [a, b] = at(event);
    if (a !== b) select(a, b);
  });
  canvas.addEventListener("pointermove", (event) => {
    const { opened } = store.state;
    if (!opened) return;
    const [a, b] = at(event);
    const [name, other] = [opened.images[a], opened.images[b]].map((image) => image?.name.split("/").at(-1));
    let matches = 0;
    for (let k = 0; k < opened.pairs.length; k += 3) {
      if ((opened.pairs[k] === a && opened.pairs[k + 1] === b) || (opened.pairs[k] === b && opened.pairs[k + 1] === a)) matches = opened.pairs[k + 2];
    }
    under.textContent = a === b ? `${name}` : `${name} and ${other}: ${matches > 0 ? count(matches) : "no matches"}`;
  });
  canvas.addEventListener("pointerleave", () => (under.textContent = "\u00a0"));
  store.on(["opened"], index);
  store.on(["selection"], draw);
  new ResizeObserver(() => (size < Math.min(store.state.opened?.images.length ?? 0, resolution()) ? index() : draw())).observe(canvas);
  return { node, redraw: draw };
}
