// How the scene looks: colour, sizes, what is left out. What is used most stands in the bar, the rest one press away.

import { el, hide } from "../ui/dom.js";
import { sheet } from "../ui/sheet.js";
import { count, plural } from "../ui/format.js";

/**
 * @param {import("../store.js").Store} store @param {(look: Record<string, any>) => void} look
 * @param {{ frame: () => void, projection: (orthographic: boolean) => void }} on
 */
export function toolbar(store, look, on) {
  const select = (/** @type {string} */ label, /** @type {[string, string][]} */ options, /** @type {(value: string) => void} */ change) => {
    const field = el("select", { onchange: () => change(field.value) }, ...options.map(([value, text]) => el("option", { value }, text)));
    return el("label", {}, el("span", {}, label), field);
  };
  // Twice as large is as far from the middle as half as large.
  const slider = (/** @type {string} */ label, /** @type {number} */ most, /** @type {(factor: number) => void} */ change) => {
    const field = el("input", { type: "range", min: -1, max: 1, step: 0.02, value: "0", oninput: () => change(most ** Number(field.value)) });
    return el("label", {}, el("span", {}, label), field);
  };
  const maxError = el("input", { type: "number", min: 0, step: 0.25, placeholder: "any", oninput: () => filter() });
  const minTrack = el("input", { type: "number", min: 2, step: 1, placeholder: "2", oninput: () => filter() });
  const component = el("select", { onchange: () => store.set({ component: component.value === "" ? null : Number(component.value) }) });
  const componentRow = el("label", { class: "hidden" }, el("span", {}, "Model"), component);
  const frusta = el("input", { type: "checkbox", checked: true, onchange: () => sized() });
  let frustumScale = 1;

  function filter() {
    store.set({ filter: { maxErrorPx: maxError.value === "" ? Infinity : Math.max(0, Number(maxError.value)), minTrack: Math.max(2, Math.round(Number(minTrack.value)) || 2) } });
  }
  const sized = () => look({ frustumScale: frusta.checked ? frustumScale : 0 });

  const filters = sheet("Filter", "Which points",
    el("label", {}, el("span", {}, "Error at most, px"), maxError),
    el("label", {}, el("span", {}, "Observations at least"), minTrack),
    el("p", { class: "quiet small" }, "The download leaves out what the view leaves out."),
    el("button", { type: "button", onclick: () => { maxError.value = minTrack.value = ""; filter(); } }, "Show all"));
  const views = sheet("View", "How to look",
    select("Camera colour", [["plain", "one colour"], ["error", "mean error"], ["component", "component"]], (frustaBy) => look({ frustaBy })),
    select("Projection", [["perspective", "perspective"], ["orthographic", "parallel"]], (kind) => on.projection(kind === "orthographic")),
    el("label", {}, el("span", {}, "Show cameras"), frusta));

  const node = el("div", { class: "tools hidden", role: "toolbar", "aria-label": "How the scene looks" },
    select("Colour", [["rgb", "photo"], ["error", "error"], ["track", "observations"], ["component", "component"]], (by) => look({ by })),
    componentRow,
    slider("Points", 3, (pointScale) => look({ pointScale })),
    slider("Cameras", 4, (factor) => { frustumScale = factor; sized(); }),
    filters.node, views.node,
    el("button", { type: "button", class: "link-like plain", title: "See the whole scene (F)", onclick: on.frame }, "Fit"));

  function components() {
    const parts = store.state.report?.components ?? [];
    hide(componentRow, parts.length < 2);
    component.replaceChildren(el("option", { value: "" }, `all ${parts.length}`), ...parts.map((part, k) => el("option", { value: String(k) }, `${k + 1}: ${plural(part.images, "image")}, ${count(part.points)} points`)));
    component.value = store.state.component === null ? "" : String(store.state.component);
  }
  store.on(["report"], components);
  store.on(["filter"], () => {
    const { maxErrorPx, minTrack: least } = store.state.filter;
    filters.mark(Number.isFinite(maxErrorPx) || least > 2);
  });
  store.on(["opened"], () => {
    maxError.value = minTrack.value = "";
    filters.close();
    views.close();
  });
  return { node };
}
