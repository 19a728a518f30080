// Refusals: which file, why, what to do; over the scene, where one has just dropped something.

import { el } from "./dom.js";

/** More at once help nobody; the log has them all. */
const MOST = 4;

/** @param {HTMLElement} panel @param {import("../store.js").Store} store */
export function startProblems(panel, store) {
  const list = el("div", { class: "problems", role: "alert" });
  panel.append(list);
  store.on(["problems"], () => {
    const { problems } = store.state;
    const rest = problems.length - MOST;
    list.replaceChildren(...problems.slice(0, MOST).map((problem) => el("div", { class: "notice bad" },
      el("div", {}, el("b", {}, problem.file), `: ${problem.message}.`, problem.hint && el("p", {}, `${problem.hint[0].toUpperCase()}${problem.hint.slice(1)}.`)),
      el("button", { type: "button", class: "icon", "aria-label": `Dismiss: ${problem.file}`, onclick: () => store.set({ problems: store.state.problems.filter((other) => other !== problem) }) }, "×"))),
    ...(rest > 0 ? [el("div", { class: "notice bad" }, `and ${rest} more in the log`)] : []));
    // Where the panels are stacked the scene may be out of sight.
    if (problems.length > 0) list.scrollIntoView({ block: "nearest" });
  });
}
