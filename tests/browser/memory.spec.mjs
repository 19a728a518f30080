// What a scene takes from the machine comes back when it goes: measured at the browser's processes, not by the page itself.

import assert from "node:assert/strict";
import { readFileSync, rmSync } from "node:fs";
import { join } from "node:path";
import { test } from "node:test";
import { button, fixtures, large, open, openScene, out, panel, phase, reconstruct, refusal, synth } from "./page.mjs";

/** Of what a solved scene took, so much is given back at least: allocators keep some of their pages for the next. */
const RETURNED = 0.6;
const PATIENCE_MS = 20_000;

/** @typedef {import("../../web/node_modules/playwright-core/index.js").Browser} Browser */

/** Memory of the processes that run pages and their workers, bytes: proportional set size, so that shared pages count once. @param {Browser} browser */
async function rendererBytes(browser) {
  const session = await browser.newBrowserCDPSession();
  const { processInfo } = await session.send("SystemInfo.getProcessInfo");
  await session.detach();
  const sizes = processInfo.filter(({ type }) => type === "renderer").map(({ id }) => {
    const found = readFileSync(`/proc/${id}/smaps_rollup`, "utf8").match(/^Pss:\s+(\d+) kB/m);
    return found ? 1024 * Number(found[1]) : 0;
  });
  assert.ok(sizes.length > 0 && sizes.every((size) => size > 1e6), "the page's process was found");
  return sizes.reduce((sum, size) => sum + size, 0);
}

/**
 * The least of some time without garbage, which ends early once enough is back: browsers free in their own time.
 * @param {Browser} browser @param {import("./page.mjs").Page} page @param {number} [enough] bytes
 */
async function settled(browser, page, enough = 0) {
  const session = await page.context().newCDPSession(page);
  let least = Infinity;
  for (const until = Date.now() + PATIENCE_MS; Date.now() < until && least > enough; ) {
    await session.send("HeapProfiler.collectGarbage");
    least = Math.min(least, await rendererBytes(browser));
    await page.waitForTimeout(500);
  }
  await session.detach();
  return least;
}

const street = () => join(synth("street", ["--kind", "street", "--images", "90", "--points", "24000", "--pairs-per-image", "14"]), "database.db");
const orbit = join(fixtures, "orbit/database.db");
const mb = (/** @type {number} */ bytes) => `${(bytes / 1e6).toFixed(0)} MB`;

/** @type {[string, (page: import("./page.mjs").Page) => Promise<unknown>][]} */
const WAYS = [
  ["closed", async (page) => {
    await button(page, "Close").click();
    await phase(page, ["empty"]);
  }],
  ["replaced by a small one", (page) => openScene(page, [orbit])],
];

test("memory comes back when a scene is closed or replaced", { timeout: 240_000 }, async () => {
  const { browser, page, complaints } = await open();
  try {
    // What any first scene leaves behind (compiled code, panels) is none of this scene's.
    await openScene(page, [orbit]);
    await reconstruct(page, 60_000);
    await button(page, "Close").click();
    await phase(page, ["empty"]);
    const before = await settled(browser, page);
    for (const [how, leave] of WAYS) {
      await openScene(page, [street()]);
      await reconstruct(page, 90_000);
      const held = await rendererBytes(browser);
      await leave(page);
      const after = await settled(browser, page, held - RETURNED * (held - before));
      console.log(`${how}: ${mb(before)} before, ${mb(held)} with 90 images solved, ${mb(after)} after: ${(100 * (held - after) / (held - before)).toFixed(0)} % of it came back`);
      assert.ok(held - before > 50e6, `the scene took ${mb(held - before)} only: nothing to give back`);
      assert.ok(held - after >= RETURNED * (held - before), `${mb(after)} are still held`);
    }
    assert.deepEqual(complaints, []);
  } finally {
    await browser.close();
  }
});

test("a scene that cannot fit is refused with the figure before it is solved", { timeout: 120_000 }, async () => {
  const path = join(out, "too-many-matches.db");
  // 19 million matches at 200 bytes each: more than the 3.6 GB that a tab has.
  large(path, 150_000_000, true);
  const { browser, page, complaints } = await open();
  try {
    await openScene(page, [path]);
    assert.match(await panel(page, "Run"), /takes about 3\.[78] GB of memory/);
    await page.getByRole("region", { name: "Run" }).getByRole("button", { name: "Reconstruct" }).click();
    const said = await refusal(page);
    console.log(said.replaceAll("\n", " "));
    assert.match(said, /too-many-matches\.db.*3\.[78] GB of memory and a tab has 3\.6 GB.*\n.*command line/s);
    await phase(page, ["ready"]);
    await openScene(page, [orbit]);
    await reconstruct(page, 30_000);
    assert.match(await panel(page, "Run"), /18 of 18 images placed/);
    assert.deepEqual(complaints, []);
  } finally {
    await browser.close();
    rmSync(path, { force: true });
  }
});
