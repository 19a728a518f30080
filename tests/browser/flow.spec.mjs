// The whole way: a database goes in, a model comes out, and it is as good as the command line's.

import assert from "node:assert/strict";
import { readFileSync, readdirSync, rmSync } from "node:fs";
import { join } from "node:path";
import { test } from "node:test";
import { unpack } from "./archive.mjs";
import { button, choose, computeOn, drop, evaluate, exported, fixtures, nativeModel, open, openScene, out, panel, phase, reconstruct, shared } from "./page.mjs";

/** AUC@1 of the page's model may differ by so much from the command line's on the same file (issue 5). */
const AUC_TOLERANCE = 0.3;

/** Solves in the page and on the command line, and holds both to each other by the truth. */
async function compare({ name, database, truth, images, gpu, limitMs }) {
  const { browser, page, complaints } = await open({ gpu });
  try {
    await openScene(page, [database]);
    // Software adapters are taken by those only who ask for them.
    if (gpu) await computeOn(page, "gpu");
    const ms = await reconstruct(page, limitMs);
    assert.match(await panel(page, "Run"), new RegExp(`\\b${images} of ${images} images placed`));
    const adapters = await page.evaluate(() => globalThis.watched.messages.filter((m) => m.type === "backend").map((m) => m.adapter.kind));
    assert.deepEqual(adapters, [gpu ? "software" : "none"], "computes where it was meant to");
    const files = await exported(page, `${name}-page`);
    const [ours, theirs] = [evaluate(files.model, truth), evaluate(nativeModel(database, name), truth)];
    assert.equal(ours.common_images, images);
    console.log(`${name}: ${ms} ms in the page, AUC@1 ${ours.auc_all.at_1.toFixed(2)}, command line ${theirs.auc_all.at_1.toFixed(2)}`);
    assert.ok(Math.abs(ours.auc_all.at_1 - theirs.auc_all.at_1) <= AUC_TOLERANCE, `${ours.auc_all.at_1} and ${theirs.auc_all.at_1}`);
    await page.screenshot({ path: join(out, `${name}.png`) });
    assert.deepEqual(complaints, []);
  } finally {
    await browser.close();
  }
}

test("the sample is reconstructed and downloaded in every format", { timeout: 60_000 }, async () => {
  const { browser, page, complaints } = await open();
  try {
    await button(page, "Try a sample").click();
    await phase(page, ["ready"]);
    await reconstruct(page, 30_000);
    assert.match(await panel(page, "Run"), /18 of 18 images placed/);
    await page.getByRole("region", { name: "Run" }).getByRole("button", { name: "Download model" }).click();
    for (const box of await page.getByRole("dialog").getByRole("checkbox").all()) await box.check();
    const started = page.waitForEvent("download");
    await button(page.getByRole("dialog"), "Download").click();
    const folder = join(out, "sample");
    rmSync(folder, { recursive: true, force: true });
    await (await started).saveAs(`${folder}.zip`);
    const names = unpack(`${folder}.zip`, folder);
    for (const name of ["cameras.bin", "images.bin", "points3D.bin", "cameras.txt", "images.txt", "points3D.txt", ".ply", "transforms.json", "report.json", "settings.json"]) {
      assert.ok(names.some((found) => found.endsWith(name)), `${name} is missing from ${names.join(", ")}`);
    }
    const truth = join(fixtures, "orbit/truth");
    const [binary, text] = ["cameras.bin", "cameras.txt"].map((ending) => names.find((name) => name.endsWith(ending)) ?? "");
    for (const model of [join(folder, binary, ".."), join(folder, text, "..")]) {
      const { auc_all: auc, common_images: common } = evaluate(model, truth);
      assert.equal(common, 18);
      assert.ok(auc.at_1 > 80, `AUC@1 ${auc.at_1}`);
    }
    const report = JSON.parse(readFileSync(join(folder, names.find((name) => name.endsWith("report.json")) ?? ""), "utf8"));
    assert.equal(report.num_registered, 18);
    assert.deepEqual(complaints, []);
  } finally {
    await browser.close();
  }
});

const herzJesus = shared && { database: join(shared, "strecha_Herz-Jesus-P8/database.db"), truth: join(shared, "strecha_Herz-Jesus-P8/gt/sparse"), images: 8 };
const orbit = { database: join(fixtures, "orbit/database.db"), truth: join(fixtures, "orbit/truth"), images: 18 };

for (const gpu of [true, false]) {
  const name = `${herzJesus ? "Herz-Jesus-P8" : "orbit"}-${gpu ? "webgpu" : "processor"}`;
  test(`${name} is as good as on the command line`, { timeout: 240_000 }, () => compare({ name, ...(herzJesus || orbit), gpu, limitMs: 200_000 }));
}

test("castle-P19 on the processor is as good as on the command line", { skip: !shared && "no shared data", timeout: 180_000 }, () =>
  compare({ name: "castle-P19", database: join(shared ?? "", "strecha_castle-P19/database.db"), truth: join(shared ?? "", "strecha_castle-P19/gt/sparse"), images: 19, gpu: false, limitMs: 150_000 }));

test("depth maps beside the database make the model metric", { timeout: 60_000 }, async () => {
  const { browser, page, complaints } = await open();
  try {
    const maps = join(fixtures, "orbit/depth");
    await openScene(page, [orbit.database, ...readdirSync(maps).map((name) => join(maps, name))]);
    await reconstruct(page, 30_000);
    const { model, names } = await exported(page, "orbit-depth");
    const { scale_error: scale, common_images: common } = evaluate(model, orbit.truth);
    console.log(`with depth maps the scale is off by ${(100 * scale).toFixed(2)} %`);
    assert.equal(common, 18);
    // The maps have 2 % noise, and without them the scale is off by a sixth.
    assert.ok(Math.abs(scale) < 0.005, `${scale}`);
    const report = JSON.parse(readFileSync(join(out, "orbit-depth", names.find((name) => name.endsWith("report.json")) ?? ""), "utf8"));
    assert.equal(report.components[0].metric.maps, 17);
    assert.deepEqual(report.depth_input.missing, ["00006.jpg"]);
    assert.deepEqual(complaints, []);
  } finally {
    await browser.close();
  }
});

test("photographs that come after the solve colour it", { timeout: 60_000 }, async () => {
  const { browser, page, complaints } = await open();
  try {
    await openScene(page, [orbit.database]);
    await reconstruct(page, 30_000);
    /** Of the first point (COLMAP's points3D.bin: count, id, xyz, rgb). @param {string} model */
    const rgb = (model) => [...readFileSync(join(model, "points3D.bin")).subarray(40, 43)];
    assert.deepEqual(rgb((await exported(page, "colours-before")).model), [0, 0, 0]);
    const red = await page.evaluate(async () => {
      const canvas = new OffscreenCanvas(64, 48);
      const context = canvas.getContext("2d");
      context.fillStyle = "rgb(200 40 40)";
      context.fillRect(0, 0, 64, 48);
      const bytes = await (await canvas.convertToBlob({ type: "image/jpeg", quality: 1 })).arrayBuffer();
      return btoa(String.fromCharCode(...new Uint8Array(bytes)));
    });
    await page.evaluate(() => globalThis.watched.messages.splice(0));
    await drop(page, { photographs: Object.fromEntries(Array.from({ length: 18 }, (_, k) => [`${String(k).padStart(5, "0")}.jpg`, red])) });
    await page.waitForFunction(() => globalThis.watched.messages.some((m) => m.type === "snapshot"));
    const found = rgb((await exported(page, "colours-after")).model);
    assert.ok(found.every((channel, k) => Math.abs(channel - [200, 40, 40][k]) < 8), `${found}`);
    assert.deepEqual(complaints, []);
  } finally {
    await browser.close();
  }
});

test("a COLMAP model opens and goes out again as it came", { timeout: 60_000 }, async () => {
  const { browser, page, complaints } = await open();
  try {
    const truth = join(fixtures, "orbit/truth");
    await choose(page, ["cameras.txt", "images.txt", "points3D.txt"].map((name) => join(truth, name)));
    await phase(page, ["ready", "done"]);
    const { auc_all: auc, scale_error: scale } = evaluate((await exported(page, "orbit-model")).model, truth);
    assert.ok(auc.at_1 > 99.99 && Math.abs(scale) < 1e-6, `${auc.at_1} ${scale}`);
    assert.deepEqual(complaints, []);
  } finally {
    await browser.close();
  }
});
