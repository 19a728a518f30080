// Live plots: cost and damping an LM iteration, the histogram of errors, the error of every image. A plot is made once and fed;
// during a solve it is fed a few times a second, so that drawing never holds the page up.

import uPlot from "uplot";
import { el, heading, hide, token } from "../ui/dom.js";
import { count, short } from "../ui/format.js";

const HEIGHT_PX = 116;
/** Between two drawings of the same plot, ms. */
const PACE_MS = 200;
/** Iterations drawn: beyond, every other one goes. */
const MAX_ITERATIONS = 1200;

/** More would run into one another. */
const MOST_MARKS = 4;
const FONT = "11px ui-sans-serif, system-ui, sans-serif";

/** @param {Record<string, any>} [more] */
const axis = (more = {}) => ({ stroke: token("--quiet"), grid: { stroke: token("--line"), width: 1 }, ticks: { show: false }, font: FONT, size: 22, gap: 4, ...more });
/** Values are logarithms to base ten. */
const powers = (/** @type {unknown} */ _, /** @type {number[]} */ values) => values.map((v) => short(10 ** v));
/** Steps between marks of images and iterations, which are whole. */
const COUNTS = [1, 2, 5, 10, 20, 50, 100, 200, 500, 1000, 2000, 5000];
/** Marks of a logarithmic axis: whole powers, else 1, 2 and 5 times them, else the ends of a range too narrow for these. */
const marks = (/** @type {unknown} */ _, /** @type {unknown} */ __, /** @type {number} */ low, /** @type {number} */ high) => {
  const within = [];
  for (let power = Math.floor(low); power <= high; power += 1) {
    for (const at of [0, Math.log10(2), Math.log10(5)]) if (power + at >= low && power + at <= high) within.push(power + at);
  }
  const whole = within.filter(Number.isInteger);
  const found = whole.length > 1 ? whole : within;
  const step = Math.ceil(found.length / MOST_MARKS);
  const inset = 0.06 * (high - low);
  return found.length > 1 ? found.filter((_, k) => k % step === 0) : [low + inset, high - inset];
};

/** One plot in its block. */
class Plot {
  /** @param {string} title @param {string} note @param {() => Record<string, any>} options @param {string} label for readers */
  constructor(title, note, options, label) {
    const head = heading(title, note);
    this.note = head.note;
    this.box = el("div", { class: "plot", role: "img", "aria-label": label });
    this.node = el("div", { class: "block hidden" }, head.node, this.box);
    this.options = options;
    /** @type {uPlot|null} */ this.chart = null;
    /** @type {any[]} */ this.data = [];
    this.timer = 0;
    this.last = -Infinity;
    new ResizeObserver(() => this.chart?.setSize({ width: this.width, height: HEIGHT_PX })).observe(this.node);
  }

  get width() {
    return Math.max(160, this.node.clientWidth || 290);
  }

  /** @param {any[]} data columns; none: nothing to show */
  feed(data) {
    this.data = data;
    const empty = data.length === 0 || data[0].length === 0;
    hide(this.node, empty);
    if (empty) {
      clearTimeout(this.timer);
      this.timer = 0;
    } else if (this.timer === 0) this.timer = window.setTimeout(() => this.draw(), Math.max(0, PACE_MS - (performance.now() - this.last)));
  }

  draw() {
    this.timer = 0;
    this.last = performance.now();
    if (this.chart) this.chart.setData(/** @type {any} */ (this.data));
    else this.chart = new uPlot(/** @type {any} */ ({ width: this.width, height: HEIGHT_PX, padding: [8, 6, 0, 0], legend: { show: false }, ...this.options() }), /** @type {any} */ (this.data), this.box);
  }

  /** In the colours of a new theme. */
  restyle() {
    this.chart?.destroy();
    this.chart = null;
    if (this.data.length > 0) this.draw();
  }

  /** Makes the plot while there is time: the first one costs some ten milliseconds, which a solve should not see. */
  prepare() {
    if (this.chart || (this.data[0]?.length ?? 0) > 0) return;
    const columns = this.options().series.length;
    this.data = Array.from({ length: columns }, () => []);
    this.draw();
  }
}

/** @param {import("../store.js").Store} store @param {(image: number) => void} select */
export function plots(store, select) {
  const cost = new Plot("Cost", "", () => ({
    cursor: { y: false, points: { show: false } },
    scales: { x: { time: false }, y: {}, damping: {} },
    axes: [axis({ incrs: COUNTS }), axis({ size: 42, values: powers, splits: marks }), axis({ scale: "damping", side: 1, size: 42, values: powers, splits: marks, grid: { show: false } })],
    series: [{}, { label: "cost", stroke: token("--accent"), width: 1.8, points: { show: false } },
      { label: "damping", scale: "damping", stroke: token("--fair"), width: 1, dash: [3, 3], points: { show: false } }],
  }), "Cost and damping of every iteration of the stage that runs, on logarithmic axes");
  const bars = (/** @type {string} */ color) => ({ fill: token(color), stroke: token(color), width: 0, paths: uPlot.paths.bars?.({ size: [0.86] }), points: { show: false } });
  const errors = new Plot("Errors", "", () => ({
    cursor: { y: false, points: { show: false } },
    scales: { x: { time: false } },
    axes: [axis({ values: (/** @type {unknown} */ _, /** @type {number[]} */ v) => v.map((x, k) => (k === v.length - 1 ? `${short(x)} px` : short(x))) }), axis({ size: 42, space: 26, values: (/** @type {unknown} */ _, /** @type {number[]} */ v) => v.map((x) => (x >= 10_000 ? `${short(x / 1000)}k` : short(x))) })],
    series: [{}, { label: "points", ...bars("--good") }],
  }), "Histogram of the points' mean reprojection errors");
  const images = new Plot("Per image", "mean px, click to open", () => ({
    cursor: { y: false, points: { show: false } },
    scales: { x: { time: false, range: (/** @type {unknown} */ _, /** @type {number} */ low, /** @type {number} */ high) => [low - 0.5, high + 0.5] }, y: { range: (/** @type {unknown} */ _, /** @type {number} */ __, /** @type {number} */ high) => [0, high > 0 ? high * 1.05 : 1] } },
    axes: [axis({ incrs: COUNTS }), axis({ size: 42, space: 26 })],
    series: [{}, { label: "px", ...bars("--quiet") }, { label: "selected", ...bars("--accent") }],
    hooks: { ready: [(/** @type {uPlot} */ chart) => chart.over.addEventListener("click", () => {
      const at = chart.cursor.idx;
      if (typeof at === "number" && store.state.opened?.images[at]) select(at);
    })] },
  }), "Mean reprojection error of every image");
  const all = [cost, errors, images];
  const node = el("div", {}, ...all.map((plot) => plot.node));
  /** @type {{ iteration: number[], cost: number[], damping: number[] }} */
  let history = { iteration: [], cost: [], damping: [] };
  let stage = "";

  /** Mean errors by image, px; of a camera without observations nothing. @type {(number|null)[]} */
  let values = [];
  function perImage() {
    if (values.every((value) => value === null)) return images.feed([]);
    const { image } = store.state.selection;
    images.feed([values.map((_, k) => k + 1), values.map((value, k) => (k === image ? null : value)), values.map((value, k) => (k === image ? value : null))]);
  }
  store.on(["selection"], perImage);
  store.on(["opened"], () => {
    if (store.state.opened) all.forEach((plot, k) => setTimeout(() => plot.prepare(), 100 + 60 * k));
  });

  return {
    node,
    redraw: () => all.forEach((plot) => plot.restyle()),
    reset() {
      history = { iteration: [], cost: [], damping: [] };
      stage = "";
      cost.feed([]);
      errors.feed([]);
      values = [];
      perImage();
    },
    /** @param {Extract<import("../engine/protocol.js").MapperEvent, { event: "iteration" }>} event @param {string} name of the stage */
    iteration(event, name) {
      // Costs of different stages are in different units: one curve is one stage's.
      if (event.stage !== stage) {
        stage = event.stage;
        history = { iteration: [], cost: [], damping: [] };
      }
      history.iteration.push((history.iteration.at(-1) ?? 0) + 1);
      history.cost.push(Math.log10(Math.max(event.cost, 1e-12)));
      history.damping.push(Math.log10(Math.max(event.damping, 1e-20)));
      if (history.cost.length > MAX_ITERATIONS) for (const column of Object.values(history)) thin(column);
      cost.note.textContent = `${name} · ${short(event.cost)} · λ ${short(event.damping)}`;
      cost.note.title = `${count(event.active_observations)} observations in the system`;
      cost.feed([history.iteration, history.cost, history.damping]);
    },
    /** What the scene shows now. @param {import("../scene/panel.js").Shown} figures */
    shown({ histogram, cameraImage, cameraErrors }) {
      if (histogram) {
        errors.note.textContent = `of points, median ${short(histogram.median)} px`;
        errors.feed([histogram.bins, histogram.counts]);
      }
      // In the middle of a step nobody knows errors: what was known last stands.
      if (!cameraErrors.some((error) => error >= 0)) return;
      values = new Array(store.state.opened?.images.length ?? 0).fill(null);
      cameraImage.forEach((image, k) => (values[image] = cameraErrors[k] >= 0 ? cameraErrors[k] : null));
      perImage();
    },
  };
}

/** Drops every other value but keeps the last. @param {number[]} column */
function thin(column) {
  const kept = column.filter((_, k) => k % 2 === 0 || k === column.length - 1);
  column.splice(0, column.length, ...kept);
}
