// The page in headless Chromium, for the specs: served and started by `cargo xtask browser`, driven by playwright-core.

import { execFileSync } from "node:child_process";
import { existsSync, mkdirSync, rmSync } from "node:fs";
import { join } from "node:path";
import { chromium } from "../../web/node_modules/playwright-core/index.mjs";
import { unpack } from "./archive.mjs";

/** @typedef {import("../../web/node_modules/playwright-core/index.js").Page} Page */

/** WebGPU and WebGL on SwiftShader, canvases that can be photographed (source: shared/toolchain.md). */
const WITH_GPU = [
  "--use-angle=swiftshader", "--enable-unsafe-swiftshader", "--enable-unsafe-webgpu", "--ignore-gpu-blocklist", "--enable-gpu",
  "--enable-features=Vulkan", "--use-vulkan=swiftshader",
];
/** The same with a WebGPU that offers no adapter. */
const WITHOUT_GPU = ["--use-angle=swiftshader", "--enable-unsafe-swiftshader", "--disable-features=WebGPU"];
const COMMON = [
  "--no-sandbox", "--disable-quic", "--no-first-run", "--disable-background-networking", "--disable-component-update", "--disable-sync",
];

const need = (/** @type {string} */ name) => process.env[name] ?? (() => { throw new Error(`${name} is not set: run the specs with \`cargo xtask browser\``); })();
export const url = need("EPIPOLE_PAGE");
/** Where pictures, downloads and made scenes go. */
export const out = need("EPIPOLE_OUT");
/** The real scenes, or nothing. @type {string|undefined} */
export const shared = process.env.EPIPOLE_SHARED;
export const fixtures = new URL("../fixtures", import.meta.url).pathname;
mkdirSync(out, { recursive: true });

/**
 * A browser with one page on it. `complaints` is everything that the page said to the console as an error: nothing it says
 * there is without meaning.
 * With `gpu` there is WebGPU on SwiftShader; without it WebGPU offers no adapter, or is `"missing"`, as in older browsers.
 * @param {{ gpu?: boolean|"missing", width?: number, height?: number, theme?: "dark"|"light", query?: string, still?: boolean, touch?: boolean }} [options]
 */
export async function open({ gpu = false, width = 1440, height = 880, theme = "dark", query = "", still = false, touch = false } = {}) {
  const browser = await chromium.launch({
    executablePath: process.env.EPIPOLE_CHROMIUM ?? "/usr/bin/chromium",
    args: [...COMMON, ...(gpu === true ? WITH_GPU : WITHOUT_GPU)],
  });
  try {
    const page = await browser.newPage({ viewport: { width, height }, colorScheme: theme, reducedMotion: still ? "reduce" : "no-preference", hasTouch: touch, isMobile: touch, deviceScaleFactor: touch ? 2 : 1 });
    /** @type {string[]} */
    const complaints = [];
    page.on("console", (message) => message.type() === "error" && complaints.push(message.text()));
    page.on("pageerror", (error) => complaints.push(String(error)));
    await page.addInitScript(watch);
    if (gpu === "missing") {
      await page.route("**/web/engine-worker.js", async (route) => {
        const response = await route.fetch();
        await route.fulfill({ response, body: `delete WorkerNavigator.prototype.gpu;\n${await response.text()}` });
      });
    }
    const start = Date.now();
    await page.goto(url + query);
    const loadedMs = Date.now() - start;
    await page.waitForFunction(() => globalThis.watched.engineReady !== null, undefined, { timeout: 20_000 });
    return { browser, page, complaints, loadedMs, readyMs: Date.now() - start };
  } catch (error) {
    // An open browser would keep the spec from ending.
    await browser.close();
    throw error;
  }
}

/** In the page, before its own scripts: long tasks of its thread, and what its workers say and when. */
function watch() {
  /** Engines that are alive, the newest last: the page opens the next scene beside the one that is there. */
  const engines = [];
  const watched = { longTasks: [], messages: [], workers: [], engineReady: null, engines, get engine() { return engines.at(-1) ?? null; } };
  Reflect.set(globalThis, "watched", watched);
  new PerformanceObserver((list) => watched.longTasks.push(...list.getEntries().map(({ startTime, duration }) => ({ startTime, duration }))))
    .observe({ type: "longtask", buffered: true });
  const Plain = globalThis.Worker;
  globalThis.Worker = class extends Plain {
    terminate() {
      if (engines.includes(this)) engines.splice(engines.indexOf(this), 1);
      super.terminate();
    }

    constructor(address, options) {
      super(address, options);
      watched.workers.push(this);
      this.addEventListener("message", ({ data }) => {
        if (data?.type === "ready") {
          watched.engineReady ??= performance.now();
          engines.push(this);
        }
        watched.messages.push({ at: performance.now(), type: data?.type ?? "answer", event: data?.event?.event, stage: data?.event?.stage, adapter: data?.adapter });
      });
    }
  };
}

/** Waits until the page has read what it was given and is in one of these phases. @param {Page} page @param {string[]} phases @param {number} [timeout] */
export async function phase(page, phases, timeout = 60_000) {
  await page.waitForFunction((wanted) => document.body.dataset.reading !== "true" && wanted.includes(document.body.dataset.phase), phases, { timeout, polling: 20 });
}

/** Chooses files as a person does. @param {Page} page @param {string[]} files */
export async function choose(page, files) {
  await page.locator('input[type="file"][aria-label="Files"]').setInputFiles(files);
}

/**
 * Drops files and folders anywhere on the page, as the browser hands them over; a folder's content is an object.
 * @param {Page} page @param {Record<string, any>} tree names to base64 content or further folders
 */
export async function drop(page, tree) {
  await page.evaluate((tree) => {
    const entry = (name, content, path) => {
      const fullPath = `${path}/${name}`;
      if (typeof content !== "string") {
        let children = Object.entries(content).map(([child, inner]) => entry(child, inner, fullPath));
        // The system's reader gives what it has and then nothing.
        const readEntries = (done) => done(children.splice(0, 100));
        return { isFile: false, isDirectory: true, name, fullPath, createReader: () => ({ readEntries }) };
      }
      const file = new File([Uint8Array.from(atob(content), (c) => c.charCodeAt(0))], name);
      return { isFile: true, isDirectory: false, name, fullPath, file: (done) => done(file) };
    };
    const items = Object.entries(tree).map(([name, content]) => ({ kind: "file", webkitGetAsEntry: () => entry(name, content, ""), getAsFile: () => null }));
    const event = new DragEvent("drop", { bubbles: true, cancelable: true });
    Object.defineProperty(event, "dataTransfer", { value: { types: ["Files"], items, files: [] } });
    document.querySelector("#scene").dispatchEvent(event);
  }, tree);
}

/** How many times longer a piece of work takes now than it would on a machine that does nothing else; 1 or more. */
export function slowdown() {
  const [start, before] = [performance.now(), process.cpuUsage()];
  let busyMs = 0;
  while (busyMs < 60) {
    const { user, system } = process.cpuUsage(before);
    busyMs = (user + system) / 1000;
  }
  return Math.max(1, (performance.now() - start) / busyMs);
}

/**
 * Runs a timed attempt up to three times and gives the first that passes, else the last failure. `limit` stretches a time by
 * how busy the machine is with other things before and after: what is slow by itself is still too slow.
 * @template T @param {(limit: (ms: number) => number) => Promise<T>} attempt @returns {Promise<T>}
 */
export async function undisturbed(attempt) {
  for (let left = 2; ; left -= 1) {
    const before = slowdown();
    try {
      return await attempt((ms) => ms * Math.max(before, slowdown()));
    } catch (error) {
      if (left === 0) throw error;
      console.log(`once more, as the machine may have been busy (${before.toFixed(1)}, ${slowdown().toFixed(1)}): ${/** @type {Error} */ (error).message.split("\n")[0]}`);
    }
  }
}

/**
 * The tasks of the page's thread while something goes on, by the browser's own trace: what the long-task observer sees, and how
 * much of it was work and how much was waiting for a processor.
 * @param {import("../../web/node_modules/playwright-core/index.js").Browser} browser @param {() => Promise<unknown>} work
 * @returns {Promise<{ wallMs: number, workMs: number }[]>}
 */
export async function tasksDuring(browser, work) {
  const session = await browser.newBrowserCDPSession();
  /** @type {Record<string, any>[]} */
  const events = [];
  session.on("Tracing.dataCollected", ({ value }) => events.push(...value));
  await session.send("Tracing.start", { traceConfig: { includedCategories: ["toplevel"] } });
  await work();
  const complete = new Promise((resolve) => session.once("Tracing.tracingComplete", () => resolve(undefined)));
  await session.send("Tracing.end");
  await complete;
  await session.detach();
  const pages = new Set(events.filter(({ name, args }) => name === "thread_name" && args.name === "CrRendererMain").map(({ pid, tid }) => `${pid}/${tid}`));
  return events.filter(({ name, ph, pid, tid }) => name.endsWith("RunTask") && ph === "X" && pages.has(`${pid}/${tid}`)).map(({ dur, tdur }) => ({ wallMs: dur / 1000, workMs: (tdur ?? dur) / 1000 }));
}

/** Opens a scene and waits until it can be solved. @param {Page} page @param {string[]} files @param {number} [timeout] */
export async function openScene(page, files, timeout = 60_000) {
  await choose(page, files);
  await phase(page, ["ready"], timeout);
}

/** @param {Page} page @param {string} name */
export const button = (page, name) => page.getByRole("button", { name, exact: true });

/** Chooses where the next solve computes. @param {Page} page @param {"gpu"|"cpu"|"auto"} backend */
export async function computeOn(page, backend) {
  await page.getByRole("region", { name: "Run" }).getByRole("button", { name: "Settings" }).click();
  const dialog = page.getByRole("dialog");
  await dialog.getByLabel("Compute on").selectOption(backend);
  await button(dialog, "Use these").click();
}

/** Solves the opened scene to its end; milliseconds. @param {Page} page @param {number} limitMs */
export async function reconstruct(page, limitMs) {
  const start = Date.now();
  await page.getByRole("region", { name: "Run" }).getByRole("button", { name: "Reconstruct" }).click();
  await phase(page, ["done"], limitMs);
  return Date.now() - start;
}

/** What the page says of problems, once it says anything. @param {Page} page @param {number} [timeout] */
export async function refusal(page, timeout = 30_000) {
  const notice = page.getByRole("alert").locator(".notice");
  await notice.first().waitFor({ timeout });
  return (await notice.allInnerTexts()).join("\n");
}

/** The whole text of a panel. @param {Page} page @param {"Inputs"|"Scene"|"Run"} name */
export const panel = (page, name) => page.getByRole("region", { name }).innerText();

/**
 * Downloads what the page offers at first, as one zip, and unpacks it; `model` is the folder of the COLMAP model in it.
 * @param {Page} page @param {string} name
 */
export async function exported(page, name) {
  const started = page.waitForEvent("download", { timeout: 30_000 });
  await page.getByRole("region", { name: "Run" }).getByRole("button", { name: "Download model" }).click();
  await button(page.getByRole("dialog"), "Download").click();
  const folder = join(out, name);
  rmSync(folder, { recursive: true, force: true });
  await (await started).saveAs(`${folder}.zip`);
  const names = unpack(`${folder}.zip`, folder);
  const cameras = names.find((file) => file.endsWith("cameras.bin"));
  if (cameras === undefined) throw new Error(`no model in ${names.join(", ")}`);
  return { model: join(folder, cameras, ".."), names };
}

/** A scene by the project's synthesiser, made once. @param {string} name @param {string[]} options @returns {string} its folder */
export function synth(name, options) {
  const folder = join(out, name);
  if (!existsSync(join(folder, "database.db"))) {
    execFileSync(need("EPIPOLE_FIXTURES"), ["synth", ...options, "--output", folder], { stdio: "ignore" });
  }
  return folder;
}

/** A database of so many bytes, of what nobody reads or of matches. @param {string} path @param {number} bytes @param {boolean} [matches] */
export function large(path, bytes, matches = false) {
  execFileSync(need("EPIPOLE_FIXTURES"), ["large", "--bytes", String(bytes), ...(matches ? ["--matches"] : []), "--output", path], { stdio: "ignore" });
}

/** The command line's own run of a database, made anew; returns the model. @param {string} database @param {string} name */
export function nativeModel(database, name) {
  const folder = join(out, `${name}-native`);
  execFileSync(need("EPIPOLE_PROGRAM"), ["reconstruct", database, "--output", folder], { stdio: "ignore" });
  return join(folder, "0");
}

/** `epipole evaluate --json`. @param {string} model @param {string} truth */
export function evaluate(model, truth) {
  return JSON.parse(execFileSync(need("EPIPOLE_PROGRAM"), ["evaluate", model, truth, "--json"], { encoding: "utf8" }).trim().split("\n").at(-1) ?? "");
}

/** Bytes that the engine's wasm memory has grown to; it never shrinks, so that this is the peak. @param {Page} page @returns {Promise<number>} */
export async function wasmBytes(page) {
  const { value } = await ask(page, { type: "status" });
  return value.memoryBytes;
}

/** The engine's own thread, to see and change what it is given by the browser. @param {Page} page */
export async function engineWorker(page) {
  for (const worker of page.workers().reverse()) if (await worker.evaluate(() => "epipolePanicked" in globalThis)) return worker;
  throw new Error("there is no engine");
}

/** Asks the engine's worker as the page does; with how long the answer took. @param {Page} page @param {Record<string, any>} command @param {number} [limitMs] */
export async function ask(page, command, limitMs = 10_000) {
  // The page ends its engine with a scene that it gives up and starts another, which an unlucky question falls between.
  for (let left = 2; ; left -= 1) {
    await page.waitForFunction(() => globalThis.watched.engine, undefined, { timeout: 20_000 });
    const answer = await page.evaluate(([command, limitMs]) => new Promise((resolve) => {
      const { engine } = globalThis.watched;
      // The page counts from zero: a negative id is nobody's.
      const id = -1 - Math.floor(Math.random() * 1e9);
      const start = performance.now();
      const listen = ({ data }) => {
        if (data?.id !== id) return;
        engine.removeEventListener("message", listen);
        resolve({ value: data.value, failure: data.failure, ms: performance.now() - start });
      };
      engine.addEventListener("message", listen);
      engine.postMessage({ id, ...command });
      setTimeout(() => resolve(engine === globalThis.watched.engine ? { ms: Infinity } : null), limitMs);
    }), /** @type {const} */ ([command, limitMs]));
    if (answer || left === 0) return answer;
  }
}
