// Prints the sizes of all that a first visit of the page loads, as it is and with brotli; the last number is the sum.
import { readFileSync, readdirSync } from "node:fs";
import { extname, join } from "node:path";
import { brotliCompressSync, constants } from "node:zlib";

const dist = process.argv[2];
/** The sample loads when it is asked for, source maps when the browser's tools are open. */
const later = new Set([".db", ".map"]);
const names = { ".wasm": "the engine", ".js": "modules", ".css": "styles", ".html": "the page", ".svg": "the icon" };
const groups = new Map();
for (const path of readdirSync(dist, { recursive: true })) {
  if (!extname(path) || later.has(extname(path))) continue;
  const group = names[extname(path)] ?? path;
  const data = readFileSync(join(dist, path));
  const packed = brotliCompressSync(data, { params: { [constants.BROTLI_PARAM_QUALITY]: 11, [constants.BROTLI_PARAM_LGWIN]: 24 } }).length;
  const sum = groups.get(group) ?? [0, 0];
  groups.set(group, [sum[0] + data.length, sum[1] + packed]);
}
let total = 0;
for (const [group, [bytes, packed]] of groups) {
  console.log(`${group}: ${bytes} bytes, compressed ${packed}`);
  total += packed;
}
console.log(`all compressed, bytes: ${total}`);
