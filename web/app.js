// Puts the page together: panels, engine, files, keys.

import { Engine } from "./engine/client.js";
import { fromUrl, openAddress } from "./files/address.js";
import { inputsPanel } from "./inputs/panel.js";
import { Pictures } from "./inputs/pictures.js";
import { runPanel } from "./run/panel.js";
import { scenePanel } from "./scene/panel.js";
import { Session } from "./session.js";
import { Store } from "./store.js";
import { startDevice } from "./ui/device.js";
import { startDivider } from "./ui/dividers.js";
import { startDropping } from "./ui/dropping.js";
import { bytes, count, plural } from "./ui/format.js";
import { startProblems } from "./ui/problems.js";
import { addShortcuts, showShortcuts, startShortcuts } from "./ui/shortcuts.js";
import { startTheme } from "./ui/theme.js";

const byId = (/** @type {string} */ id) => /** @type {HTMLElement} */ (document.getElementById(id));
const store = new Store();
const pictures = new Pictures();
const engine = new Engine((message) => receive(message));
const device = startDevice(byId("device"));
const { pickFiles, pickFolder } = startDropping((entries, what) => session.open(entries, what));

/** @param {(text: string, done?: number, total?: number) => void} told */
const loaded = (told) => (/** @type {number} */ done, /** @type {number} */ total) => told(`Loading ${bytes(done)}${total >= done && total > 0 ? ` of ${bytes(total)}` : ""}`, done, total);
const sample = () => session.open((signal) => fromUrl(new URL("./sample.db", import.meta.url).href, loaded(view.progress), signal), "the sample");

const view = scenePanel(byId("scene"), store, engine, pictures, {
  pickFiles, pickFolder, sample, solve: () => run.solve(), giveUp: () => session.giveUp(), shown: (figures) => run.shown(figures),
});
const inputs = inputsPanel(byId("inputs"), store, engine, pictures, { snap: view.snap, pickFiles, pickFolder, sample, close: () => session.close() });
const run = runPanel(byId("run"), store, engine, {
  pickFiles, solve: (choice) => session.solve(choice), stop: () => session.stop(), cancel: () => session.cancel(), pause: () => session.togglePause(), problem: (failure) => session.problem(failure),
});
const session = new Session(store, engine, pictures, {
  reading: view.progress, draw: view.show, began: run.begin, ended: run.end, say: run.journal.add, picturesChanged: inputs.picturesChanged, settings: run.useSettings,
  cleared: () => {
    view.clear();
    run.clear();
  },
});
startProblems(byId("scene"), store);
const theme = startTheme(/** @type {HTMLButtonElement} */ (byId("theme")), () => {
  view.theme();
  inputs.redraw();
  run.redraw();
});
startDivider(byId("divider-inputs"), byId("panels"), "inputs");
startDivider(byId("divider-run"), byId("panels"), "run");

/** @param {import("./engine/protocol.js").Message} message */
function receive(message) {
  if (message.type === "ready") {
    device.set(message.adapter);
    run.journal.add(message.adapter.why);
  } else if (message.type === "backend") {
    run.journal.add(message.adapter.why);
    device.running(message.adapter);
  } else if (message.type === "event") {
    const { event } = message;
    run.event(event);
    if (event.event === "stage_finished") run.journal.add(event.summary);
    else if (event.event === "warning" || event.event === "device_lost") run.journal.add(event.message, "fair");
    else if (event.event === "component_finished") run.journal.add(`model ${event.component + 1}: ${plural(event.images, "image")}, ${count(event.points)} points`);
    if (event.event === "device_lost" && event.resumed_on === null) device.running({ kind: "none", name: "processor", why: event.message });
  } else if (message.type === "snapshot") {
    session.snapshot(message.snapshot);
  } else if (message.type === "panic") {
    session.died(message.message, device.started);
  }
}

store.on(["opened", "phase", "reading"], () => {
  const { opened, phase, reading } = store.state;
  byId("title").textContent = opened ? `${opened.name} · ${plural(opened.images.length, "image")} · ${plural(opened.pairs.length / 3, "pair")} · ${bytes(opened.bytes)}` : "";
  document.title = `${{ running: "Solving · ", paused: "Paused · ", stopping: "Stopping · ", done: "Done · ", empty: "", ready: "" }[phase]}${opened ? `${opened.name} · ` : ""}Epipole`;
  document.body.dataset.phase = phase;
  document.body.dataset.reading = String(reading);
});

addShortcuts([
  { keys: ["o"], what: "choose files", run: pickFiles },
  { keys: ["r"], what: "reconstruct", run: () => ["ready", "done"].includes(store.state.phase) && run.solve() },
  { keys: [" "], what: "pause, go on", run: () => session.togglePause() },
  { keys: ["x"], what: "stop and keep", run: () => session.stop() },
  { keys: ["d"], what: "download", run: run.download },
  { keys: [","], what: "settings", run: () => !session.running && run.openSettings() },
  { keys: ["f"], what: "see the whole scene", run: view.frame },
  { keys: ["c"], what: "look through the selected image", run: () => store.state.selection.image !== undefined && view.snap(store.state.selection.image) },
  { keys: ["n", "p"], what: "next, previous image", run: (event) => {
    const [n, next] = [store.state.opened?.images.length ?? 0, /n/i.test(event.key)];
    const at = store.state.selection.image ?? (next ? -1 : n);
    if (n > 0) store.set({ selection: { kind: "image", image: (at + (next ? 1 : n - 1)) % n }, seenBy: [] });
  } },
  { keys: ["t"], what: "theme", run: theme.next },
  { keys: ["Escape"], what: "select nothing", run: () => store.set({ selection: { kind: "none" }, seenBy: [] }) },
  { keys: ["?"], what: "this list", run: showShortcuts },
]);
startShortcuts();
byId("help").addEventListener("click", showShortcuts);
run.journal.setHeading(() => `Epipole, ${navigator.userAgent}\n${device.why}`);
openAddress(session, (signal, address) => fromUrl(address, loaded(view.progress), signal));
