/**
 * Prepares a command: a form for each that the dictionary has, with units and ranges, what a preview
 * says it would come to, and what became of it beside that once it was sent.
 */

import { ask, newId, operator } from "../model/connection.js";
import { comparison } from "./command_table.js";
import { eachFrame, html, say } from "../dom.js";
import { rangeOf } from "../model/draft.js";
import { UNITS, clock, degrees, number } from "../words.js";

/** @typedef {import("../model/context.js").Context} Context */

/**
 * @param {HTMLElement} element
 * @param {Context} context
 * @returns {() => void}
 */
export function mount(element, context) {
  const { asset, session, draft } = context;
  /** @type {string | null} the command that was sent last from here */
  let sent = null;
  let trouble = "";

  const chooser = html("select", { "aria-label": "command", onchange: () => ((sent = null), draft.prepare(chooser.value || null)) });
  const summary = html("p", { className: "summary dim" });
  const fields = html("div", { className: "fields" });
  const replace = html("input", { type: "checkbox", onchange: () => draft.setReplace(replace.checked) });
  const replaceLine = html("label", { className: "check" }, replace, "end the motions under way and waiting first");
  const link = html("select", { "aria-label": "link" });
  const linkLine = html("label", { className: "check" }, "send by", link);
  const preview = html("div", { className: "preview-words", "data-testid": "preview" });
  const send = html("button", { type: "submit", className: "send", textContent: "Send" });
  const clear = html("button", { type: "button", textContent: "clear", onclick: () => ((sent = null), draft.prepare(null)) });
  const hindrance = html("span", { className: "hindrance" });
  const outcome = html("div", { className: "outcome", "data-testid": "outcome" });
  const empty = html("p", { className: "empty" });
  const form = html(
    "form",
    { autocomplete: "off", onsubmit: (event) => (event.preventDefault(), submit()) },
    chooser,
    summary,
    fields,
    replaceLine,
    linkLine,
    preview,
    html("div", { className: "buttons" }, send, clear, hindrance),
    outcome,
  );
  const root = html("section", { className: "rover-view form-view" }, empty, html("div", { className: "scroll" }, form));
  element.append(root);

  async function submit() {
    if (draft.entry === null || draft.problems.size) return;
    const id = newId();
    trouble = "";
    sent = id;
    draw();
    try {
      const taken = await ask("/api/commands", {
        json: {
          ...{ id, asset: asset.name, name: draft.entry.name, args: draft.values },
          ...(draft.replace ? { arrival: "replace" } : {}),
          ...(link.value ? { link: link.value } : {}),
        },
      });
      sent = taken.id; // a stop has another
    } catch (error) {
      trouble = error.status === 0 ? `${error.message}. It may have been sent: look at the commands.` : error.message;
    }
    draw();
  }

  function buildChooser() {
    const families = grouped(asset.entry?.commands ?? []);
    chooser.replaceChildren(
      html("option", { value: "", textContent: "choose a command" }),
      ...[...families].map(([family, commands]) =>
        html("optgroup", { label: family }, ...commands.map((each) => html("option", { value: each.name, textContent: each.name }))),
      ),
    );
  }

  /** Make the fields of another command. */
  function build() {
    fields.replaceChildren(...(draft.entry?.arguments ?? []).map((each) => (each.type === "list" ? listField(each) : field(each, draft.typed, each.name))));
  }

  function field(argument, record, key) {
    const unit = argument.typed?.unit ?? argument.unit;
    const range = rangeOf(argument);
    const common = { "aria-label": argument.name, "data-problem-of": key, name: key };
    const input =
      argument.type === "choice"
        ? html(
            "select",
            { ...common, onchange: (event) => draft.type(record, argument.name, event.target.value) },
            ...(argument.optional ? [""] : []).concat(argument.choices ?? []).map((each) => html("option", { value: each, textContent: each || "as set" })),
          )
        : html("input", {
            ...common,
            type: "text",
            inputMode: argument.type === "text" ? "text" : "decimal",
            oninput: (event) => draft.type(record, argument.name, event.target.value.replace(",", ".")),
          });
    if (argument.type === "choice" && !argument.optional && !record[argument.name]) record[argument.name] = argument.choices?.[0] ?? "";
    input.value = record[argument.name] ?? "";
    return html(
      "label",
      { className: "field", title: [range, argument.help].filter(Boolean).join("; ") },
      html("span", { className: "name", textContent: argument.name + (argument.optional ? "" : " *") }),
      input,
      html("span", { className: "unit", textContent: UNITS[unit] ?? unit }),
      html("span", { className: "help dim", textContent: [range, argument.help].filter(Boolean).join("; ") }),
      html("span", { className: "problem" }),
    );
  }

  /** A list, an item a line. */
  function listField(argument) {
    const items = html("div", { className: "items" });
    const box = html(
      "fieldset",
      { className: "list" },
      html("legend", { textContent: `${argument.name}: ${argument.help || "in this order"}${argument.most ? `, ${argument.most} at most` : ""}` }),
      items,
      html("button", { type: "button", textContent: "add one", onclick: () => draft.addItem(argument.name, {}) }),
    );
    box.refresh = () => {
      const records = draft.typed[argument.name] ?? [];
      if (items.drawn === records.length && items.first === records[0]) return;
      items.drawn = records.length;
      items.first = records[0];
      items.replaceChildren(
        ...records.map((record, index) =>
          html(
            "div",
            { className: "item" },
            html("b", { textContent: String(index + 1) }),
            ...argument.items.map((part) => compactField(part, record, `${argument.name}.${index}.${part.name}`)),
            html("button", { type: "button", textContent: "×", title: "leave it out", "aria-label": `leave out ${index + 1}`, onclick: () => draft.removeItem(argument.name, index) }),
          ),
        ),
      );
    };
    return box;
  }

  function compactField(argument, record, key) {
    const unit = argument.typed?.unit ?? argument.unit;
    return html(
      "label",
      { title: [argument.help, rangeOf(argument)].filter(Boolean).join("; ") },
      html("span", { className: "dim", textContent: `${argument.name} ${UNITS[unit] ?? unit}` }),
      html("input", {
        type: "text",
        inputMode: "decimal",
        "aria-label": key,
        "data-problem-of": key,
        value: record[argument.name] ?? "",
        oninput: (event) => draft.type(record, argument.name, event.target.value.replace(",", ".")),
      }),
    );
  }

  function render() {
    const entry = asset.entry;
    empty.hidden = entry !== null;
    form.hidden = entry === null;
    if (!entry) return say(empty, session.unreached(asset));
    if (chooser.drawn !== entry) {
      buildChooser();
      chooser.drawn = entry;
    }
    if (chooser.value !== (draft.entry?.name ?? "")) chooser.value = draft.entry?.name ?? "";
    if (fields.typed !== draft.typed) {
      build();
      fields.typed = draft.typed;
    }
    for (const child of fields.children) child.refresh?.();
    say(summary, draft.entry ? draft.entry.summary : "Choose a command, or click the map to prepare a move there.");
    replaceLine.hidden = !draft.entry?.motion;
    replace.checked = draft.replace;
    drawLink();
    drawProblems();
    drawPreview();
    drawSend();
    drawOutcome();
  }

  /** Offer the links of an asset that has several; left to the console, it is the first that is up, the direct one before all. */
  function drawLink() {
    const names = [...asset.links.keys()];
    linkLine.hidden = draft.entry === null || names.length < 2;
    if (link.drawn === names.join()) return;
    link.drawn = names.join();
    const chosen = link.value;
    link.replaceChildren(
      html("option", { value: "", textContent: "the link by which it is there soonest" }),
      ...names.map((name) => html("option", { value: name, textContent: `the ${name} link` })),
    );
    link.value = names.includes(chosen) ? chosen : "";
  }

  function drawProblems() {
    const problems = draft.problems;
    for (const input of fields.querySelectorAll("[data-problem-of]")) {
      const problem = problems.get(input.dataset.problemOf) ?? "";
      const shown = problem === "needed" ? "" : problem;
      input.classList.toggle("wrong", Boolean(shown));
      const words = input.parentElement.querySelector(".problem");
      if (words) say(words, shown);
      else if (shown) input.title = shown;
    }
  }

  function drawPreview() {
    preview.hidden = !draft.entry?.motion;
    if (preview.hidden) return;
    preview.classList.toggle("refused", Boolean(draft.objection));
    if (draft.objection) return say(preview, draft.objection);
    if (draft.waits) return say(preview, "working out what it would come to …");
    if (!draft.preview) return say(preview, "Fill in what is needed, and a preview shows where it leads.");
    const end = draft.preview.path.at(-1);
    const energy = draft.preview.energy == null ? "" : `, ${number(draft.preview.energy)} J`;
    const nearest = draft.preview.clearance == null ? "" : `; comes to ${draft.preview.clearance.toFixed(2)} m from ${draft.preview.nearest}`;
    say(
      preview,
      `Preview: takes ${draft.preview.duration.toFixed(1)} s, ${draft.preview.length.toFixed(2)} m${energy};` +
        ` ends at x ${end.x.toFixed(2)} m, y ${end.y.toFixed(2)} m, ${degrees(end.heading).toFixed(0)}°${nearest}`,
    );
  }

  function drawSend() {
    send.hidden = clear.hidden = draft.entry === null;
    if (send.hidden) return say(hindrance, "");
    const why = hindranceOf();
    send.disabled = why !== "";
    say(send, `Send ${draft.entry.name} to ${asset.name}`);
    say(hindrance, why);
  }

  /** Why it cannot be sent now, and what to do about it; empty if it can. */
  function hindranceOf() {
    const held = asset.authority;
    const { mode } = asset;
    if (!asset.isReached) return `${asset.name} cannot be reached`;
    if (draft.problems.size) return draft.problems.get("") ?? "fill in what is marked";
    if (held?.holder && held.holder !== operator.name) return `${held.holder} commands: request it above`;
    if (held?.needed && !held.holder) return "nobody commands: request it above";
    if (mode && !draft.entry.modes.includes(mode)) return `not in mode ${mode}${draft.entry.modes.includes("IDLE") && ["STOPPED", "SAFE"].includes(mode) ? ": send “resume” first" : ""}`;
    return "";
  }

  function drawOutcome() {
    const command = sent === null ? undefined : asset.commands.get(sent);
    outcome.hidden = sent === null;
    outcome.className = `outcome ${command?.state ?? (trouble ? "rejected" : "sending")}`;
    if (outcome.hidden) return;
    const last = command?.history.at(-1);
    const words = trouble || (command ? `${command.name}, ${clock(command.made)}: ${command.state.replace("_", " ")}. ${last?.detail ?? ""}` : "being sent …");
    outcome.replaceChildren(html("p", { textContent: words }), (command && comparison(command)) || "");
  }

  const draw = eachFrame(render);
  const offs = [
    draft.on(draw),
    ...["entry", "commands", "authority", "status", "tree", "links"].map((topic) => asset.on(topic, draw)),
    session.connection.on(draw),
  ];
  draw();
  return () => {
    offs.forEach((off) => off());
    root.remove();
  };
}

function grouped(commands) {
  const families = new Map();
  for (const each of commands) families.set(each.family, [...(families.get(each.family) ?? []), each]);
  return families;
}
