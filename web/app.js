// Puts the page together: panels, engine, files, keys.

import { Engine, Refusal } from "./engine/client.js";
import { fromDrop, fromPicker, fromUrl, sort } from "./files/intake.js";
import { inputsPanel } from "./inputs/panel.js";
import { Pictures } from "./inputs/pictures.js";
import { runPanel } from "./run/panel.js";
import { scenePanel } from "./scene/panel.js";
import { Store } from "./store.js";
import { startDivider } from "./ui/dividers.js";
import { bytes, count, plural } from "./ui/format.js";
import { el } from "./ui/dom.js";
import { addShortcuts, showShortcuts, startShortcuts } from "./ui/shortcuts.js";
import { startTheme } from "./ui/theme.js";

/** @typedef {import("./engine/protocol.js").Entry} Entry */

const byId = (/** @type {string} */ id) => /** @type {HTMLElement} */ (document.getElementById(id));
const store = new Store();
const pictures = new Pictures();
const engine = new Engine((message) => receive(message));
/** @type {import("./engine/protocol.js").Adapter|null} */
let adapter = null;
/** Raised when a newer scene was asked for: what is still on its way from the older one is dropped. */
let scene = 0;

const inputs = inputsPanel(byId("inputs"), store, engine, pictures, { snap: (image) => view.snap(image), pickFiles, pickFolder });
const view = scenePanel(byId("scene"), store, engine, { pickFiles, pickFolder, sample });
const run = runPanel(byId("run"), store, engine, { pickFiles, solve, problem, cancel });
const theme = startTheme(/** @type {HTMLButtonElement} */ (byId("theme")), () => {
  view?.theme();
  inputs?.redraw();
  run?.redraw();
});
startDivider(byId("divider-inputs"), byId("panels"), "inputs");
startDivider(byId("divider-run"), byId("panels"), "run");

/** @param {import("./engine/protocol.js").Failure} failure */
function problem(failure) {
  store.set({ problems: [...store.state.problems, failure] });
  run.journal.add(`${failure.file}: ${failure.message}${failure.hint ? `; ${failure.hint}` : ""}`, "bad");
}

/** @param {unknown} error @param {string} file */
function refuse(error, file) {
  if (error instanceof Refusal) problem(error.failure);
  else problem({ file, message: /** @type {Error} */ (error)?.message ?? String(error), hint: "" });
}

/** @param {import("./engine/protocol.js").Message} message */
function receive(message) {
  if (message.type === "ready") {
    adapter = message.adapter;
    const chip = byId("device");
    const dot = /** @type {HTMLElement} */ (chip.firstElementChild);
    dot.className = `dot ${{ gpu: "good", software: "fair", none: "fair" }[adapter.kind]}`;
    /** @type {HTMLElement} */ (chip.lastElementChild).textContent = adapter.kind === "none" ? "processor" : adapter.name;
    chip.title = adapter.why;
    run.journal.add(adapter.why);
  } else if (message.type === "event") {
    const { event } = message;
    run.stages.event(event);
    if (event.event === "iteration") run.charts.iteration(event);
    else if (event.event === "stage_finished") run.journal.add(event.summary);
    else if (event.event === "warning") run.journal.add(event.message, "fair");
    else if (event.event === "component_finished") run.journal.add(`model ${event.component + 1}: ${plural(event.images, "image")}, ${count(event.points)} points`);
  } else if (message.type === "snapshot") {
    if (store.state.opened === null) return;
    run.charts.errors(message.snapshot.errors);
    view.show(message.snapshot);
  } else if (message.type === "panic") {
    // One that never started would not start the next time either.
    const hint = adapter === null ? "reload the page; a browser of the last two years is needed" : "this is a mistake of ours: copy the report from the log; the page can be used on";
    problem({ file: "the engine", message: message.message, hint });
    if (adapter !== null) engine.restart();
    if (store.state.opened) store.set({ phase: "empty", opened: null });
  }
}

/** @param {() => Promise<Entry[]>} entries */
async function open(entries) {
  const mine = (scene += 1);
  if (["running", "paused", "stopping"].includes(store.state.phase)) engine.restart();
  const before = store.state;
  store.set({ problems: [] });
  let named = "the files";
  try {
    const sorted = await sort(await entries());
    if (mine !== scene) return;
    for (const failure of sorted.refused) problem(failure);
    named = sorted.open[0]?.path ?? named;
    if (sorted.open.length > 0) {
      pictures.clear();
      store.reset();
      store.set({ phase: "opening", problems: before.problems.length > 0 ? store.state.problems : [] });
      for (const failure of sorted.refused) problem(failure);
      byId("title").textContent = `reading ${named}`;
      const opened = await engine.ask({ type: "open", entries: sorted.open });
      if (mine !== scene) return;
      store.set({ opened, phase: "ready" });
      byId("title").textContent = `${opened.name} · ${plural(opened.images.length, "image")} · ${plural(opened.pairs.length / 3, "pair")} · ${bytes(opened.bytes)}`;
      for (const warning of opened.warnings) run.journal.add(warning, "fair");
    }
    const media = [...sorted.pictures, ...sorted.depths];
    if (media.length > 0) await attach(sorted.pictures, sorted.depths);
    else if (sorted.open.length === 0 && sorted.refused.length === 0) problem({ file: named, message: "nothing in it is of use here", hint: "drop a database.db, or a folder that holds one" });
  } catch (error) {
    if (mine !== scene) return;
    refuse(error, named);
    store.set({ phase: store.state.opened ? store.state.phase : "empty" });
    if (!store.state.opened) byId("title").textContent = "";
  }
}

/** @param {Entry[]} photographs @param {Entry[]} depths */
async function attach(photographs, depths) {
  const { opened } = store.state;
  if (!opened) {
    problem({ file: photographs[0]?.path ?? depths[0]?.path, message: "photographs alone cannot be reconstructed yet", hint: "match them with COLMAP (feature_extractor, then exhaustive_matcher) and drop its database.db, with or without them" });
    return;
  }
  const found = pictures.add(photographs, opened.images.map((image) => image.name));
  if (photographs.length > 0 && found === 0) problem({ file: photographs[0].path, message: "none of these photographs is in the database", hint: `it names ${opened.images[0]?.name ?? "none"}, for example` });
  if (found > 0) {
    run.journal.add(`${plural(found, "photograph")} of ${count(opened.images.length)}`);
    await engine.ask({ type: "pictures", entries: [...pictures.files].map(([path, file]) => ({ path, file })) });
  }
  if (depths.length > 0) problem({ file: depths[0].path, message: "depth maps are not used in the tab yet", hint: "the command line takes them: epipole reconstruct --depth-dir" });
  inputs.picturesChanged();
}

/** @param {import("./run/settings.js").Choice} choice */
async function solve(choice) {
  const mine = scene;
  store.set({ phase: "running", report: null, problems: [], selection: { kind: "none" }, component: null });
  run.begin();
  try {
    const report = await engine.ask({ type: "solve", ...choice });
    if (mine !== scene) return;
    store.set({ report, phase: "done" });
    run.end(report.stopped ? `Stopped: ${report.num_registered} of ${report.num_images} images are placed.` : `${report.num_registered} of ${report.num_images} images are placed.`, !report.stopped);
  } catch (error) {
    if (mine !== scene) return;
    if (store.state.opened) {
      refuse(error, store.state.opened.name);
      run.end("", false);
      store.set({ phase: "ready" });
    }
  }
}

/** Gives the solve up: the worker ends at its next breath and the scene is as it was opened. */
function cancel() {
  engine.signal({ type: "cancel" });
}

const filePicker = el("input", { type: "file", multiple: true, class: "hidden", "aria-label": "Files", onchange: () => picked(filePicker) });
const folderPicker = el("input", { type: "file", multiple: true, class: "hidden", "aria-label": "Folder", webkitdirectory: true, onchange: () => picked(folderPicker) });
document.body.append(filePicker, folderPicker);

/** @param {HTMLInputElement} input */
function picked(input) {
  const entries = fromPicker(/** @type {FileList} */ (input.files));
  input.value = "";
  open(async () => entries);
}

function pickFiles() {
  filePicker.click();
}

function pickFolder() {
  folderPicker.click();
}

function sample() {
  open(() => fromUrl(new URL("./vendor/sample.db", import.meta.url).href, showBytes));
}

/** @param {number} done @param {number} total */
function showBytes(done, total) {
  byId("title").textContent = `loading ${bytes(done)}${total >= done && total > 0 ? ` of ${bytes(total)}` : ""}`;
}

let depth = 0;
const dragging = (/** @type {boolean} */ on) => document.body.classList.toggle("dragging", on);
addEventListener("dragenter", (event) => {
  event.preventDefault();
  depth += 1;
  dragging(true);
});
addEventListener("dragleave", () => {
  depth -= 1;
  if (depth <= 0) dragging(false);
});
addEventListener("dragover", (event) => event.preventDefault());
addEventListener("drop", (/** @type {DragEvent} */ event) => {
  event.preventDefault();
  depth = 0;
  dragging(false);
  const transfer = event.dataTransfer;
  if (transfer) {
    const entries = fromDrop(transfer);
    open(() => entries);
  }
});

addShortcuts([
  { keys: ["o"], what: "choose files", run: pickFiles },
  { keys: ["r", "Enter"], what: "reconstruct", run: () => store.state.phase === "ready" && store.state.opened?.kind === "database" && run.solve() },
  { keys: [" "], what: "pause, go on", run: run.togglePause },
  { keys: ["x"], what: "stop and keep", run: () => ["running", "paused"].includes(store.state.phase) && run.stop() },
  { keys: ["d"], what: "download", run: run.download },
  { keys: ["f"], what: "see the whole scene", run: view.frame },
  { keys: ["c"], what: "look through the selected image", run: () => store.state.selection.image !== undefined && view.snap(store.state.selection.image) },
  { keys: ["n", "p"], what: "next, previous image", run: (event) => {
    const n = store.state.opened?.images.length ?? 0;
    const at = store.state.selection.image ?? -1;
    if (n > 0) store.set({ selection: { kind: "image", image: (at + (event.key === "n" ? 1 : n - 1) + n) % n } });
  } },
  { keys: ["t"], what: "theme", run: theme.next },
  { keys: ["Escape"], what: "select nothing", run: () => store.set({ selection: { kind: "none" } }) },
  { keys: ["?"], what: "this list", run: showShortcuts },
]);
startShortcuts();
byId("help").addEventListener("click", showShortcuts);
byId("device").addEventListener("click", () => {
  const dialog = el("dialog", { "aria-labelledby": "device-title", onclose: () => dialog.remove() },
    el("h2", { id: "device-title" }, "Where it computes"), el("p", {}, adapter?.why ?? "The engine is starting."),
    el("div", { class: "actions" }, el("button", { type: "button", onclick: () => dialog.close() }, "Close")));
  document.body.append(dialog);
  dialog.showModal();
});
run.journal.setHeading(() => `Epipole, ${navigator.userAgent}\n${adapter?.why ?? ""}`);

// A scene by address: once a visit, so that a scene that brings the tab down does not do so for ever.
const address = new URLSearchParams(location.search).get("url");
if (address) {
  const guard = `epipole.opening:${address}`;
  if (sessionStorage.getItem(guard)) problem({ file: address, message: "opening it did not end well the last time", hint: "reload once more to try again, or download the file and drop it here" });
  else {
    sessionStorage.setItem(guard, "1");
    open(() => fromUrl(address, showBytes)).finally(() => sessionStorage.removeItem(guard));
  }
  if (sessionStorage.getItem(guard) && store.state.problems.length > 0) sessionStorage.removeItem(guard);
}
