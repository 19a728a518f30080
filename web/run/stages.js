// The list of stages with counts and times, one bar, and one line on what is going on.

import { el, hide } from "../ui/dom.js";
import { count, duration, short } from "../ui/format.js";

/** Stages in order, by the names of the mapper's events. */
export const STAGES = /** @type {const} */ ([
  ["calibrate", "View-graph calibration"],
  ["relative_pose", "Relative poses"],
  ["rotation", "Rotation averaging"],
  ["tracks", "Tracks"],
  ["position", "Global positioning"],
  ["refine", "Bundle adjustment"],
  ["retriangulate", "Retriangulation"],
  ["finish", "Colours and errors"],
]);

/** Share of a run that each stage takes, from the benchmark scenes: what the bar is drawn by. */
const SHARE = { calibrate: 0.03, relative_pose: 0.2, rotation: 0.05, tracks: 0.04, position: 0.14, refine: 0.26, retriangulate: 0.25, finish: 0.03 };

export function stageList() {
  const items = new Map(STAGES.map(([id, name]) => {
    const mark = el("i", { class: "mark" });
    const label = el("span", {}, name);
    const time = el("span", { class: "quiet" });
    return [/** @type {string} */ (id), { node: el("li", { "data-state": "waiting" }, mark, label, time), label, time, name: /** @type {string} */ (name) }];
  }));
  const list = el("ol", { class: "stages", "aria-label": "Stages" }, ...[...items.values()].map(({ node }) => node));
  const bar = el("progress", { max: 1, value: 0, "aria-label": "Progress" });
  const now = el("p", { class: "quiet now", "aria-live": "off" });
  const node = el("div", { class: "block" }, list, bar, now);
  /** @type {Map<string, number>} */
  const spent = new Map();
  let before = 0;
  let within = 0;
  let began = 0;
  let paused = 0;
  let pausedAt = 0;

  /** Stages of this run, and what their shares come to. */
  let shown = STAGES.map(([id]) => id);
  let total = 1;
  const sum = (/** @type {(keyof typeof SHARE)[]} */ ids) => ids.reduce((all, id) => all + SHARE[id], 0);
  const progress = () => Math.min(1, (before + within) / total);

  return {
    node,
    /** @param {string[]} [only] stages that this run has; all, if not given */
    reset(only) {
      for (const [id, { node: item, label, time, name }] of items) {
        hide(item, only !== undefined && !only.includes(id));
        item.dataset.state = "waiting";
        label.textContent = name;
        time.textContent = "";
        item.title = "";
      }
      shown = STAGES.map(([id]) => id).filter((id) => only === undefined || only.includes(id));
      total = sum(shown);
      spent.clear();
      [before, within, began, paused, pausedAt] = [0, 0, performance.now(), 0, 0];
      bar.value = 0;
      now.textContent = "";
      hide(bar, false);
    },
    /** Time in which nothing is done does not count. @param {boolean} on */
    pause(on) {
      if (on && pausedAt === 0) pausedAt = performance.now();
      else if (!on && pausedAt > 0) {
        paused += performance.now() - pausedAt;
        pausedAt = 0;
      }
    },
    /** Seconds so far, and those left as far as the stages so far allow a guess. */
    clock() {
      const elapsed = ((pausedAt > 0 ? pausedAt : performance.now()) - began - paused) / 1000;
      const done = progress();
      return { elapsed, left: done > 0.08 && elapsed > 2 ? (elapsed * (1 - done)) / done : null };
    },
    /** @param {import("../engine/protocol.js").MapperEvent} event */
    event(event) {
      if (!("stage" in event)) return;
      const item = items.get(event.stage);
      if (!item) return;
      const share = SHARE[/** @type {keyof typeof SHARE} */ (event.stage)] ?? 0;
      if (event.event === "stage_started") {
        item.node.dataset.state = "running";
        // Later components go through the same stages again: the bar does not go back.
        before = Math.max(before, sum(shown.slice(0, Math.max(0, shown.findIndex((id) => id === event.stage)))));
        within = 0;
        now.textContent = `${item.name}${event.component > 0 ? ` of model ${event.component + 1}` : ""}`;
        item.time.textContent = "";
      } else if (event.event === "progress") {
        within = event.total > 0 ? share * Math.min(1, event.done / event.total) : 0;
        now.textContent = `${item.name}: ${count(event.done)} of ${count(event.total)}`;
        item.time.textContent = `${count(event.done)} / ${count(event.total)}`;
      } else if (event.event === "iteration") {
        now.textContent = `${item.name}: iteration ${event.iteration} · ${count(event.active_observations)} observations · λ ${short(event.damping)}`;
      } else if (event.event === "stage_finished") {
        item.node.dataset.state = "done";
        item.node.title = event.summary;
        // Every component goes through it: the time of all of them.
        spent.set(event.stage, (spent.get(event.stage) ?? 0) + event.seconds);
        item.time.textContent = duration(spent.get(event.stage) ?? 0);
        within = share;
      }
      bar.value = progress();
    },
    /** @param {string} text @param {boolean} complete */
    finish(text, complete) {
      if (complete) bar.value = 1;
      for (const { node: item } of items.values()) if (item.dataset.state === "running") item.dataset.state = complete ? "done" : "stopped";
      now.textContent = text;
    },
  };
}
