// One registry of shortcuts: what listens is what the panel lists.

import { dialog } from "./dialog.js";
import { el } from "./dom.js";

/** @typedef {{ keys: string[], what: string, run: (event: KeyboardEvent) => void }} Shortcut */

/** @type {Shortcut[]} */
const registry = [];

/** @param {Shortcut[]} shortcuts */
export function addShortcuts(shortcuts) {
  registry.push(...shortcuts);
}

/** Whether a key press is meant for a field, a dialog or a button. @param {KeyboardEvent} event */
function isTaken({ target, key }) {
  if (!(target instanceof HTMLElement)) return false;
  if (target.closest("dialog") !== null) return true;
  if (target.tagName === "INPUT" && /** @type {HTMLInputElement} */ (target).type === "checkbox") return key === " ";
  if (/^(INPUT|SELECT|TEXTAREA)$/.test(target.tagName)) return key !== "?" || target.tagName !== "SELECT";
  return (key === "Enter" || key === " ") && target.closest("button, summary, a") !== null;
}

export function startShortcuts() {
  addEventListener("keydown", (/** @type {KeyboardEvent} */ event) => {
    if (event.ctrlKey || event.metaKey || event.altKey || isTaken(event)) return;
    // Capitals are the same keys.
    const key = event.key.length === 1 ? event.key.toLowerCase() : event.key;
    const hit = registry.find((shortcut) => shortcut.keys.includes(key));
    if (!hit) return;
    event.preventDefault();
    hit.run(event);
  });
}

export function showShortcuts() {
  const rows = registry.map(({ keys, what }) =>
    el("tr", {}, el("td", {}, ...keys.flatMap((key, k) => [k > 0 ? " " : "", el("kbd", {}, key === " " ? "space" : key.length === 1 ? key.toUpperCase() : key)])), el("td", {}, what)));
  const mouse = [["drag", "orbit"], ["right drag, two fingers", "pan"], ["wheel, pinch", "zoom"], ["click", "select a point or a camera"], ["double click", "fly to it"], ["arrow keys", "orbit, when the scene has the focus"], ["W A S D Q E", "fly, when the scene has the focus"], ["+ −", "zoom, when the scene has the focus"]]
    .map(([key, what]) => el("tr", {}, el("td", {}, key), el("td", {}, what)));
  dialog({ title: "Shortcuts" }, el("table", { class: "shortcuts" }, el("tbody", {}, ...rows, ...mouse))).show();
}
