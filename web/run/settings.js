// What a person can choose before a run: presets first, the rest as the settings file that the command line takes too.

import { dialog } from "../ui/dialog.js";
import { el } from "../ui/dom.js";

/** @typedef {{ settings: Record<string, any>, backend: "auto"|"gpu"|"cpu" }} Choice */

/** @returns {Choice} */
export const defaults = () => ({ settings: { preset: "default" }, backend: "auto" });

const PRESETS = /** @type {[string, string][]} */ ([["fast", "fast: fewer rounds, no retriangulation"], ["default", "default"], ["accurate", "accurate: tighter stops, more rounds"]]);
const INTRINSICS = /** @type {[string, string][]} */ ([["refine", "refine"], ["prior", "stay near the database's"], ["fixed", "keep the database's"]]);
const MATCHES = /** @type {[string, string][]} */ ([["verified", "verified ones"], ["raw", "raw ones, verified again"]]);
const BACKENDS = /** @type {[string, string][]} */ ([["auto", "the best there is"], ["gpu", "WebGPU"], ["cpu", "the processor"]]);
const DEPTH_KINDS = /** @type {[string, string][]} */ ([["z", "along the optical axis (z)"], ["ray", "along the ray"]]);

/** The choice in a line. @param {Choice} choice */
export function describe({ settings, backend }) {
  const { preset = "default", ...rest } = settings;
  const parts = [`Preset ${preset}`];
  if (rest.intrinsics) parts.push(`intrinsics ${rest.intrinsics}`);
  if (rest.matches) parts.push(`${rest.matches} matches`);
  if (rest.seed) parts.push(`seed ${rest.seed}`);
  if (backend !== "auto") parts.push(`on ${backend === "gpu" ? "WebGPU" : "the processor"}`);
  const others = Object.keys(rest).filter((name) => !["intrinsics", "matches", "seed"].includes(name));
  if (others.length > 0) parts.push(`own ${others.join(", ")}`);
  return parts.join(" · ");
}

/** Lays `over` on `base`, object by object, as the settings file does. @param {any} base @param {any} over @returns {any} */
function merge(base, over) {
  const isObject = (/** @type {any} */ value) => typeof value === "object" && value !== null && !Array.isArray(value);
  if (!isObject(base) || !isObject(over)) return over;
  return Object.fromEntries([...new Set([...Object.keys(base), ...Object.keys(over)])].map((key) => [key, key in over ? (key in base ? merge(base[key], over[key]) : over[key]) : base[key]]));
}

/** @param {Choice} choice @param {(choice: Choice) => void} changed */
export function editSettings(choice, changed) {
  const { settings } = choice;
  const select = (/** @type {string} */ value, /** @type {[string, string][]} */ options) => el("select", {}, ...options.map(([id, text]) => el("option", { value: id, selected: id === value }, text)));
  const preset = select(settings.preset ?? "default", PRESETS);
  const intrinsics = select(settings.intrinsics ?? "refine", INTRINSICS);
  const matches = select(settings.matches ?? "verified", MATCHES);
  const seed = el("input", { type: "number", min: 0, step: 1, value: String(settings.seed ?? 0) });
  const backend = select(choice.backend, BACKENDS);
  const depth = settings.depth ?? {};
  const depthScale = el("input", { type: "number", min: 0, step: "any", placeholder: "as the format says", value: depth.scale === undefined ? "" : String(depth.scale) });
  const depthKind = select(depth.kind ?? "z", DEPTH_KINDS);
  const depthSigma = el("input", { type: "number", min: 0, step: "any", placeholder: "default", value: depth.relative_sigma === undefined ? "" : String(depth.relative_sigma) });
  const depthMax = el("input", { type: "number", min: 0, step: "any", placeholder: "default", value: depth.max_m === undefined ? "" : String(depth.max_m) });
  // What has no field of its own stays as it was written.
  const { preset: _p, intrinsics: _i, matches: _m, seed: _s, depth: _d, ...rest } = settings;
  const { scale: _a, kind: _b, relative_sigma: _c, max_m: _e, ...depthRest } = depth;
  const others = { ...rest, ...(Object.keys(depthRest).length > 0 ? { depth: depthRest } : {}) };
  const more = el("textarea", { rows: 4, spellcheck: false, "aria-describedby": "settings-problem", placeholder: '{ "refine": { "rounds": 4 } }', value: Object.keys(others).length > 0 ? JSON.stringify(others, null, 2) : "" });
  const problem = el("p", { id: "settings-problem", role: "alert", class: "bad" });
  const row = (/** @type {string} */ label, /** @type {HTMLElement} */ field) => el("label", { class: "row" }, el("span", {}, label), field);

  function save() {
    let written = {};
    try {
      written = more.value.trim() === "" ? {} : JSON.parse(more.value);
      if (typeof written !== "object" || written === null || Array.isArray(written)) throw new Error("write an object such as {\"refine\": {\"rounds\": 4}}");
    } catch (error) {
      problem.textContent = `Further settings: ${/** @type {Error} */ (error).message}`;
      more.focus();
      return;
    }
    /** @type {Record<string, any>} */
    const fields = { preset: preset.value };
    if (intrinsics.value !== "refine") fields.intrinsics = intrinsics.value;
    if (matches.value !== "verified") fields.matches = matches.value;
    if (Number(seed.value) > 0) fields.seed = Math.floor(Number(seed.value));
    /** @type {Record<string, any>} */
    const depths = {};
    if (depthScale.value !== "") depths.scale = Number(depthScale.value);
    if (depthKind.value !== "z") depths.kind = depthKind.value;
    if (depthSigma.value !== "") depths.relative_sigma = Number(depthSigma.value);
    if (depthMax.value !== "") depths.max_m = Number(depthMax.value);
    if (Object.keys(depths).length > 0) fields.depth = depths;
    changed({ settings: merge(fields, written), backend: /** @type {Choice["backend"]} */ (backend.value) });
    box.close();
  }

  const box = dialog({ title: "Settings", actions: [
    el("button", { type: "button", class: "left", onclick: () => { changed(defaults()); box.close(); } }, "Defaults"),
    el("button", { type: "button", onclick: () => box.close() }, "Cancel"),
    el("button", { type: "button", class: "main", onclick: save }, "Use these"),
  ] },
  row("Preset", preset), row("Intrinsics", intrinsics), row("Matches", matches), row("Compute on", backend), row("Seed", seed),
  el("details", { open: Object.keys(depth).length > 0 }, el("summary", {}, "Depth maps"),
    row("Metres per stored unit", depthScale), row("Measured", depthKind), row("Relative standard deviation", depthSigma), row("Farthest that counts, m", depthMax)),
  el("details", { open: Object.keys(others).length > 0 }, el("summary", {}, "Further settings"),
    el("label", {}, el("span", { class: "quiet" }, "As in a settings file of the command line (JSON)"), more), problem));
  box.show();
}
