// The right panel: what to do, how far it is, how well it goes.

import { el, heading, hide } from "../ui/dom.js";
import { bytes, duration } from "../ui/format.js";
import { exportDialog } from "./export.js";
import { imageTable } from "./image-table.js";
import { log } from "./log.js";
import { plots } from "./plots.js";
import { defaults, describe, editSettings } from "./settings.js";
import { STAGES, stageList } from "./stages.js";

const NAMES = new Map(/** @type {[string, string][]} */ (/** @type {unknown} */ (STAGES)));

/**
 * @param {HTMLElement} panel @param {import("../store.js").Store} store @param {import("../engine/client.js").Engine} engine
 * @param {{ pickFiles: () => void, solve: (choice: import("./settings.js").Choice) => void, stop: () => void, cancel: () => void, pause: () => void, problem: (failure: import("../engine/protocol.js").Failure) => void }} on
 */
export function runPanel(panel, store, engine, on) {
  const { node: head, note } = heading("Run");
  const stages = stageList();
  const select = (/** @type {number} */ image) => store.set({ selection: { kind: "image", image }, seenBy: [] });
  const charts = plots(store, select);
  const journal = log();
  const table = imageTable(store, select);
  let choice = defaults();

  const advice = el("p", { class: "quiet" });
  const choiceText = el("span", { class: "quiet" });
  const main = el("button", { type: "button", class: "main" });
  const pause = el("button", { type: "button", onclick: on.pause }, "Pause");
  const second = el("button", { type: "button" });
  const settings = el("button", { type: "button", class: "link", title: "Settings (,)", onclick: () => openSettings() }, "Settings");
  const chosen = el("div", { class: "chosen" }, choiceText, settings);
  const footer = el("div", { class: "actions-bar" }, main, second, pause);
  panel.append(el("div", { class: "run-scroll", tabIndex: 0, role: "group", "aria-label": "Progress and plots" }, el("div", { class: "pad" }, head, advice, chosen, stages.node, charts.node, table.node, journal.node)), footer);

  const solve = () => on.solve(choice);

  /** The main action changes with the state. */
  function actions() {
    const { phase, opened, reading } = store.state;
    const canSolve = opened?.kind === "database";
    const focused = footer.contains(document.activeElement);
    /** @type {[string, (() => void)|null]} */
    const [label, act] = phase === "empty" ? (reading ? ["Reading…", null] : ["Choose files", on.pickFiles])
      : phase === "ready" ? (canSolve ? ["Reconstruct", solve] : ["Download model", openExport])
      : phase === "stopping" ? ["Stopping…", null]
      : phase === "done" ? ["Download model", openExport]
      : ["Stop and keep", on.stop];
    main.textContent = label;
    main.disabled = act === null;
    main.onclick = act;
    const going = phase === "running" || phase === "paused";
    hide(pause, !going);
    pause.textContent = phase === "paused" ? "Go on" : "Pause";
    hide(second, !(going || phase === "done" || (phase === "ready" && opened !== null && !canSolve)));
    second.textContent = going ? "Cancel" : canSolve ? "Solve again" : phase === "done" ? "Refine again" : "Refine";
    second.onclick = going ? on.cancel : solve;
    hide(stages.node, !(going || phase === "stopping" || phase === "done"));
    hide(advice, going || phase === "stopping" || phase === "done");
    hide(chosen, !(phase === "empty" || phase === "ready" || phase === "done"));
    if (opened) {
      advice.textContent = canSolve ? `${bytes(opened.bytes)} opened. Solving takes about ${bytes(opened.predictedBytes)} of memory and happens in this tab.`
        : `A finished model of ${bytes(opened.bytes)}: look at it, refine it (one bundle adjustment), filter it, download it in another format.`;
    } else advice.textContent = "Stages, plots and the model to download appear here.";
    choiceText.textContent = describe(choice);
    // The button just pressed means something else now: a second press must not undo what the first began.
    if (focused) (going ? pause : main).focus();
    stages.pause(phase === "paused");
    tick();
  }

  function openExport() {
    exportDialog(store, engine, { ...choice.settings, backend: choice.backend }, on.problem);
  }

  function openSettings() {
    editSettings(choice, (next) => {
      choice = next;
      actions();
    });
  }

  function tick() {
    const { phase } = store.state;
    if (phase !== "running" && phase !== "stopping" && phase !== "paused") return;
    const { elapsed, left } = stages.clock();
    const text = phase === "paused" ? `paused at ${duration(elapsed)}` : `${duration(elapsed)}${left !== null ? ` · about ${duration(Math.max(left, 1))} left` : ""}`;
    if (note.textContent !== text) note.textContent = text;
  }
  setInterval(tick, 500);

  store.on(["phase", "opened", "report", "reading"], actions);
  store.on(["opened"], () => {
    note.textContent = "";
    stages.reset();
    charts.reset();
  });
  actions();
  return {
    journal, solve, openSettings,
    /** @param {Record<string, any>} settings from a file */
    useSettings(settings) {
      const { backend = choice.backend, ...rest } = settings;
      choice = { settings: rest, backend };
      journal.add(`settings taken over: ${describe(choice)}`);
      actions();
    },
    redraw: charts.redraw,
    /** @param {import("../engine/protocol.js").MapperEvent} event */
    event(event) {
      stages.event(event);
      if (event.event === "iteration") charts.iteration(event, (NAMES.get(event.stage) ?? event.stage).toLowerCase());
    },
    shown: charts.shown,
    /** @param {boolean} isModel refined, not solved */
    begin(isModel) {
      stages.reset(isModel ? ["refine"] : undefined);
      charts.reset();
      note.textContent = "";
    },
    /** @param {string} text @param {boolean} complete */
    end(text, complete) {
      const { elapsed } = stages.clock();
      stages.finish(text, complete);
      note.textContent = duration(elapsed);
    },
    /** Nothing of a run that was given up stays. */
    clear() {
      charts.reset();
      note.textContent = "";
    },
    download: () => {
      if (store.state.phase === "done" || (store.state.phase === "ready" && store.state.opened?.kind === "model")) openExport();
    },
  };
}
