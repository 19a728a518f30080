// Numbers as people read them.

const whole = new Intl.NumberFormat("en", { maximumFractionDigits: 0 });

/** 65614 → "65 614". @param {number} n */
export const count = (n) => whole.format(n).replaceAll(",", "\u202f");

/** "1 image", "3 images". @param {number} n @param {string} one @param {string} [many] */
export const plural = (n, one, many = `${one}s`) => `${count(n)} ${n === 1 ? one : many}`;

/** 0.0001 → "< 1 ms", 0.08 → "80 ms", 8.04 → "8.0 s", 75 → "1:15". @param {number} seconds */
export function duration(seconds) {
  if (!Number.isFinite(seconds)) return "";
  if (seconds < 0.0005) return "< 1 ms";
  if (seconds < 0.0995) return `${Math.round(seconds * 1000)} ms`;
  if (seconds < 59.95) return `${seconds.toFixed(1)} s`;
  const s = Math.round(seconds);
  const [h, m] = [Math.floor(s / 3600), Math.floor((s % 3600) / 60)];
  const two = (/** @type {number} */ n) => String(n).padStart(2, "0");
  return h > 0 ? `${h}:${two(m)}:${two(s % 60)}` : `${m}:${two(s % 60)}`;
}

/** @param {number} n */
export function bytes(n) {
  const units = ["B", "KB", "MB", "GB"];
  let k = 0;
  while (n >= 1000 && k < units.length - 1) [n, k] = [n / 1000, k + 1];
  return `${k === 0 || n >= 100 ? Math.round(n) : n.toFixed(1)} ${units[k]}`;
}

/** 0.3944 → "0.394 px". @param {number|null|undefined} n */
export const pixels = (n) => (n === null || n === undefined || !Number.isFinite(n) ? "–" : `${n.toFixed(n < 10 ? 3 : 1)} px`);

/** Three significant digits, with an exponent where that is shorter. @param {number} n */
export function short(n) {
  if (n === 0) return "0";
  const size = Math.abs(n);
  return size >= 1e5 || size < 1e-3 ? n.toExponential(1).replace("e+", "e") : String(Number(n.toPrecision(3)));
}
