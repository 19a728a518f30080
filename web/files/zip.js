// Zip archives read by ranges: the directory first, then each file as a stream. Sizes are checked before and while
// unpacking, so a small archive cannot fill the memory.

import { Refusal } from "../engine/client.js";

/** @typedef {import("../engine/protocol.js").Entry} Entry */

/** Unpacked bytes at most: what a tab can hold beside a solve. */
const MAX_BYTES = 3e9;
/** Data unpacks to at most some 1 030 times its size; images and databases to a few times. More is no scene. */
const MAX_RATIO = 200;
const MAX_ENTRIES = 200_000;

/** @param {Entry} archive @param {(text: string) => void} told @returns {Promise<Entry[]>} */
export async function unzip({ path, file }, told) {
  const fail = (/** @type {string} */ message, hint = "pack the files again") => new Refusal({ file: path, message, hint });
  const directory = await readDirectory(file, fail);
  const wanted = directory.filter(({ name }) => !name.endsWith("/"));
  if (wanted.length > MAX_ENTRIES) throw fail(`it holds ${wanted.length} files`, "drop only the scene");
  const total = wanted.reduce((sum, { size }) => sum + size, 0);
  if (total > MAX_BYTES) throw fail(`it would unpack to ${(total / 1e9).toFixed(1)} GB`, "unpack it and drop the folder");
  const suspicious = wanted.find(({ size, packed }) => size > 1e6 && size > MAX_RATIO * Math.max(packed, 1));
  if (suspicious) throw fail(`${suspicious.name} claims to unpack to ${Math.round(suspicious.size / Math.max(suspicious.packed, 1))} times its size`, "this is no scene; unpack it yourself if you trust it");
  /** @type {Entry[]} */
  const entries = [];
  for (const [k, item] of wanted.entries()) {
    told(`Unpacking ${path}: ${k + 1} of ${wanted.length}`);
    entries.push({ path: item.name, file: new File([await unpack(file, item, fail)], item.name.split("/").at(-1) ?? item.name) });
  }
  return entries;
}

/** @typedef {{ name: string, method: number, packed: number, size: number, offset: number }} Item */

/** @param {Blob} file @param {number} from @param {number} to */
const view = async (file, from, to) => new DataView(await file.slice(from, to).arrayBuffer());

/**
 * The central directory, zip64 included (source: PKWARE APPNOTE 6.3 §4.3).
 * @param {File} file @param {(message: string, hint?: string) => Refusal} fail @returns {Promise<Item[]>}
 */
async function readDirectory(file, fail) {
  const tailStart = Math.max(0, file.size - 66_000);
  const tail = await view(file, tailStart, file.size);
  let at = tail.byteLength - 22;
  while (at >= 0 && tail.getUint32(at, true) !== 0x06054b50) at -= 1;
  if (at < 0) throw fail("the archive is cut off: its directory is missing", "copy it again");
  let [count, size, start] = [tail.getUint16(at + 10, true), tail.getUint32(at + 12, true), tail.getUint32(at + 16, true)];
  if (at >= 20 && tail.getUint32(at - 20, true) === 0x07064b50) {
    const end = Number(tail.getBigUint64(at - 12, true));
    const end64 = await view(file, end, end + 56);
    if (end64.byteLength < 56) throw fail("the archive is cut off", "copy it again");
    [count, size, start] = [Number(end64.getBigUint64(32, true)), Number(end64.getBigUint64(40, true)), Number(end64.getBigUint64(48, true))];
  }
  if (start + size > file.size) throw fail("the archive is cut off", "copy it again");
  const data = await view(file, start, start + size);
  const items = [];
  let p = 0;
  for (let k = 0; k < count; k += 1) {
    if (p + 46 > data.byteLength || data.getUint32(p, true) !== 0x02014b50) throw fail("its directory is damaged");
    const [flags, nameBytes, extraBytes, commentBytes] = [8, 28, 30, 32].map((o) => data.getUint16(p + o, true));
    const item = {
      name: new TextDecoder().decode(new Uint8Array(data.buffer, p + 46, Math.min(nameBytes, data.byteLength - p - 46))),
      method: data.getUint16(p + 10, true),
      packed: data.getUint32(p + 20, true),
      size: data.getUint32(p + 24, true),
      offset: data.getUint32(p + 42, true),
    };
    if (flags & 1) throw fail(`${item.name} is encrypted`, "unpack it with the password and drop the folder");
    widen(item, data, p + 46 + nameBytes, extraBytes);
    items.push(item);
    p += 46 + nameBytes + extraBytes + commentBytes;
  }
  return items;
}

/** Sizes of 4 GB and more stand in an extra field. @param {Item} item @param {DataView} data @param {number} start @param {number} length */
function widen(item, data, start, length) {
  for (let p = start; p + 4 <= Math.min(start + length, data.byteLength); ) {
    const [id, bytes] = [data.getUint16(p, true), data.getUint16(p + 2, true)];
    let q = p + 4;
    const wide = () => {
      const value = q + 8 <= data.byteLength ? Number(data.getBigUint64(q, true)) : 0;
      q += 8;
      return value;
    };
    if (id === 1) {
      if (item.size === 0xffffffff) item.size = wide();
      if (item.packed === 0xffffffff) item.packed = wide();
      if (item.offset === 0xffffffff) item.offset = wide();
    }
    p += 4 + bytes;
  }
}

/** @param {File} file @param {Item} item @param {(message: string, hint?: string) => Refusal} fail @returns {Promise<Blob>} */
async function unpack(file, item, fail) {
  const local = await view(file, item.offset, item.offset + 30);
  if (local.byteLength < 30 || local.getUint32(0, true) !== 0x04034b50) throw fail(`${item.name} is damaged`);
  const start = item.offset + 30 + local.getUint16(26, true) + local.getUint16(28, true);
  const packed = file.slice(start, start + item.packed);
  if (item.method === 0) return packed;
  if (item.method !== 8) throw fail(`${item.name} is packed with method ${item.method}`, "pack with the usual method (deflate)");
  let done = 0;
  /** A response does not pass on why its stream ended. @type {Refusal|null} */
  let refused = null;
  const guarded = packed.stream().pipeThrough(new DecompressionStream("deflate-raw")).pipeThrough(new TransformStream({
    transform(chunk, controller) {
      done += chunk.byteLength;
      if (done <= item.size) {
        controller.enqueue(chunk);
        return;
      }
      refused = fail(`${item.name} unpacks to more than its directory says`, "this is no honest archive; unpack it yourself if you trust it");
      controller.error(refused);
    },
  }));
  try {
    return await new Response(guarded).blob();
  } catch {
    throw refused ?? fail(`${item.name} is damaged`, "copy the archive again");
  }
}
