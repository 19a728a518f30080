// Owns the engine: wasm, files and the GPU device. The page talks to it by messages only.

import init, { Session } from "../vendor/epipole_web.js";
import { findAdapter } from "./adapter.js";
import { decode } from "./decode.js";
import { Pool } from "./pool.js";

/** @typedef {import("./protocol.js").Entry} Entry */

/** @type {InstanceType<typeof Session>} */
let session;
/** @type {ReturnType<InstanceType<typeof Session>["control"]>|null} */
let control = null;
let paused = false;
/** @type {(() => void)|null} */
let goOn = null;

/** Set before the module starts: panics call it. */
Reflect.set(globalThis, "epipolePanicked", (/** @type {string} */ message) => postMessage({ type: "panic", message }));

const channel = new MessageChannel();
/** @type {(() => void)[]} */
const breaths = [];
channel.port1.onmessage = () => {
  const next = breaths.shift();
  if (paused && next) {
    goOn = next;
    postMessage({ type: "paused" });
  } else next?.();
};

/** A task of its own, so that the page's messages get in: a timer would be held up by the browser. */
function breathe() {
  return new Promise((/** @type {(value: void) => void} */ resolve) => {
    breaths.push(() => resolve());
    channel.port2.postMessage(null);
  });
}

function resume() {
  paused = false;
  goOn?.();
  goOn = null;
}

function fresh() {
  session?.free();
  session = new Session();
  control = null;
}

const pool = new Pool();
let mostHelpers = 0;

const host = {
  send, breathe, decode,
  startHelpers: (/** @type {WebAssembly.Module} */ module) => pool.start(module, mostHelpers),
  solvePairs: (/** @type {Float64Array} */ problems) => pool.solve(problems),
  endHelpers: () => pool.end(),
};

/** @param {"solve"|"refine"} what @param {{ settings: Record<string, any>, backend?: "auto"|"gpu"|"cpu", helpers?: number }} command */
async function run(what, { settings, backend = "auto", helpers = navigator.hardwareConcurrency }) {
  paused = false;
  mostHelpers = helpers;
  control = session.control();
  try {
    return await session[what](settings, backend, host);
  } finally {
    control.free();
    control = null;
  }
}

/** @type {Record<string, (command: any) => any>} */
const commands = {
  open({ entries }) {
    fresh();
    const list = /** @type {Entry[]} */ (entries);
    if (/\.(bin|txt)$/i.test(list[0].path)) {
      const folder = list[0].path.split("/").slice(0, -1).join("/") || "model";
      const opened = session.openModel(folder, list.map(({ path }) => path), list.map(({ file }) => file));
      return { ...opened, report: session.modelReport() };
    }
    const wal = list.find(({ path }) => path.endsWith("-wal"));
    return session.openDatabase(list[0].path, list[0].file, wal?.file);
  },
  async pictures({ entries }) {
    for (const { path, file } of /** @type {Entry[]} */ (entries)) session.addPicture(path, file);
    await session.color(host);
  },
  depths({ entries }) {
    for (const { path, file } of /** @type {Entry[]} */ (entries)) session.addDepth(path, file);
  },
  solve: (command) => run("solve", command),
  refine: (command) => run("refine", command),
  snapshot: () => send("snapshot", session.snapshot()),
  keypoints: ({ image }) => session.keypoints(image),
  residuals: ({ image }) => session.residuals(image),
  matches: ({ image, other }) => session.matches(image, other),
  track: ({ point }) => session.track(point),
  export: ({ formats, component, filter, settings }) =>
    session.export(formats, component ?? undefined, { minTrack: filter.minTrack, maxErrorPx: Number.isFinite(filter.maxErrorPx) ? filter.maxErrorPx : undefined }, settings),
  status: async () => ({ memoryBytes: (await started).memory.buffer.byteLength, longestGap: session.longestGap() }),
};

/** @param {string} kind @param {any} value */
function send(kind, value) {
  if (kind === "event") {
    postMessage({ type: "event", event: value });
    return;
  }
  if (kind === "backend") {
    postMessage({ type: "backend", adapter: value });
    return;
  }
  const arrays = Object.values(value).filter((part) => ArrayBuffer.isView(part)).map((part) => part.buffer);
  postMessage({ type: "snapshot", snapshot: value }, { transfer: arrays });
}

/** @param {unknown} error */
function failure(error) {
  if (typeof error === "object" && error !== null && "message" in error && "file" in error) return error;
  const message = error instanceof Error ? error.message : String(error);
  return { file: "the engine", message, hint: "" };
}

const started = init({ module_or_path: new URL("./epipole_web_bg.wasm", import.meta.url) });

addEventListener("message", async ({ data }) => {
  if (data.type === "pause") paused = true;
  else if (data.type === "resume") resume();
  else if (data.type === "stop" || data.type === "cancel") {
    control?.[/** @type {"stop"|"cancel"} */ (data.type)]();
    resume();
  } else {
    try {
      await started;
      postMessage({ id: data.id, value: await commands[data.type](data) });
    } catch (error) {
      postMessage({ id: data.id, failure: failure(error) });
    }
  }
});

started.then(
  async () => {
    fresh();
    postMessage({ type: "ready", adapter: await findAdapter() });
  },
  (error) => postMessage({ type: "panic", message: `the engine could not start: ${error?.message ?? error}` }),
);
