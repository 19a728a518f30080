// The middle panel: the drop zone before, the scene after, and what decides how it looks.

import { el, hide, token } from "../ui/dom.js";
import { count, pixels, plural } from "../ui/format.js";
import { startControls } from "./controls.js";
import { ramp } from "./colors.js";
import { View } from "./view.js";

/**
 * @param {HTMLElement} panel @param {import("../store.js").Store} store @param {import("../engine/client.js").Engine} engine
 * @param {{ pickFiles: () => void, pickFolder: () => void, sample: () => void }} on
 */
export function scenePanel(panel, store, engine, on) {
  const canvas = el("canvas", { class: "view", tabIndex: 0, role: "application", "aria-roledescription": "3-D scene", "aria-label": "Scene: arrow keys orbit, W A S D Q E fly, plus and minus zoom" });
  const facts = el("div", { class: "facts", role: "status" });
  const legend = el("div", { class: "legend hidden" });
  const inspector = el("aside", { class: "inspector hidden", "aria-label": "Selected point" });
  const unavailable = el("p", { class: "notice bad hidden" });

  const drop = el("div", { class: "drop" },
    el("div", { class: "drop-card" },
      el("h2", {}, "Drop a COLMAP database"),
      el("p", { class: "quiet" }, "database.db, a folder or a zip, with photographs and depth maps if you have them. COLMAP models open for viewing."),
      el("div", { class: "drop-actions" },
        el("button", { type: "button", class: "main", onclick: on.pickFiles }, "Choose files"),
        el("button", { type: "button", onclick: on.pickFolder }, "Choose a folder"),
        el("button", { type: "button", onclick: on.sample }, "Try a sample")),
      el("p", { class: "quiet small" }, "Nothing is uploaded: the page is forbidden to send anything, by a content security policy.")));

  const view = new View(canvas, {
    shown: (points, scale) => {
      shown = points;
      describe();
      hide(legend, scale === null);
      if (scale) {
        const stops = [0, 1 / 3, 2 / 3, 1].map((t) => `rgb(${ramp(t).map(Math.round).join(" ")})`).join(", ");
        const bar = el("span", { class: "bar-of-colour" });
        bar.style.background = `linear-gradient(90deg, ${stops})`;
        legend.replaceChildren(bar, el("span", { class: "ends" }, el("span", {}, scale.low), el("span", {}, scale.label), el("span", {}, scale.high)));
      }
    },
    unavailable: (message) => {
      unavailable.textContent = message;
      hide(unavailable, false);
    },
  });
  let shown = 0;
  let last = { points: 0, cameras: 0 };

  /** @param {Record<string, any>} look */
  const look = (look) => view.send({ type: "look", look });
  const select = (/** @type {string} */ label, /** @type {[string, string][]} */ options, /** @type {(value: string) => void} */ change) =>
    el("label", {}, el("span", {}, label), el("select", { onchange: (/** @type {Event} */ e) => change(/** @type {HTMLSelectElement} */ (e.target).value) }, ...options.map(([value, text]) => el("option", { value }, text))));
  const slider = (/** @type {string} */ label, /** @type {number} */ min, /** @type {number} */ max, /** @type {number} */ value, /** @type {(value: number) => void} */ change) =>
    el("label", {}, el("span", {}, label), el("input", { type: "range", min, max, step: (max - min) / 100, value, oninput: (/** @type {Event} */ e) => change(Number(/** @type {HTMLInputElement} */ (e.target).value)) }));
  const component = el("select", { "aria-label": "Component", onchange: () => store.set({ component: component.value === "" ? null : Number(component.value) }) });
  const componentRow = el("label", { class: "hidden" }, el("span", {}, "Model"), component);
  const errorFilter = el("input", { type: "number", min: 0, step: 0.5, placeholder: "any", "aria-label": "Largest reprojection error, px", oninput: () => filter() });
  const trackFilter = el("input", { type: "number", min: 2, step: 1, placeholder: "2", "aria-label": "Fewest observations of a point", oninput: () => filter() });
  function filter() {
    store.set({ filter: { maxErrorPx: errorFilter.value === "" ? Infinity : Number(errorFilter.value), minTrack: Math.max(2, Number(trackFilter.value) || 2) } });
  }
  const tools = el("div", { class: "tools hidden", role: "toolbar", "aria-label": "How the scene looks" },
    select("Colour", [["rgb", "photo"], ["error", "error"], ["track", "observations"], ["component", "component"]], (by) => look({ by })),
    slider("Points", 1, 8, 2, (pointSize) => look({ pointSize })),
    slider("Frusta", 0, 3, 1, (frustumScale) => look({ frustumScale })),
    select("Frusta by", [["plain", "one colour"], ["error", "error"], ["component", "component"]], (frustaBy) => look({ frustaBy })),
    el("label", { class: "narrow" }, el("span", {}, "Error ≤"), errorFilter),
    el("label", { class: "narrow" }, el("span", {}, "Seen ≥"), trackFilter),
    componentRow,
    select("View", [["perspective", "perspective"], ["orthographic", "parallel"]], (kind) => view.send({ type: "projection", orthographic: kind === "orthographic" })),
    el("button", { type: "button", onclick: () => view.send({ type: "frame" }) }, "Whole scene"));
  panel.append(canvas, facts, legend, unavailable, inspector, drop, tools);

  startControls(canvas, view, {
    click: async (x, y) => {
      const hit = await view.pick(x, y);
      if (hit.image !== null) store.set({ selection: { kind: "image", image: hit.image } });
      else if (hit.point !== null) store.set({ selection: { kind: "point", point: hit.point } });
      else store.set({ selection: { kind: "none" } });
    },
    doubleClick: async (x, y) => {
      const hit = await view.pick(x, y);
      if (hit.image !== null) view.send({ type: "snap", image: hit.image });
      else if (hit.point !== null) view.send({ type: "goTo", point: hit.point });
    },
  });

  function describe() {
    const { report, opened } = store.state;
    if (!opened || last.cameras + last.points === 0) {
      facts.replaceChildren();
      return;
    }
    const parts = [`${count(last.points)} points`, plural(last.cameras, "camera")];
    const observations = report?.components.reduce((sum, c) => sum + c.points, 0) ?? 0;
    if (report && observations > 0) {
      parts.push(pixels(report.components.reduce((sum, c) => sum + c.mean_reprojection_error_px * c.points, 0) / observations));
    }
    facts.replaceChildren(el("b", {}, parts.join(" · ")), shown < last.points ? el("span", { class: "quiet" }, ` ${count(shown)} shown`) : "");
  }

  async function inspect() {
    const { selection } = store.state;
    hide(inspector, selection.kind !== "point");
    view.send({ type: "select", image: selection.kind === "image" || selection.kind === "pair" ? selection.image : null, point: selection.kind === "point" ? selection.point : null });
    if (selection.kind !== "point") return;
    const track = await engine.ask({ type: "track", point: selection.point ?? 0 }).catch(() => null);
    if (!track || store.state.selection.kind !== "point") return;
    inspector.replaceChildren(
      el("div", { class: "heading" }, el("h2", {}, "Point"), el("button", { type: "button", class: "icon", "aria-label": "Close", onclick: () => store.set({ selection: { kind: "none" } }) }, "×")),
      el("p", {}, `seen ${plural(track.observations.length, "time")} · ${pixels(track.errorPx)} · ${track.angleDeg.toFixed(1)}° apart at most`),
      el("p", { class: "quiet" }, track.position.map((/** @type {number} */ x) => x.toFixed(3)).join(", ")),
      el("table", {}, el("tbody", {}, ...track.observations.map((/** @type {{image: number, errorPx: number}} */ o) => el("tr", {},
        el("td", {}, el("button", { type: "button", class: "link", onclick: () => store.set({ selection: { kind: "image", image: o.image } }) }, store.state.opened?.images[o.image]?.name.split("/").at(-1) ?? "")),
        el("td", {}, pixels(o.errorPx)))))));
  }

  function components() {
    const parts = store.state.report?.components ?? [];
    hide(componentRow, parts.length < 2);
    component.replaceChildren(el("option", { value: "" }, `all ${parts.length}`), ...parts.map((part, k) => el("option", { value: String(k) }, `${k + 1}: ${plural(part.images, "image")}, ${count(part.points)} points`)));
    look({ imageErrors: (store.state.report?.images ?? []).map((image) => image.mean_reprojection_error_px) });
    describe();
  }

  function theme() {
    const rgb = (/** @type {string} */ name) => {
      const hex = Number.parseInt(token(name).slice(1), 16);
      return [(hex >> 16) & 255, (hex >> 8) & 255, hex & 255];
    };
    look({
      background: rgb("--ground").map((x) => x / 255), frustumColor: rgb("--frustum"), accent: rgb("--accent"),
      still: matchMedia("(prefers-reduced-motion: reduce)").matches,
    });
  }

  store.on(["selection"], inspect);
  store.on(["report"], components);
  store.on(["filter", "component"], () => look({ filter: store.state.filter, component: store.state.component }));
  store.on(["opened"], () => {
    view.send({ type: "clear" });
    last = { points: 0, cameras: 0 };
    component.value = "";
    describe();
  });
  store.on(["phase", "opened"], () => {
    hide(drop, store.state.opened !== null || store.state.phase === "opening");
    hide(tools, store.state.opened === null);
  });
  theme();
  return {
    theme,
    snap: (/** @type {number} */ image) => view.send({ type: "snap", image }),
    frame: () => view.send({ type: "frame" }),
    /** @param {import("../engine/protocol.js").Snapshot} snapshot */
    show: (snapshot) => {
      last = { points: snapshot.positions.length / 3, cameras: snapshot.cameraImage.length };
      view.show(snapshot);
      describe();
    },
    dropTarget: drop,
  };
}
