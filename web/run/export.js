// Downloads: which files, of which model, as one zip or one by one.

import { el, hide } from "../ui/dom.js";
import { count, plural } from "../ui/format.js";
import { zip } from "../files/zip-writer.js";

const FORMATS = /** @type {const} */ ([
  ["colmap_bin", "COLMAP model, binary", true],
  ["colmap_txt", "COLMAP model, text", false],
  ["ply", "Point cloud (PLY)", false],
  ["transforms", "transforms.json (nerfstudio)", false],
  ["report", "Settings and report (JSON)", true],
]);

/** @param {string} name @param {BlobPart[]} parts @param {string} type */
export function save(name, parts, type = "application/octet-stream") {
  const address = URL.createObjectURL(new Blob(parts, { type }));
  const link = el("a", { href: address, download: name });
  document.body.append(link);
  link.click();
  link.remove();
  setTimeout(() => URL.revokeObjectURL(address), 60_000);
}

/**
 * @param {import("../store.js").Store} store @param {import("../engine/client.js").Engine} engine
 * @param {Record<string, any>} settings @param {(problem: import("../engine/protocol.js").Failure) => void} failed
 */
export function exportDialog(store, engine, settings, failed) {
  const { report, filter, component } = store.state;
  const boxes = FORMATS.map(([id, label, on]) => ({ id, box: el("input", { type: "checkbox", checked: on }), label }));
  const asZip = el("input", { type: "checkbox", checked: true });
  const filtered = Number.isFinite(filter.maxErrorPx) || filter.minTrack > 2;
  const applyFilter = el("input", { type: "checkbox", checked: true });
  const go = el("button", { type: "button", class: "main", onclick: () => download() }, "Download");
  const busy = el("p", { class: "quiet hidden", role: "status" }, "Writing…");
  const parts = report?.components ?? [];
  const what = component === null || parts.length < 2 ? `${plural(parts.length || 1, "model")}` : `model ${component + 1}: ${plural(parts[component].images, "image")}, ${count(parts[component].points)} points`;

  async function download() {
    const formats = boxes.filter(({ box }) => box.checked).map(({ id }) => id);
    if (formats.length === 0) return;
    go.disabled = true;
    hide(busy, false);
    try {
      const all = { maxErrorPx: Infinity, minTrack: 2 };
      /** @type {{ path: string, bytes: Uint8Array<ArrayBuffer> }[]} */
      const files = await engine.ask({ type: "export", formats, component, filter: applyFilter.checked ? filter : all, settings });
      const base = (store.state.opened?.name ?? "scene").replace(/\.[^.]+$/, "");
      if (asZip.checked || files.length > 12) save(`${base}.zip`, [zip(files)], "application/zip");
      else for (const { path, bytes } of files) save(path.replaceAll("/", "_"), [bytes]);
      dialog.close();
    } catch (error) {
      const { failure, message } = /** @type {any} */ (error);
      failed(failure ?? { file: "export", message, hint: "" });
      dialog.close();
    }
  }

  const dialog = el("dialog", { "aria-labelledby": "export-title", onclose: () => dialog.remove() },
    el("h2", { id: "export-title" }, "Download"),
    el("p", { class: "quiet" }, what),
    ...boxes.map(({ box, label }) => el("label", { class: "check" }, box, label)),
    filtered && el("label", { class: "check" }, applyFilter, "only the points that are shown"),
    el("label", { class: "check" }, asZip, "as one zip"),
    busy,
    el("div", { class: "actions" }, el("button", { type: "button", onclick: () => dialog.close() }, "Cancel"), go));
  document.body.append(dialog);
  dialog.showModal();
}
