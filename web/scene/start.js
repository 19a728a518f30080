// What stands in the scene's place as long as there is no scene: where to drop, what is being read, what was read.

import { el, hide, perFrame, sharpContext, token } from "../ui/dom.js";
import { bytes, count, plural } from "../ui/format.js";

/** Chords drawn at most, strongest first: more are a disc. */
const MAX_CHORDS = 4000;

/**
 * @param {import("../store.js").Store} store
 * @param {{ pickFiles: () => void, pickFolder: () => void, sample: () => void, solve: () => void, giveUp: () => void, leave: () => void }} on leave: the focus must go elsewhere
 */
export function startCards(store, on) {
  const drop = el("div", { class: "card drop-card" },
    el("h2", {}, "Drop a COLMAP database"),
    el("p", { class: "quiet" }, "database.db, a folder or a zip, with photographs and depth maps if you have them. COLMAP models open for viewing."),
    el("div", { class: "card-actions" },
      el("button", { type: "button", class: "main", onclick: on.pickFiles }, "Choose files"),
      el("button", { type: "button", onclick: on.pickFolder }, "Choose a folder"),
      el("button", { type: "button", onclick: on.sample }, "Try a sample")),
    el("p", { class: "quiet small" }, "Nothing is uploaded: a content security policy forbids this page to send anything."));

  const what = el("p", {}, "");
  const bar = el("progress", { "aria-label": "Loading" });
  // Apart: a scene that is there stays in sight and in use.
  const reading = el("div", { class: "start over hidden" }, el("div", { class: "card reading", role: "status" }, what, bar,
    el("button", { type: "button", onclick: on.giveUp }, "Cancel")));

  const name = el("h2", {}, "");
  const facts = el("dl", { class: "facts-list" });
  const hint = el("p", { class: "quiet small" });
  const solveNow = el("button", { type: "button", class: "main", onclick: on.solve }, "Reconstruct now");
  const ready = el("div", { class: "card ready" }, name, facts, el("div", { class: "card-actions" }, solveNow), hint);
  const ring = el("canvas", { class: "ring", "aria-hidden": "true" });
  const node = el("div", { class: "start" }, ring, drop, ready);

  /** The focus was in a card that is gone meanwhile. */
  let cameFrom = false;
  function update() {
    const { phase, reading: isReading, opened, pictures, depths, placed } = store.state;
    const waits = phase === "ready" && opened?.kind === "database";
    // Until the first cameras have a place, what is known of the scene is who matches whom.
    const matching = placed.size === 0 && (phase === "running" || phase === "paused");
    const focused = node.contains(document.activeElement) || reading.contains(document.activeElement);
    hide(drop, phase !== "empty" || isReading);
    hide(reading, !isReading);
    if (focused && isReading) cameFrom = true;
    if (phase === "empty" && !isReading) cameFrom = false;
    hide(ready, !waits || isReading);
    hide(ring, !(waits || matching));
    hide(node, !((phase === "empty" && !isReading) || waits || matching));
    if (matching) draw();
    if (isReading) {
      // Where the panels are stacked it may be out of sight.
      reading.scrollIntoView({ block: "nearest" });
      return;
    }
    if (focused && !waits) on.leave();
    if (!waits || !opened) return;
    // Whoever came here by keyboard goes on from here.
    if (focused || cameFrom) solveNow.focus({ preventScroll: true });
    cameFrom = false;
    let matches = 0;
    for (let k = 2; k < opened.pairs.length; k += 3) matches += opened.pairs[k];
    name.textContent = opened.name;
    const rows = [["images", count(opened.images.length)], ["cameras", count(opened.cameras.length)], ["pairs", count(opened.pairs.length / 3)],
      ["verified matches", count(matches)], ["photographs", pictures > 0 ? count(pictures) : "none yet"],
      ...(depths > 0 ? [["depth maps", count(depths)]] : []), ["memory to solve", `about ${bytes(opened.predictedBytes)}`]];
    facts.replaceChildren(...rows.map(([term, value]) => el("div", {}, el("dt", {}, term), el("dd", {}, value))));
    hint.textContent = pictures >= opened.images.length ? `Every photograph is here.`
      : pictures > 0 ? `${plural(opened.images.length - pictures, "photograph")} can still be dropped.`
      : "Drop the folder of photographs for colours and crops, now or later. It works without.";
    draw();
  }

  /** The view graph: images round a circle, a chord for every matched pair. */
  const draw = perFrame(() => {
    const { opened } = store.state;
    if (!opened || ring.classList.contains("hidden")) return;
    const { context, width, height } = sharpContext(ring);
    const n = opened.images.length;
    const radius = Math.min(width, height) / 2 - 24;
    const [cx, cy] = [width / 2, height / 2];
    const place = (/** @type {number} */ k) => {
      const angle = (2 * Math.PI * k) / n - Math.PI / 2;
      return /** @type {[number, number]} */ ([cx + radius * Math.cos(angle), cy + radius * Math.sin(angle)]);
    };
    let order = Array.from({ length: opened.pairs.length / 3 }, (_, k) => 3 * k);
    if (order.length > MAX_CHORDS) order = order.sort((a, b) => opened.pairs[b + 2] - opened.pairs[a + 2]).slice(0, MAX_CHORDS);
    const most = order.reduce((top, k) => Math.max(top, opened.pairs[k + 2]), 1);
    context.strokeStyle = token("--accent");
    const fade = Math.min(1, 30 / Math.sqrt(order.length + 1));
    for (const k of order) {
      const [from, to] = [place(opened.pairs[k]), place(opened.pairs[k + 1])];
      context.globalAlpha = (0.06 + 0.44 * Math.sqrt(opened.pairs[k + 2] / most)) * fade;
      context.beginPath();
      context.moveTo(...from);
      context.quadraticCurveTo(cx + 0.3 * (from[0] + to[0] - 2 * cx), cy + 0.3 * (from[1] + to[1] - 2 * cy), ...to);
      context.stroke();
    }
    context.globalAlpha = 1;
    context.fillStyle = token("--quiet");
    for (let k = 0; k < n; k += 1) {
      context.beginPath();
      context.arc(...place(k), n > 300 ? 1 : 2, 0, 7);
      context.fill();
    }
  });

  store.on(["phase", "reading", "opened", "pictures", "depths", "placed"], update);
  new ResizeObserver(draw).observe(ring);
  update();
  return {
    node, reading, redraw: draw,
    /** @param {string} text @param {number} [done] @param {number} [total] */
    progress(text, done, total) {
      what.textContent = text;
      if (done !== undefined && total !== undefined && total > 0) [bar.max, bar.value] = [total, Math.min(done, total)];
      else bar.removeAttribute("value");
    },
  };
}
