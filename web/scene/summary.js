// What the page shows of a scene in figures: counted in the worker that draws, where it holds nobody up.

const BINS = 40;
/** Values beyond these many are sampled for quantiles. */
const SAMPLE = 20_000;

/** @typedef {{ bins: number[], counts: number[], median: number, limit: number }} Histogram */

/**
 * Errors of the points that are shown, px; the last bin holds everything beyond.
 * @param {Float32Array} errors @param {Uint8Array} colors alpha 0: not shown @returns {Histogram|null}
 */
export function histogram(errors, colors) {
  /** @type {number[]} */
  const sample = [];
  const step = Math.max(1, Math.ceil(errors.length / SAMPLE));
  for (let p = 0; p < errors.length; p += step) if (errors[p] >= 0 && colors[4 * p + 3] > 0) sample.push(errors[p]);
  if (sample.length === 0) return null;
  sample.sort((a, b) => a - b);
  const limit = Math.max(0.1, sample[Math.floor(0.99 * (sample.length - 1))]);
  /** @type {number[]} */
  const counts = new Array(BINS).fill(0);
  for (let p = 0; p < errors.length; p += 1) {
    if (errors[p] >= 0 && colors[4 * p + 3] > 0) counts[Math.min(BINS - 1, Math.floor((errors[p] / limit) * BINS))] += 1;
  }
  return { bins: counts.map((_, k) => ((k + 0.5) / BINS) * limit), counts, median: sample[sample.length >> 1], limit };
}
