// Photographs by image name, decoded small and only when somebody looks.

import { asStored } from "../files/stored.js";

/** @typedef {import("../engine/protocol.js").Entry} Entry */

const THUMBNAIL_PX = 160;
/** Decoders at work at once: each holds a whole photograph for a moment. */
const AT_ONCE = 2;
/** Thumbnails kept, some 70 kB each: the oldest go. */
const KEPT = 500;

export class Pictures {
  constructor() {
    /** @type {Map<string, File>} */ this.files = new Map();
    /** @type {Map<string, Promise<ImageBitmap|null>>} */ this.thumbnails = new Map();
    /** @type {(() => void)[]} */ this.queue = [];
    this.busy = 0;
  }

  /**
   * Finds the photographs of the named images: by whole path, then by the path's end, then by name alone if that is
   * unique. Case does not matter. @param {Entry[]} entries @param {string[]} names @returns {number} how many were found
   */
  add(entries, names) {
    const wanted = new Map(names.map((name) => [name.toLowerCase(), name]));
    /** @type {Map<string, string[]>} */
    const byBase = new Map();
    for (const name of names) {
      const base = name.toLowerCase().split("/").at(-1) ?? name;
      const same = byBase.get(base);
      if (same) same.push(name);
      else byBase.set(base, [name]);
    }
    let found = 0;
    for (const { path, file } of entries) {
      const parts = path.toLowerCase().split("/");
      let name;
      for (let k = 0; k < parts.length && !name; k += 1) name = wanted.get(parts.slice(k).join("/"));
      const same = byBase.get(parts.at(-1) ?? "");
      name ??= same?.length === 1 ? same[0] : undefined;
      if (name && !this.files.has(name)) {
        this.files.set(name, file);
        this.thumbnails.delete(name);
        found += 1;
      }
    }
    return found;
  }

  /** @param {string} name @returns {Promise<ImageBitmap|null>} null: no file, or none the browser can decode */
  thumbnail(name) {
    const known = this.thumbnails.get(name);
    if (known) return known;
    const file = this.files.get(name);
    if (!file) return Promise.resolve(null);
    const made = this.decode(async () => createImageBitmap(await asStored(file), { resizeWidth: THUMBNAIL_PX, resizeQuality: "medium" }));
    this.thumbnails.set(name, made);
    if (this.thumbnails.size > KEPT) {
      const [oldest, bitmap] = /** @type {[string, Promise<ImageBitmap|null>]} */ (this.thumbnails.entries().next().value);
      this.thumbnails.delete(oldest);
      // Whoever has just asked for it may still be drawing.
      setTimeout(() => bitmap.then((old) => old?.close()), 1000);
    }
    return made;
  }

  /** @param {string} name @param {number} widthPx @returns {Promise<ImageBitmap|null>} */
  picture(name, widthPx) {
    const file = this.files.get(name);
    if (!file) return Promise.resolve(null);
    return this.decode(async () => createImageBitmap(await asStored(file), { resizeWidth: Math.round(widthPx), resizeQuality: "high" }));
  }

  /**
   * A square piece of a photograph, in pixels of the image as the database knows it: the file may be a smaller copy.
   * @param {string} name @param {number} x @param {number} y @param {number} side @param {number} imageWidthPx
   * @returns {Promise<ImageBitmap|null>}
   */
  crop(name, x, y, side, imageWidthPx) {
    const file = this.files.get(name);
    if (!file) return Promise.resolve(null);
    return this.decode(async () => {
      const whole = await createImageBitmap(await asStored(file));
      const zoom = whole.width / (imageWidthPx || whole.width);
      try {
        return await createImageBitmap(whole, Math.round(x * zoom), Math.round(y * zoom), Math.max(1, Math.round(side * zoom)), Math.max(1, Math.round(side * zoom)));
      } finally {
        whole.close();
      }
    });
  }

  /** @param {() => Promise<ImageBitmap>} work @returns {Promise<ImageBitmap|null>} */
  async decode(work) {
    if (this.busy >= AT_ONCE) await new Promise((/** @type {(value: void) => void} */ resolve) => this.queue.push(resolve));
    else this.busy += 1;
    try {
      return await work();
    } catch {
      return null;
    } finally {
      const next = this.queue.shift();
      if (next) next();
      else this.busy -= 1;
    }
  }

  clear() {
    for (const made of this.thumbnails.values()) made.then((bitmap) => bitmap?.close());
    this.thumbnails.clear();
    this.files.clear();
  }
}
