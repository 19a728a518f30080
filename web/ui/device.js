// The chip that says where it computes, and the dialog that says why.

import { el } from "./dom.js";
import { dialog } from "./dialog.js";

/** @typedef {import("../engine/protocol.js").Adapter} Adapter */

/** @param {HTMLElement} chip */
export function startDevice(chip) {
  /** @type {Adapter|null} */
  let adapter = null;
  /** @type {Adapter|null} */
  let taken = null;
  const say = (/** @type {Adapter} */ { kind, name, why }) => {
    /** @type {HTMLElement} */ (chip.firstElementChild).className = `dot ${{ gpu: "good", software: "fair", none: "fair" }[kind]}`;
    /** @type {HTMLElement} */ (chip.lastElementChild).textContent = kind === "none" ? "processor" : name;
    chip.title = why;
  };
  chip.addEventListener("click", () => dialog({ title: "Where it computes" },
    el("p", {}, adapter?.why ?? "The engine is starting."),
    taken && el("p", {}, `The last run: ${taken.why}`),
    el("p", { class: "quiet" }, "Settings → Compute on chooses between WebGPU and the processor; the figures agree, the speed differs.")).show());
  return {
    get why() {
      return adapter?.why ?? "";
    },
    get started() {
      return adapter !== null;
    },
    /** @param {Adapter} found */
    set(found) {
      adapter = found;
      say(found);
    },
    /** @param {Adapter} used what the run that begins has taken */
    running(used) {
      taken = used;
      // The browser knows the adapter's name, the engine often does not.
      say(used.kind !== "none" && adapter && adapter.kind !== "none" ? { ...used, name: adapter.name } : used);
    },
  };
}
