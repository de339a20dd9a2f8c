/**
 * Prepares a command: a form for each that the dictionary has, with units and ranges, what a preview
 * says it would come to, and what became of it beside that once it was sent.
 */

import { ask, newId, operator } from "../model/connection.js";
import { comparison } from "./command_table.js";
import { button, html, keep, say } from "../dom.js";
import { Field, ListField } from "./forms.js";
import { View } from "./view.js";
import { clock, degrees, number } from "../words.js";

/** @import { AssetEntry, CommandEntry } from "../model/messages.js" */

export class CommandForm extends View {
  /** @type {string | null} the command that was sent last from here */
  #sent = null;
  /** why it was refused, or may not have been sent */
  #trouble = "";
  /** @type {AssetEntry | null} that of which commands are offered */
  #offered = null;
  /** @type {Record<string, any> | null} what the fields are of */
  #typed = null;
  /** @type {(Field | ListField)[]} */
  #fields = [];

  #chooser = html("select", { "aria-label": "command", onchange: () => this.#prepare(this.#chooser.value || null) });
  #summary = html("p", { className: "summary dim" });
  #fieldBox = html("div", { className: "fields" });
  #replace = html("input", { type: "checkbox", onchange: () => this.draft.setReplace(this.#replace.checked) });
  #replaceLine = html("label", { className: "check" }, this.#replace, "end the motions under way and waiting first");
  #link = html("select", { "aria-label": "link" });
  #linkLine = html("label", { className: "check" }, "send by", this.#link);
  #preview = html("div", { className: "preview-words", "data-testid": "preview" });
  #send = html("button", { type: "submit", className: "send", textContent: "Send" });
  #clear = button("clear", "", () => this.#prepare(null));
  #hindrance = html("span", { className: "hindrance" });
  #outcome = html("div", { className: "outcome", "data-testid": "outcome" });
  #empty = html("p", { className: "empty" });
  #form = html(
    "form",
    { autocomplete: "off", onsubmit: (event) => (event.preventDefault(), this.#submit()) },
    this.#chooser,
    this.#summary,
    this.#fieldBox,
    this.#replaceLine,
    this.#linkLine,
    this.#preview,
    html("div", { className: "buttons" }, this.#send, this.#clear, this.#hindrance),
    this.#outcome,
  );
  root = html("section", { className: "rover-view form-view" }, this.#empty, html("div", { className: "scroll" }, this.#form));

  start() {
    const topics = ["entry", "commands", "authority", "status", "tree", "links"];
    return [this.draft.on(this.draw), ...topics.map((topic) => this.asset.on(topic, this.draw)), this.session.connection.on(this.draw)];
  }

  /** @param {string | null} name */
  #prepare(name) {
    this.#sent = null;
    this.draft.prepare(name);
  }

  async #submit() {
    const { asset, draft } = this;
    if (draft.entry === null || draft.problems.size) return;
    const id = newId();
    this.#trouble = "";
    this.#sent = id;
    this.draw();
    try {
      const taken = await ask("/api/commands", {
        json: {
          ...{ id, asset: asset.name, name: draft.entry.name, args: draft.values },
          ...(draft.replace ? { arrival: "replace" } : {}),
          ...(this.#link.value ? { link: this.#link.value } : {}),
        },
      });
      this.#sent = taken.id; // a stop has another
    } catch (error) {
      this.#trouble = error.status === 0 ? `${error.message}. It may have been sent: look at the commands.` : error.message;
    }
    this.draw();
  }

  render() {
    const { asset, draft, session } = this;
    const { entry } = asset;
    this.#empty.hidden = entry !== null;
    this.#form.hidden = entry === null;
    if (!entry) return say(this.#empty, session.unreached(asset));
    if (this.#offered !== entry) this.#offer(entry);
    if (this.#chooser.value !== (draft.entry?.name ?? "")) this.#chooser.value = draft.entry?.name ?? "";
    if (this.#typed !== draft.typed) this.#makeFields();
    const { problems } = draft;
    for (const field of this.#fields) field.render(problems);
    say(this.#summary, draft.entry ? draft.entry.summary : "Choose a command, or click the map to prepare a move there.");
    this.#replaceLine.hidden = !draft.entry?.motion;
    this.#replace.checked = draft.replace;
    this.#drawLinks();
    this.#preview.hidden = !draft.entry?.motion;
    this.#preview.classList.toggle("refused", Boolean(draft.objection));
    say(this.#preview, draft.objection || this.#previewed());
    this.#drawSend();
    this.#drawOutcome();
  }

  /** Offer the commands of an asset by their families. @param {AssetEntry} entry */
  #offer(entry) {
    this.#offered = entry;
    const option = ({ name }) => html("option", { value: name, textContent: name });
    const groups = [...grouped(entry.commands)].map(([label, commands]) => html("optgroup", { label }, ...commands.map(option)));
    this.#chooser.replaceChildren(html("option", { value: "", textContent: "choose a command" }), ...groups);
  }

  /** Make the fields of another command. */
  #makeFields() {
    const { draft } = this;
    this.#typed = draft.typed;
    this.#fields = (draft.entry?.arguments ?? []).map((each) => (each.type === "list" ? new ListField(draft, each) : new Field(draft, each, draft.typed)));
    this.#fieldBox.replaceChildren(...this.#fields.map((each) => each.element));
  }

  /** Offer the links of an asset that has several; left to the console, it is the first that is up, the direct one before all. */
  #drawLinks() {
    const names = [...this.asset.links.keys()];
    this.#linkLine.hidden = this.draft.entry === null || names.length < 2;
    const words = (name) => (name ? `the ${name} link` : "the link by which it is there soonest");
    keep(this.#link, ["", ...names], String, (name) => html("option", { value: name, textContent: words(name) }));
  }

  /** What the command would come to, as far as that is known. */
  #previewed() {
    const { waits, preview } = this.draft;
    if (waits) return "working out what it would come to …";
    if (!preview) return "Fill in what is needed, and a preview shows where it leads.";
    const end = preview.path.at(-1);
    const energy = preview.energy == null ? "" : `, ${number(preview.energy)} J`;
    const nearest = preview.clearance == null ? "" : `; comes to ${preview.clearance.toFixed(2)} m from ${preview.nearest}`;
    return (
      `Preview: takes ${preview.duration.toFixed(1)} s, ${preview.length.toFixed(2)} m${energy};` +
      ` ends at x ${end.x.toFixed(2)} m, y ${end.y.toFixed(2)} m, ${degrees(end.heading).toFixed(0)}°${nearest}`
    );
  }

  #drawSend() {
    const { entry } = this.draft;
    this.#send.hidden = this.#clear.hidden = entry === null;
    if (entry === null) return say(this.#hindrance, "");
    const why = this.#hindranceOf(entry);
    this.#send.disabled = why !== "";
    say(this.#send, `Send ${entry.name} to ${this.asset.name}`);
    say(this.#hindrance, why);
  }

  /** Why it cannot be sent now, and what to do about it; empty if it can. @param {CommandEntry} entry */
  #hindranceOf({ modes }) {
    const { asset, draft } = this;
    const { authority: held, mode } = asset;
    if (!asset.isReached) return `${asset.name} cannot be reached`;
    if (draft.problems.size) return draft.problems.get("") ?? "fill in what is marked";
    if (held?.holder && held.holder !== operator.name) return `${held.holder} commands: request it above`;
    if (held?.needed && !held.holder) return "nobody commands: request it above";
    if (mode && !modes.includes(mode)) return `not in mode ${mode}${modes.includes("IDLE") && ["STOPPED", "SAFE"].includes(mode) ? ": send “resume” first" : ""}`;
    return "";
  }

  #drawOutcome() {
    const command = this.#sent === null ? undefined : this.asset.commands.get(this.#sent);
    this.#outcome.hidden = this.#sent === null;
    this.#outcome.className = `outcome ${command?.state ?? (this.#trouble ? "rejected" : "sending")}`;
    if (this.#outcome.hidden) return;
    const last = command?.history.at(-1);
    const words = this.#trouble || (command ? `${command.name}, ${clock(command.made)}: ${command.state.replace("_", " ")}. ${last?.detail ?? ""}` : "being sent …");
    this.#outcome.replaceChildren(html("p", { textContent: words }), (command && comparison(command)) || "");
  }
}

/** @param {CommandEntry[]} commands @returns {Map<string, CommandEntry[]>} by family */
function grouped(commands) {
  const families = new Map();
  for (const each of commands) families.set(each.family, [...(families.get(each.family) ?? []), each]);
  return families;
}
