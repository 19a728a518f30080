// A zip archive of files that are in memory: stored, not packed, since models hardly shrink (source: APPNOTE 6.3 §4.3).

const TABLE = Uint32Array.from({ length: 256 }, (_, n) => {
  let c = n;
  for (let k = 0; k < 8; k += 1) c = c & 1 ? 0xedb88320 ^ (c >>> 1) : c >>> 1;
  return c >>> 0;
});

/** Bytes between two breaths, some 10 ms of work: the page stays awake while a large model is written. */
const BREATH_BYTES = 4e6;

/** @param {Uint8Array} bytes */
export async function crc32(bytes) {
  let c = 0xffffffff;
  for (let from = 0; from < bytes.length; from += BREATH_BYTES) {
    const to = Math.min(bytes.length, from + BREATH_BYTES);
    for (let k = from; k < to; k += 1) c = TABLE[(c ^ bytes[k]) & 255] ^ (c >>> 8);
    if (to < bytes.length) await new Promise((resolve) => setTimeout(resolve));
  }
  return (c ^ 0xffffffff) >>> 0;
}

/** UTF-8 names (bit 11), 1 January 1980: the same files give the same bytes. */
const FLAGS = 0x0800;
const DATE = 0x0021;

/** @param {{ path: string, bytes: Uint8Array<ArrayBuffer> }[]} files @returns {Promise<Blob>} */
export async function zip(files) {
  /** @type {BlobPart[]} */
  const parts = [];
  const directory = [];
  let offset = 0;
  for (const { path, bytes } of files) {
    const name = new TextEncoder().encode(path);
    const crc = await crc32(bytes);
    const local = new DataView(new ArrayBuffer(30));
    local.setUint32(0, 0x04034b50, true);
    local.setUint16(4, 20, true);
    common(local, 6, crc, bytes.length, name.length);
    parts.push(local.buffer, name, bytes);
    const central = new DataView(new ArrayBuffer(46));
    central.setUint32(0, 0x02014b50, true);
    central.setUint16(4, 20, true);
    central.setUint16(6, 20, true);
    common(central, 8, crc, bytes.length, name.length);
    central.setUint32(42, offset, true);
    directory.push(central.buffer, name);
    offset += 30 + name.length + bytes.length;
  }
  const size = directory.reduce((sum, part) => sum + part.byteLength, 0);
  const end = new DataView(new ArrayBuffer(22));
  end.setUint32(0, 0x06054b50, true);
  end.setUint16(8, files.length, true);
  end.setUint16(10, files.length, true);
  end.setUint32(12, size, true);
  end.setUint32(16, offset, true);
  return new Blob([...parts, ...directory, end.buffer], { type: "application/zip" });
}

/** What a local and a central header have in common. @param {DataView} view @param {number} at @param {number} crc @param {number} size @param {number} nameBytes */
function common(view, at, crc, size, nameBytes) {
  view.setUint16(at, FLAGS, true);
  view.setUint16(at + 6, DATE, true);
  view.setUint32(at + 8, crc, true);
  view.setUint32(at + 12, size, true);
  view.setUint32(at + 16, size, true);
  view.setUint16(at + 20, nameBytes, true);
}
