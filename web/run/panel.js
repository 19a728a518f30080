// The right panel: what to do, how far it is, how well it goes.

import { el, heading, hide } from "../ui/dom.js";
import { bytes, duration } from "../ui/format.js";
import { exportDialog } from "./export.js";
import { imageTable } from "./image-table.js";
import { log } from "./log.js";
import { plots } from "./plots.js";
import { defaults, editSettings } from "./settings.js";
import { stageList } from "./stages.js";

/**
 * @param {HTMLElement} panel @param {import("../store.js").Store} store @param {import("../engine/client.js").Engine} engine
 * @param {{ pickFiles: () => void, solve: (choice: import("./settings.js").Choice) => void, problem: (failure: import("../engine/protocol.js").Failure) => void, cancel: () => void }} on
 */
export function runPanel(panel, store, engine, on) {
  const { node: head, note } = heading("Run");
  const stages = stageList();
  const charts = plots(store, (image) => store.set({ selection: { kind: "image", image } }));
  const journal = log();
  const table = imageTable(store, (image) => store.set({ selection: { kind: "image", image } }));
  let choice = defaults();
  let pausedAt = 0;

  const memory = el("p", { class: "quiet hidden" });
  const main = el("button", { type: "button", class: "main" });
  const pause = el("button", { type: "button" }, "Pause");
  const second = el("button", { type: "button" });
  const settings = el("button", { type: "button", onclick: () => editSettings(choice, (next) => (choice = next)) }, "Settings");
  const footer = el("div", { class: "actions-bar" }, main, second, pause, settings);
  panel.append(el("div", { class: "run-scroll" }, el("div", { class: "pad" }, head, memory, stages.node, charts.node, table.node, journal.node)), footer);

  const solve = () => on.solve(choice);
  const stop = () => {
    store.set({ phase: "stopping" });
    engine.signal({ type: "stop" });
  };
  const togglePause = () => {
    if (store.state.phase === "running") {
      pausedAt = performance.now();
      store.set({ phase: "paused" });
      engine.signal({ type: "pause" });
    } else if (store.state.phase === "paused") {
      stages.waited(performance.now() - pausedAt);
      store.set({ phase: "running" });
      engine.signal({ type: "resume" });
    }
  };
  pause.addEventListener("click", togglePause);

  /** The main action changes with the state. */
  function actions() {
    const { phase, opened, report } = store.state;
    const canSolve = opened?.kind === "database";
    /** @type {[string, (() => void)|null]} */
    const [label, act] = phase === "empty" ? ["Choose files", on.pickFiles]
      : phase === "opening" ? ["Reading…", null]
      : phase === "ready" ? (canSolve ? ["Reconstruct", solve] : ["Download model", () => openExport()])
      : phase === "stopping" ? ["Stopping…", null]
      : phase === "done" ? ["Download model", () => openExport()]
      : ["Stop and keep", stop];
    main.textContent = label;
    main.disabled = act === null;
    main.onclick = act;
    const going = phase === "running" || phase === "paused" || phase === "stopping";
    hide(pause, !going || phase === "stopping");
    pause.textContent = phase === "paused" ? "Go on" : "Pause";
    hide(second, !(going || (phase === "done" && canSolve)));
    second.textContent = going ? "Cancel" : "Solve again";
    second.onclick = going ? on.cancel : solve;
    hide(settings, going || phase === "opening");
    hide(stages.node, !(going || report !== null));
    hide(memory, !(phase === "ready" && opened));
    if (opened) memory.textContent = `${bytes(opened.bytes)} read; a solve will need about ${bytes(opened.predictedBytes)} of memory.`;
  }

  function openExport() {
    exportDialog(store, engine, { ...choice.settings, backend: choice.backend }, on.problem);
  }

  setInterval(() => {
    if (store.state.phase !== "running" && store.state.phase !== "stopping") return;
    const { elapsed, left } = stages.clock();
    note.textContent = `${duration(elapsed)}${left !== null ? ` · about ${duration(Math.max(left, 1))} left` : ""}`;
  }, 250);

  store.on(["phase", "opened", "report"], actions);
  store.on(["opened"], () => {
    note.textContent = "";
    charts.reset();
  });
  actions();
  return {
    journal, charts, stages, solve, stop, togglePause,
    redraw: charts.draw,
    begin() {
      stages.reset();
      charts.reset();
      note.textContent = "";
    },
    /** @param {string} text @param {boolean} complete */
    end(text, complete) {
      const { elapsed } = stages.clock();
      stages.finish(text, complete);
      note.textContent = duration(elapsed);
    },
    download: () => {
      if (store.state.phase === "done" || store.state.opened?.kind === "model") openExport();
    },
  };
}
