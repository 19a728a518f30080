// A button that opens a small sheet of further controls beside it.

import { el, hide } from "./dom.js";

let made = 0;

/** @param {string} label @param {string} title @param {...HTMLElement} content */
export function sheet(label, title, ...content) {
  const id = `sheet-${made++}`;
  const mark = el("i", { class: "dot accent hidden", title: "in use" });
  const button = el("button", { type: "button", class: "link-like", "aria-expanded": "false", "aria-controls": id, onclick: () => toggle(box.classList.contains("hidden")) }, label, mark);
  const box = el("div", { id, class: "sheet hidden", role: "group", "aria-label": title }, ...content);
  const node = el("div", { class: "sheet-holder" }, button, box);

  /** @param {boolean} open */
  function toggle(open) {
    hide(box, !open);
    button.setAttribute("aria-expanded", String(open));
    if (open) /** @type {HTMLElement|null} */ (box.querySelector("input, select, button"))?.focus();
  }
  node.addEventListener("keydown", (event) => {
    if (event.key !== "Escape" || box.classList.contains("hidden")) return;
    event.stopPropagation();
    toggle(false);
    button.focus();
  });
  // A press elsewhere closes it, as every menu does.
  addEventListener("pointerdown", (event) => {
    if (!node.contains(/** @type {Node} */ (event.target))) toggle(false);
  });
  return { node, close: () => toggle(false), mark: (/** @type {boolean} */ on) => {
    hide(mark, !on);
    button.classList.toggle("plain", on);
  } };
}
