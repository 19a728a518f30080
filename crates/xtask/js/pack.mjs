// Writes what a visitor gets to `web/dist`, a folder for any server: the page's modules and styles put together and made small.
// Apart they are sixty requests, with comments and types as a third of their bytes.
import { cp, mkdir, readdir, rm } from "node:fs/promises";
import { join } from "node:path";

const root = process.argv[2];
const web = join(root, "web");
const dist = join(web, "dist");
const { build } = await import(join(web, "node_modules/esbuild/lib/main.js"));

// One folder for all, so that `import.meta.url` gives the same base in every bundle. A worker is named after its folder.
const entries = { app: join(web, "app.js"), policy: join(web, "policy.js"), page: join(web, "styles/page.css") };
for (const path of await readdir(web, { recursive: true })) {
  const [folder, name, ...deeper] = path.split(/[\\/]/);
  if (name?.endsWith("worker.js") && folder !== "node_modules" && deeper.length === 0) entries[`${folder}-${name.slice(0, -3)}`] = join(web, path);
}

await rm(dist, { recursive: true, force: true });
await mkdir(join(dist, "web"), { recursive: true });
await build({
  entryPoints: entries, outdir: join(dist, "web"), bundle: true, minify: true, format: "esm", charset: "utf8", logLevel: "warning",
  // What two of them need is a file of its own: the engine's worker and its helpers stand on the same JavaScript.
  splitting: true,
  // For whoever opens the browser's tools: no visit loads them.
  sourcemap: "linked",
});
for (const [from, to] of [
  ["index.html", "index.html"],
  ["web/icon.svg", "web/icon.svg"],
  ["web/vendor/epipole_web_bg.wasm", "web/epipole_web_bg.wasm"],
  ["tests/fixtures/orbit/database.db", "web/sample.db"],
]) await cp(join(root, from), join(dist, to));
