// A helper of the engine's worker: solves pairs and knows nothing else.

import { initSync, solvePairs } from "../vendor/epipole_web.js";

let panic = "";
/** Set before the module starts: panics call it. */
Reflect.set(globalThis, "epipolePanicked", (/** @type {string} */ message) => (panic = message));

/** First the compiled module, then batches. Answers are numbers, a failure is a text. */
addEventListener("message", ({ data }) => {
  try {
    if (data instanceof WebAssembly.Module) {
      initSync({ module: data });
      return;
    }
    const answers = solvePairs(data);
    if (!answers) throw new Error("the batch is of another build");
    postMessage(answers, { transfer: [answers.buffer] });
  } catch (error) {
    postMessage(panic || String(error));
  }
});
