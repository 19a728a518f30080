// Helpers of the engine's worker: plain workers that share no memory, so that any server and any page around this one will do.

import { policedWorker } from "./client.js";

/** Every helper has a module of its own, some megabytes. */
const MOST = 8;

/** @typedef {{ problems: Float64Array, resolve: (answers: Float64Array) => void, reject: (why: string) => void }} Batch */

export class Pool {
  constructor() {
    /** What each helper works on; null for nothing. @type {Map<Worker, Batch|null>} */
    this.helpers = new Map();
    /** @type {Batch[]} */
    this.queue = [];
  }

  /** @param {WebAssembly.Module} module the engine's own, which need not be compiled again @param {number} wanted @returns {number} */
  start(module, wanted) {
    this.end();
    const count = Math.min(wanted, MOST);
    // The engine's worker does nothing else meanwhile: one helper would only take its place.
    if (!(count > 1)) return 0;
    while (this.helpers.size < count) {
      const helper = policedWorker("./engine-pair-worker.js");
      this.helpers.set(helper, null);
      helper.onmessage = ({ data }) => {
        if (typeof data === "string") this.lose(helper, data);
        else {
          this.helpers.get(helper)?.resolve(data);
          this.give(helper);
        }
      };
      helper.onerror = (event) => this.lose(helper, event.message || "a helper could not be loaded");
      helper.postMessage(module);
    }
    return count;
  }

  /** @param {Float64Array} problems of the module's memory: copied @returns {Promise<Float64Array>} */
  solve(problems) {
    return new Promise((resolve, reject) => {
      this.queue.push({ problems: problems.slice(), resolve, reject });
      for (const [helper, batch] of this.helpers) if (!batch) this.give(helper);
      if (this.helpers.size === 0) this.refuse("no helper is left");
    });
  }

  /** @param {Worker} helper that has nothing to do */
  give(helper) {
    const batch = this.queue.shift() ?? null;
    this.helpers.set(helper, batch);
    if (batch) helper.postMessage(batch.problems, [batch.problems.buffer]);
  }

  /** @param {Worker} helper @param {string} why */
  lose(helper, why) {
    helper.terminate();
    this.helpers.get(helper)?.reject(why);
    this.helpers.delete(helper);
    if (this.helpers.size === 0) this.refuse(why);
  }

  /** @param {string} why */
  refuse(why) {
    for (const { reject } of this.queue.splice(0)) reject(why);
  }

  /** Gives their memory back; what they have not answered never will be. */
  end() {
    for (const helper of [...this.helpers.keys()]) this.lose(helper, "the helpers were ended");
  }
}
