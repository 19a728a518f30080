// Dialogs: one way to open, title, close and clean up.

import { el } from "./dom.js";

let made = 0;

/**
 * @param {{ title: string, wide?: boolean, actions?: (HTMLElement|false|null)[], closed?: () => void }} options
 * @param {...(Node|string|false|null|undefined)} content
 */
export function dialog({ title, wide = false, actions, closed }, ...content) {
  const id = `dialog-${made++}`;
  const node = el("dialog", { "aria-labelledby": id, class: wide ? "wide" : "", onclose: () => {
    node.remove();
    closed?.();
  } },
  el("h2", { id }, title), ...content,
  el("div", { class: "actions" }, ...(actions ?? [el("button", { type: "button", onclick: () => node.close() }, "Close")])));
  // A press beside it closes it, as one expects.
  node.addEventListener("pointerdown", (event) => {
    const box = node.getBoundingClientRect();
    const inside = event.clientX >= box.left && event.clientX <= box.right && event.clientY >= box.top && event.clientY <= box.bottom;
    if (event.target === node && !inside) node.close();
  });
  return {
    node,
    close: () => node.close(),
    show: () => {
      document.body.append(node);
      node.showModal();
    },
  };
}
