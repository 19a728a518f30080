// The middle panel: the scene, what is known of it, and how it is looked at.

import { el, hide, token } from "../ui/dom.js";
import { count, pixels, plural } from "../ui/format.js";
import { ramp } from "./colors.js";
import { startControls } from "./controls.js";
import { inspector } from "./inspector.js";
import { startCards } from "./start.js";
import { toolbar } from "./toolbar.js";
import { View } from "./view.js";

/** A photograph in the scene is as wide as this, px. */
const PHOTO_PX = 768;

/**
 * @typedef {object} Shown
 * @property {number} shown points that pass the filter @property {number} points @property {number} cameras
 * @property {Uint32Array} cameraImage @property {Float32Array} cameraErrors mean px, −1 unknown
 * @property {import("./colors.js").Legend} legend @property {import("./summary.js").Histogram|null} histogram
 */

/**
 * @param {HTMLElement} panel @param {import("../store.js").Store} store @param {import("../engine/client.js").Engine} engine
 * @param {import("../inputs/pictures.js").Pictures} pictures
 * @param {{ pickFiles: () => void, pickFolder: () => void, sample: () => void, solve: () => void, giveUp: () => void, shown: (figures: Shown) => void }} on
 */
export function scenePanel(panel, store, engine, pictures, on) {
  const canvas = el("canvas", { class: "view", tabIndex: 0, role: "application", "aria-roledescription": "3-D scene", "aria-label": "Scene: arrow keys orbit, W A S D Q E fly, plus and minus zoom" });
  const facts = el("div", { class: "facts", role: "status" });
  const legend = el("div", { class: "legend hidden" });
  const unavailable = el("p", { class: "notice bad hidden" });

  const look = (/** @type {Record<string, any>} */ change) => view.send({ type: "look", look: change });
  const tools = toolbar(store, look, { frame: () => view.send({ type: "frame" }), projection: (orthographic) => view.send({ type: "projection", orthographic }) });
  const view = new View(canvas, tools.node, {
    shown: (figures) => {
      last = figures;
      describe();
      drawLegend();
      on.shown(figures);
    },
    unavailable: (message) => {
      unavailable.textContent = message;
      hide(unavailable, false);
    },
  });
  /** @type {Shown|null} */
  let last = null;
  const point = inspector(store, engine, pictures, (seenBy) => {
    store.set({ seenBy });
    highlight();
  });
  const cards = startCards(store, { ...on, leave: () => canvas.focus({ preventScroll: true }) });
  panel.append(canvas, cards.node, facts, legend, unavailable, point.node, tools.node, cards.reading);

  startControls(canvas, view, {
    click: async (x, y) => {
      const hit = await view.pick(x, y);
      if (hit.image !== null) store.set({ selection: { kind: "image", image: hit.image }, seenBy: [] });
      else if (hit.point !== null) store.set({ selection: { kind: "point", point: hit.point }, seenBy: [] });
      else store.set({ selection: { kind: "none" }, seenBy: [] });
    },
    doubleClick: async (x, y) => {
      const hit = await view.pick(x, y);
      if (hit.image !== null) view.send({ type: "snap", image: hit.image });
      else if (hit.point !== null) view.send({ type: "goTo", point: hit.point });
    },
  });

  function describe() {
    const { report, opened } = store.state;
    if (!opened || !last || last.cameras + last.points === 0) {
      facts.replaceChildren();
      return;
    }
    const parts = [plural(last.points, "point"), plural(last.cameras, "camera")];
    const observations = report?.components.reduce((sum, c) => sum + c.observations, 0) ?? 0;
    if (report && observations > 0) parts.push(pixels(report.components.reduce((sum, c) => sum + c.mean_reprojection_error_px * c.observations, 0) / observations));
    const lines = [el("div", {}, el("b", {}, parts.join(" · ")), last.shown < last.points ? el("span", { class: "quiet" }, ` · ${count(last.shown)} shown`) : "")];
    for (const { metric } of /** @type {{ metric?: Metric|null }[]} */ (report?.components ?? [])) if (metric) lines.push(el("div", { class: "quiet" }, metricLine(metric)));
    facts.replaceChildren(...lines);
  }

  function drawLegend() {
    const scale = last?.legend ?? null;
    hide(legend, scale === null || (last?.points ?? 0) === 0);
    if (!scale) return;
    const bar = el("span", { class: "bar-of-colour" });
    bar.style.background = `linear-gradient(90deg, ${[0, 1 / 3, 2 / 3, 1].map((t) => `rgb(${ramp(t).map(Math.round).join(" ")})`).join(", ")})`;
    legend.replaceChildren(el("span", {}, scale.label), bar, el("span", { class: "ends" }, el("span", {}, scale.low), el("span", {}, scale.high)));
  }

  /** Selection of the page → what is lit in the scene. */
  function highlight() {
    const { selection, seenBy } = store.state;
    view.send({ type: "select", image: selection.image, partner: selection.kind === "pair" ? selection.other : undefined, point: selection.kind === "point" ? selection.point : undefined, seenBy });
    hang();
  }

  /** The photograph of the selected image goes to its camera, where there is one. */
  async function hang() {
    const { selection, opened, placed } = store.state;
    const { image } = selection;
    if (image === undefined || image === hung || !opened || !placed.has(image)) return;
    const picture = await pictures.picture(opened.images[image].name, PHOTO_PX);
    if (!picture) return;
    if (store.state.selection.image === image && store.state.opened === opened) {
      hung = image;
      view.send({ type: "photo", image, picture }, [picture]);
    } else picture.close();
  }
  /** The image whose photograph the scene holds. */
  let hung = -1;

  function theme() {
    const rgb = (/** @type {string} */ name) => {
      const hex = Number.parseInt(token(name).slice(1), 16);
      return [(hex >> 16) & 255, (hex >> 8) & 255, hex & 255];
    };
    look({
      background: rgb("--ground").map((x) => x / 255), frustumColor: rgb("--frustum"), accent: rgb("--accent"), plain: rgb("--point"),
      still: matchMedia("(prefers-reduced-motion: reduce)").matches,
    });
    cards.redraw();
  }

  store.on(["selection"], highlight);
  store.on(["pictures", "placed"], hang);
  store.on(["report"], describe);
  store.on(["filter", "component"], () => look({ filter: store.state.filter, component: store.state.component }));
  store.on(["phase", "opened", "placed"], () => hide(tools.node, store.state.opened === null || !cards.node.classList.contains("hidden")));
  function clear() {
    hung = -1;
    view.clear();
    last = null;
    describe();
    drawLegend();
  }
  theme();
  return {
    theme, clear,
    progress: cards.progress,
    snap: (/** @type {number} */ image) => {
      view.send({ type: "snap", image });
      // Where the panels are stacked it may be out of sight.
      panel.scrollIntoView({ block: "nearest" });
    },
    frame: () => view.send({ type: "frame" }),
    /** @param {import("../engine/protocol.js").Snapshot} snapshot its arrays move to the worker that draws */
    show: (snapshot) => view.show(snapshot),
  };
}

/** @typedef {{ unit: string, scale_relative_sigma: number, maps: number }} Metric what depth maps made of the scale, as the report has it */

/** @param {Metric} metric */
function metricLine({ unit, scale_relative_sigma: sigma, maps }) {
  return `in metres (${unit}), scale ± ${(100 * sigma).toFixed(2)} % from ${plural(maps, "depth map")}`;
}
