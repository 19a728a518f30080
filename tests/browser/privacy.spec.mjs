// Nothing leaves the tab: not from the page, not from its workers; `?url=` opens exactly one door.

import assert from "node:assert/strict";
import { readFileSync } from "node:fs";
import { createServer } from "node:http";
import { join } from "node:path";
import { test } from "node:test";
import { fixtures, open, phase, refusal } from "./page.mjs";

/** A server elsewhere that other pages may read, with what it was asked for. */
async function elsewhere() {
  /** @type {string[]} */
  const asked = [];
  const server = createServer((request, response) => {
    asked.push(request.url ?? "");
    response.setHeader("access-control-allow-origin", "*");
    if (request.url !== "/database.db") return response.writeHead(404).end();
    response.end(readFileSync(join(fixtures, "orbit/database.db")));
  }).listen(0, "127.0.0.1");
  await new Promise((resolve) => server.once("listening", resolve));
  return { asked, server, origin: `http://127.0.0.1:${/** @type {import("node:net").AddressInfo} */ (server.address()).port}` };
}

/** Tries to send something. */
const send = (/** @type {string} */ address) => fetch(address, { method: "POST", body: "secret", mode: "no-cors" }).then(() => "sent", () => "refused");

test("neither the page nor its workers can send anything anywhere", { timeout: 60_000 }, async () => {
  const { server, origin, asked } = await elsewhere();
  const { browser, page } = await open();
  try {
    assert.equal(await page.evaluate(send, `${origin}/from-page`), "refused");
    assert.ok(page.workers().length >= 1, "the engine has a worker");
    for (const worker of page.workers()) assert.equal(await worker.evaluate(send, `${origin}/from-worker`), "refused");
    assert.deepEqual(asked, []);
  } finally {
    await browser.close();
    server.close();
  }
});

test("?url= opens a scene from that origin and no other", { timeout: 60_000 }, async () => {
  const [named, other] = [await elsewhere(), await elsewhere()];
  const { browser, page } = await open({ query: `?url=${encodeURIComponent(`${named.origin}/database.db`)}` });
  try {
    await phase(page, ["ready"]);
    assert.deepEqual(named.asked, ["/database.db"]);
    assert.equal(await page.evaluate(send, `${other.origin}/from-page`), "refused");
    assert.deepEqual(other.asked, []);
    await page.goto(`${page.url().split("?")[0]}?url=${encodeURIComponent(`${named.origin}/gone.db`)}`);
    assert.match(await refusal(page), /gone\.db.*404/s);
  } finally {
    await browser.close();
    named.server.close();
    other.server.close();
  }
});
