// The page's end of the engine's workers: the whole of what a page needs to embed the engine. Every scene gets a worker of its own,
// so that nothing of one can leak into the next and its memory is given back; the next is opened beside it, so that a refusal costs nothing.

/**
 * @typedef {import("./protocol.js").Command} Command
 * @typedef {import("./protocol.js").Entry} Entry
 * @typedef {import("./protocol.js").Opened} Opened
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

/** One worker, and what was asked of it. */
class Line {
  /** @param {(message: Message) => void} receive what the worker says on its own */
  constructor(receive) {
    this.next = 0;
    /** @type {Map<number, {resolve: (value: any) => void, reject: (error: Error) => void}>} */
    this.waiting = new Map();
    /** @type {Set<Promise<any>>} */
    this.answers = new Set();
    /** A scene was opened in this worker, or should have been. */
    this.used = false;
    this.solving = false;
    this.worker = policedWorker("./engine-worker.js");
    this.worker.onmessage = ({ data }) => {
      if (data.id === undefined) {
        if (data.type === "panic") this.fail(data.message);
        receive(data);
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
      receive({ type: "panic", message });
    };
  }

  /** @param {string} message */
  fail(message, hint = "reload the page; if it happens again, copy the log into a bug report") {
    for (const { reject } of this.waiting.values()) reject(new Refusal({ file: "the engine", message, hint }));
    this.waiting.clear();
  }

  /** @param {Command} command @param {Transferable[]} [transfer] @returns {Promise<any>} */
  async ask(command, transfer = []) {
    const id = this.next++;
    const answer = new Promise((resolve, reject) => {
      this.waiting.set(id, { resolve, reject });
      this.worker.postMessage({ id, ...command }, transfer);
    });
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

  end() {
    this.worker.terminate();
    this.fail("the scene was closed", "");
  }

  /** Ends once what was asked before is answered, at once if a run is on its way. */
  async retire() {
    if (!this.solving) await Promise.allSettled([...this.answers]);
    this.end();
  }
}

export class Engine {
  /** @param {(message: Message) => void} receive */
  constructor(receive) {
    this.receive = receive;
    /** What the last worker found to compute on: said again only where it has changed. */
    this.adapter = "";
    this.line = this.fresh();
    /** Where the next scene is being opened. @type {Line|null} */
    this.candidate = null;
  }

  fresh() {
    const line = new Line((message) => {
      if (message.type === "ready") {
        const adapter = JSON.stringify(message.adapter);
        if (adapter === this.adapter) return;
        this.adapter = adapter;
      } else if (line !== this.line || line === this.candidate) return;
      this.receive(message);
    });
    return line;
  }

  /**
   * Opens a scene beside the one that is there, which goes on until `adopt`; a refusal or `signal` ends the new one only.
   * @param {Entry[]} entries @param {AbortSignal} signal @returns {Promise<Opened>}
   */
  async open(entries, signal) {
    const line = (this.candidate = this.line.used ? this.fresh() : this.line);
    line.used = true;
    const end = () => line.end();
    signal.addEventListener("abort", end);
    try {
      return await line.ask({ type: "open", entries });
    } catch (error) {
      line.end();
      if (line === this.candidate) this.candidate = null;
      if (line === this.line) this.line = this.fresh();
      throw error;
    } finally {
      signal.removeEventListener("abort", end);
    }
  }

  /** The scene that was opened last takes the place of the one before, whose worker ends. */
  adopt() {
    if (!this.candidate) return;
    const before = this.line;
    [this.line, this.candidate] = [this.candidate, null];
    if (before !== this.line) before.retire();
  }

  /** Ends the worker of the scene that is there and starts one without a scene. */
  restart() {
    this.line.end();
    this.line = this.fresh();
  }

  /** Ends the engine and gives all of its memory back. */
  dispose() {
    this.candidate?.end();
    this.line.end();
  }

  /** @param {Command} command @param {Transferable[]} [transfer] @returns {Promise<any>} */
  ask(command, transfer) {
    return this.line.ask(command, transfer);
  }

  /** @param {Signal} signal */
  signal(signal) {
    this.line.worker.postMessage(signal);
  }
}
