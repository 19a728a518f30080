// What a person can choose before a run: presets first, the rest as the settings file that the command line takes too.

import { el } from "../ui/dom.js";

/** @typedef {{ settings: Record<string, any>, backend: "auto"|"gpu"|"cpu" }} Choice */

/** @returns {Choice} */
export const defaults = () => ({ settings: { preset: "default" }, backend: "auto" });

/** @param {Choice} choice @param {(choice: Choice) => void} changed */
export function editSettings(choice, changed) {
  const { settings } = choice;
  const select = (/** @type {string} */ value, /** @type {[string, string][]} */ options) => el("select", {}, ...options.map(([id, text]) => el("option", { value: id, selected: id === value }, text)));
  const preset = select(settings.preset ?? "default", [["fast", "fast"], ["default", "default"], ["accurate", "accurate"]]);
  const intrinsics = select(settings.intrinsics ?? "refine", [["refine", "refine"], ["prior", "stay near the database's"], ["fixed", "fixed"]]);
  const matches = select(settings.matches ?? "verified", [["verified", "verified"], ["raw", "raw, verify again"]]);
  const seed = el("input", { type: "number", min: 0, step: 1, value: String(settings.seed ?? 0) });
  const backend = select(choice.backend, [["auto", "best there is"], ["gpu", "WebGPU"], ["cpu", "processor"]]);
  const rest = Object.fromEntries(Object.entries(settings).filter(([name]) => !["preset", "intrinsics", "matches", "seed"].includes(name)));
  const more = el("textarea", { rows: 5, spellcheck: false, "aria-describedby": "settings-problem", value: Object.keys(rest).length > 0 ? JSON.stringify(rest, null, 2) : "" });
  const problem = el("p", { id: "settings-problem", role: "alert", class: "bad" });
  const row = (/** @type {string} */ label, /** @type {HTMLElement} */ field) => el("label", { class: "row" }, el("span", {}, label), field);

  function save() {
    let parsed = {};
    try {
      parsed = more.value.trim() === "" ? {} : JSON.parse(more.value);
      if (typeof parsed !== "object" || parsed === null || Array.isArray(parsed)) throw new Error("write an object such as {\"refine\": {\"rounds\": 4}}");
    } catch (error) {
      problem.textContent = `Further settings: ${/** @type {Error} */ (error).message}`;
      more.focus();
      return;
    }
    /** @type {Record<string, any>} */
    const written = { ...parsed, preset: preset.value };
    if (intrinsics.value !== "refine") written.intrinsics = intrinsics.value;
    if (matches.value !== "verified") written.matches = matches.value;
    if (Number(seed.value) > 0) written.seed = Math.floor(Number(seed.value));
    changed({ settings: written, backend: /** @type {Choice["backend"]} */ (backend.value) });
    dialog.close();
  }

  const dialog = el("dialog", { "aria-labelledby": "settings-title", onclose: () => dialog.remove() },
    el("h2", { id: "settings-title" }, "Settings"),
    row("Preset", preset), row("Intrinsics", intrinsics), row("Matches", matches), row("Seed", seed), row("Compute on", backend),
    el("label", {}, el("span", {}, "Further settings, as in a settings file (JSON)"), more), problem,
    el("div", { class: "actions" },
      el("button", { type: "button", onclick: () => { changed(defaults()); dialog.close(); } }, "Defaults"),
      el("button", { type: "button", onclick: () => dialog.close() }, "Cancel"),
      el("button", { type: "button", class: "main", onclick: save }, "Use these")));
  document.body.append(dialog);
  dialog.showModal();
}
