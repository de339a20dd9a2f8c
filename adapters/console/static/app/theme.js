/** The theme of the page, dark or light: the browser's preference, or the operator's choice in this browser. */

import { button, set, setText } from "./dom.js";

/** Folder of Open MCT's files. */
export const OPENMCT = new URL("../vendor/openmct/", import.meta.url).pathname;
const CHOICE = "rover-console-theme";
/** Labels of the choices; without a choice the page follows the browser. @type {Record<string, string>} */
const LABELS = { "": "auto", light: "light", dark: "dark" };
const browserIsLight = matchMedia("(prefers-color-scheme: light)");

/** The choice; empty to follow the browser. */
const choice = () => Object.keys(LABELS).find((each) => each === localStorage.getItem(CHOICE)) ?? "";

/** Apply the theme to our styles, and to those of Open MCT once its link is in the page. */
export function applyTheme() {
  document.documentElement.dataset.theme = choice();
  const isLight = choice() ? choice() === "light" : browserIsLight.matches;
  const link = document.querySelector("link[data-openmct]");
  if (link) set(link, { href: `${OPENMCT}${isLight ? "snow" : "espresso"}Theme.css` });
}
applyTheme();
browserIsLight.addEventListener("change", applyTheme);

/** Return the button that changes the theme: as the browser, light, dark. */
export function themeButton() {
  const made = button("", "", next, { className: "theme" });
  function label() {
    setText(made, `◐ ${LABELS[choice()]}`);
    set(made, { title: "theme: as the browser prefers (auto), light or dark; click to change it", "aria-label": `theme ${LABELS[choice()]}` });
  }
  function next() {
    const names = Object.keys(LABELS);
    localStorage.setItem(CHOICE, names[(names.indexOf(choice()) + 1) % names.length]);
    applyTheme();
    label();
  }
  label();
  return made;
}
