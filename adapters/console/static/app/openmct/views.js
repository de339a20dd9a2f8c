/** The console's views as views of Open MCT: one object for each view of an asset. */

import { AlarmsView } from "../views/alarms.js";
import { CommandForm } from "../views/command_form.js";
import { CommandTable } from "../views/command_table.js";
import { contextOf } from "../model/context.js";
import { RelayView } from "../views/relay.js";
import { FilesView } from "../views/files.js";
import { FleetView } from "../views/fleet.js";
import { LogView } from "../views/log.js";
import { MapView } from "../views/map.js";
import { PlansView } from "../views/plans.js";
import { RecordingView } from "../views/recording.js";
import { TimeStripView } from "../views/time_strip.js";
import { TreeView } from "../views/tree.js";
import { ValuesView } from "../views/values.js";
import { VideoView } from "../views/video.js";
import { NAMESPACE, partsOf } from "./identifiers.js";

/** Views by the last part of the object's key; `of` restricts a view to rovers or recordings, `console` adds it to the console, `help` is its part of the documentation. @type {Record<string, {name: string, icon: string, help: string, view: any, of?: "rover" | "recording", console?: boolean}>} */
export const VIEWS = {
  map: { name: "Map", icon: "icon-map", help: "console.md#map", view: MapView },
  form: { name: "Command", icon: "icon-command", help: "console.md#command-and-stop", view: CommandForm, of: "rover" },
  commands: { name: "Commands", icon: "icon-activity", help: "console.md#command-and-stop", view: CommandTable },
  tree: { name: "Behaviour tree", icon: "icon-conditional", help: "watch-a-tree.md", view: TreeView },
  strip: { name: "Time strip", icon: "icon-timeline", help: "console.md#history-time-strip", view: TimeStripView },
  values: { name: "Latest values", icon: "icon-tabular-lad", help: "console.md#housekeeping-of-the-components", view: ValuesView, console: true },
  log: { name: "Log", icon: "icon-list-view", help: "why.md", view: LogView },
  alarms: { name: "Alarms", icon: "icon-bell", help: "console.md#alarms", view: AlarmsView, of: "rover", console: true },
  dtn: { name: "Relay", icon: "icon-chain-links", help: "console.md#relay-link-orbiter", view: RelayView, of: "rover" },
  video: { name: "Camera", icon: "icon-camera", help: "see-the-video.md", view: VideoView, of: "rover" },
  plans: { name: "Plans", icon: "icon-plan", help: "write-a-plan.md", view: PlansView, of: "rover" },
  files: { name: "Files", icon: "icon-image", help: "console.md#files", view: FilesView, of: "rover", console: true },
  recording: { name: "Recording", icon: "icon-session", help: "console.md#view-a-recording", view: RecordingView, of: "recording" },
};

/** Return the kinds of views of an asset. @param {import("../model/asset.js").Asset} asset */
export function viewsOf(asset) {
  if (asset.isConsole) return Object.keys(VIEWS).filter((kind) => VIEWS[kind].console);
  const other = asset.recording ? "rover" : "recording";
  return Object.keys(VIEWS).filter((kind) => VIEWS[kind].of !== other);
}

/** @param {import("../model/session.js").Session} session @param {import("../model/context.js").Context["shown"]} shown */
export function views(session, shown) {
  return (openmct) => {
    addView(openmct, "rover.fleet", "Rovers", "icon-object", (_, element) => FleetView.mount(element, { session, shown }));
    for (const [kind, { name, icon, view }] of Object.entries(VIEWS)) {
      addView(openmct, `rover.${kind}`, name, icon, (object, element) =>
        view.mount(element, { ...contextOf(session, partsOf(object.identifier)[0]), shown }),
      );
    }
    openmct.actions.register({
      key: "rover.help",
      name: "Help",
      description: "Open the documentation of this view",
      cssClass: "icon-info",
      group: "view",
      priority: 1,
      showInStatusBar: true,
      appliesTo: ([object]) => helpOf(object) !== undefined,
      invoke: ([object]) => open(`/help/${helpOf(object)}`, "rover-help"),
    });
  };
}

/** Return the documentation of a view's object; undefined for other objects. @returns {string | undefined} */
function helpOf({ identifier, type }) {
  return identifier.namespace === NAMESPACE ? VIEWS[type.replace("rover.", "")]?.help : undefined;
}

/** Add a type of object and its view. */
function addView(openmct, type, name, cssClass, mount) {
  openmct.types.addType(type, { name, cssClass, description: `${name}, from rover-console` });
  openmct.objectViews.addProvider({
    key: type,
    name,
    cssClass,
    canView: (object) => object.identifier.namespace === NAMESPACE && object.type === type,
    view: (object) => {
      let unmount = () => {};
      return {
        show: (element) => (unmount = mount(object, element)),
        destroy: () => unmount(),
      };
    },
  });
}
