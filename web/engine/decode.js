// Decodes photographs: the browser does it faster than any code of ours, and knows more formats.

import { asStored } from "../files/stored.js";

/**
 * The pixels as the file stores them: COLMAP does not turn images by their EXIF orientation, and keypoints are counted in what
 * it saw.
 * @param {Blob} file @param {number} maxSide longest side of the result, px
 */
export async function decode(file, maxSide) {
  const full = await createImageBitmap(await asStored(file), { premultiplyAlpha: "none", colorSpaceConversion: "none" });
  const scale = Math.min(1, maxSide / Math.max(full.width, full.height));
  const canvas = new OffscreenCanvas(Math.max(1, Math.round(full.width * scale)), Math.max(1, Math.round(full.height * scale)));
  const context = canvas.getContext("2d", { willReadFrequently: true });
  if (!context) throw new Error("no canvas to decode on");
  context.drawImage(full, 0, 0, canvas.width, canvas.height);
  full.close();
  return context.getImageData(0, 0, canvas.width, canvas.height);
}
