// What is no scene is refused with the file, the cause and the next step, and the page works on.

import assert from "node:assert/strict";
import { mkdirSync, readFileSync, writeFileSync } from "node:fs";
import { join } from "node:path";
import { after, before, test } from "node:test";
import { pack } from "./archive.mjs";
import { ask, choose, drop, evaluate, exported, fixtures, open, openScene, out, panel, phase, reconstruct, refusal, synth, wasmBytes } from "./page.mjs";

const folder = join(out, "refused");
const database = join(fixtures, "orbit/database.db");
/** A picture of one pixel. */
const JPEG = "/9j/4AAQSkZJRgABAQEASABIAAD/2wBDAP//////////////////////////////////////////////////////////////////////////////////////wAALCAABAAEBAREA/8QAFAABAAAAAAAAAAAAAAAAAAAACf/EABQQAQAAAAAAAAAAAAAAAAAAAAD/2gAIAQEAAD8AVN//2Q==";
/** What the bomb unpacks to. */
const BOMB_BYTES = 400_000_000;

/** One page for all: what one refusal breaks, the next would show. @type {Awaited<ReturnType<typeof open>>} */
let tab;

before(async () => {
  mkdirSync(folder, { recursive: true });
  tab = await open();
});
after(async () => tab?.browser.close());

/** @param {string} name @param {Buffer|string} content */
function file(name, content) {
  const path = join(folder, name);
  writeFileSync(path, content);
  return path;
}

/** @param {string} said @param {RegExp[]} parts */
function says(said, parts) {
  for (const part of parts) assert.match(said, part);
  // The file, the cause, and on a line of its own what to do.
  assert.match(said, /\.\s*\n.{12,}\./s, "says what to do");
}

const whole = readFileSync(database);
const cases = [
  { name: "a text", files: () => [file("matches.log", "image1.jpg image2.jpg 120\n")], says: [/matches\.log/, /text/, /database\.db/] },
  { name: "an empty file", files: () => [file("database.db", "")], says: [/database\.db/, /empty/] },
  { name: "a web page saved as a database", files: () => [file("download.db", "<!DOCTYPE html><title>Log in</title>")], says: [/download\.db/, /web page/] },
  { name: "a database cut in its header", files: () => [file("header.db", whole.subarray(0, 60))], says: [/header\.db/] },
  { name: "a database cut in half", files: () => [file("half.db", whole.subarray(0, whole.length / 2))], says: [/half\.db/] },
  { name: "a database without matches", files: () => [file("other.db", Buffer.concat([Buffer.from("SQLite format 3\0"), Buffer.alloc(5000, 7)]))], says: [/other\.db/] },
  { name: "a photograph alone", files: () => [file("IMG_0001.jpg", Buffer.from(JPEG, "base64"))], says: [/IMG_0001\.jpg/, /photograph/, /COLMAP/] },
  { name: "noise", files: () => [file("noise.bin", Buffer.from(Array.from({ length: 4000 }, (_, k) => (k * 7919) % 251)))], says: [/noise\.bin/] },
  { name: "a cut archive", files: () => [file("cut.zip", pack([{ name: "database.db", content: whole }]).subarray(0, 9000))], says: [/cut\.zip/, /cut off/] },
  {
    name: "a bomb of 400 MB that says so",
    files: () => [file("bomb.zip", pack([{ name: "database.db", content: Buffer.alloc(BOMB_BYTES), crc: 0 }]))],
    says: [/bomb\.zip/, /unpack/],
  },
  {
    name: "a bomb of 400 MB that hides it",
    files: () => [file("hidden.zip", pack([{ name: "database.db", content: Buffer.alloc(BOMB_BYTES), size: 500_000, crc: 0 }]))],
    says: [/hidden\.zip/, /more than its directory says/],
  },
];

for (const { name, files, says: parts } of cases) {
  test(`${name} is refused`, { timeout: 60_000 }, async () => {
    await choose(tab.page, files());
    const said = await refusal(tab.page);
    console.log(`${name}: ${said.replaceAll("\n", " ")}`);
    says(said, parts);
    await phase(tab.page, ["empty"]);
    assert.ok((await wasmBytes(tab.page)) < 50e6, "a refusal costs no memory");
  });
}

test("an empty folder is refused", { timeout: 20_000 }, async () => {
  await drop(tab.page, { holiday: {} });
  says(await refusal(tab.page), [/empty/, /database\.db/]);
});

test("a folder without a scene is refused", { timeout: 20_000 }, async () => {
  await drop(tab.page, { holiday: { "notes.txt": btoa("sunny"), more: { "a.txt": btoa("b"), "b.txt": btoa("b"), "c.txt": btoa("c") } } });
  says(await refusal(tab.page), [/database\.db/]);
});

test("after all that a dropped folder with a database is reconstructed", { timeout: 60_000 }, async () => {
  const { page, complaints } = tab;
  await drop(page, { scene: { "notes.txt": btoa("sunny"), inner: { "database.db": whole.toString("base64") } } });
  await phase(page, ["ready"]);
  assert.equal(await page.getByRole("alert").locator(".notice").count(), 0, "old refusals are gone");
  await reconstruct(page, 30_000);
  assert.match(await panel(page, "Run"), /18 of 18 images placed/);
  assert.deepEqual(complaints, []);
});

/** What the page shows of a scene: all of it must be the same after a refusal. @param {import("./page.mjs").Page} page */
const shown = (page) => page.evaluate(async () => {
  // Thumbnails follow with the next frame.
  for (let k = 0; k < 2; k += 1) await new Promise((resolve) => requestAnimationFrame(resolve));
  return {
    title: document.title, phase: document.body.dataset.phase, facts: document.querySelector(".facts").innerText,
    images: [...document.querySelectorAll(".thumbnail")].map((cell) => [cell.getAttribute("aria-label"), cell.getAttribute("aria-selected")]),
  };
});

/** Engines that are alive: what was refused or replaced must not stay in memory. @param {import("./page.mjs").Page} page @returns {Promise<number>} */
const engines = (page) => page.evaluate(() => globalThis.watched.engines.length);

/** @param {string} folder of a model */
const bytesOf = (folder) => Buffer.concat(["cameras.bin", "images.bin", "points3D.bin"].map((name) => readFileSync(join(folder, name))));

test("a refusal leaves the solved scene alone", { timeout: 90_000 }, async () => {
  const { page, complaints } = tab;
  await openScene(page, [database, file("00001.jpg", Buffer.from(JPEG, "base64"))]);
  await reconstruct(page, 30_000);
  await page.keyboard.press("n");
  const [before, model] = [await shown(page), bytesOf((await exported(page, "before-refusal")).model)];
  assert.match(before.facts, /18 cameras/);
  for (const refused of [file("half.db", whole.subarray(0, whole.length / 2)), file("images.bin", Buffer.alloc(900, 3)), file("matches.log", "image1.jpg image2.jpg 120\n")]) {
    await choose(page, [refused]);
    says(await refusal(page), []);
    await phase(page, ["done"]);
    assert.deepEqual(await shown(page), before);
    assert.ok(bytesOf((await exported(page, "after-refusal")).model).equals(model), "another model");
    await page.getByRole("alert").getByRole("button").click();
  }
  assert.equal((await ask(page, { type: "keypoints", image: 0 })).value.length > 0, true, "the engine that answers is the scene's");
  assert.equal(await engines(page), 1);
  assert.deepEqual(complaints, []);
});

test("a refusal leaves a running solve alone", { timeout: 120_000 }, async () => {
  const { page, complaints } = tab;
  const street = synth("street", ["--kind", "street", "--images", "90", "--points", "24000", "--pairs-per-image", "14"]);
  await openScene(page, [join(street, "database.db")]);
  await page.getByRole("region", { name: "Run" }).getByRole("button", { name: "Reconstruct" }).click();
  await page.waitForFunction(() => globalThis.watched.messages.some((m) => m.event === "iteration"), undefined, { polling: 10 });
  await choose(page, [file("half.db", whole.subarray(0, whole.length / 2))]);
  says(await refusal(page), [/half\.db/]);
  assert.equal((await shown(page)).phase, "running");
  await phase(page, ["done"], 90_000);
  assert.match(await panel(page, "Run"), /90 of 90 images placed/);
  assert.ok(evaluate((await exported(page, "solved-through")).model, join(street, "truth")).auc_all.at_5 > 80);
  // A scene that is good ends it, at once.
  await page.getByRole("region", { name: "Run" }).getByRole("button", { name: "Solve again" }).click();
  await openScene(page, [database]);
  assert.match((await shown(page)).title, /^orbit\/database\.db|^database\.db/);
  await reconstruct(page, 30_000);
  assert.match(await panel(page, "Run"), /18 of 18 images placed/);
  assert.equal(await engines(page), 1);
  assert.deepEqual(complaints, []);
});

test("what is given up while it is read leaves no trace", { timeout: 60_000 }, async () => {
  const { page, complaints } = tab;
  const before = await shown(page);
  const workers = await page.evaluate(() => {
    // Reading takes no longer than starting a worker: too short for a test's own hand.
    const cancel = [...document.querySelectorAll(".reading button")].find((node) => node.textContent === "Cancel");
    const { workers } = globalThis.watched;
    const count = workers.length;
    const wait = () => (workers.length > count ? cancel.click() : setTimeout(wait, 1));
    wait();
    return count;
  });
  await choose(page, [database]);
  await phase(page, ["done"]);
  await page.waitForTimeout(2000);
  assert.equal(await page.evaluate(() => globalThis.watched.workers.length), workers + 1, "it was being read");
  assert.deepEqual(await shown(page), before);
  assert.equal(await page.getByRole("alert").locator(".notice").count(), 0);
  assert.equal(await engines(page), 1);
  assert.deepEqual(complaints, []);
});
