// The page's end of the scene's worker: input goes in, what was picked comes out.

import { policedWorker } from "../engine/client.js";

export class View {
  /**
   * @param {HTMLCanvasElement} canvas @param {HTMLElement} cover what lies over its lower end
   * @param {{ shown: (figures: import("./panel.js").Shown) => void, unavailable: (message: string) => void }} told
   */
  constructor(canvas, cover, told) {
    this.canvas = canvas;
    this.cover = cover;
    this.generation = 0;
    this.worker = policedWorker("./scene-worker.js");
    /** @type {Map<number, (hit: {point: number|null, image: number|null}) => void>} */
    this.picks = new Map();
    this.worker.onmessage = ({ data }) => {
      // Figures of a scene that was cleared meanwhile are nobody's.
      if (data.type === "shown" && data.generation !== this.generation) return;
      if (data.type === "shown") told.shown(data);
      else if (data.type === "unavailable") told.unavailable(data.message);
      else if (data.type === "picked") {
        this.picks.get(data.id)?.(data);
        this.picks.delete(data.id);
      }
    };
    const offscreen = canvas.transferControlToOffscreen();
    this.worker.postMessage({ type: "start", canvas: offscreen }, [offscreen]);
    const resized = new ResizeObserver(() => this.resize());
    resized.observe(canvas);
    resized.observe(cover);
    this.resize();
  }

  resize() {
    const { width, height, bottom } = this.canvas.getBoundingClientRect();
    const cover = this.cover.getBoundingClientRect();
    const coveredPx = cover.height > 0 ? bottom - cover.top : 0;
    this.cover.parentElement?.style.setProperty("--covered", `${coveredPx}px`);
    this.send({ type: "resize", width, height, coveredPx, ratio: Math.min(devicePixelRatio || 1, 2) });
  }

  /** @param {any} message @param {Transferable[]} [transfer] */
  send(message, transfer = []) {
    this.worker.postMessage(message, transfer);
  }

  /** @param {import("../engine/protocol.js").Snapshot} snapshot its arrays move to the worker */
  show(snapshot) {
    const arrays = Object.values(snapshot).filter((value) => ArrayBuffer.isView(value)).map((value) => value.buffer);
    this.send({ type: "snapshot", snapshot }, [...new Set(arrays)]);
  }

  clear() {
    this.generation += 1;
    this.send({ type: "clear", generation: this.generation });
  }

  /** @param {number} x @param {number} y CSS px @returns {Promise<{point: number|null, image: number|null}>} */
  pick(x, y) {
    const id = (this.lastPick = (this.lastPick ?? 0) + 1);
    return new Promise((resolve) => {
      this.picks.set(id, resolve);
      this.send({ type: "pick", id, x, y });
    });
  }
}
