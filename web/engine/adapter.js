// What this browser offers to compute on, in words: which adapter, or why there is none.

/** @typedef {import("./protocol.js").Adapter} Adapter */

/** Programs that play a graphics card on the processor. */
const SOFTWARE = /swiftshader|lavapipe|llvmpipe|warp|basic render/i;

/** @param {string} why @returns {Adapter} */
function processor(why) {
  return { kind: "none", name: "processor", why: `Computing on the processor of this machine: ${why}` };
}

/** @returns {Promise<Adapter>} */
export async function findAdapter() {
  const gpu = Reflect.get(navigator, "gpu");
  if (!gpu) {
    return processor(isSecureContext ? "this browser has no WebGPU, or it is switched off." : "browsers give WebGPU to pages over https or from localhost only.");
  }
  let adapter;
  try {
    adapter = await gpu.requestAdapter({ powerPreference: "high-performance" });
  } catch (error) {
    return processor(`WebGPU refused: ${/** @type {Error} */ (error)?.message ?? error}.`);
  }
  if (!adapter) return processor("WebGPU is there but offers no adapter; the graphics driver may be blocked or missing.");
  const info = adapter.info ?? {};
  const name = [info.description, [info.vendor, info.architecture].filter(Boolean).join(" ")].find(Boolean) ?? "unnamed GPU";
  const software = Boolean(info.isFallbackAdapter ?? adapter.isFallbackAdapter) || SOFTWARE.test(`${name} ${info.device ?? ""} ${info.architecture ?? ""}`);
  if (software) {
    return { kind: "software", name, why: `The only WebGPU adapter is ${name}, a program on the processor: right but slow. Runs use the processor itself unless WebGPU is chosen.` };
  }
  return { kind: "gpu", name, why: `WebGPU on ${name}. Scenes too small to pay for it are computed on the processor.` };
}
