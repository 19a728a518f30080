// The page's end of the engine's worker: the whole of what a page needs to embed the engine. Every scene gets a worker of its own,
// so that nothing of one can leak into the next and its memory is given back.

/**
 * @typedef {import("./protocol.js").Command} Command
 * @typedef {import("./protocol.js").Signal} Signal
 * @typedef {import("./protocol.js").Message} Message
 */

/** A refusal that the worker sent: says which file, why, and what to do. */
export class Refusal extends Error {
  /** @param {import("./protocol.js").Failure} failure */
  constructor(failure) {
    super(failure.message);
    this.failure = failure;
  }
}

/**
 * A module worker that obeys this page's content security policy: a worker loaded by address has only the policy of its
 * own response, one made here inherits ours.
 * @param {string} path beside the page's script: `crates/xtask/js/pack.mjs` puts all that is served into one folder
 */
export function policedWorker(path) {
  const address = URL.createObjectURL(new Blob([`import ${JSON.stringify(new URL(path, import.meta.url).href)};`], { type: "text/javascript" }));
  const worker = new Worker(address, { type: "module" });
  // The worker fetches its script on its own time: freeing the address at once would pull it away.
  setTimeout(() => URL.revokeObjectURL(address), 10_000);
  return worker;
}

export class Engine {
  /** @param {(message: Message) => void} receive */
  constructor(receive) {
    this.receive = receive;
    this.next = 0;
    /** @type {Map<number, {resolve: (value: any) => void, reject: (error: Error) => void}>} */
    this.waiting = new Map();
    /** @type {Set<Promise<any>>} */
    this.answers = new Set();
    /** A scene was opened in this worker. */
    this.used = false;
    this.solving = false;
    /** What the last worker found to compute on: said again only where it has changed. */
    this.adapter = "";
    this.start();
  }

  start() {
    this.used = false;
    this.worker = policedWorker("./engine-worker.js");
    this.worker.onmessage = ({ data }) => {
      if (data.id === undefined) {
        if (data.type === "ready") {
          const adapter = JSON.stringify(data.adapter);
          if (adapter === this.adapter) return;
          this.adapter = adapter;
        }
        if (data.type === "panic") this.fail("it ended early");
        this.receive(data);
        return;
      }
      const waiting = this.waiting.get(data.id);
      this.waiting.delete(data.id);
      if (data.failure) waiting?.reject(new Refusal(data.failure));
      else waiting?.resolve(data.value);
    };
    this.worker.onerror = (event) => {
      const message = event.message || "the engine's worker could not be loaded";
      this.fail(message);
      this.receive({ type: "panic", message });
    };
  }

  /** @param {string} message */
  fail(message) {
    for (const { reject } of this.waiting.values()) {
      reject(new Refusal({ file: "the engine", message, hint: "reload the page; if it happens again, copy the log into a bug report" }));
    }
    this.waiting.clear();
  }

  /** Ends a worker that no longer listens and starts a fresh one. */
  restart() {
    this.worker?.terminate();
    this.fail("cancelled");
    this.start();
  }

  /** Ends the engine and gives all of its memory back. */
  dispose() {
    this.worker?.terminate();
    this.worker = undefined;
    this.fail("the engine was disposed of");
  }

  /** Starts a fresh worker once what was asked before is answered, at once if a run is on its way. A module's memory grows and never shrinks. */
  async renew() {
    if (!this.used) return;
    if (!this.solving) await Promise.allSettled([...this.answers]);
    this.restart();
  }

  /** @param {Command} command @param {Transferable[]} [transfer] @returns {Promise<any>} */
  async ask(command, transfer = []) {
    if (command.type === "close") return this.renew();
    if (command.type === "open") {
      await this.renew();
      this.used = true;
    }
    const answer = this.post(command, transfer);
    this.answers.add(answer);
    const solves = command.type === "solve" || command.type === "refine";
    if (solves) this.solving = true;
    try {
      return await answer;
    } finally {
      this.answers.delete(answer);
      if (solves) this.solving = false;
    }
  }

  /** @param {Command} command @param {Transferable[]} transfer @returns {Promise<any>} */
  post(command, transfer) {
    const id = this.next++;
    return new Promise((resolve, reject) => {
      this.waiting.set(id, { resolve, reject });
      this.worker?.postMessage({ id, ...command }, transfer);
    });
  }

  /** @param {Signal} signal */
  signal(signal) {
    this.worker?.postMessage(signal);
  }
}
