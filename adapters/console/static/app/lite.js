/** The light page for slow links and small screens: STOP and operations, without Open MCT. */

import { html, reconcile } from "./dom.js";
import { fullLink } from "./light_page.js";
import { LIGHT_TOPICS, Session } from "./model/session.js";
import { identifierOf } from "./openmct/identifiers.js";
import { login } from "./views/login.js";
import { OperationsView } from "./views/operations.js";
import { StatusBar } from "./views/status_bar.js";

const session = new Session(await login(), LIGHT_TOPICS);
/** @type {import("./model/context.js").Context["shown"]} */
const shown = {
  name: null,
  choose: (name) => {
    shown.name = name;
    session.changed("assets");
  },
};
const top = html("div");
const operations = html("div", { id: "operations" });
const recordings = html("nav", { "aria-label": "recordings" });
document.body.append(
  top,
  operations,
  html("footer", {}, fullLink("full console"), html("a", { href: "/help", textContent: "help" }), "Light page, without Open MCT.", recordings),
);

/** Show the first rover as soon as there is one, and the links of the recordings. */
function choose() {
  shown.name ??= session.rovers[0]?.name ?? null;
  const makeLink = (name) => html("a", { href: `/#/browse/rover:rovers/rover:${identifierOf(name).key}/rover:${identifierOf(name, "layout").key}`, textContent: `${name} (full console)` });
  reconcile(recordings, [...session.omitted], String, makeLink);
}
session.on("assets", choose);
choose();
StatusBar.mount(top, { session, shown });
OperationsView.mount(operations, { session, shown });
