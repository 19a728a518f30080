// Verified matches of every pair as a square picture: loops, gaps and lonely images show at a glance.

import { el, heading, perFrame, sharpContext, token } from "../ui/dom.js";
import { count } from "../ui/format.js";

/** @param {import("../store.js").Store} store @param {(image: number, other: number) => void} select */
export function matchMatrix(store, select) {
  const { node: head, note } = heading("Matches");
  const canvas = el("canvas", { class: "matrix", tabIndex: 0, role: "img" });
  const node = el("div", { class: "block" }, head, canvas);
  /** @type {Map<number, number>} */
  let lookup = new Map();
  let most = 1;

  function index() {
    const { opened } = store.state;
    lookup = new Map();
    most = 1;
    if (!opened) return;
    for (let k = 0; k < opened.pairs.length; k += 3) {
      const [a, b, matches] = opened.pairs.subarray(k, k + 3);
      lookup.set(a * opened.images.length + b, matches);
      most = Math.max(most, matches);
    }
    const pairs = opened.pairs.length / 3;
    note.textContent = `${count(pairs)} pairs · verified matches`;
    canvas.setAttribute("aria-label", `Matrix of ${count(pairs)} matched pairs among ${count(opened.images.length)} images; the strongest has ${count(most)} verified matches`);
    draw();
  }

  const draw = perFrame(() => {
    const { opened, selection } = store.state;
    const { context, width } = sharpContext(canvas);
    context.fillStyle = token("--ground");
    context.fillRect(0, 0, width, width);
    if (!opened || opened.images.length === 0) return;
    const n = opened.images.length;
    const size = width / n;
    const accent = token("--accent");
    context.fillStyle = accent;
    for (const [key, matches] of lookup) {
      const [a, b] = [Math.floor(key / n), key % n];
      context.globalAlpha = 0.12 + 0.88 * Math.sqrt(matches / most);
      const side = Math.max(size, 1);
      context.fillRect(b * size, a * size, side, side);
      context.fillRect(a * size, b * size, side, side);
    }
    context.globalAlpha = 1;
    if (selection.kind === "image" || selection.kind === "pair") {
      context.fillStyle = token("--text");
      context.globalAlpha = 0.35;
      const k = selection.image ?? 0;
      context.fillRect(0, k * size, width, Math.max(size, 1));
      context.fillRect(k * size, 0, Math.max(size, 1), width);
      context.globalAlpha = 1;
    }
  });

  canvas.addEventListener("click", (event) => {
    const n = store.state.opened?.images.length ?? 0;
    const box = canvas.getBoundingClientRect();
    const at = (/** @type {number} */ x) => Math.min(n - 1, Math.max(0, Math.floor((x / box.width) * n)));
    const [a, b] = [at(event.clientY - box.top), at(event.clientX - box.left)];
    if (n > 0 && a !== b) select(a, b);
  });
  canvas.addEventListener("pointermove", (event) => {
    const { opened } = store.state;
    if (!opened) return;
    const n = opened.images.length;
    const box = canvas.getBoundingClientRect();
    const a = Math.min(n - 1, Math.floor(((event.clientY - box.top) / box.height) * n));
    const b = Math.min(n - 1, Math.floor(((event.clientX - box.left) / box.width) * n));
    const matches = lookup.get(Math.min(a, b) * n + Math.max(a, b)) ?? 0;
    canvas.title = a === b ? (opened.images[a]?.name ?? "") : `${opened.images[a]?.name} and ${opened.images[b]?.name}: ${count(matches)} matches`;
  });
  store.on(["opened"], index);
  store.on(["selection"], draw);
  new ResizeObserver(draw).observe(canvas);
  return { node, redraw: draw };
}
