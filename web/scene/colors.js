// What colour a point or a camera has, and the scale to read it by.

/** Blue over green and yellow to red, as in the legend. */
const RAMP = [[59, 92, 242], [48, 183, 150], [240, 214, 80], [240, 84, 84]];

/** @param {number} t 0…1 @returns {[number, number, number]} */
export function ramp(t) {
  const x = Math.min(Math.max(t, 0), 1) * (RAMP.length - 1);
  const k = Math.min(Math.floor(x), RAMP.length - 2);
  return /** @type {[number, number, number]} */ (RAMP[k].map((from, c) => from + (RAMP[k + 1][c] - from) * (x - k)));
}

/** Colours of components, far apart in hue. @param {number} k @returns {[number, number, number]} */
export function categorical(k) {
  const hue = (k * 137.508 + 205) % 360;
  const channel = (/** @type {number} */ n) => {
    const x = (n + hue / 30) % 12;
    return 255 * (0.62 - 0.32 * Math.max(-1, Math.min(x - 3, 9 - x, 1)));
  };
  return [channel(0), channel(8), channel(4)];
}

/** What the engine paints points that no photograph has coloured (`UNCOLORED` of crates/web/src/snapshot.rs). */
const UNCOLORED = [190, 196, 206];

/** @typedef {"rgb"|"error"|"track"|"component"} ColorBy */
/** @typedef {{ label: string, low: string, high: string }|null} Legend */

/** The range that the colours span, from the data itself: its 2nd to 98th percentile. @param {ArrayLike<number>} values */
function range(values) {
  const step = Math.max(1, Math.floor(values.length / 20_000));
  /** @type {number[]} */
  const sample = [];
  for (let k = 0; k < values.length; k += step) if (values[k] >= 0) sample.push(values[k]);
  sample.sort((a, b) => a - b);
  const at = (/** @type {number} */ share) => sample[Math.min(sample.length - 1, Math.floor(share * sample.length))] ?? 0;
  return [at(0.02), at(0.98)];
}

/**
 * RGBA for every point; alpha 0 where the filter takes it out.
 * @param {import("../engine/protocol.js").Snapshot} snapshot @param {ColorBy} by
 * @param {{maxErrorPx: number, minTrack: number}} filter @param {number|null} component
 * @param {[number, number, number]} plain for points without a colour of their own
 * @returns {{ colors: Uint8Array, shown: number, legend: Legend }}
 */
export function pointColors(snapshot, by, filter, component, plain) {
  const count = snapshot.positions.length / 3;
  const colors = new Uint8Array(4 * count);
  const values = by === "error" ? snapshot.errors : snapshot.tracks;
  const [low, high] = by === "error" || by === "track" ? range(values) : [0, 1];
  const spread = high - low || 1;
  let shown = 0;
  const ownColor = (/** @type {number} */ p) => UNCOLORED.every((channel, k) => snapshot.colors[3 * p + k] === channel) ? plain : snapshot.colors.subarray(3 * p, 3 * p + 3);
  for (let p = 0; p < count; p += 1) {
    const kept = snapshot.errors[p] <= filter.maxErrorPx && snapshot.tracks[p] >= filter.minTrack
      && (component === null || snapshot.pointComponent[p] === component);
    if (!kept) continue;
    shown += 1;
    // Not known yet: neither good nor bad.
    const unknown = by === "error" && values[p] < 0;
    const rgb = unknown ? plain : by === "rgb" ? ownColor(p)
      : by === "component" ? categorical(snapshot.pointComponent[p])
      : ramp((values[p] - low) / spread);
    colors[4 * p] = rgb[0];
    colors[4 * p + 1] = rgb[1];
    colors[4 * p + 2] = rgb[2];
    colors[4 * p + 3] = 255;
  }
  const digits = (/** @type {number} */ x) => String(Number(x.toPrecision(2)));
  const legend = by === "error" ? { label: "reprojection error, px", low: digits(low), high: digits(high) }
    : by === "track" ? { label: "observations of a point", low: digits(low), high: digits(high) }
    : null;
  return { colors, shown, legend };
}
