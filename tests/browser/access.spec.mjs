// Everybody can use the page: axe finds nothing serious, and the whole flow goes by keyboard.

import assert from "node:assert/strict";
import { readFileSync } from "node:fs";
import { join } from "node:path";
import { test } from "node:test";
import { button, evaluate, fixtures, open, openScene, out, panel, phase, reconstruct } from "./page.mjs";
import { unpack } from "./archive.mjs";

const axe = readFileSync(new URL("../../web/node_modules/axe-core/axe.min.js", import.meta.url), "utf8");

/** What axe finds that keeps somebody out. @param {import("./page.mjs").Page} page @param {string} where */
async function check(page, where) {
  // The page's own policy refuses an added script: evaluated, it is the browser's.
  if (!(await page.evaluate(() => "axe" in globalThis))) await page.evaluate(axe);
  const [rules, found] = await page.evaluate(async () => {
    const { violations, passes } = await globalThis.axe.run(document);
    return [passes.length, violations.map(({ id, impact, help, nodes }) => ({ id, impact, help, nodes: nodes.map(({ target, failureSummary }) => `${target}: ${failureSummary}`) }))];
  });
  assert.ok(rules > 15, `${where}: only ${rules} rules had something to look at`);
  for (const { id, impact, help } of found) console.log(`${where}: ${impact}: ${id}, ${help}`);
  assert.deepEqual(found.filter(({ impact }) => impact === "serious" || impact === "critical"), [], where);
}

for (const theme of /** @type {const} */ (["dark", "light"])) {
  test(`axe finds nothing serious in the ${theme} theme`, { timeout: 120_000 }, async () => {
    const { browser, page } = await open({ theme });
    try {
      await check(page, "empty");
      await openScene(page, [join(fixtures, "orbit/database.db")]);
      await check(page, "opened");
      await page.getByRole("region", { name: "Run" }).getByRole("button", { name: "Settings" }).click();
      await check(page, "settings");
      await page.keyboard.press("Escape");
      await reconstruct(page, 60_000);
      await check(page, "solved");
      await page.keyboard.press("n");
      await page.waitForTimeout(300);
      await check(page, "an image");
      await page.keyboard.press("?");
      await check(page, "shortcuts");
      await page.keyboard.press("Escape");
      await page.keyboard.press("d");
      await check(page, "download");
    } finally {
      await browser.close();
    }
  });
}

/** Moves the focus on until it is where it should be; fails after a whole round. @param {import("./page.mjs").Page} page @param {string} name */
async function tabTo(page, name) {
  for (let k = 0; k < 80; k += 1) {
    await page.keyboard.press("Tab");
    const at = await page.evaluate(() => {
      const node = document.activeElement;
      const box = node?.getBoundingClientRect();
      const style = node && getComputedStyle(node);
      return { name: node?.getAttribute("aria-label") ?? node?.textContent?.trim() ?? "", seen: Boolean(box && box.width > 0 && box.height > 0), ring: style ? `${style.outlineStyle} ${style.outlineWidth} ${style.boxShadow}` : "" };
    });
    if (at.name !== name) continue;
    assert.ok(at.seen, `${name} has the focus and is not to be seen`);
    assert.doesNotMatch(at.ring, /^none \S+ none$/, `${name} does not show that it has the focus`);
    return;
  }
  assert.fail(`no way to ${name} by Tab`);
}

test("the whole flow goes by keyboard alone", { timeout: 120_000 }, async () => {
  const { browser, page, complaints } = await open();
  try {
    await tabTo(page, "Try a sample");
    await page.keyboard.press("Enter");
    await phase(page, ["ready"]);
    await tabTo(page, "Settings");
    await page.keyboard.press("Space");
    await page.getByRole("dialog").waitFor();
    await page.keyboard.press("Escape");
    await page.getByRole("dialog").waitFor({ state: "detached" });
    await tabTo(page, "Reconstruct");
    await page.keyboard.press("Enter");
    await phase(page, ["done"]);
    assert.match(await panel(page, "Run"), /18 of 18 images placed/);
    // The scene: fly to an image, turn, come back.
    await page.keyboard.press("n");
    await page.keyboard.press("c");
    await page.keyboard.press("f");
    await tabTo(page, "Download model");
    await page.keyboard.press("Enter");
    await page.getByRole("dialog").waitFor();
    await tabTo(page, "Download");
    const started = page.waitForEvent("download");
    await page.keyboard.press("Enter");
    await (await started).saveAs(join(out, "keyboard.zip"));
    const names = unpack(join(out, "keyboard.zip"), join(out, "keyboard"));
    const cameras = names.find((name) => name.endsWith("cameras.bin")) ?? "";
    assert.equal(evaluate(join(out, "keyboard", cameras, ".."), join(fixtures, "orbit/truth")).common_images, 18);
    assert.equal(await button(page, "Reconstruct").count(), 0);
    assert.deepEqual(complaints, []);
  } finally {
    await browser.close();
  }
});
