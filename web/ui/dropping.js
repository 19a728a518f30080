// Files come by drop anywhere on the page, by picker, or pasted.

import { fromDrop, fromPicker } from "../files/intake.js";
import { el } from "./dom.js";

/** @param {(entries: () => Promise<import("../engine/protocol.js").Entry[]>, what: string) => void} open */
export function startDropping(open) {
  const files = el("input", { type: "file", multiple: true, class: "hidden", "aria-label": "Files", tabIndex: -1, onchange: () => picked(files) });
  const folder = el("input", { type: "file", multiple: true, class: "hidden", "aria-label": "Folder", tabIndex: -1, webkitdirectory: true, onchange: () => picked(folder) });
  document.body.append(files, folder);

  /** @param {HTMLInputElement} input */
  function picked(input) {
    const entries = fromPicker(/** @type {FileList} */ (input.files));
    const what = entries[0]?.path ?? "the folder";
    input.value = "";
    open(async () => entries, what);
  }

  /** Elements under the pointer with a dragged file: entering a child comes before leaving its parent. */
  let depth = 0;
  const carriesFiles = (/** @type {DragEvent} */ event) => event.dataTransfer?.types.includes("Files") ?? false;
  const dragging = (/** @type {boolean} */ on) => document.body.classList.toggle("dragging", on);
  addEventListener("dragenter", (/** @type {DragEvent} */ event) => {
    if (!carriesFiles(event)) return;
    event.preventDefault();
    depth += 1;
    dragging(true);
  });
  addEventListener("dragleave", (/** @type {DragEvent} */ event) => {
    if (!carriesFiles(event)) return;
    depth -= 1;
    if (depth <= 0) dragging(false);
  });
  addEventListener("dragover", (event) => event.preventDefault());
  addEventListener("drop", (/** @type {DragEvent} */ event) => {
    event.preventDefault();
    depth = 0;
    dragging(false);
    if (event.dataTransfer && carriesFiles(event)) {
      const entries = fromDrop(event.dataTransfer);
      open(() => entries, "what was dropped");
    }
  });
  addEventListener("paste", (/** @type {ClipboardEvent} */ event) => {
    const pasted = [...(event.clipboardData?.files ?? [])];
    if (pasted.length > 0) open(async () => pasted.map((file) => ({ path: file.name, file })), "what was pasted");
  });
  return { pickFiles: () => files.click(), pickFolder: () => folder.click() };
}
