// Mouse, pen, touch and keys become movements of the view.

/** Radians a pixel of drag. */
const ORBIT = 0.006;
/** Held keys: distances to the target a second, radians a second. @type {Record<string, ["fly"|"orbit", number, number][]>} */
const DRIVES = {
  ArrowLeft: [["orbit", 0, -1.2]], ArrowRight: [["orbit", 0, 1.2]], ArrowUp: [["orbit", 1, -1.2]], ArrowDown: [["orbit", 1, 1.2]],
  w: [["fly", 2, 0.9]], s: [["fly", 2, -0.9]], a: [["fly", 0, -0.9]], d: [["fly", 0, 0.9]], q: [["fly", 1, -0.9]], e: [["fly", 1, 0.9]],
};
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
  // Keys move as long as they are held, at the screen's own pace: repeated key presses would stutter.
  /** @type {Set<string>} */
  const held = new Set();
  const drive = () => {
    /** @type {{ fly: number[], orbit: number[] }} */
    const speed = { fly: [0, 0, 0], orbit: [0, 0] };
    for (const key of held) DRIVES[key]?.forEach(([how, axis, amount]) => (speed[how][axis] += amount));
    view.send({ type: "drive", ...speed });
  };
  canvas.addEventListener("keydown", (event) => {
    if (event.ctrlKey || event.metaKey || event.altKey) return;
    const key = event.key.length === 1 ? event.key.toLowerCase() : event.key;
    const zoom = { "+": 0.9, "=": 0.9, "-": 1.1 }[key];
    if (!(key in DRIVES) && zoom === undefined) return;
    event.preventDefault();
    event.stopPropagation();
    if (zoom !== undefined) move("zoom", [zoom]);
    else if (!held.has(key)) {
      held.add(key);
      drive();
    }
  });
  const release = (/** @type {string[]} */ keys) => {
    const before = held.size;
    for (const key of keys) held.delete(key);
    if (held.size !== before) drive();
  };
  // The key may come up elsewhere, or never.
  addEventListener("keyup", (/** @type {KeyboardEvent} */ event) => release([event.key.length === 1 ? event.key.toLowerCase() : event.key]));
  canvas.addEventListener("blur", () => release([...held]));
}
