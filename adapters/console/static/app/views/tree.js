/**
 * The behaviour tree, live: one node a row with its message, and a sentence on the cause of motion or
 * standstill. Branches without a running or failed node are folded until the operator opens them.
 */

import { fetchJson } from "../model/connection.js";
import { button, html, reconcile, setText, set, svg } from "../dom.js";
import { View } from "./view.js";
import { clock } from "../format.js";

/** @import { TreeNode, TreeState } from "../model/messages.js" */

const ROW = 22;
const INDENT = 18;
const LEFT = 14;
/** Age after which a tree is shown as stale, s. The rover publishes it on each change, and every 10 s. */
const LATE_S = 25;
/** Time after the end of a command until its tree is read, s: a short command appears only there. */
const SOON_S = 1;
const MAX_RECALLED = 50;
const MARKS = {
  selector: ["?", "selector: the first child that does not fail"],
  sequence: ["→", "sequence: one child after the other"],
  parallel: ["⇉", "parallel: all children side by side"],
  decorator: ["◆", "decorator"],
  condition: ["◇", "condition"],
  take: ["▹", "takes a goal of a queue"],
  leaf: ["▸", "leaf"],
  planned: ["·", "of a plan"],
};
const STYLES = {
  running: "running",
  success: "success",
  declined: "nothing to do",
  failure: "failed",
  idle: "not ticked",
};

export class TreeView extends View {
  /** @type {TreeState | null} the tree at the displayed time */
  #past = null;
  /** @type {Map<string, boolean>} branches that the operator opened or folded, by path */
  #chosen = new Map();
  /** whether all branches are open */
  #isOpen = false;

  #mode = html("span", { className: "mode" });
  #why = html("span", { className: "why" });
  #search = html("input", { type: "search", placeholder: "find a node", "aria-label": "find a node", oninput: this.draw });
  #all = button("open all", "", () => this.#toggleAll());
  #rows = svg("svg", { class: "tree", role: "tree", "aria-label": "behaviour tree" });
  #empty = html("p", { className: "empty" });
  #legend = html(
    "p",
    { className: "legend" },
    ...Object.entries(STYLES).map(([style, label]) => html("span", {}, svg("svg", { width: 14, height: 14, class: style }, statusSign(7, 7)), label)),
  );
  #head = html("header", {}, this.#mode, this.#why, html("span", { className: "tools" }, this.#search, this.#all));
  root = html("section", { className: "rover-view tree-view" }, this.#head, this.#empty, html("div", { className: "scroll", tabIndex: 0 }, this.#rows), this.#legend);

  start() {
    const { asset, session, selection, cursor, draw } = this;
    this.#loadPast();
    return [asset.on("tree", draw), asset.on("links", draw), session.onSecond(draw), selection.on(() => this.#recall()), cursor.on(() => this.#loadPast())];
  }

  /** Request the tree at the displayed time. */
  async #loadPast() {
    const utc = this.cursor.utc_s;
    if (utc === null) this.#past = null;
    this.draw();
    if (utc === null) return;
    const [record] = await this.#read(`before=${utc}&limit=1`);
    if (this.cursor.utc_s !== utc) return;
    this.#past = record ?? null;
    this.draw();
  }

  /** Request the trees during the selected command, if no tree with it was received. */
  async #recall() {
    const command = this.asset.commands.get(this.selection.command ?? "");
    this.draw();
    if (!command || this.asset.nodesOf(command).length) return;
    const at = command.history.at(-1)?.utc ?? command.created;
    await this.#read(`start=${command.created}&before=${at + SOON_S}&limit=${MAX_RECALLED}`);
    this.draw();
  }

  /** Read archived trees, and record which commands their nodes executed. @param {string} query @returns {Promise<TreeState[]>} */
  async #read(query) {
    const path = `/api/records/tree?asset=${encodeURIComponent(this.asset.name)}&${query}`;
    const { records } = await fetchJson(path).catch(() => ({ records: [] }));
    for (const each of records) this.asset.noteNodes(each);
    return records;
  }

  get #tree() {
    return this.cursor.utc_s === null ? this.asset.tree : this.#past;
  }

  #toggleAll() {
    this.#isOpen = !this.#isOpen;
    this.#chosen = new Map(this.#isOpen ? this.#tree?.nodes.map((node) => [node.path, true]) : []);
    this.draw();
  }

  render() {
    const { asset, cursor, session, selection } = this;
    const tree = this.#tree;
    const isNow = cursor.utc_s === null;
    const isFresh = isNow && tree !== null && asset.isReached && session.now - tree.utc < LATE_S;
    this.root.classList.toggle("stale", isNow && tree !== null && !isFresh);
    this.root.classList.toggle("past", !isNow);
    this.#empty.hidden = tree !== null;
    this.#legend.hidden = this.#head.hidden = tree === null;
    setText(this.#empty, this.#whyEmpty());
    setText(this.#mode, tree?.mode ?? "");
    this.#mode.dataset.mode = tree?.mode ?? "";
    setText(this.#why, !tree ? "" : isFresh ? tree.why : `as of ${clock(tree.utc)}: ${tree.why}`);
    setText(this.#all, this.#isOpen ? "fold" : "open all");
    this.#drawRows(visible(tree?.nodes ?? [], this.#search.value.trim().toLowerCase(), this.#chosen, selection.nodesOf(asset)));
  }

  #whyEmpty() {
    const { asset, cursor, session } = this;
    if (asset.recording) return session.unreached(asset);
    if (cursor.utc_s !== null) return `No archived behaviour tree at ${clock(cursor.utc_s)}.`;
    return asset.isReached ? "No behaviour tree received yet." : session.unreached(asset);
  }

  #drawRows(rows) {
    const width = Math.max(320, ...rows.map((row) => row.x + 30 + 7.3 * (row.node.name.length + row.node.message.length + 4)));
    set(this.#rows, { width, height: rows.length * ROW + 6 });
    reconcile(this.#rows, rows, (row) => row.node.path, (row) => this.#makeRow(row.node), drawRow);
  }

  /** @param {TreeNode} node */
  #makeRow({ kind, path }) {
    const fold = svg("text", { class: "fold" });
    const made = svg(
      "g",
      { role: "treeitem", tabindex: -1 },
      svg("rect", { class: "back", x: 0, height: ROW, width: "100%" }),
      svg("path", { class: "branch" }),
      fold,
      svg("g", { class: "status" }, statusSign(0, 0)),
      svg("text", { class: "name" }, svg("title", {}, MARKS[kind]?.[1] ?? kind), svg("tspan", { class: "mark" }), svg("tspan")),
      svg("text", { class: "message" }),
    );
    fold.addEventListener("click", (event) => {
      event.stopPropagation();
      this.#chosen.set(path, made.getAttribute("aria-expanded") !== "true");
      this.draw();
    });
    made.addEventListener("click", () => {
      const node = this.#tree?.nodes.find((each) => each.path === path);
      if (node) this.selection.selectNode(this.asset, node);
    });
    return made;
  }
}

function drawRow(made, { node, index, parent, x, style, children, open, hit, selected }) {
  const y = index * ROW + ROW / 2 + 3;
  const [back, branch, fold, status, name, message] = made.children;
  set(made, { class: `${style}${hit ? " hit" : ""}${selected ? " selected" : ""}`, "data-status": style });
  if (children) made.setAttribute("aria-expanded", String(open));
  set(back, { y: y - ROW / 2 });
  set(branch, { d: parent === null ? "" : `M${x - INDENT + 1} ${y - (index - parent) * ROW + 9}V${y}H${x - 8}` });
  set(fold, { x: x + 12, y: y + 4 });
  setText(fold, children ? (open ? "▾" : "▸") : "");
  set(status, { transform: `translate(${x} ${y})` });
  const at = x + (children ? 26 : 12);
  set(name, { x: at, y: y + 4.5 });
  const [, mark, nameText] = name.children;
  setText(mark, `${MARKS[node.kind]?.[0] ?? ""} `);
  setText(nameText, open || !children ? node.name : `${node.name}  (${children})`);
  const length = node.name.length + (open || !children ? 0 : 3 + String(children).length) + 3;
  set(message, { x: at + 4 + 7.3 * length, y: y + 4.5 });
  setText(message, style === "running" || style === "failure" ? node.message : "");
}

/** Create the status signs; the stylesheet shows one of them. */
function statusSign(x, y) {
  return svg(
    "g",
    { transform: `translate(${x} ${y})`, class: "sign" },
    svg("circle", { r: 5 }),
    svg("path", { class: "tick", d: "M-2.6 .2L-.7 2.2L2.8-2" }),
    svg("path", { class: "cross", d: "M-2-2L2 2M2-2L-2 2" }),
    svg("path", { class: "dash", d: "M-2.4 0H2.4" }),
  );
}

/**
 * Return the rows to draw, of nodes in depth-first order.
 * @param {TreeNode[]} nodes
 * @param {string} sought
 * @param {Map<string, boolean>} chosen
 * @param {Set<string>} selected paths
 */
function visible(nodes, sought, chosen, selected) {
  const parents = parentsOf(nodes);
  const below = nodes.map(() => 0);
  const matters = nodes.map((node) => ["running", "failure"].includes(node.status) || selected.has(node.path));
  const hits = nodes.map((node) => sought !== "" && node.name.toLowerCase().includes(sought));
  const holdsHit = [...hits];
  for (let index = nodes.length - 1; index > 0; index--) {
    const parent = parents[index];
    if (parent === null) continue;
    below[parent] += 1 + below[index];
    holdsHit[parent] ||= holdsHit[index];
    matters[parent] ||= matters[index];
  }
  const rows = [];
  const rowsByIndex = new Map();
  for (const [index, node] of nodes.entries()) {
    const parent = parents[index];
    if (parent !== null && !rowsByIndex.get(parent)?.open) continue;
    if (sought !== "" && !holdsHit[index]) continue;
    const open = sought !== "" || (chosen.get(node.path) ?? (matters[index] || node.depth === 0));
    const row = {
      node,
      index: rows.length,
      parent: parent === null ? null : rowsByIndex.get(parent).index,
      x: LEFT + node.depth * INDENT,
      style: node.status,
      children: below[index],
      open,
      hit: hits[index],
      selected: selected.has(node.path),
    };
    rowsByIndex.set(index, row);
    rows.push(row);
  }
  return rows;
}

/** Return the index of each node's parent, null for a root. */
function parentsOf(nodes) {
  const path = [];
  return nodes.map((node, index) => {
    path.length = node.depth;
    path.push(index);
    return path.length > 1 ? (path[path.length - 2] ?? null) : null;
  });
}
