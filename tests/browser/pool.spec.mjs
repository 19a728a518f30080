// Helpers for the pairs of a scene: they take part, change nothing, and are there only while they are needed.

import assert from "node:assert/strict";
import { once } from "node:events";
import { createServer } from "node:http";
import { join } from "node:path";
import { test } from "node:test";
import { ask, button, fixtures, open, openScene, panel, phase, synth, undisturbed } from "./page.mjs";

/** Between kernels, and between a click and what it does (issue 5). */
const ACTS_MS = 200;

/** Thousands of pairs without a pose: some seconds of work for one worker. */
const database = () => join(synth("pairs", ["--kind", "orbit", "--images", "120", "--points", "4000", "--no-poses", "--pairs-per-image", "40"]), "database.db");

/** A few hundred pairs that have to be verified again. */
const raw = () => join(synth("raw-pairs", ["--kind", "orbit", "--images", "60", "--points", "2500", "--raw-outliers", "0.5", "--pairs-per-image", "20"]), "database.db");

/** @typedef {import("./page.mjs").Page} Page */
/** @typedef {import("../../web/node_modules/playwright-core/index.js").Browser} Browser */

/** All workers of the browser, also those that workers have started. @param {Browser} browser */
async function workers(browser) {
  const session = await browser.newBrowserCDPSession();
  const { targetInfos } = await session.send("Target.getTargets");
  await session.detach();
  return targetInfos.filter(({ type }) => type === "worker").length;
}

/** Waits until there are so many workers. @param {Browser} browser @param {(count: number) => boolean} enough */
async function until(browser, enough) {
  for (const end = Date.now() + 10_000; Date.now() < end; await new Promise((next) => setTimeout(next, 20))) {
    if (enough(await workers(browser))) return;
  }
  assert.fail(`${await workers(browser)} workers`);
}

/** Solves with at most so many helpers. @param {Page} page @param {number} helpers @param {Record<string, any>} [further] settings */
async function solve(page, helpers, further = {}) {
  const settings = { preset: "fast", refine: { rounds: 1 }, ...further };
  const { value: report, failure } = await ask(page, { type: "solve", settings, backend: "cpu", helpers }, 120_000);
  assert.equal(failure, undefined);
  const stage = report.stages.find((/** @type {{ stage: string }} */ { stage }) => stage === "relative_pose");
  const { value: files } = await ask(page, { type: "export", formats: ["colmap_bin"], component: null, filter: { maxErrorPx: Infinity, minTrack: 0 }, settings });
  return { summary: stage.summary, seconds: stage.seconds, warnings: report.warnings, model: files.map((/** @type {any} */ { path, bytes }) => [path, Buffer.from(bytes).toString("base64")]) };
}

for (const [what, scene, further, found] of /** @type {const} */ ([
  ["stored matrices", database, {}, /^0 stored, \d{4} decomposed, 0 estimated; .*; by 2 workers$/],
  ["raw matches", raw, { matches: "raw" }, /^0 stored, 0 decomposed, \d{3} estimated; .*; by 2 workers$/],
])) {
  test(`helpers take part in poses from ${what}, and the model is the same bytes`, { timeout: 240_000 }, async () => {
    const { browser, page, complaints } = await open();
    try {
      await openScene(page, [scene()]);
      const before = await workers(browser);
      const alone = await solve(page, 1, further);
      const helped = await solve(page, 2, further);
      const many = await solve(page, 5, further);
      console.log(`relative poses from ${what}: ${alone.seconds.toFixed(2)} s in one worker, ${helped.seconds.toFixed(2)} s with two helpers (${(alone.seconds / helped.seconds).toFixed(2)} times as fast), ${many.seconds.toFixed(2)} s with five; ${helped.summary}`);
      assert.doesNotMatch(alone.summary, /workers/);
      assert.match(helped.summary, found);
      assert.match(many.summary, /; by 5 workers$/);
      assert.ok(alone.model.length >= 3, "a COLMAP model");
      assert.deepEqual(helped.model, alone.model);
      assert.deepEqual(many.model, alone.model);
      assert.deepEqual([helped.warnings, many.warnings], [alone.warnings, alone.warnings]);
      assert.equal(await workers(browser), before, "they are ended when the stage is over");
      assert.deepEqual(complaints, []);
    } finally {
      await browser.close();
    }
  });
}

/** Clicks a button of the run; on the page's clock, when that was. @param {Page} page @param {string} name */
const clickAt = (page, name) =>
  button(page.getByRole("region", { name: "Run" }), name).evaluate((node) => {
    const at = performance.now();
    node.click();
    return at;
  });

/** Starts a solve and waits until helpers are at work. @param {Browser} browser @param {Page} page @param {number} before */
async function startSolving(browser, page, before) {
  await clickAt(page, "Reconstruct");
  await until(browser, (count) => count >= before + 2);
  const told = await page.evaluate(() => globalThis.watched.messages.length);
  await page.waitForFunction((told) => globalThis.watched.messages.slice(told).some((m) => m.event === "progress" && m.stage === "relative_pose"), told, { polling: 10, timeout: 10_000 });
}

for (const name of ["Cancel", "Stop and keep"]) {
  test(`${name} ends the helpers at once`, { timeout: 120_000 }, async () => {
    const { browser, page } = await open();
    try {
      await openScene(page, [database()]);
      const before = await workers(browser);
      await undisturbed(async (limit) => {
        await startSolving(browser, page, before);
        const clicked = await clickAt(page, name);
        const handle = await page.waitForFunction(() => document.body.dataset.phase === "ready" && performance.now(), undefined, { polling: "raf", timeout: 30_000 });
        const ms = (await handle.jsonValue()) - clicked;
        console.log(`${name}: ${ms.toFixed(0)} ms after the click`);
        await until(browser, (count) => count === before);
        const rotation = await page.evaluate(() => globalThis.watched.messages.some((m) => m.stage === "rotation"));
        assert.ok(!rotation, "it was within the stage");
        assert.ok(ms <= limit(ACTS_MS), `${ms} ms`);
      });
      // Nothing of it is in the next run.
      const { summary, warnings } = await solve(page, 2);
      assert.match(summary, /^0 stored, \d{4} decomposed, 0 estimated; dropped 0 weak and 0 without a pose; by 2 workers$/);
      assert.deepEqual(warnings, []);
    } finally {
      await browser.close();
    }
  });
}

test("without helpers that can be loaded the engine's worker does it all, and says so", { timeout: 120_000 }, async () => {
  const { browser, page } = await open();
  try {
    await page.route("**/*pair-worker.js", (route) => route.abort());
    await openScene(page, [database()]);
    const before = await workers(browser);
    const { summary, warnings } = await solve(page, 2);
    assert.match(summary, /^0 stored, \d{4} decomposed, 0 estimated; dropped 0 weak and 0 without a pose/);
    assert.match(warnings.join("\n"), /^helpers left \d{4} pairs, which are solved without them: a helper could not be loaded$/);
    assert.equal(await workers(browser), before);
  } finally {
    await browser.close();
  }
});

test("helpers can send nothing anywhere", { timeout: 120_000 }, async () => {
  /** @type {(string|undefined)[]} */
  const asked = [];
  const server = createServer(({ url }, response) => (asked.push(url), response.end())).listen(0, "127.0.0.1");
  await once(server, "listening");
  const { port } = /** @type {import("node:net").AddressInfo} */ (server.address());
  const { browser, page } = await open();
  try {
    await page.route("**/*pair-worker.js", async (route) => {
      const response = await route.fetch();
      const sending = `fetch("http://127.0.0.1:${port}/from-helper", { method: "POST", body: "secret", mode: "no-cors" }).catch(() => fetch(new URL("?refused", import.meta.url)));`;
      await route.fulfill({ response, body: `${await response.text()}\n${sending}` });
    });
    const refused = page.waitForRequest(/\?refused$/, { timeout: 30_000 });
    await openScene(page, [database()]);
    assert.match((await solve(page, 2)).summary, /; by 2 workers$/);
    await refused;
    assert.deepEqual(asked, []);
  } finally {
    await browser.close();
    server.close();
  }
});

test("nothing comes of helpers while a run is paused, and they end with the engine", { timeout: 120_000 }, async () => {
  const { browser, page, complaints } = await open();
  try {
    await openScene(page, [database()]);
    const before = await workers(browser);
    await startSolving(browser, page, before);
    await undisturbed(async (limit) => {
      const clicked = await clickAt(page, "Pause");
      await page.waitForTimeout(1000);
      const last = await page.evaluate((from) => Math.max(from, ...globalThis.watched.messages.filter((m) => m.type === "event").map((m) => m.at)), clicked);
      console.log(`paused ${(last - clicked).toFixed(0)} ms after the click`);
      assert.ok(last - clicked <= limit(ACTS_MS), `${last - clicked} ms`);
      await clickAt(page, "Go on");
    });
    // Another scene ends the engine's worker, and with it those that it has started.
    await until(browser, (count) => count >= before + 2);
    await openScene(page, [join(fixtures, "orbit/database.db")]);
    await until(browser, (count) => count === before);
    await phase(page, ["ready"]);
    assert.match(await panel(page, "Inputs"), /18/);
    assert.deepEqual(complaints, []);
  } finally {
    await browser.close();
  }
});
