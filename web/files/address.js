// Scenes by address: `?url=`, and the sample.

import { Refusal } from "../engine/client.js";

/** @typedef {import("../engine/protocol.js").Entry} Entry */

/** More than this is not loaded without a question: a phone pays for every byte. */
const ASK_BYTES = 300e6;

/**
 * A file from an address, with progress. @param {string} address
 * @param {(done: number, total: number) => void} progress @param {AbortSignal} [signal] @returns {Promise<Entry[]>}
 */
export async function fromUrl(address, progress, signal) {
  const fail = (/** @type {string} */ message, /** @type {string} */ hint) => new Refusal({ file: address, message, hint });
  let url;
  try {
    url = new URL(address, location.href);
  } catch {
    throw fail("this is no address", "write ?url=https://… with the whole address of a database.db or a zip");
  }
  let response;
  try {
    response = await fetch(url, { credentials: "omit", referrerPolicy: "no-referrer", signal });
  } catch (error) {
    if (signal?.aborted) throw error;
    throw fail("the address cannot be read", "its server must allow other pages to read it (CORS) and must not send on to another server; or download the file and drop it here");
  }
  if (!response.ok || !response.body) throw fail(`the server answered ${response.status}`, "check the address");
  const total = Number(response.headers.get("content-length")) || 0;
  if (total > ASK_BYTES && !confirm(`This loads ${(total / 1e6).toFixed(0)} MB from ${url.host}. Load it?`)) throw fail("it was not loaded", "download it and drop it here");
  let done = 0;
  const counted = response.body.pipeThrough(new TransformStream({
    transform(chunk, controller) {
      done += chunk.byteLength;
      progress(done, total);
      controller.enqueue(chunk);
    },
  }));
  const name = decodeURIComponent(url.pathname.split("/").at(-1) || "download");
  return [{ path: name, file: new File([await new Response(counted).blob()], name) }];
}

/**
 * Opens what `?url=` names: once, so that a scene that brings the tab down does not do so for ever.
 * @param {import("../session.js").Session} session @param {(signal: AbortSignal, address: string) => Promise<Entry[]>} read
 */
export function openAddress(session, read) {
  const address = new URLSearchParams(location.search).get("url");
  if (!address) return;
  const guard = `epipole.opening:${address}`;
  if (sessionStorage.getItem(guard)) {
    sessionStorage.removeItem(guard);
    session.problem({ file: address, message: "opening it did not end well the last time", hint: "reload once more to try again, or download the file and drop it here" });
    return;
  }
  sessionStorage.setItem(guard, "1");
  session.open((signal) => read(signal, address), address).finally(() => sessionStorage.removeItem(guard));
}
