// The page in headless Chromium, for the specs: served by `cargo xtask page`, driven by playwright-core.

import { chromium } from "../../web/node_modules/playwright-core/index.mjs";

/** WebGPU and WebGL on SwiftShader, canvases that can be photographed (source: shared/toolchain.md). */
const WITH_GPU = [
  "--use-angle=swiftshader", "--enable-unsafe-swiftshader", "--enable-unsafe-webgpu", "--ignore-gpu-blocklist", "--enable-gpu",
  "--enable-features=Vulkan", "--use-vulkan=swiftshader",
];
/** The same without WebGPU. */
const WITHOUT_GPU = ["--use-angle=swiftshader", "--enable-unsafe-swiftshader", "--disable-features=WebGPU"];
const COMMON = [
  "--no-sandbox", "--disable-quic", "--no-first-run", "--disable-background-networking", "--disable-component-update", "--disable-sync",
];

export const url = process.env.EPIPOLE_PAGE ?? "http://127.0.0.1:8080/";
export const shared = process.env.EPIPOLE_SHARED ?? "";
export const out = process.env.EPIPOLE_OUT ?? "/tmp";

/** @param {{ gpu?: boolean, width?: number, height?: number, theme?: "dark"|"light", query?: string }} [options] */
export async function open({ gpu = true, width = 1440, height = 880, theme = "dark", query = "" } = {}) {
  const browser = await chromium.launch({
    executablePath: process.env.EPIPOLE_CHROMIUM ?? "/usr/bin/chromium",
    args: [...COMMON, ...(gpu ? WITH_GPU : WITHOUT_GPU)],
  });
  const page = await browser.newPage({ viewport: { width, height }, colorScheme: theme, acceptDownloads: true });
  /** Nothing the page says to the console is without meaning. @type {string[]} */
  const complaints = [];
  page.on("console", (message) => message.type() === "error" && complaints.push(message.text()));
  page.on("pageerror", (error) => complaints.push(String(error)));
  // Every task over 50 ms on the page's own thread, from the start.
  await page.addInitScript(() => {
    const long = [];
    Reflect.set(globalThis, "longTasks", long);
    new PerformanceObserver((list) => long.push(...list.getEntries().map(({ startTime, duration }) => ({ startTime, duration })))).observe({ type: "longtask", buffered: true });
  });
  const start = Date.now();
  await page.goto(url + query);
  await page.getByText("processor").or(page.getByText("SwiftShader")).first().waitFor({ timeout: 20_000 });
  return { browser, page, complaints, readyMs: Date.now() - start };
}

/** Chooses files as a person does. @param {import("playwright-core").Page} page @param {string[]} files */
export async function choose(page, files) {
  await page.locator('input[type="file"][aria-label="Files"]').setInputFiles(files);
}

/** @param {import("playwright-core").Page} page @param {string} name */
export const button = (page, name) => page.getByRole("button", { name, exact: true });

/** Runs the opened scene to its end; milliseconds. @param {import("playwright-core").Page} page @param {number} limitMs */
export async function reconstruct(page, limitMs) {
  const start = Date.now();
  await button(page, "Reconstruct").click();
  await button(page, "Download model").waitFor({ timeout: limitMs });
  return Date.now() - start;
}
