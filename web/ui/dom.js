// Building elements without a framework.

/**
 * An element with properties and children. `on*` are listeners, `class` and `aria-*`/`data-*` attributes.
 * @template {keyof HTMLElementTagNameMap} T
 * @param {T} tag @param {Record<string, any>} [properties] @param {...(Node|string|null|undefined|false)} children
 * @returns {HTMLElementTagNameMap[T]}
 */
export function el(tag, properties = {}, ...children) {
  const node = document.createElement(tag);
  for (const [name, value] of Object.entries(properties)) {
    if (value === undefined || value === null || value === false) continue;
    if (name.startsWith("on")) node.addEventListener(name.slice(2), value);
    else if (name === "class" || name === "role" || name === "for" || name.includes("-")) node.setAttribute(name, value === true ? "" : String(value));
    else Reflect.set(node, name, value);
  }
  node.append(...children.filter((child) => child instanceof Node || typeof child === "string"));
  return node;
}

/** @param {Element} node @param {boolean} hidden */
export function hide(node, hidden) {
  node.classList.toggle("hidden", hidden);
}

/** A heading with a note at its right end: returns the row and both. @param {string} title @param {string} [note] */
export function heading(title, note = "") {
  const right = el("span", {}, note);
  const left = el("h2", {}, title);
  return { node: el("div", { class: "heading" }, left, right), title: left, note: right };
}

/** Runs `draw` at most once a frame, however often it is asked. @param {() => void} draw */
export function perFrame(draw) {
  let asked = false;
  return () => {
    if (asked) return;
    asked = true;
    requestAnimationFrame(() => {
      asked = false;
      draw();
    });
  };
}

/**
 * A canvas sized for the screen's pixels; returns its context scaled to CSS pixels. It is kept off the graphics device: small
 * drawings do not pay there, and the solver is using it. @param {HTMLCanvasElement} canvas
 */
export function sharpContext(canvas) {
  const ratio = Math.min(devicePixelRatio || 1, 2);
  const { width, height } = canvas.getBoundingClientRect();
  const [w, h] = [Math.max(1, Math.round(width * ratio)), Math.max(1, Math.round(height * ratio))];
  if (canvas.width !== w || canvas.height !== h) [canvas.width, canvas.height] = [w, h];
  const context = /** @type {CanvasRenderingContext2D} */ (canvas.getContext("2d", { willReadFrequently: true }));
  context.setTransform(ratio, 0, 0, ratio, 0, 0);
  context.clearRect(0, 0, width, height);
  return { context, width, height };
}

/** A colour of the theme. @param {string} name */
export function token(name) {
  return getComputedStyle(document.documentElement).getPropertyValue(name).trim();
}
