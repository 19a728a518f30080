// Prints the sizes of all that a first visit of the page loads, as it is and with brotli; the last number is the sum.
import { readFileSync, readdirSync, statSync } from "node:fs";
import { join, relative } from "node:path";
import { brotliCompressSync, constants } from "node:zlib";

const root = process.argv[2];
const skip = new Set(["node_modules", "tests"]);
const files = [join(root, "index.html")];
const walk = (folder) => {
  for (const name of readdirSync(folder)) {
    const path = join(folder, name);
    if (statSync(path).isDirectory()) {
      if (!skip.has(name)) walk(path);
    } else if (/\.(js|css|svg|wasm)$/.test(name)) files.push(path);
  }
};
walk(join(root, "web"));
const groups = new Map();
for (const path of files) {
  const data = readFileSync(path);
  const packed = brotliCompressSync(data, { params: { [constants.BROTLI_PARAM_QUALITY]: 11, [constants.BROTLI_PARAM_LGWIN]: 24 } }).length;
  const group = /\.wasm$/.test(path) ? relative(root, path) : relative(root, path).startsWith("web/vendor") ? "web/vendor, JavaScript and styles" : "the page's own files";
  const sum = groups.get(group) ?? [0, 0];
  groups.set(group, [sum[0] + data.length, sum[1] + packed]);
}
let total = 0;
for (const [group, [bytes, packed]] of groups) {
  console.log(`${group}: ${bytes} bytes, compressed ${packed}`);
  total += packed;
}
console.log(`all compressed, bytes: ${total}`);
