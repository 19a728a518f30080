// Helpers for the pairs of a scene: they take part, change nothing, and are there only while they are needed.

import assert from "node:assert/strict";
import { join } from "node:path";
import { test } from "node:test";
import { ask, button, open, openScene, panel, phase, synth, undisturbed } from "./page.mjs";

/** Between kernels, and between a click and what it does (issue 5). */
const ACTS_MS = 200;

/** Thousands of pairs without a pose: some seconds of work for one worker. */
const database = () => join(synth("pairs", ["--kind", "orbit", "--images", "150", "--points", "6000", "--no-poses", "--pairs-per-image", "40"]), "database.db");

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

/** Solves with at most so many helpers. @param {Page} page @param {number} [helpers] */
async function solve(page, helpers) {
  const settings = { preset: "fast" };
  const { value: report, failure } = await ask(page, { type: "solve", settings, backend: "cpu", helpers }, 120_000);
  assert.equal(failure, undefined);
  const stage = report.stages.find((/** @type {{ stage: string }} */ { stage }) => stage === "relative_pose");
  const { value: files } = await ask(page, { type: "export", formats: ["colmap_bin"], component: null, filter: { maxErrorPx: Infinity, minTrack: 0 }, settings });
  return { summary: stage.summary, seconds: stage.seconds, warnings: report.warnings, model: files.map((/** @type {any} */ { path, bytes }) => [path, Buffer.from(Object.values(bytes)).toString("base64")]) };
}

test("helpers take part, and the model is the same bytes", { timeout: 240_000 }, async () => {
  const { browser, page, complaints } = await open();
  try {
    await openScene(page, [database()]);
    const before = await workers(browser);
    const alone = await solve(page, 1);
    const helped = await solve(page, 2);
    const many = await solve(page, 5);
    console.log(`relative poses: ${alone.seconds.toFixed(2)} s in one worker, ${helped.seconds.toFixed(2)} s with two helpers (${(alone.seconds / helped.seconds).toFixed(2)} times as fast), ${many.seconds.toFixed(2)} s with five; ${helped.summary}`);
    assert.doesNotMatch(alone.summary, /workers/);
    assert.match(helped.summary, /; by 2 workers$/);
    assert.match(many.summary, /; by 5 workers$/);
    assert.deepEqual(helped.model, alone.model);
    assert.deepEqual(many.model, alone.model);
    assert.deepEqual(many.warnings, alone.warnings);
    assert.equal(await workers(browser), before, "they are ended when the stage is over");
    assert.deepEqual(complaints, []);
  } finally {
    await browser.close();
  }
});
