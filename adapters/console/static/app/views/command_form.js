/**
 * The command form: fields for each command of the dictionary, with units and ranges, its preview, and
 * after sending its result beside the prediction.
 */

import { fetchJson, newId, operator } from "../model/connection.js";
import { comparison } from "./command_table.js";
import { button, html, reconcile, setText } from "../dom.js";
import { fieldsOf } from "./forms.js";
import { SHOWN_M, SHOWN_RAD } from "../model/draft.js";
import { View } from "./view.js";
import { clock, degrees, number } from "../format.js";

/** @import { AssetEntry, CommandEntry } from "../model/messages.js" */

const SENT = "sent; change a field to send another";

export class CommandForm extends View {
  /** @type {string | null} id of the command that this form sent last */
  #sent = null;
  /** refusal, or the reason why it may not have been sent */
  #trouble = "";
  /** @type {AssetEntry | null} entry of the offered commands */
  #offeredEntry = null;
  /** @type {Record<string, any> | null} the typed arguments of the present fields */
  #shownDraft = null;
  /** @type {ReturnType<typeof fieldsOf>} */
  #fields = [];

  #chooser = html("select", { "aria-label": "command", onchange: () => this.#prepare(this.#chooser.value || null) });
  #summary = html("p", { className: "summary dim" });
  #fieldBox = html("div", { className: "fields" });
  #replace = html("input", { type: "checkbox", onchange: () => this.draft.setReplace(this.#replace.checked) });
  #replaceLine = html("label", { className: "check" }, this.#replace, "replace the active and queued motions");
  #onlyShown = html("input", { type: "checkbox", onchange: () => this.draft.setOnlyShown(this.#onlyShown.checked) });
  #onlyShownText = html("span");
  #onlyShownLine = html("label", { className: "check" }, this.#onlyShown, this.#onlyShownText);
  #link = html("select", { "aria-label": "link" });
  #linkLine = html("label", { className: "check" }, "send by", this.#link);
  #preview = html("div", { className: "preview-text", "data-testid": "preview" });
  #send = html("button", { type: "submit", className: "send", textContent: "Send", title: "Ctrl+Enter sends; Enter in a field only moves to this button" });
  #again = button("again", "arm the same command again", () => this.draft.rearm(), { className: "again" });
  #clear = button("clear", "", () => this.#prepare(null));
  #hindrance = html("span", { className: "hindrance" });
  #outcome = html("div", { className: "outcome", "data-testid": "outcome" });
  #empty = html("p", { className: "empty" });
  #form = html(
    "form",
    {
      autocomplete: "off",
      onsubmit: (event) => (event.preventDefault(), this.#submit()),
      onkeydown: (event) => this.#onKey(event),
    },
    html("div", { className: "scroll" }, this.#chooser, this.#summary, this.#fieldBox, this.#replaceLine, this.#onlyShownLine, this.#linkLine, this.#outcome),
    this.#preview,
    html("div", { className: "buttons" }, this.#send, this.#again, this.#clear, this.#hindrance),
  );
  root = html("section", { className: "rover-view form-view" }, this.#empty, this.#form);

  start() {
    const topics = ["entry", "commands", "authority", "status", "tree", "links"];
    return [this.draft.on(this.draw), this.asset.on("track", () => this.draft.refresh()), ...topics.map((topic) => this.asset.on(topic, this.draw)), this.session.connection.on(this.draw)];
  }

  /** @param {string | null} name */
  #prepare(name) {
    this.#sent = null;
    this.draft.prepare(name);
    this.render(); // with the key: Tab then moves to the first field
  }

  /** Ctrl+Enter sends; Enter in a field moves to the send button, or to the first wrong field, and sends nothing. @param {KeyboardEvent} event */
  #onKey(event) {
    if (event.key !== "Enter" || event.isComposing) return;
    const isField = event.target instanceof HTMLInputElement || event.target instanceof HTMLSelectElement;
    if (!isField && !event.ctrlKey && !event.repeat) return;
    event.preventDefault();
    if (event.repeat) return;
    this.render();
    if (event.ctrlKey) this.#submit();
    else if (!this.#send.disabled) this.#send.focus();
    else this.#form.querySelector("input.wrong, .fields input:placeholder-shown")?.focus();
  }

  async #submit() {
    const { asset, draft } = this;
    if (draft.entry === null || this.#hindranceOf(draft.entry)) return;
    const id = newId();
    this.#trouble = "";
    this.#sent = id;
    const json = {
      ...{ id, asset: asset.name, name: draft.entry.name, args: draft.values },
      ...(draft.replace ? { preemption: "replace" } : {}),
      ...draft.precondition,
      ...(this.#link.value ? { link: this.#link.value } : {}),
    };
    draft.disarm();
    try {
      const answer = await fetchJson("/api/commands", { json });
      this.#sent = answer.id; // the server gives a stop another id
    } catch (error) {
      this.#trouble = error.status === 0 ? `${error.message}. It may have been sent: check the commands.` : error.message;
      if (error.status !== 0 && draft.isSent) draft.rearm();
    }
    this.draw();
  }

  render() {
    const { asset, draft, session } = this;
    const { entry } = asset;
    this.#empty.hidden = entry !== null;
    this.#form.hidden = entry === null;
    if (!entry) return setText(this.#empty, session.unreached(asset));
    if (this.#offeredEntry !== entry) this.#offer(entry);
    if (this.#chooser.value !== (draft.entry?.name ?? "")) this.#chooser.value = draft.entry?.name ?? "";
    if (this.#shownDraft !== draft.typed) this.#makeFields();
    const { problems } = draft;
    for (const field of this.#fields) field.render(problems);
    setText(this.#summary, draft.entry ? draft.entry.summary : "Choose a command, or click the map to prepare a move there.");
    this.#replaceLine.hidden = !draft.entry?.motion;
    this.#replace.checked = draft.replace;
    this.#onlyShownLine.hidden = !draft.offersOnlyShown;
    this.#onlyShown.checked = draft.isOnlyShown;
    if (draft.offersOnlyShown) setText(this.#onlyShownText, onlyShownText(asset.pose, draft.predecessor));
    this.#drawLinks();
    this.#preview.hidden = !draft.entry?.motion || draft.isSent;
    this.#preview.classList.toggle("refused", Boolean(draft.objection));
    setText(this.#preview, draft.objection || this.#previewed());
    this.#drawSend();
    this.#drawOutcome();
  }

  /** Offer the commands of an asset, grouped by families. @param {AssetEntry} entry */
  #offer(entry) {
    this.#offeredEntry = entry;
    const option = ({ name }) => html("option", { value: name, textContent: name });
    const groups = [...grouped(entry.commands)].map(([label, commands]) => html("optgroup", { label }, ...commands.map(option)));
    this.#chooser.replaceChildren(html("option", { value: "", textContent: "choose a command" }), ...groups);
  }

  /** Create the fields of the chosen command. */
  #makeFields() {
    const { draft } = this;
    this.#shownDraft = draft.typed;
    this.#fields = fieldsOf(draft);
    this.#fieldBox.replaceChildren(...this.#fields.map((each) => each.element));
  }

  /** Offer the links of an asset with several. By default the console takes the first one that is up, the direct link before others. */
  #drawLinks() {
    const names = [...this.asset.links.keys()];
    this.#linkLine.hidden = this.draft.entry === null || names.length < 2;
    const label = (name) => (name ? `the ${name} link` : "fastest link");
    reconcile(this.#link, ["", ...names], String, (name) => html("option", { value: name, textContent: label(name) }));
  }

  /** The text of the preview. */
  #previewed() {
    const { waits, preview } = this.draft;
    if (waits) return "preview pending …";
    if (!preview) return "Fill in the required fields to see a preview.";
    return `Preview: ${predictionText(preview)}`;
  }

  #drawSend() {
    const { entry } = this.draft;
    this.#send.hidden = this.#clear.hidden = entry === null;
    const why = entry && this.#hindranceOf(entry);
    this.#again.hidden = why !== SENT;
    setText(this.#hindrance, why ?? "");
    if (entry === null) return;
    this.#send.disabled = why !== "";
    setText(this.#send, `Send ${entry.name} to ${this.asset.name}`);
  }

  /** Return why it cannot be sent now, and the remedy; empty if it can. @param {CommandEntry} entry */
  #hindranceOf({ modes }) {
    const { asset, draft } = this;
    const { authority: held, mode } = asset;
    if (draft.isSent) return SENT;
    if (!draft.isArmed) return "sent a moment ago";
    if (!asset.isReached) return `${asset.name} cannot be reached`;
    if (draft.problems.size) return draft.problems.get("") ?? "fill in the marked fields";
    if (held?.holder && held.holder !== operator.name) return `${held.holder} commands: request the authority above`;
    if (held?.needed && !held.holder) return "no operator commands: request the authority above";
    if (mode && !modes.includes(mode)) return `not in mode ${mode}${modes.includes("IDLE") && ["STOPPED", "SAFE"].includes(mode) ? ": send “resume” first" : ""}`;
    return "";
  }

  #drawOutcome() {
    const command = this.#sent === null ? undefined : this.asset.commands.get(this.#sent);
    this.#outcome.hidden = this.#sent === null;
    this.#outcome.className = `outcome ${command?.state ?? (this.#trouble ? "rejected" : "sending")}`;
    if (this.#outcome.hidden) return;
    const last = command?.history.at(-1);
    const label = this.#trouble || (command ? `${command.name}, ${clock(command.created)}: ${command.state.replace("_", " ")}. ${last?.detail ?? ""}` : "sending …");
    this.#outcome.replaceChildren(html("p", { textContent: label }), (command && comparison(command)) || "");
  }
}

/** Format a prediction in one line. @param {import("../model/messages.js").Preview} preview */
export function predictionText({ duration, length, energy, path, clearance, nearest, note }) {
  const end = path.at(-1);
  return (
    `takes ${duration.toFixed(1)} s, ${length.toFixed(2)} m${energy == null ? "" : `, ${number(energy)} J`};` +
    ` ends at x ${end.x.toFixed(2)} m, y ${end.y.toFixed(2)} m, ${degrees(end.heading).toFixed(0)}°` +
    (clearance == null ? "" : `; minimum clearance ${clearance.toFixed(2)} m, to ${nearest}`) +
    (note ? `; ${note}` : "")
  );
}

/** @param {import("../model/asset.js").Fix} pose @param {import("../model/messages.js").CommandStatus | null} predecessor */
function onlyShownText({ x, y, heading }, predecessor) {
  const bounds = `within ${SHOWN_M} m and ${degrees(SHOWN_RAD).toFixed(0)}°`;
  const before = predecessor ? `, and after ${predecessor.name} ${predecessor.number} is executed` : "";
  return `only if it is where I see it: ${bounds} of x ${x.toFixed(2)} m, y ${y.toFixed(2)} m, ${degrees(heading).toFixed(0)}°${before}`;
}

/** @param {CommandEntry[]} commands @returns {Map<string, CommandEntry[]>} by family */
function grouped(commands) {
  const families = new Map();
  for (const each of commands) families.set(each.family, [...(families.get(each.family) ?? []), each]);
  return families;
}
