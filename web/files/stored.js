// Photographs as they are stored. Browsers turn them by their EXIF orientation and cannot be told not to (`imageOrientation:
// "none"` means "from-image" today), but keypoints are counted in the stored pixels: so the browser is not shown the EXIF.

/** EXIF is at most 64 kB and stands near the front; a thumbnail or a colour profile may come before it. */
const HEAD_BYTES = 256 * 1024;
const [START, SCAN, EXIF] = [0xffd8, 0xda, 0xe1];

/** @param {Blob} file @returns {Promise<Blob>} the same pixels; a JPEG without its EXIF segment */
export async function asStored(file) {
  const head = new DataView(await file.slice(0, HEAD_BYTES).arrayBuffer());
  if (head.byteLength < 4 || head.getUint16(0) !== START) return file;
  for (let at = 2; at + 10 <= head.byteLength && head.getUint8(at) === 0xff; ) {
    const marker = head.getUint8(at + 1);
    if (marker === SCAN) break;
    const end = at + 2 + head.getUint16(at + 2);
    // "Exif": XMP comes in segments of the same number and turns nothing.
    if (marker === EXIF && head.getUint32(at + 4) === 0x45786966) return new Blob([file.slice(0, at), file.slice(end)], { type: "image/jpeg" });
    at = end;
  }
  return file;
}
