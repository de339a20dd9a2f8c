/** The choice between the full console and the light page on small screens, kept in this browser. */

import { button, html } from "./dom.js";

const CHOICE = "rover-console-page";
const SMALL = "(max-width: 700px)";

/** @param {"light" | "full"} page */
const choose = (page) => localStorage.setItem(CHOICE, page);

/** @param {string} textContent */
export const lightLink = (textContent) => html("a", { href: "/lite", textContent, onclick: () => choose("light") });

/** @param {string} textContent */
export const fullLink = (textContent) => html("a", { href: "/", textContent, onclick: () => choose("full") });

/** In a small window offer the light page, or open it if the operator chose it before. */
export function offerLightPage() {
  const chosen = localStorage.getItem(CHOICE);
  if (!matchMedia(SMALL).matches || chosen === "full") return;
  if (chosen === "light") return location.replace("/lite");
  const stay = button("stay", "show the full console in small windows, too", () => (choose("full"), offer.remove()));
  const offer = html("div", { className: "rover-view light-offer", role: "status" }, "This window is small.", lightLink("Open the light page"), stay);
  document.querySelector("#top").after(offer);
}
