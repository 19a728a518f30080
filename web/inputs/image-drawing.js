// Draws a photograph with its keypoints and their errors, or two with the matches between them; small and large alike.

import { sharpContext, token } from "../ui/dom.js";
import { ramp } from "../scene/colors.js";

/** Errors from here on are drawn red, px: filters take observations out at a few pixels. */
export const LARGE_ERROR_PX = 2;
/** More marks than this hide the picture they lie on. */
const MAX_MARKS = 4000;
/** Lines beyond this many are a smear. */
const MAX_LINES = 1500;

/** @typedef {{ width: number, height: number }} Size */
/**
 * @typedef {object} Drawn
 * @property {Size} size of the image, px @property {Size|null} otherSize
 * @property {Float32Array} keypoints xy @property {Float32Array|null} residuals px, −1 where a keypoint is in no point
 * @property {Float32Array|null} matches five numbers each: xy here, xy there, 1
 * @property {ImageBitmap|null} picture @property {ImageBitmap|null} otherPicture
 */

/** Height over width of what is drawn. @param {Drawn} drawn @param {boolean} sideBySide */
export function shapeOf({ size, otherSize }, sideBySide) {
  const aspect = (size.height || 3) / (size.width || 4);
  if (!otherSize) return aspect;
  const other = (otherSize.height || 3) / (otherSize.width || 4);
  return sideBySide ? Math.max(aspect, other) / 2 : aspect + other;
}

/** @param {HTMLCanvasElement} canvas @param {Drawn} drawn @param {boolean} sideBySide */
export function drawImages(canvas, drawn, sideBySide) {
  const { context, width } = sharpContext(canvas);
  const { size, otherSize } = drawn;
  const share = otherSize && sideBySide ? width / 2 : width;
  const zoom = share / (size.width || 1);
  const height = (share * (size.height || 3)) / (size.width || 4);
  context.fillStyle = token("--ground");
  context.fillRect(0, 0, share, height);
  if (drawn.picture) context.drawImage(drawn.picture, 0, 0, share, height);
  if (!otherSize) {
    marks(context, drawn, zoom);
    return;
  }
  const [left, top] = sideBySide ? [share, 0] : [0, height];
  const zoomOther = share / (otherSize.width || 1);
  context.fillRect(left, top, share, zoomOther * otherSize.height);
  if (drawn.otherPicture) context.drawImage(drawn.otherPicture, left, top, share, zoomOther * otherSize.height);
  const matches = drawn.matches ?? new Float32Array();
  const step = 5 * Math.max(1, Math.ceil(matches.length / 5 / MAX_LINES));
  context.globalAlpha = Math.max(0.25, Math.min(0.85, 120 / (matches.length / step + 1)));
  context.lineWidth = 1;
  // Neighbouring lines differ in hue, so that single ones can be followed.
  for (let k = 0, hue = 150; k < matches.length; k += step, hue = (hue + 47) % 360) {
    context.strokeStyle = `hsl(${hue} 80% 60%)`;
    context.beginPath();
    context.moveTo(matches[k] * zoom, matches[k + 1] * zoom);
    context.lineTo(left + matches[k + 2] * zoomOther, top + matches[k + 3] * zoomOther);
    context.stroke();
  }
  context.globalAlpha = 1;
}

/** @param {CanvasRenderingContext2D} context @param {Drawn} drawn @param {number} zoom */
function marks(context, { keypoints, residuals }, zoom) {
  const step = Math.max(1, Math.ceil(keypoints.length / 2 / MAX_MARKS));
  const used = residuals !== null && residuals.some((error) => error >= 0);
  // Those in no point first, so that they do not hide the others.
  for (const inPoint of [false, true]) {
    for (let k = 0; 2 * k < keypoints.length; k += step) {
      const error = residuals?.[k] ?? -1;
      if (error >= 0 !== inPoint) continue;
      const [r, g, b] = inPoint ? ramp(error / LARGE_ERROR_PX) : used ? [140, 148, 160] : [120, 210, 255];
      context.fillStyle = `rgb(${r} ${g} ${b})`;
      context.globalAlpha = inPoint ? 0.95 : used ? 0.35 : 0.75;
      const side = inPoint ? 3 : 2;
      context.fillRect(keypoints[2 * k] * zoom - side / 2, keypoints[2 * k + 1] * zoom - side / 2, side, side);
    }
  }
  context.globalAlpha = 1;
}
