// Mouse, pen, touch and keys become movements of the view.

/** Radians a pixel of drag. */
const ORBIT = 0.006;
const KEY_STEP = 0.06;
/** A press that moves less than this is a click. */
const CLICK_PX = 5;

/**
 * @param {HTMLCanvasElement} canvas @param {import("./view.js").View} view
 * @param {{ click: (x: number, y: number) => void, doubleClick: (x: number, y: number) => void }} on
 */
export function startControls(canvas, view, on) {
  /** @type {Map<number, {x: number, y: number}>} */
  const fingers = new Map();
  let travelled = 0;
  let button = 0;
  const move = (/** @type {string} */ how, /** @type {number[]} */ amount) => view.send({ type: "move", how, amount });

  canvas.addEventListener("pointerdown", (event) => {
    canvas.setPointerCapture(event.pointerId);
    fingers.set(event.pointerId, { x: event.clientX, y: event.clientY });
    if (fingers.size === 1) [travelled, button] = [0, event.button];
  });
  canvas.addEventListener("pointermove", (event) => {
    const before = fingers.get(event.pointerId);
    if (!before) return;
    const [dx, dy] = [event.clientX - before.x, event.clientY - before.y];
    travelled += Math.hypot(dx, dy);
    if (fingers.size === 1) {
      if (button === 2 || button === 1 || event.shiftKey) move("pan", [dx / canvas.clientHeight, dy / canvas.clientHeight]);
      else move(event.ctrlKey ? "look" : "orbit", [dx * ORBIT, dy * ORBIT]);
    } else if (fingers.size === 2) {
      const other = [...fingers.entries()].find(([id]) => id !== event.pointerId)?.[1];
      if (other) {
        const apart = Math.hypot(before.x - other.x, before.y - other.y);
        const next = Math.hypot(event.clientX - other.x, event.clientY - other.y);
        if (next > 1) move("zoom", [apart / next]);
        move("pan", [dx / 2 / canvas.clientHeight, dy / 2 / canvas.clientHeight]);
      }
    }
    fingers.set(event.pointerId, { x: event.clientX, y: event.clientY });
  });
  const place = (/** @type {MouseEvent} */ event) => {
    const box = canvas.getBoundingClientRect();
    return /** @type {[number, number]} */ ([event.clientX - box.left, event.clientY - box.top]);
  };
  const lift = (/** @type {PointerEvent} */ event) => {
    const wasOne = fingers.size === 1 && fingers.has(event.pointerId);
    fingers.delete(event.pointerId);
    if (wasOne && travelled < CLICK_PX && button === 0 && event.type === "pointerup") on.click(...place(event));
  };
  canvas.addEventListener("pointerup", lift);
  canvas.addEventListener("pointercancel", lift);
  canvas.addEventListener("dblclick", (event) => on.doubleClick(...place(event)));
  canvas.addEventListener("contextmenu", (event) => event.preventDefault());
  canvas.addEventListener("wheel", (event) => {
    event.preventDefault();
    const lines = event.deltaMode === 1 ? 16 : 1;
    move("zoom", [Math.exp(Math.min(Math.max(event.deltaY * lines, -400), 400) * 0.0015)]);
  }, { passive: false });
  canvas.addEventListener("keydown", (event) => {
    if (event.ctrlKey || event.metaKey || event.altKey) return;
    /** @type {Record<string, [string, number[]]>} */
    const keys = {
      ArrowLeft: ["orbit", [-0.08, 0]], ArrowRight: ["orbit", [0.08, 0]], ArrowUp: ["orbit", [0, -0.08]], ArrowDown: ["orbit", [0, 0.08]],
      w: ["fly", [0, 0, KEY_STEP]], s: ["fly", [0, 0, -KEY_STEP]], a: ["fly", [-KEY_STEP, 0, 0]], d: ["fly", [KEY_STEP, 0, 0]],
      q: ["fly", [0, -KEY_STEP, 0]], e: ["fly", [0, KEY_STEP, 0]], "+": ["zoom", [0.9]], "=": ["zoom", [0.9]], "-": ["zoom", [1.1]],
    };
    const hit = keys[event.key];
    if (!hit) return;
    event.preventDefault();
    event.stopPropagation();
    move(...hit);
  });
}
