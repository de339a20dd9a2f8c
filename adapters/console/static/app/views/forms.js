/** Input fields of a draft's arguments. */

import { button, html, setText } from "../dom.js";
import { rangeOf } from "../model/draft.js";
import { unitOf } from "../format.js";

/** @import { ArgumentEntry } from "../model/messages.js" */
/** @import { Draft } from "../model/draft.js" */

/** Return the fields of a draft's arguments. @param {Draft} draft */
export const fieldsOf = (draft) => (draft.entry?.arguments ?? []).map((each) => (each.type === "list" ? new ListField(draft, each) : new Field(draft, each, draft.typed)));

/** Field of one argument, with its unit, range and help; an item of a list shows name and unit only. */
class Field {
  #problem = html("span", { className: "problem" });
  #input;
  #key;

  /** @param {Draft} draft @param {ArgumentEntry} argument @param {Record<string, any>} record that stores the text @param {string} [key] of its problem, in an item */
  constructor(draft, argument, record, key) {
    const { name, help } = argument;
    const [unit, range] = [unitOf(argument), rangeOf(argument)];
    const title = [range, help].filter(Boolean).join("; ");
    this.#key = key ?? name;
    this.#input = inputOf(draft, argument, record, this.#key);
    this.element = key
      ? html("label", { title: title }, html("span", { className: "dim", textContent: `${name} ${unit}` }), this.#input)
      : html(
          "label",
          { className: "field", title: title },
          html("span", { className: "name", textContent: name + (argument.optional ? "" : " *") }),
          this.#input,
          html("span", { className: "unit", textContent: unit }),
          html("span", { className: "help dim", textContent: title }),
          this.#problem,
        );
  }

  /** @param {Map<string, string>} problems by key; missing values are not marked */
  render(problems) {
    const problem = problems.get(this.#key) ?? "";
    const shown = problem === "needed" ? "" : problem;
    this.#input.classList.toggle("wrong", Boolean(shown));
    setText(this.#problem, shown);
    if (shown && !this.#problem.parentElement) this.#input.title = shown;
  }
}

/** Field of a list, one item a row. */
class ListField {
  #items = html("div", { className: "items" });
  /** @type {Record<string, any>[]} the items with fields */
  #records = [];
  /** @type {Field[]} */
  #fields = [];
  #draft;
  #argument;

  /** @param {Draft} draft @param {ArgumentEntry} argument */
  constructor(draft, argument) {
    const { name, help, max_items: maxItems } = argument;
    this.#draft = draft;
    this.#argument = argument;
    this.element = html(
      "fieldset",
      { className: "list" },
      html("legend", { textContent: `${name}: ${help || "in this order"}${maxItems ? `, ${maxItems} at most` : ""}` }),
      this.#items,
      button("add item", "", () => draft.addItem(name, {})),
    );
  }

  /** @param {Map<string, string>} problems by key */
  render(problems) {
    const records = this.#draft.typed[this.#argument.name] ?? [];
    if (records.length !== this.#records.length || records[0] !== this.#records[0]) {
      this.#records = [...records];
      this.#fields = [];
      this.#items.replaceChildren(...records.map((record, index) => this.#makeItem(record, index)));
    }
    for (const field of this.#fields) field.render(problems);
  }

  #makeItem(record, index) {
    const { name, items } = this.#argument;
    const fields = items.map((part) => new Field(this.#draft, part, record, `${name}.${index}.${part.name}`));
    this.#fields.push(...fields);
    return html(
      "div",
      { className: "item" },
      html("b", { textContent: String(index + 1) }),
      ...fields.map((each) => each.element),
      button("×", "remove item", () => this.#draft.removeItem(name, index), { "aria-label": `remove item ${index + 1}` }),
    );
  }
}

/** @param {Draft} draft @param {ArgumentEntry} argument @param {Record<string, any>} record @param {string} key */
function inputOf(draft, { name, type, choices, optional }, record, key) {
  const common = { "aria-label": key, name: key };
  const typed = (text) => draft.type(record, name, text);
  if (type !== "choice") {
    const inputMode = type === "text" ? "text" : "decimal";
    const oninput = (event) => typed(event.target.value);
    return html("input", { ...common, type: "text", inputMode, value: record[name] ?? "", oninput });
  }
  if (!optional && !record[name]) record[name] = choices?.[0] ?? "";
  const options = [...(optional ? [""] : []), ...(choices ?? [])].map((value) => html("option", { value, textContent: value || "default" }));
  const made = html("select", { ...common, onchange: () => typed(made.value) }, ...options);
  made.value = record[name] ?? "";
  return made;
}
