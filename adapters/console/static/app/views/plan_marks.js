/** Layer of the map, in px: the waypoints of a plan in preparation, with the numbers of their steps, to be dragged. */

import { reconcile, setText, set, svg } from "../dom.js";
import { tidy } from "./map_layers.js";

/** @import { Mark } from "../model/plan_draft.js" */
/** @import { Viewport } from "./viewport.js" */
/** @typedef {{marks?: Mark[], moveMark?: (mark: Mark, x: number, y: number) => void, select?: (step: Mark["step"]) => void}} Marked a draft with waypoints to drag */

export class Marks {
  /** key of the dragged waypoint */
  #dragged = "";
  element = svg("g", { class: "marks" });
  #viewport;

  /** @param {Viewport} viewport */
  constructor(viewport) {
    this.#viewport = viewport;
  }

  /** @param {Marked} draft */
  render(draft) {
    const keyOf = (/** @type {Mark} */ { step, item }) => `${step.key} ${item}`;
    reconcile(this.element, draft.marks ?? [], keyOf, (mark) => this.#make(draft, keyOf(mark)), (made, mark) => {
      const [circle, text] = made.children;
      set(made, { class: `${mark.isSelected ? "selected" : ""} ${mark.isRefused ? "refused" : ""}`, transform: `translate(${this.#viewport.toScreen(mark.x, mark.y)})`, "data-mark": mark.label });
      set(circle, { r: 7 + 2 * mark.label.length });
      setText(text, mark.label);
      made.mark = mark;
    });
  }

  /** @param {Marked} draft @param {string} key */
  #make(draft, key) {
    const made = svg("g", {}, svg("circle"), svg("text", { y: 4 }));
    made.onpointerdown = (event) => {
      event.stopPropagation();
      made.setPointerCapture(event.pointerId);
      this.#dragged = key;
      draft.select(made.mark.step);
    };
    made.onpointermove = (event) => {
      if (this.#dragged !== key) return;
      event.stopPropagation();
      const [x, y] = this.#viewport.toWorld(event.offsetX, event.offsetY);
      draft.moveMark(made.mark, tidy(x), tidy(y));
    };
    made.onpointerup = (event) => event.stopPropagation();
    made.onlostpointercapture = () => (this.#dragged = "");
    return made;
  }
}
