// What the page looks like before, during and after a solve, in both themes and on a phone: pictures for people, and the few
// things about them that a test can know.

import assert from "node:assert/strict";
import { statSync } from "node:fs";
import { join } from "node:path";
import { test } from "node:test";
import { inflateSync } from "node:zlib";
import { button, fixtures, open, openScene, out, phase, reconstruct, shared } from "./page.mjs";

/** The README is read on slow lines too. */
const PICTURE_BYTES = 300_000;

const castle = shared && join(shared, "strecha_castle-P19");

/** @typedef {{ width: number, height: number, at: (x: number, y: number) => number[] }} Picture `at` gives red, green and blue */

/** @param {Buffer} png of 8-bit RGB or RGBA, as browsers write them @returns {Picture} */
function decode(png) {
  const [width, height, channels] = [png.readUInt32BE(16), png.readUInt32BE(20), png[25] === 6 ? 4 : 3];
  const parts = [];
  for (let at = 8; at < png.length; at += 12 + png.readUInt32BE(at)) {
    if (png.toString("latin1", at + 4, at + 8) === "IDAT") parts.push(png.subarray(at + 8, at + 8 + png.readUInt32BE(at)));
  }
  const raw = inflateSync(Buffer.concat(parts));
  const stride = width * channels;
  let above = Buffer.alloc(stride);
  /** @type {Buffer[]} */
  const rows = [];
  for (let y = 0; y < height; y += 1) {
    const filter = raw[y * (stride + 1)];
    const row = Buffer.from(raw.subarray(y * (stride + 1) + 1, (y + 1) * (stride + 1)));
    for (let x = 0; x < stride; x += 1) {
      const [a, b, c] = [x >= channels ? row[x - channels] : 0, above[x], x >= channels ? above[x - channels] : 0];
      const p = a + b - c;
      const [pa, pb, pc] = [Math.abs(p - a), Math.abs(p - b), Math.abs(p - c)];
      row[x] += [0, a, b, (a + b) >> 1, pa <= pb && pa <= pc ? a : pb <= pc ? b : c][filter];
    }
    rows.push(row);
    above = row;
  }
  return { width, height, at: (x, y) => [...rows[y].subarray(channels * x, channels * x + 3)] };
}

/** Share of the pixels that are not the most frequent colour. @param {Picture} picture */
function drawnShare({ width, height, at }) {
  /** @type {Map<number, number>} */
  const colours = new Map();
  for (let y = 0; y < height; y += 1) {
    for (let x = 0; x < width; x += 1) {
      const [red, green, blue] = at(x, y);
      const colour = (red << 16) | (green << 8) | blue;
      colours.set(colour, (colours.get(colour) ?? 0) + 1);
    }
  }
  return 1 - Math.max(...colours.values()) / (width * height);
}

/** No camera hides under the toolbar. @param {import("./page.mjs").Page} page @param {string} name */
async function camerasInSight(page, name) {
  const tools = page.locator(".tools");
  const [canvas, top] = [await page.locator("#scene canvas.view").boundingBox(), (await tools.boundingBox())?.y ?? 0];
  assert.ok(canvas && top > canvas.y, `${name}: there is a toolbar`);
  await tools.evaluate((node) => (node.style.visibility = "hidden"));
  const picture = decode(await page.locator("#scene canvas.view").screenshot());
  await tools.evaluate((node) => (node.style.visibility = ""));
  const frustum = await page.evaluate(() => getComputedStyle(document.documentElement).getPropertyValue("--frustum").trim().match(/[0-9a-f]{2}/g).map((channel) => Number.parseInt(channel, 16)));
  const edge = ((top - canvas.y) * picture.height) / canvas.height;
  let [above, below] = [0, 0];
  for (let y = 0; y < picture.height; y += 1) {
    for (let x = 0; x < picture.width; x += 1) {
      const isCamera = picture.at(x, y).every((channel, k) => Math.abs(channel - frustum[k]) < 16);
      if (isCamera && y < edge) above += 1;
      else if (isCamera) below += 1;
    }
  }
  assert.ok(above > 100, `${name}: only ${above} px of cameras`);
  assert.equal(below, 0, `${name}: cameras under the toolbar`);
}

/** Nothing is cut off at the side, and the canvas shows something where it should. @param {import("./page.mjs").Page} page @param {string} name @param {boolean} drawn */
async function look(page, name, drawn) {
  const path = join(out, `looks-${name}.png`);
  await page.screenshot({ path });
  const overflow = await page.evaluate(() => document.documentElement.scrollWidth - document.documentElement.clientWidth);
  assert.ok(overflow <= 0, `${name}: ${overflow} px wider than the screen`);
  if (drawn) {
    const share = drawnShare(decode(await page.locator("#scene canvas.view").screenshot()));
    assert.ok(share > 0.01, `${name}: the scene is blank, only ${(100 * share).toFixed(2)} % of it is drawn`);
  }
  return path;
}

for (const [name, options] of /** @type {const} */ ([
  ["dark", { theme: "dark" }],
  ["light", { theme: "light" }],
  ["small", { theme: "dark", width: 1280, height: 720 }],
  ["phone", { theme: "light", width: 390, height: 844, touch: true }],
])) {
  test(`before, during and after a solve: ${name}`, { timeout: 120_000 }, async () => {
    const { browser, page, complaints } = await open(options);
    try {
      await look(page, `${name}-1-before`, false);
      await openScene(page, [castle ? join(castle, "database.db") : join(fixtures, "orbit/database.db")]);
      await page.waitForTimeout(300);
      await look(page, `${name}-2-opened`, false);
      await page.getByRole("region", { name: "Run" }).getByRole("button", { name: "Reconstruct" }).click();
      await page.waitForFunction(() => globalThis.watched.messages.some((m) => m.type === "snapshot"), undefined, { timeout: 60_000 });
      await look(page, `${name}-3-during`, false);
      await phase(page, ["done"], 90_000);
      // The last state is drawn and framed.
      await page.waitForTimeout(1500);
      await page.getByRole("region", { name: "Scene" }).scrollIntoViewIfNeeded();
      await look(page, `${name}-4-after`, true);
      await camerasInSight(page, name);
      assert.deepEqual(complaints, []);
    } finally {
      await browser.close();
    }
  });
}

test("the README's picture", { skip: !process.env.EPIPOLE_PICTURE && "only with `cargo xtask browser --picture`", timeout: 180_000 }, async () => {
  const path = process.env.EPIPOLE_PICTURE ?? "";
  const { browser, page } = await open({ theme: "dark", width: 1200, height: 720 });
  try {
    if (castle) {
      await page.locator('input[type="file"][aria-label="Folder"]').setInputFiles(castle);
      await phase(page, ["ready"]);
    } else {
      await button(page, "Try a sample").click();
      await phase(page, ["ready"]);
    }
    await page.waitForTimeout(1500);
    await reconstruct(page, 120_000);
    await page.waitForTimeout(3000);
    await page.screenshot({ path });
    const { size } = statSync(path);
    assert.ok(size <= PICTURE_BYTES, `${size} bytes`);
  } finally {
    await browser.close();
  }
});
