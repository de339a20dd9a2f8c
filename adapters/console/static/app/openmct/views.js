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

/** Views by the last part of the object's key; `of` restricts a view to rovers or recordings, `console` adds it to the console. @type {Record<string, {name: string, icon: string, view: any, of?: "rover" | "recording", console?: boolean}>} */
export const VIEWS = {
  map: { name: "Map", icon: "icon-map", view: MapView },
  form: { name: "Command", icon: "icon-command", view: CommandForm, of: "rover" },
  commands: { name: "Commands", icon: "icon-activity", view: CommandTable },
  tree: { name: "Behaviour tree", icon: "icon-conditional", view: TreeView },
  strip: { name: "Time strip", icon: "icon-timeline", view: TimeStripView },
  values: { name: "Latest values", icon: "icon-tabular-lad", view: ValuesView, console: true },
  log: { name: "Log", icon: "icon-list-view", view: LogView },
  alarms: { name: "Alarms", icon: "icon-bell", view: AlarmsView, of: "rover", console: true },
  dtn: { name: "Relay", icon: "icon-chain-links", view: RelayView, of: "rover" },
  video: { name: "Camera", icon: "icon-camera", view: VideoView, of: "rover" },
  plans: { name: "Plans", icon: "icon-plan", view: PlansView, of: "rover" },
  files: { name: "Files", icon: "icon-image", view: FilesView, of: "rover", console: true },
  recording: { name: "Recording", icon: "icon-session", view: RecordingView, of: "recording" },
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
  };
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
