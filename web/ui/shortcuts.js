// One registry of shortcuts: what listens is what the panel lists.

import { el } from "./dom.js";

/** @typedef {{ keys: string[], what: string, run: (event: KeyboardEvent) => void }} Shortcut */

/** @type {Shortcut[]} */
const registry = [];

/** @param {Shortcut[]} shortcuts */
export function addShortcuts(shortcuts) {
  registry.push(...shortcuts);
}

/** Whether a key press is meant for a field or a dialog. @param {EventTarget|null} target */
function isTyping(target) {
  return target instanceof HTMLElement && (target.isContentEditable || /^(INPUT|SELECT|TEXTAREA)$/.test(target.tagName) || target.closest("dialog") !== null);
}

export function startShortcuts() {
  addEventListener("keydown", (/** @type {KeyboardEvent} */ event) => {
    if (event.ctrlKey || event.metaKey || event.altKey || isTyping(event.target)) return;
    const hit = registry.find((shortcut) => shortcut.keys.includes(event.key));
    if (!hit) return;
    event.preventDefault();
    hit.run(event);
  });
}

export function showShortcuts() {
  const rows = registry.map(({ keys, what }) =>
    el("tr", {}, el("td", {}, ...keys.flatMap((key, k) => [k > 0 ? " " : "", el("kbd", {}, key === " " ? "space" : key)])), el("td", {}, what)));
  const mouse = [["drag", "orbit"], ["right drag, two fingers", "pan"], ["wheel, pinch", "zoom"], ["click", "select a point or a camera"], ["double click", "fly to it"]]
    .map(([key, what]) => el("tr", {}, el("td", {}, key), el("td", {}, what)));
  const close = el("button", { type: "button", onclick: () => dialog.close() }, "Close");
  const dialog = el("dialog", { "aria-labelledby": "shortcuts-title", onclose: () => dialog.remove() },
    el("h2", { id: "shortcuts-title" }, "Shortcuts"),
    el("table", {}, el("tbody", {}, ...rows, ...mouse)),
    el("div", { class: "actions" }, close));
  document.body.append(dialog);
  dialog.showModal();
}
