// The grid of photographs with their state. Only what is in sight is drawn: scenes have thousands of images.

import { el, sharpContext, token } from "../ui/dom.js";
import { median, standing } from "./reasons.js";

const LABEL = { pending: "not solved yet", placed: "placed", weak: "weak", missing: "not placed" };
const DOT = { pending: "", placed: "good", weak: "fair", missing: "bad" };

/**
 * @param {import("../store.js").Store} store @param {import("./pictures.js").Pictures} pictures
 * @param {{ select: (image: number) => void, snap: (image: number) => void }} on
 */
export function thumbnails(store, pictures, on) {
  const grid = el("div", { class: "thumbnails", role: "listbox", "aria-label": "Images" });
  const seen = new IntersectionObserver((entries) => {
    for (const { target, isIntersecting } of entries) if (isIntersecting) draw(/** @type {HTMLElement} */ (target));
  }, { rootMargin: "200px" });

  /** @param {HTMLElement} cell */
  async function draw(cell) {
    const name = cell.dataset.name ?? "";
    const bitmap = await pictures.thumbnail(name);
    const canvas = /** @type {HTMLCanvasElement} */ (cell.querySelector("canvas"));
    if (!canvas.isConnected) return;
    const { context, width, height } = sharpContext(canvas);
    if (bitmap) {
      const fill = Math.max(width / bitmap.width, height / bitmap.height);
      context.drawImage(bitmap, (width - bitmap.width * fill) / 2, (height - bitmap.height * fill) / 2, bitmap.width * fill, bitmap.height * fill);
    } else {
      context.fillStyle = token("--quiet");
      context.font = "11px system-ui, sans-serif";
      context.textAlign = "center";
      context.textBaseline = "middle";
      const base = name.split("/").at(-1)?.replace(/\.[^.]+$/, "") ?? name;
      context.fillText(base.length > 11 ? `…${base.slice(-10)}` : base, width / 2, height / 2, width - 6);
    }
  }

  function build() {
    const images = store.state.opened?.images ?? [];
    seen.disconnect();
    grid.replaceChildren(...images.map((image, k) => {
      const cell = el("button", {
        type: "button", class: "thumbnail", role: "option", "data-name": image.name, tabIndex: k === 0 ? 0 : -1,
        onclick: () => on.select(k), ondblclick: () => on.snap(k),
      }, el("canvas", { "aria-hidden": "true" }), el("i", { class: "dot" }));
      seen.observe(cell);
      return cell;
    }));
    mark();
  }

  function mark() {
    const { opened, report, selection, imageFilter } = store.state;
    const middle = median((report?.images ?? []).map((image) => image.mean_reprojection_error_px));
    [...grid.children].forEach((node, k) => {
      const cell = /** @type {HTMLElement} */ (node);
      const image = opened?.images[k];
      const is = standing(report?.images[k], middle);
      cell.title = `${image?.name}\n${LABEL[is.standing]}${is.why ? `: ${is.why}` : ""}`;
      cell.setAttribute("aria-label", `${image?.name}, ${LABEL[is.standing]}${is.why ? `, ${is.why}` : ""}`);
      const isSelected = (selection.kind === "image" || selection.kind === "pair") && selection.image === k;
      cell.setAttribute("aria-selected", String(isSelected));
      cell.classList.toggle("partner", selection.kind === "pair" && selection.other === k);
      cell.classList.toggle("hidden", imageFilter !== "all" && is.standing !== imageFilter);
      /** @type {HTMLElement} */ (cell.querySelector(".dot")).className = `dot ${DOT[is.standing]}`;
    });
  }

  grid.addEventListener("keydown", (event) => {
    const columns = getComputedStyle(grid).gridTemplateColumns.split(" ").length;
    const step = { ArrowLeft: -1, ArrowRight: 1, ArrowUp: -columns, ArrowDown: columns }[event.key];
    if (step === undefined) return;
    event.preventDefault();
    event.stopPropagation();
    const cells = /** @type {HTMLElement[]} */ ([...grid.children].filter((cell) => !cell.classList.contains("hidden")));
    const at = cells.indexOf(/** @type {HTMLElement} */ (document.activeElement));
    cells[Math.min(Math.max(at + step, 0), cells.length - 1)]?.focus();
  });

  store.on(["opened"], build);
  store.on(["report", "selection", "imageFilter"], mark);
  return { node: grid, redraw: () => [...grid.children].forEach((cell) => { seen.unobserve(cell); seen.observe(cell); }) };
}
