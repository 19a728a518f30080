// Live plots: cost and damping an LM iteration, the histogram of errors, the error of every image.

import uPlot from "../vendor/uPlot.esm.js";
import { el, heading, hide, perFrame, token } from "../ui/dom.js";
import { count, short } from "../ui/format.js";

const HEIGHT = 120;
const BINS = 40;

/** @param {import("../store.js").Store} store @param {(image: number) => void} select */
export function plots(store, select) {
  const cost = heading("Cost", "per LM iteration");
  const costBox = el("div", { class: "plot" });
  const errors = heading("Reprojection error", "points, px");
  const errorBox = el("div", { class: "plot" });
  const images = heading("Per image", "mean px, click to open");
  const imageBox = el("div", { class: "plot" });
  const costBlock = el("div", { class: "block hidden" }, cost.node, costBox);
  const errorBlock = el("div", { class: "block hidden" }, errors.node, errorBox);
  const imageBlock = el("div", { class: "block hidden" }, images.node, imageBox);
  const node = el("div", {}, costBlock, errorBlock, imageBlock);
  /** @type {{ cost: number[], damping: number[], active: number[] }} */
  let history = { cost: [], damping: [], active: [] };
  /** @type {number[][]} */ let histogram = [[], []];
  /** @type {uPlot[]} */
  let charts = [];
  let stage = "";

  const axis = (/** @type {Record<string, any>} */ more = {}) => ({
    stroke: token("--quiet"), grid: { stroke: token("--line"), width: 1 }, ticks: { show: false },
    font: "11px system-ui, sans-serif", size: 34, gap: 3, ...more,
  });
  const width = () => Math.max(180, costBox.clientWidth || 290);
  /** @param {HTMLElement} box @param {Record<string, any>} options @param {any} data */
  const chart = (box, options, data) => {
    box.replaceChildren();
    const made = new uPlot(/** @type {any} */ ({ width: width(), height: HEIGHT, legend: { show: false }, cursor: { y: false, points: { show: false } }, ...options }), data, box);
    charts.push(made);
    return made;
  };

  const draw = perFrame(() => {
    for (const old of charts) old.destroy();
    charts = [];
    hide(costBlock, history.cost.length === 0);
    hide(errorBlock, histogram[0].length === 0);
    const report = store.state.report;
    hide(imageBlock, !report);
    if (history.cost.length > 0) {
      const latest = history.cost.length - 1;
      cost.note.textContent = `${short(history.cost[latest])} · λ ${short(history.damping[latest])} · ${count(history.active[latest])} obs`;
      const log = (/** @type {any} */ _, /** @type {number[]} */ values) => values.map((v) => (v === null ? "" : short(v)));
      chart(costBox, {
        scales: { x: { time: false }, y: { distr: 3 }, damping: { distr: 3 } },
        axes: [axis({ label: "iteration", labelSize: 14, labelFont: "11px system-ui, sans-serif" }), axis({ values: log }), axis({ scale: "damping", side: 1, values: log, grid: { show: false } })],
        series: [{}, { label: "cost", stroke: token("--accent"), width: 1.6, points: { show: false } }, { label: "damping", scale: "damping", stroke: token("--fair"), width: 1, dash: [3, 3], points: { show: false } }],
      }, [history.cost.map((_, k) => k + 1), history.cost.map((c) => Math.max(c, 1e-12)), history.damping]);
    }
    if (histogram[0].length > 0) {
      chart(errorBox, {
        scales: { x: { time: false } },
        axes: [axis(), axis({ size: 40 })],
        series: [{}, { label: "points", fill: token("--good"), stroke: token("--good"), paths: uPlot.paths.bars?.({ size: [0.9] }), points: { show: false } }],
      }, histogram);
    }
    if (report) {
      const values = report.images.map((image) => image.mean_reprojection_error_px);
      const bars = chart(imageBox, {
        scales: { x: { time: false } },
        axes: [axis({ label: "image", labelSize: 14, labelFont: "11px system-ui, sans-serif" }), axis()],
        series: [{}, { label: "px", fill: token("--quiet"), stroke: token("--quiet"), paths: uPlot.paths.bars?.({ size: [0.9] }), points: { show: false } }],
      }, [values.map((_, k) => k + 1), values]);
      bars.over.addEventListener("click", () => {
        const at = bars.cursor.idx;
        if (at !== null && at !== undefined && report.images[at]) select(at);
      });
    }
  });
  new ResizeObserver(draw).observe(node);
  store.on(["report"], draw);

  return {
    node,
    draw,
    reset() {
      history = { cost: [], damping: [], active: [] };
      histogram = [[], []];
      stage = "";
      draw();
    },
    /** @param {Extract<import("../engine/protocol.js").MapperEvent, { event: "iteration" }>} event */
    iteration(event) {
      // Costs of different stages are in different units: one curve is one stage's.
      if (event.stage !== stage) {
        stage = event.stage;
        history = { cost: [], damping: [], active: [] };
      }
      history.cost.push(event.cost);
      history.damping.push(event.damping);
      history.active.push(event.active_observations);
      draw();
    },
    /** @param {Float32Array} pointErrors px, negative: unknown */
    errors(pointErrors) {
      const known = pointErrors.filter((error) => error >= 0);
      if (known.length === 0) return;
      const sorted = known.slice().sort();
      const limit = Math.max(0.25, sorted[Math.floor(0.99 * (sorted.length - 1))]);
      const bins = new Array(BINS).fill(0);
      for (const error of known) bins[Math.min(BINS - 1, Math.floor((error / limit) * BINS))] += 1;
      histogram = [bins.map((_, k) => ((k + 0.5) / BINS) * limit), bins];
      errors.note.textContent = `median ${short(sorted[sorted.length >> 1])} px`;
      draw();
    },
  };
}
