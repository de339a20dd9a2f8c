/**
 * The keyboard shortcuts of every page, and their list below the status bar. Letters act with Alt only, so that
 * typed text and screen readers are not disturbed.
 */

import { button, html, tableHead } from "../dom.js";

/** Elements that a shortcut focuses, by the code of the key with Alt. */
const TARGETS = { KeyC: ".form-view select", KeyL: '.command .head[tabindex="0"]', KeyK: ".teleop .arm", KeyQ: ".question button" };
const SHORTCUTS = [
  ["F8, Pause, Ctrl+Space", "STOP, with the cursor anywhere"],
  ["Alt+C", "go to the command form"],
  ["Enter in a field of the form", "go to Send; nothing is sent"],
  ["Ctrl+Enter in the form", "send the command"],
  ["Alt+L", "go to the list of commands"],
  ["↑ ↓ Home End in the list", "go to another command"],
  ["Enter in the list", "open the command: its stages, and why it ended so"],
  ["Alt+Q", "go to the answers of an open question of a plan"],
  ["Alt+K", "go to “drive by keys” beside the camera"],
  ["W A S D or arrows, while that is on", "drive; the rover stops as you release the key"],
  ["?", "open and close this list"],
];

/** Whether a key is a stop: F8, Pause, or Ctrl+Space on keyboards without them. @param {KeyboardEvent} event */
export const isStopKey = ({ key, code, ctrlKey }) => ["F8", "Pause"].includes(key) || (code === "Space" && ctrlKey);

export class Shortcuts {
  button = button("keys", "keyboard shortcuts (?)", () => this.#toggle(), { "aria-expanded": "false" });
  element = html(
    "div",
    { className: "alarm-list shortcuts", hidden: true },
    html("table", {}, tableHead("key", "effect"), html("tbody", {}, ...SHORTCUTS.map((texts) => html("tr", {}, ...texts.map((textContent) => html("td", { textContent })))))),
  );

  /** Act on a key of the page. @param {KeyboardEvent} event */
  onKey(event) {
    const target = event.altKey && !event.ctrlKey && TARGETS[event.code] ? document.querySelector(TARGETS[event.code]) : null;
    const isTyping = event.target instanceof Element && event.target.closest("input, textarea, select, [contenteditable]");
    if (target instanceof HTMLElement) target.focus();
    else if (event.key === "?" && !isTyping) this.#toggle();
    else if (event.key === "Escape" && !this.element.hidden) this.#toggle();
    else return;
    event.preventDefault();
  }

  #toggle() {
    this.element.hidden = !this.element.hidden;
    this.button.setAttribute("aria-expanded", String(!this.element.hidden));
  }
}
