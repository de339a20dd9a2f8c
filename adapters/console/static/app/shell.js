/** Open MCT with the rovers as its objects, and the clock of rover-console. */

import { operator } from "./model/connection.js";
import { cursor, span } from "./model/context.js";
import { ROVERS, keepNewerAddress } from "./openmct/address.js";
import { identifierOf } from "./openmct/identifiers.js";
import { objects } from "./openmct/objects.js";
import { storedObjects } from "./openmct/stored_objects.js";
import { telemetry } from "./openmct/telemetry.js";
import { views } from "./openmct/views.js";
import { OPENMCT } from "./theme.js";

/** @import { Session } from "./model/session.js" */
/** @import { Shown } from "./openmct/address.js" */

const MINUTE_MS = 60_000;
const AHEAD_MS = 5_000;
const TICK_MS = 250;
/** Storage key of Open MCT for the open branches. */
const OPEN_BRANCHES = "mct-tree-expanded";
const SPANS = { "5 minutes": 5, "15 minutes": 15, "1 hour": 60, "6 hours": 360 };

/** The clock of rover-console; the browser's clock may be wrong. */
class ConsoleClock {
  key = "console";
  name = "Console clock";
  description = "The time by the clock of rover-console";
  cssClass = "icon-clock";
  #listeners = new Set();
  #session;

  /** @param {Session} session */
  constructor(session) {
    this.#session = session;
    setInterval(() => this.#listeners.forEach((each) => each(this.currentValue())), TICK_MS);
  }

  on(_, listener) {
    this.#listeners.add(listener);
  }

  off(_, listener) {
    this.#listeners.delete(listener);
  }

  currentValue() {
    return this.#session.now * 1000;
  }
}

/** Start Open MCT; resolves once it shows its pages. @param {Session} session @param {Shown} shown @returns {Promise<void>} */
export async function start(session, shown) {
  /** @type {any} Open MCT sets this property. */
  const { openmct } = /** @type {any} */ (window);
  const { plugins } = openmct;
  openmct.setAssetPath(OPENMCT);
  openmct.time.addClock(new ConsoleClock(session));
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
    conductor(plugins),
  ]) {
    openmct.install(plugin);
  }
  followRealTime(openmct.time);
  shareTime(openmct.time);
  await session.ready;
  followAsset(openmct.time, session, shown);
  openTree(shown);
  keepNewerAddress(openmct.router);
  await new Promise((resolve) => {
    openmct.once("start", resolve);
    openmct.start(document.querySelector("#openmct"));
  });
}

/** The time conductor, with its spans. */
const conductor = (plugins) =>
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
  });

function followRealTime(time) {
  time.setTimeSystem("utc");
  time.setClock("console");
  time.setClockOffsets({ start: -5 * MINUTE_MS, end: AHEAD_MS });
  time.setMode("realtime");
}

/** Pass the span of the time conductor to the views. In fixed time the map shows the pose of the rover at its end. */
function shareTime(time) {
  let wasFixed = false;
  function followTime() {
    const isFixed = time.isFixed();
    if (isFixed) cursor.set(time.getBounds().end / 1000);
    else if (wasFixed) cursor.set(null);
    wasFixed = isFixed;
  }
  const followSpan = ({ start, end }) => span.set(start / 1000, end / 1000);
  time.on("boundsChanged", (_, isTick) => isTick || followTime());
  time.on("boundsChanged", followSpan);
  time.on("modeChanged", followTime);
  followSpan(time.getBounds());
  cursor.on(() => {
    if (cursor.utc_s === null && time.isFixed()) time.setMode("realtime");
  });
}

/** Show a recording over its own time, and a rover in real time. @param {any} time @param {Session} session @param {Shown} shown */
function followAsset(time, session, shown) {
  /** @type {string | null} the shown recording */
  let shownRecording = null;
  function follow() {
    const recording = shown.name === null ? null : session.asset(shown.name).recording;
    const name = recording ? shown.name : null;
    if (name === shownRecording) return;
    if (shownRecording !== null && !session.assets.has(shownRecording)) location.hash = ROVERS;
    if (recording) time.setMode("fixed", { start: recording.start * 1000, end: Math.ceil(recording.end * 1000) });
    else time.setMode("realtime");
    shownRecording = name;
  }
  session.on("assets", follow);
  addEventListener("hashchange", follow);
  follow();
}

/** Let Open MCT open the branch of the shown rover, until the operator opens or folds a branch. @param {Shown} shown */
function openTree({ name }) {
  if (localStorage.getItem(OPEN_BRANCHES) !== null) return;
  const root = "/browse/rover:rovers";
  const branches = name === null ? [root] : [root, `${root}/rover:${identifierOf(name).key}`];
  localStorage.setItem(OPEN_BRANCHES, JSON.stringify(branches));
}

/** Make the operator the user of Open MCT, which writes the name to displays and notebook entries. */
function user() {
  return (openmct) => {
    openmct.user.setProvider({
      on: () => {},
      off: () => {},
      isLoggedIn: () => true,
      getCurrentUser: async () => new openmct.user.User(operator.name, operator.name),
      getPossibleRoles: async () => [],
      hasRole: async () => false,
    });
  };
}
