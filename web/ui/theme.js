// Dark, light or the system's: one attribute on the root; whoever draws on a canvas listens.

const ORDER = ["system", "dark", "light"];
const LABELS = { system: "◐", dark: "●", light: "○" };

/** Keeps the choice for the next visit; private windows may refuse. */
const storage = {
  get: () => {
    try {
      return localStorage.getItem("epipole.theme");
    } catch {
      return null;
    }
  },
  /** @param {string} theme */
  set: (theme) => {
    try {
      localStorage.setItem("epipole.theme", theme);
    } catch { /* the choice holds for this visit */ }
  },
};

/** @param {HTMLButtonElement} button @param {() => void} changed */
export function startTheme(button, changed) {
  let theme = storage.get() ?? "system";
  const apply = () => {
    if (theme === "system") delete document.documentElement.dataset.theme;
    else document.documentElement.dataset.theme = theme;
    button.textContent = LABELS[/** @type {keyof typeof LABELS} */ (theme)] ?? LABELS.system;
    button.title = `Theme: ${theme}`;
    button.setAttribute("aria-label", `Theme: ${theme}`);
    changed();
  };
  const next = () => {
    theme = ORDER[(ORDER.indexOf(theme) + 1) % ORDER.length];
    storage.set(theme);
    apply();
  };
  button.addEventListener("click", next);
  matchMedia("(prefers-color-scheme: light)").addEventListener("change", apply);
  apply();
  return { next };
}
