// The whole way: a database goes in, a model comes out.

import assert from "node:assert/strict";
import { mkdir } from "node:fs/promises";
import { join } from "node:path";
import { test } from "node:test";
import { button, choose, open, out, reconstruct, shared } from "./page.mjs";

await mkdir(out, { recursive: true });

test("the sample is reconstructed, inspected and downloaded", async () => {
  const { browser, page, complaints, readyMs } = await open();
  try {
    await page.screenshot({ path: join(out, "before.png") });
    await button(page, "Try a sample").click();
    await button(page, "Reconstruct").waitFor();
    const solved = await reconstruct(page, 60_000);
    await page.waitForTimeout(500);
    await page.screenshot({ path: join(out, "sample.png") });
    console.log(`first interaction after ${readyMs} ms, sample solved in ${solved} ms`);
    assert.match(await page.locator(".now").innerText(), /of \d+ images are placed/);
    await button(page, "Download model").click();
    const download = page.waitForEvent("download");
    await button(page, "Download").click();
    const saved = join(out, "sample.zip");
    await (await download).saveAs(saved);
    assert.deepEqual(complaints, []);
  } finally {
    await browser.close();
  }
});

for (const gpu of [true, false]) {
  test(`Herz-Jesus-P8 is reconstructed ${gpu ? "with" : "without"} WebGPU`, { skip: shared === "" && "no shared data" }, async () => {
    const { browser, page, complaints } = await open({ gpu });
    try {
      await choose(page, [join(shared, "data/strecha_Herz-Jesus-P8/database.db")]);
      await button(page, "Reconstruct").waitFor({ timeout: 30_000 });
      const solved = await reconstruct(page, 180_000);
      console.log(`Herz-Jesus-P8 ${gpu ? "with" : "without"} WebGPU: ${solved} ms`);
      assert.match(await page.locator(".now").innerText(), /8 of 8 images are placed/);
      await page.waitForTimeout(500);
      await page.screenshot({ path: join(out, `herz-jesus-${gpu ? "gpu" : "cpu"}.png`) });
      const long = await page.evaluate(() => Reflect.get(globalThis, "longTasks"));
      console.log("tasks over 50 ms on the page's thread:", JSON.stringify(long));
      assert.deepEqual(complaints, []);
    } finally {
      await browser.close();
    }
  });
}
