// The widths of the side panels: by mouse, by touch, by arrow keys.

const LIMITS = { min: 220, max: 640 };

/** @param {HTMLElement} divider @param {HTMLElement} panels @param {"inputs"|"run"} side */
export function startDivider(divider, panels, side) {
  const property = `--${side}-width`;
  const panel = /** @type {HTMLElement} */ (document.getElementById(side));
  /** @param {number} width */
  const set = (width) => {
    const room = panels.clientWidth - 340 - (side === "inputs" ? 330 : 310);
    const clamped = Math.round(Math.min(Math.max(width, LIMITS.min), Math.max(LIMITS.min, Math.min(LIMITS.max, room))));
    panels.style.setProperty(property, `${clamped}px`);
    divider.setAttribute("aria-valuenow", String(clamped));
  };
  divider.setAttribute("aria-valuemin", String(LIMITS.min));
  divider.setAttribute("aria-valuemax", String(LIMITS.max));
  divider.setAttribute("aria-valuenow", String(panel.clientWidth || 310));
  const sign = side === "inputs" ? 1 : -1;
  divider.addEventListener("pointerdown", (down) => {
    divider.setPointerCapture(down.pointerId);
    const start = panel.clientWidth;
    /** @param {PointerEvent} move */
    const drag = (move) => set(start + sign * (move.clientX - down.clientX));
    divider.addEventListener("pointermove", drag);
    divider.addEventListener("lostpointercapture", () => divider.removeEventListener("pointermove", drag), { once: true });
  });
  divider.addEventListener("keydown", (event) => {
    const step = { ArrowLeft: -16, ArrowRight: 16 }[event.key];
    if (step === undefined) return;
    event.preventDefault();
    set(panel.clientWidth + sign * step);
  });
}
