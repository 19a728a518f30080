// Every image with its state, points and error: the plain twin of thumbnails and scene.

import { el } from "../ui/dom.js";
import { count, pixels } from "../ui/format.js";
import { median, standing } from "../inputs/reasons.js";

/** @param {import("../store.js").Store} store @param {(image: number) => void} select */
export function imageTable(store, select) {
  const body = el("tbody");
  const node = el("details", { class: "block hidden" }, el("summary", {}, "Images"),
    el("div", { class: "table" }, el("table", {}, el("thead", {}, el("tr", {}, el("th", {}, "image"), el("th", {}, "points"), el("th", {}, "error"), el("th", {}, "state"))), body)));
  const fill = () => {
    const report = store.state.report;
    node.classList.toggle("hidden", !report);
    if (!report || !node.open) {
      body.replaceChildren();
      return;
    }
    const middle = median(report.images.map((image) => image.mean_reprojection_error_px));
    body.replaceChildren(...report.images.map((image, k) => {
      const is = standing(image, middle);
      return el("tr", {},
        el("td", {}, el("button", { type: "button", class: "link", onclick: () => select(k) }, image.name.split("/").at(-1) ?? "")),
        el("td", {}, count(image.points)), el("td", {}, pixels(image.mean_reprojection_error_px)),
        el("td", {}, is.standing === "placed" ? "placed" : `${is.standing === "weak" ? "weak" : "not placed"}: ${is.why}`));
    }));
  };
  node.addEventListener("toggle", fill);
  store.on(["report"], fill);
  return { node };
}
