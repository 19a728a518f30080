// Photographs by image name, decoded small and only when somebody looks.

/** @typedef {import("../engine/protocol.js").Entry} Entry */

const THUMBNAIL_PX = 160;
/** Decoders at work at once: each holds a whole photograph for a moment. */
const AT_ONCE = 2;

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
      byBase.set(base, [...(byBase.get(base) ?? []), name]);
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
    const made = this.turn().then(() => createImageBitmap(file, { resizeWidth: THUMBNAIL_PX, resizeQuality: "medium" }))
      .catch(() => null).finally(() => this.done());
    this.thumbnails.set(name, made);
    return made;
  }

  /** @param {string} name @param {number} widthPx @returns {Promise<ImageBitmap|null>} */
  async picture(name, widthPx) {
    const file = this.files.get(name);
    if (!file) return null;
    return createImageBitmap(file, { resizeWidth: Math.round(widthPx), resizeQuality: "high" }).catch(() => null);
  }

  turn() {
    if (this.busy < AT_ONCE) {
      this.busy += 1;
      return Promise.resolve();
    }
    return new Promise((/** @type {(value: void) => void} */ resolve) => this.queue.push(() => resolve()));
  }

  done() {
    const next = this.queue.shift();
    if (next) next();
    else this.busy -= 1;
  }

  clear() {
    for (const made of this.thumbnails.values()) made.then((bitmap) => bitmap?.close());
    this.thumbnails.clear();
    this.files.clear();
  }
}
