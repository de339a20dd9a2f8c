/**
 * The full console: first the status bar with STOP, then operations without Open MCT, until Open MCT is loaded. That
 * takes 40 s by a slow link.
 */

import { button, html, setText } from "./dom.js";
import { lightLink, offerLightPage } from "./light_page.js";
import { Session } from "./model/session.js";
import { Shown } from "./openmct/address.js";
import { OPENMCT, applyTheme } from "./theme.js";
import { login } from "./views/login.js";
import { StatusBar } from "./views/status_bar.js";

offerLightPage();
const session = new Session(await login());
const shown = new Shown(session);
StatusBar.mount(document.querySelector("#top"), { session, shown });

const { OperationsView } = await import("./views/operations.js");
const state = html("span", { role: "status", textContent: "The full console is loading …" });
const pane = html("div", { id: "operations" });
const unmount = OperationsView.mount(pane, { session, shown });
pane.append(html("footer", {}, state, lightLink("light page, without Open MCT")));
document.querySelector("#shell").append(pane);
/** Whether the operator works in the pane; it is then not replaced under the pointer. */
let isUsed = false;
for (const each of ["pointerdown", "keydown", "input"]) pane.addEventListener(each, () => (isUsed = true), { once: true });

/** Add an element to the head, before our styles; resolves when its file is loaded. @param {HTMLElement} element */
const loaded = (element) =>
  new Promise((resolve, reject) => {
    Object.assign(element, { onload: resolve, onerror: reject });
    document.head.prepend(element);
    applyTheme();
  });

try {
  const [{ start }] = await Promise.all([
    import("./shell.js"),
    loaded(html("script", { src: `${OPENMCT}openmct.js` })),
    loaded(html("link", { rel: "stylesheet", "data-openmct": "" })),
  ]);
  if (isUsed) await new Promise((resolve) => state.replaceChildren(button("show the full console", "Open MCT is loaded; the typed command stays", resolve)));
  await start(session, shown);
  unmount();
  pane.remove();
} catch (error) {
  setText(state, "The full console could not be loaded: reload the page.");
  throw error;
}
