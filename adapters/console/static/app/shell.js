/** The full console: Open MCT with the rovers as its objects, and the status bar with STOP above it. */

import { StatusBar } from "./views/status_bar.js";
import { cursor, span } from "./model/context.js";
import { login } from "./views/login.js";
import { identifierOf, partsOf } from "./openmct/identifiers.js";
import { objects } from "./openmct/objects.js";
import { storedObjects } from "./openmct/stored_objects.js";
import { telemetry } from "./openmct/telemetry.js";
import { user } from "./openmct/user.js";
import { views } from "./openmct/views.js";
import { Session } from "./model/session.js";

const MINUTE_MS = 60_000;
const AHEAD_MS = 5_000;
const TICK_MS = 250;
/** Storage key of Open MCT for the open branches. */
const OPEN_BRANCHES = "mct-tree-expanded";
const SPANS = { "5 minutes": 5, "15 minutes": 15, "1 hour": 60, "6 hours": 360 };
const DISPLAY_OPTIONS = "hideInspector=true&hideRecents=true";
const ROVERS = `#/browse/rover:rovers?${DISPLAY_OPTIONS}`;

await login();
const session = new Session();
/** @type {any} Open MCT sets this property. */
const { openmct } = /** @type {any} */ (window);

/** The clock of rover-console; the browser's clock may be wrong. */
class ConsoleClock {
  key = "console";
  name = "Console clock";
  description = "The time by the clock of rover-console";
  cssClass = "icon-clock";
  #listeners = new Set();

  constructor() {
    setInterval(() => this.#listeners.forEach((each) => each(this.currentValue())), TICK_MS);
  }

  on(_, listener) {
    this.#listeners.add(listener);
  }

  off(_, listener) {
    this.#listeners.delete(listener);
  }

  currentValue() {
    return session.now * 1000;
  }
}

/** @type {import("./model/context.js").Context["shown"]} */
const shown = {
  name: null,
  choose: (name) => {
    shown.name = name;
    const path = [identifierOf(), identifierOf(name), identifierOf(name, "layout")];
    const keys = path.map((each, index) => (index ? `rover:${each.key}` : "rover:rovers")).join("/");
    location.hash = `#/browse/${keys}?${DISPLAY_OPTIONS}`;
  },
};

const { plugins } = openmct;
openmct.setAssetPath("/vendor/openmct/");
for (const plugin of [
  plugins.UTCTimeSystem(),
  plugins.DisplayLayout({ showAsView: ["summary-widget"] }),
  plugins.LADTable(),
  plugins.Notebook(),
  plugins.Timeline(),
  plugins.Hyperlink(),
  plugins.BarChart(),
  plugins.ScatterPlot(),
  plugins.ClearData(["table", "telemetry.plot.overlay", "telemetry.plot.stacked"], { indicator: false }),
  objects(session),
  views(session, shown),
  telemetry(session),
  storedObjects(session),
  user(),
]) {
  openmct.install(plugin);
}

openmct.time.addClock(new ConsoleClock());
openmct.install(
  plugins.Conductor({
    menuOptions: [
      {
        name: "Real-time",
        timeSystem: "utc",
        clock: "console",
        clockOffsets: { start: -5 * MINUTE_MS, end: AHEAD_MS },
        presets: Object.entries(SPANS).map(([label, minutes]) => ({
          label,
          bounds: { start: -minutes * MINUTE_MS, end: AHEAD_MS },
        })),
      },
      {
        name: "Fixed",
        timeSystem: "utc",
        bounds: { start: Date.now() - 60 * MINUTE_MS, end: Date.now() },
        presets: Object.entries(SPANS).map(([label, minutes]) => ({
          label: `Last ${label}`,
          bounds: { start: () => Date.now() - minutes * MINUTE_MS, end: () => Date.now() },
        })),
      },
    ],
  }),
);
openmct.time.setTimeSystem("utc");
openmct.time.setClock("console");
openmct.time.setClockOffsets({ start: -5 * MINUTE_MS, end: AHEAD_MS });
openmct.time.setMode("realtime");

/** In fixed time the map shows the pose of the rover at the end of the span. */
function followTime() {
  const isFixed = openmct.time.isFixed();
  if (isFixed) cursor.set(openmct.time.getBounds().end / 1000);
  else if (wasFixed) cursor.set(null);
  wasFixed = isFixed;
}
let wasFixed = false;
openmct.time.on("boundsChanged", (_, isTick) => isTick || followTime());
/** Pass the span of the time conductor to the views. */
const followSpan = ({ start, end }) => span.set(start / 1000, end / 1000);
openmct.time.on("boundsChanged", followSpan);
followSpan(openmct.time.getBounds());
openmct.time.on("modeChanged", followTime);
cursor.on(() => {
  if (cursor.utc_s === null && openmct.time.isFixed()) openmct.time.setMode("realtime");
});

/** Show a recording over its own time, and a rover in real time. */
function followAsset() {
  const recording = shown.name === null ? null : session.asset(shown.name).recording;
  const name = recording ? shown.name : null;
  if (name === shownRecording) return;
  if (shownRecording !== null && !session.assets.has(shownRecording)) location.hash = ROVERS;
  if (recording) openmct.time.setMode("fixed", { start: recording.start * 1000, end: Math.ceil(recording.end * 1000) });
  else openmct.time.setMode("realtime");
  shownRecording = name;
}
/** @type {string | null} the shown recording */
let shownRecording = null;

/** Return the asset of the shown object, else the first asset. */
function chosen() {
  const found = /rover:([^/?]+)(?:[?]|$)/.exec(location.hash.replace(/rover:rovers\/?/, ""));
  const name = found ? partsOf({ key: found[1] })[0] : null;
  const assets = session.rovers;
  if (assets.some((each) => each.name === name)) return name;
  if (name !== null && shown.name !== null && session.assets.has(name)) return shown.name;
  return (assets.find((each) => !each.recording) ?? assets[0])?.name ?? null;
}

/** Show the first rover as soon as there is one, if the address names no object. */
function choose() {
  const name = chosen();
  if (hasNoPath && name !== null) {
    hasNoPath = false;
    shown.choose(name);
  }
  shown.name = name;
  followAsset();
}
let hasNoPath = !location.hash.includes(":");
if (hasNoPath) location.hash = ROVERS;

/** Let Open MCT open the branch of the first rover, until the operator opens or folds a branch. */
function openTree() {
  if (localStorage.getItem(OPEN_BRANCHES) !== null) return;
  const name = chosen();
  const root = "/browse/rover:rovers";
  const branches = name === null ? [root] : [root, `${root}/rover:${identifierOf(name).key}`];
  localStorage.setItem(OPEN_BRANCHES, JSON.stringify(branches));
}

session.on("assets", choose);
addEventListener("hashchange", choose);
StatusBar.mount(document.querySelector("#top"), { session, shown });
await session.ready;
choose();
openTree();
openmct.start(document.querySelector("#openmct"));
