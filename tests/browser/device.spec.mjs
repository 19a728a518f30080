// What the page does about WebGPU that is not there, is refused, or goes away in the middle of a solve: it says so and goes on.

import assert from "node:assert/strict";
import { join } from "node:path";
import { test } from "node:test";
import { button, computeOn, engineWorker, evaluate, exported, fixtures, nativeModel, open, openScene, panel, phase, reconstruct } from "./page.mjs";

const orbit = { database: join(fixtures, "orbit/database.db"), truth: join(fixtures, "orbit/truth") };
/** A loss may cost so much AUC@1: what is kept is the last accepted state, and the solve goes on from it. */
const AUC_TOLERANCE = 0.3;
/** Iterations of the first bundle adjustment before the device goes: some were accepted by then. */
const ITERATIONS = 3;

/** @typedef {import("./page.mjs").Page} Page */

/** AUC@1 of what the page has solved; all images must be in it. @param {Page} page @param {string} name */
async function accuracy(page, name) {
  assert.match(await panel(page, "Run"), /18 of 18 images placed/);
  const { auc_all: auc, common_images: common } = evaluate((await exported(page, name)).model, orbit.truth);
  assert.equal(common, 18);
  return auc.at_1;
}

/** Waits until bundle adjustment has taken some steps. @param {Page} page */
const refining = (page) => page.waitForFunction((least) => globalThis.watched.messages.filter((m) => m.event === "iteration" && m.stage === "refine").length >= least, ITERATIONS, { polling: 10, timeout: 90_000 });

/** Waits until the viewer says that it shows the cameras. @param {Page} page */
const cameras = (page) => page.locator(".facts", { hasText: "18 cameras" }).waitFor({ timeout: 10_000 });

/** Lines of the log. @param {Page} page */
const log = (page) => page.locator(".log li").allTextContents();

/** Keeps the devices that the engine opens where a test can reach them. @param {import("../../web/node_modules/playwright-core/index.js").Worker} worker */
const keepDevices = (worker) => worker.evaluate(() => {
  const devices = [];
  Reflect.set(globalThis, "devices", devices);
  const plain = GPUAdapter.prototype.requestDevice;
  GPUAdapter.prototype.requestDevice = async function (descriptor) {
    const device = await plain.call(this, descriptor);
    devices.push(device);
    return device;
  };
});

for (const another of [true, false]) {
  test(`a device lost in the middle of a solve: ${another ? "another takes its place" : "the processor goes on"}`, { timeout: 240_000 }, async () => {
    const { browser, page, complaints } = await open({ gpu: true });
    try {
      await openScene(page, [orbit.database]);
      await computeOn(page, "gpu");
      const worker = await engineWorker(page);
      await keepDevices(worker);
      await page.getByRole("region", { name: "Run" }).getByRole("button", { name: "Reconstruct" }).click();
      await refining(page);
      await worker.evaluate((another) => {
        if (!another) GPU.prototype.requestAdapter = async () => null;
        globalThis.devices.at(-1).destroy();
      }, another);
      await phase(page, ["done"], 120_000);
      const events = await page.evaluate(() => globalThis.watched.messages.filter((m) => m.type === "event").map((m) => m.event));
      assert.equal(events.filter((event) => event === "device_lost").length, 1);
      assert.equal(await worker.evaluate(() => globalThis.devices.length), another ? 2 : 1);
      const said = (await log(page)).filter((line) => /device was lost/.test(line));
      console.log(said.join("\n"));
      assert.equal(said.length, 1);
      assert.match(said[0], another ? /goes on from its last kept state on .*software/ : /there is no other.*on the CPU/);
      assert.match(await page.locator("#device").innerText(), another ? /SwiftShader/i : /processor/);
      const after = await accuracy(page, "device-lost");
      const { auc_all: undisturbed } = evaluate(nativeModel(orbit.database, "device"), orbit.truth);
      console.log(`AUC@1 ${after.toFixed(2)} after a lost device, ${undisturbed.at_1.toFixed(2)} on the command line`);
      assert.ok(Math.abs(after - undisturbed.at_1) <= AUC_TOLERANCE);
      // The viewer is none the worse for it, nor is the next scene.
      await page.keyboard.press("n");
      await page.keyboard.press("c");
      await page.keyboard.press("f");
      await cameras(page);
      await openScene(page, [orbit.database]);
      await page.evaluate(() => globalThis.watched.messages.splice(0));
      await page.getByRole("region", { name: "Run" }).getByRole("button", { name: "Reconstruct" }).click();
      await refining(page);
      await button(page, "Stop and keep").click();
      await phase(page, ["done"]);
      assert.match(await panel(page, "Run"), /18 of 18 images placed/);
      await cameras(page);
      const kinds = await page.evaluate(() => globalThis.watched.messages.filter((m) => m.type === "backend").map((m) => m.adapter.kind));
      assert.deepEqual(kinds, ["software"]);
      assert.deepEqual(complaints, []);
    } finally {
      await browser.close();
    }
  });
}

for (const [name, gpu, why] of /** @type {const} */ ([
  ["is missing", "missing", /this browser has no WebGPU/],
  ["offers no adapter", false, /offers no adapter/],
])) {
  test(`where WebGPU ${name} the processor solves and the viewer works`, { timeout: 90_000 }, async () => {
    const { browser, page, complaints } = await open({ gpu });
    try {
      assert.match((await log(page)).join("\n"), why);
      assert.equal(await page.locator("#device").innerText(), "processor");
      await page.locator("#device").click();
      assert.match(await page.getByRole("dialog").innerText(), why);
      await page.keyboard.press("Escape");
      await openScene(page, [orbit.database]);
      await reconstruct(page, 30_000);
      assert.ok((await accuracy(page, "device-none")) > 80);
      await cameras(page);
      // Asked for by name it is refused, with what to do.
      await computeOn(page, "gpu");
      await page.getByRole("region", { name: "Run" }).getByRole("button", { name: "Solve again" }).click();
      await page.getByRole("alert").locator(".notice").waitFor();
      assert.match(await page.getByRole("alert").innerText(), /WebGPU.*choose the processor/is);
      await phase(page, ["ready"]);
      assert.deepEqual(complaints, []);
    } finally {
      await browser.close();
    }
  });
}
