// How the page feels: there at once, small to load, and never stuck while it solves.

import assert from "node:assert/strict";
import { rmSync } from "node:fs";
import { join } from "node:path";
import { test } from "node:test";
import { brotliCompressSync, constants } from "node:zlib";
import { large, open, openScene, out, panel, reconstruct, shared, slowdown, synth, tasksDuring, undisturbed, wasmBytes } from "./page.mjs";

/** Compressed bytes of a first visit (issue 5). */
const VISIT_BYTES = 1_000_000;
/** From the address to the first thing that a person can do (issue 5). */
const FIRST_INTERACTION_MS = 2000;
/** What the browser calls a long task of the page's thread. */
const LONG_TASK_MS = 50;
/** The database that is not copied whole (issue 5: 1 GB or more), and how much of it memory may hold. */
const LARGE_BYTES = 1_100_000_000;
const LARGE_MEMORY_SHARE = 0.05;

test("the page is there at once", { timeout: 120_000 }, () =>
  undisturbed(async (limit) => {
    const { browser, loadedMs, readyMs } = await open();
    await browser.close();
    console.log(`loaded after ${loadedMs} ms, engine ready after ${readyMs} ms`);
    assert.ok(readyMs < limit(FIRST_INTERACTION_MS), `${readyMs} ms`);
  }));

/** As a server has it that packs its files once. @param {Buffer} data */
const packed = (data) => brotliCompressSync(data, { params: { [constants.BROTLI_PARAM_QUALITY]: 11, [constants.BROTLI_PARAM_LGWIN]: 24 } }).length;

test("a first visit is small and all from one place", { timeout: 60_000 }, async () => {
  const { browser, page } = await open();
  try {
    /** @type {Map<string, number>} */
    const sizes = new Map();
    const address = page.url();
    page.on("response", async (response) => {
      if (response.ok()) sizes.set(response.url(), packed(await response.body()));
    });
    await page.reload({ waitUntil: "networkidle" });
    await page.waitForFunction(() => globalThis.watched.engineReady !== null);
    const total = [...sizes.values()].reduce((sum, size) => sum + size, 0);
    console.log(`${sizes.size} files, ${total} bytes compressed`);
    assert.ok([...sizes.keys()].some((name) => name.endsWith(".wasm")), "the engine was among them");
    assert.deepEqual([...sizes.keys()].filter((name) => !name.startsWith(address) && !name.startsWith("blob:")), []);
    assert.ok(total <= VISIT_BYTES, `${total} bytes`);
  } finally {
    await browser.close();
  }
});

test("the page's thread is never held up by a solve", { timeout: 180_000 }, async () => {
  const { browser, page } = await open();
  try {
    const database = shared ? join(shared, "strecha_castle-P19/database.db") : join(synth("street", ["--kind", "street", "--images", "90", "--points", "24000", "--pairs-per-image", "14"]), "database.db");
    await undisturbed(async () => {
      await openScene(page, [database]);
      await page.waitForTimeout(500);
      const busy = slowdown();
      const tasks = await tasksDuring(browser, () => reconstruct(page, 90_000));
      const most = (/** @type {"wallMs"|"workMs"} */ kind) => Math.max(0, ...tasks.map((task) => task[kind]));
      console.log(`${tasks.length} tasks during a solve: ${most("workMs").toFixed(0)} ms of work at most, ${most("wallMs").toFixed(0)} ms with waiting for a processor (everything takes ${busy.toFixed(1)} times as long)`);
      assert.ok(tasks.length > 100, "the trace is of the page");
      assert.ok(most("workMs") <= LONG_TASK_MS, `${most("workMs")} ms of work`);
      // Where other programs take the processors away, nothing but the work is the page's.
      assert.ok(most("wallMs") <= LONG_TASK_MS || Math.max(busy, slowdown()) > 1.2, `${most("wallMs")} ms`);
    });
  } finally {
    await browser.close();
  }
});

test("a database of more than 1 GB opens without being copied", { timeout: 120_000 }, async () => {
  const path = join(out, "large.db");
  large(path, LARGE_BYTES);
  const { browser, page, complaints } = await open();
  try {
    const start = Date.now();
    await openScene(page, [path]);
    const [ms, bytes] = [Date.now() - start, await wasmBytes(page)];
    console.log(`${LARGE_BYTES / 1e9} GB opened in ${ms} ms with ${(bytes / 1e6).toFixed(1)} MB of wasm memory`);
    assert.ok(bytes < LARGE_MEMORY_SHARE * LARGE_BYTES, `${bytes} bytes`);
    await reconstruct(page, 60_000);
    assert.match(await panel(page, "Run"), /18 of 18 images placed/);
    assert.deepEqual(complaints, []);
  } finally {
    await browser.close();
    rmSync(path, { force: true });
  }
});
