/**
 * The nodes of a plan: the outline of one that is no list of steps, or those of a plan aboard with their progress and
 * the commands that steer it. Subtrees are folded until they run.
 */

import { fetchJson } from "../model/connection.js";
import { button, html, reconcile, setText, set } from "../dom.js";
import { View } from "./view.js";
import { clock } from "../format.js";

/** @import { OutlineNode, PlanNodeEntry } from "../model/messages.js" */
/** @typedef {OutlineNode & Partial<PlanNodeEntry>} ShownNode a node of an outline has no progress */

const MARKS = { running: "▶", success: "✓", failure: "✗" };
const SUBTREE = "SubTree";
/** States of ended plans: their nodes cannot be steered. */
const ENDED = new Set(["completed", "failed", "aborted"]);
/** Commands that need a second press, since they cancel commands or cannot be undone, with its choices. */
const CHOICES = {
  skip: { "as success": ["skipNode", { result: "SUCCESS" }], "as failure": ["skipNode", { result: "FAILURE" }] },
  retry: { "begin again": ["retryNode", {}] },
};

export class PlanNodes extends View {
  /** @type {Map<string, boolean>} whether a branch was opened or folded by the operator, by path */
  #chosen = new Map();
  /** the node and the command that wait for a second press */
  #pending = { path: "", act: "" };
  #isReading = false;
  /** @type {ShownNode[]} */
  nodes = [];
  /** id of the plan aboard that is read; empty for none */
  watched = "";
  /** @type {(act: string, args: object) => void} sends a command */
  steer = () => {};
  /** called after the nodes were read */
  onRead = () => {};
  /** the findings at a line, shown at the node @type {(line: number) => string[]} */
  findingsAt = () => [];
  root = html("ol", { className: "nodes", "aria-label": "nodes" });

  start() {
    return [this.asset.on("plans", () => this.read()), this.session.onSecond(() => this.read())];
  }

  /** Show the nodes of a plan aboard, or else an outline. @param {string} plan empty for none @param {OutlineNode[]} [outline] */
  show(plan, outline = []) {
    if (plan === this.watched && (plan || outline === this.nodes)) return;
    this.watched = plan;
    this.nodes = outline;
    this.read();
  }

  /** The progress of a node of the watched plan; undefined if unknown. @param {string} path @returns {ShownNode | undefined} */
  nodeAt(path) {
    return this.watched ? this.nodes.find((each) => each.path === path && each.status) : undefined;
  }

  /** Read the nodes of the plan aboard. */
  async read() {
    const { watched, asset } = this;
    if (!watched || this.#isReading || !asset.isReached) return this.draw();
    this.#isReading = true;
    const path = `/api/plans/${encodeURIComponent(asset.name)}/${encodeURIComponent(watched)}/nodes`;
    const found = await fetchJson(path).catch(() => null);
    this.#isReading = false;
    if (found && watched === this.watched) this.nodes = found.nodes;
    this.onRead();
    this.draw();
  }

  /** The nodes that are not below a folded one. */
  get #visible() {
    const shown = [];
    let folded = Infinity;
    for (const node of this.nodes) {
      if (node.depth > folded) continue;
      folded = this.#isOpen(node) ? Infinity : node.depth;
      shown.push(node);
    }
    return shown;
  }

  /** @param {ShownNode} node */
  #isOpen({ path, kind, status }) {
    return this.#chosen.get(path) ?? (kind !== SUBTREE || status === "running");
  }

  /** @param {ShownNode} node */
  #hasChildren(node) {
    return (this.nodes[this.nodes.indexOf(node) + 1]?.depth ?? 0) > node.depth;
  }

  render() {
    reconcile(this.root, this.#visible, ({ path }) => path, (node) => this.#makeRow(node.path), (row, node) => this.#drawRow(row, node));
  }

  /** @param {string} path */
  #makeRow(path) {
    const toggle = () => {
      const node = this.nodes.find((each) => each.path === path);
      this.#chosen.set(path, !this.#isOpen(node));
      this.draw();
    };
    const parts = [button("", "", toggle, { className: "fold" }), html("b"), html("span", { className: "what" }), html("span", { className: "arguments dim" }), html("span", { className: "buttons" })];
    return html("li", { className: "node" }, html("div", { className: "head" }, ...parts), html("p", { className: "dim" }), html("p", { className: "problem" }));
  }

  /** @param {any} row @param {ShownNode} node */
  #drawRow(row, node) {
    const [head, progress, problem] = row.children;
    const [fold, mark, what, kind, buttons] = head.children;
    const isOpen = this.#isOpen(node);
    const status = node.status ?? "";
    set(row, { style: `margin-left: ${node.depth * 14}px`, "data-status": status, "data-node": node.path });
    fold.hidden = !this.#hasChildren(node);
    setText(fold, isOpen ? "▾" : "▸");
    set(fold, { "aria-expanded": isOpen, "aria-label": `${isOpen ? "fold" : "open"} ${node.name}` });
    setText(mark, MARKS[status] ?? "");
    setText(what, node.name);
    setText(kind, [node.name.startsWith(node.kind) ? "" : node.kind, node.status ? "" : node.text].filter(Boolean).join("  "));
    setText(progress, node.status ? progressOf(node) : "");
    progress.hidden = !progress.textContent;
    setText(problem, [...this.findingsAt(node.line)].join("\n"));
    problem.hidden = !problem.textContent;
    const pending = this.#pending.path === node.path ? this.#pending.act : "";
    const state = this.asset.plansAboard.get(this.watched)?.status.toLowerCase() ?? "";
    const offered = !this.watched || ENDED.has(state) ? [] : pending ? [...Object.keys(CHOICES[pending]), "cancel"] : actsOf(node);
    reconcile(buttons, offered, String, (act) => button(act, "", () => this.#press(node.path, act), { "aria-label": `${act} ${node.name}` }));
  }

  /** @param {string} path @param {string} act */
  #press(path, act) {
    const [command, more] = CHOICES[this.#pending.act]?.[act] ?? [];
    this.#pending = act in CHOICES ? { path, act } : { path: "", act: "" };
    if (command) this.steer(command, { plan_id: this.watched, node: path, ...more });
    else if (act === "hold before") this.steer("holdAtNode", { plan_id: this.watched, node: path });
    this.draw();
  }
}

/** The commands for a node. @param {ShownNode} node */
function actsOf({ status }) {
  if (status === "running") return ["skip", "retry"];
  return status === "idle" ? ["skip", "hold before"] : [];
}

/** Format the progress of a node. @param {ShownNode} node */
function progressOf({ status, result, since, tries, code, text, unknown, decision, next, has_question: hasQuestion, command }) {
  const isRunning = status === "running";
  const now = isRunning ? "running" : result && status === "idle" ? `idle, last ${result}` : status;
  const until = next && isRunning ? `${command ? "until" : "waits until"} ${clock(next)} UTC` : "";
  const parts = [
    since ? `${now} since ${clock(since)}` : "",
    until,
    hasQuestion ? "question open" : "",
    tries > 1 ? `try ${tries}` : "",
    decision,
    unknown && `${unknown} is not known`,
    text && `failed: ${text}${code ? ` (${code})` : ""}`,
    command,
  ];
  return parts.filter(Boolean).join("; ");
}
