// What happened, line by line, and a report that one can paste into a bug report.

import { el } from "../ui/dom.js";
import { duration } from "../ui/format.js";

/** Older lines go: a log is read at its end. */
const MAX_LINES = 2000;

export function log() {
  const lines = el("ol", { class: "log", tabIndex: 0, "aria-label": "Log" });
  const copied = el("span", { class: "quiet", role: "status" });
  const node = el("details", { class: "block" }, el("summary", {}, "Log"), lines,
    el("button", { type: "button", onclick: async () => {
      try {
        await navigator.clipboard.writeText(text());
        copied.textContent = " copied";
      } catch {
        copied.textContent = " the browser does not allow copying: select the lines instead";
      }
    } }, "Copy report"), copied);
  const start = performance.now();
  /** @type {() => string} */
  let heading = () => "";
  const text = () => [heading(), ...[...lines.children].map((line) => line.textContent ?? "")].join("\n");
  return {
    node,
    text,
    /** @param {() => string} facts what a bug report should begin with */
    setHeading(facts) {
      heading = facts;
    },
    /** @param {string} message @param {"plain"|"fair"|"bad"} [kind] */
    add(message, kind = "plain") {
      const line = el("li", { class: kind }, el("span", { class: "quiet" }, duration((performance.now() - start) / 1000)), ` ${message}`);
      const atEnd = lines.scrollTop + lines.clientHeight > lines.scrollHeight - 30;
      lines.append(line);
      while (lines.children.length > MAX_LINES) lines.firstChild?.remove();
      if (atEnd) lines.scrollTop = lines.scrollHeight;
    },
  };
}
