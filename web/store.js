// What the page knows, in one place: panels read it and are told which part changed.

/**
 * @typedef {import("./engine/protocol.js").Opened} Opened
 * @typedef {import("./engine/protocol.js").Report} Report
 * @typedef {import("./engine/protocol.js").Failure} Failure
 * @typedef {"empty"|"ready"|"running"|"paused"|"stopping"|"done"} Phase
 * @typedef {{ kind: "image"|"point"|"pair"|"none", image?: number, other?: number, point?: number }} Selection
 *
 * @typedef {object} State
 * @property {Phase} phase
 * @property {boolean} reading another scene, or what joins this one, is on its way
 * @property {Opened|null} opened what was read from the database or model
 * @property {Report|null} report of the finished run
 * @property {Failure[]} problems refusals that are shown
 * @property {Selection} selection
 * @property {number[]} seenBy images that see the selected point
 * @property {Set<number>} placed images that have a camera so far
 * @property {number} pictures photographs that are at hand
 * @property {number} depths depth maps that are at hand
 * @property {number|null} component that is shown; null: all
 * @property {{maxErrorPx: number, minTrack: number}} filter of view and export alike
 * @property {string} imageFilter which thumbnails: all, placed, weak, missing
 */

/** Of the scene only: problems outlive it, and so does what is being read. */
const scene = () => ({
  /** @type {Phase} */ phase: "empty",
  /** @type {Opened|null} */ opened: null,
  /** @type {Report|null} */ report: null,
  /** @type {Selection} */ selection: { kind: "none" },
  /** @type {number[]} */ seenBy: [],
  /** @type {Set<number>} */ placed: new Set(),
  pictures: 0,
  depths: 0,
  /** @type {number|null} */ component: null,
  filter: { maxErrorPx: Infinity, minTrack: 2 },
  imageFilter: "all",
});

export class Store {
  constructor() {
    /** @type {State} */
    this.state = { reading: false, problems: [], ...scene() };
    /** @type {Map<string, Set<() => void>>} */
    this.listeners = new Map();
  }

  /** Calls `listener` when one of the parts changes. @param {(keyof State)[]} parts @param {() => void} listener */
  on(parts, listener) {
    for (const part of parts) {
      const set = this.listeners.get(part) ?? new Set();
      set.add(listener);
      this.listeners.set(part, set);
    }
  }

  /** @param {Partial<State>} change */
  set(change) {
    const called = new Set();
    Object.assign(this.state, change);
    for (const part of Object.keys(change)) {
      for (const listener of this.listeners.get(part) ?? []) {
        if (!called.has(listener)) {
          called.add(listener);
          listener();
        }
      }
    }
  }

  /** Forgets the scene, so that nothing of it leaks into the next. @param {Partial<State>} [next] the next, if there is one */
  forget(next) {
    this.set({ ...scene(), ...next });
  }
}
