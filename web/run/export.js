// Downloads: which files, of which model, as one zip or one by one.

import { zip } from "../files/zip-writer.js";
import { dialog } from "../ui/dialog.js";
import { el, hide } from "../ui/dom.js";
import { count, plural } from "../ui/format.js";

const FORMATS = /** @type {const} */ ([
  ["colmap_bin", "COLMAP model, binary", true],
  ["colmap_txt", "COLMAP model, text", false],
  ["ply", "Point cloud (PLY)", false],
  ["transforms", "transforms.json (nerfstudio)", false],
  ["report", "Settings and report (JSON)", true],
]);
/** Browsers ask before a page may save many files: then one zip is kinder. */
const MOST_FILES = 12;

/** @param {string} name @param {BlobPart[]} parts @param {string} [type] */
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
  const { report, filter, component, opened } = store.state;
  const boxes = FORMATS.filter(([id]) => id !== "report" || report).map(([id, label, on]) => ({ id, box: el("input", { type: "checkbox", checked: on, onchange: () => choose() }), label }));
  const asZip = el("input", { type: "checkbox", checked: true });
  const filtered = Number.isFinite(filter.maxErrorPx) || filter.minTrack > 2;
  const applyFilter = el("input", { type: "checkbox", checked: true });
  const go = el("button", { type: "button", class: "main", onclick: () => download() }, "Download");
  const busy = el("p", { class: "quiet hidden", role: "status" }, "Writing…");
  const parts = report?.components ?? [];
  const described = (/** @type {number} */ k) => `model ${k + 1}: ${plural(parts[k].images, "image")}, ${count(parts[k].points)} points`;
  const which = el("select", {}, el("option", { value: "" }, `all ${parts.length} models`), ...parts.map((_, k) => el("option", { value: String(k), selected: k === component }, described(k))));

  const choose = () => {
    go.disabled = boxes.every(({ box }) => !box.checked);
  };

  async function download() {
    const formats = boxes.filter(({ box }) => box.checked).map(({ id }) => id);
    go.disabled = true;
    hide(busy, false);
    try {
      const all = { maxErrorPx: Infinity, minTrack: 2 };
      /** @type {{ path: string, bytes: Uint8Array<ArrayBuffer> }[]} */
      const files = await engine.ask({ type: "export", formats, component: which.value === "" ? null : Number(which.value), filter: filtered && applyFilter.checked ? filter : all, settings });
      const base = (opened?.name ?? "scene").replace(/\/database\.db$/, "").replace(/\.[^.]+$/, "").replaceAll("/", "_");
      if (asZip.checked || files.length > MOST_FILES) save(`${base}.zip`, [await zip(files)], "application/zip");
      else for (const { path, bytes } of files) save(path.replaceAll("/", "_"), [bytes]);
    } catch (error) {
      const { failure, message } = /** @type {any} */ (error);
      failed(failure ?? { file: "the download", message, hint: "" });
    }
    box.close();
  }

  const check = (/** @type {HTMLElement} */ field, /** @type {string} */ label) => el("label", { class: "check" }, field, label);
  const limits = [Number.isFinite(filter.maxErrorPx) && `error up to ${filter.maxErrorPx} px`, filter.minTrack > 2 && `seen ${filter.minTrack} times or more`].filter(Boolean).join(", ");
  const box = dialog({ title: "Download", actions: [el("button", { type: "button", onclick: () => box.close() }, "Cancel"), go] },
    parts.length > 1 ? el("label", { class: "row" }, el("span", {}, "Which"), which) : parts.length === 1 && el("p", { class: "quiet" }, described(0)),
    el("fieldset", {}, el("legend", {}, "Files"), ...boxes.map(({ box: field, label }) => check(field, label))),
    filtered && check(applyFilter, `only the points that are shown (${limits})`),
    check(asZip, "as one zip"), busy);
  box.show();
}
