/**
 * The behaviour tree, live: a node a row, what it says beside its name, and in words why the rover
 * stands or what moves it. Branches in which nothing is done are folded until somebody opens them.
 */

import { ask } from "../model/connection.js";
import { eachFrame, html, keep, say, set, svg } from "../dom.js";
import { clock } from "../words.js";

/** @typedef {import("../model/context.js").Context} Context */
/** @import { TreeNode, TreeState } from "../model/messages.js" */

const ROW = 22;
const INDENT = 18;
const LEFT = 14;
/** A tree is told when it changes, and every 10 s. */
const LATE_S = 25;
/** A command that is done at once is seen in a tree that is told so soon after. */
const SOON_S = 1;
const MOST_RECALLED = 50;
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
const LOOKS = {
  running: "running",
  success: "success",
  declined: "nothing to do",
  failure: "failed",
  idle: "not ticked",
};

/**
 * @param {HTMLElement} element
 * @param {Context} context
 * @returns {() => void}
 */
export function mount(element, context) {
  const { asset, session, selection, cursor } = context;
  /** @type {TreeState | null} how it was at the time that is looked at */
  let past = null;
  /** @type {Map<string, boolean>} what the operator folded or opened, by path */
  const chosen = new Map();

  const mode = html("span", { className: "mode" });
  const why = html("span", { className: "why" });
  const search = html("input", {
    type: "search",
    placeholder: "find a node",
    "aria-label": "find a node",
    oninput: () => draw(),
  });
  const all = html("button", {
    type: "button",
    textContent: "open all",
    onclick: () => openAll(all.textContent === "open all"),
  });
  const rows = svg("svg", { class: "tree", role: "tree", "aria-label": "behaviour tree" });
  const empty = html("p", { className: "empty" });
  const legend = html(
    "p",
    { className: "legend" },
    ...Object.entries(LOOKS).map(([look, words]) =>
      html("span", {}, svg("svg", { width: 14, height: 14, class: look }, sign(7, 7)), words),
    ),
  );
  const head = html("header", {}, mode, why, html("span", { className: "tools" }, search, all));
  const root = html(
    "section",
    { className: "rover-view tree-view" },
    head,
    empty,
    html("div", { className: "scroll" }, rows),
    legend,
  );
  element.append(root);

  function openAll(open) {
    chosen.clear();
    for (const node of nodes()) chosen.set(node.path, open);
    if (!open) chosen.clear();
    all.textContent = open ? "fold" : "open all";
    draw();
  }

  const shown = () => (cursor.utc_s === null ? asset.tree : past);
  const isFresh = () => cursor.utc_s === null && asset.isReached && session.now - asset.tree.utc < LATE_S;

  /** Ask how it was at the time that is looked at. */
  async function lookBack() {
    const utc = cursor.utc_s;
    if (utc === null) past = null;
    draw();
    if (utc === null) return;
    const path = `/api/records/tree?asset=${encodeURIComponent(asset.name)}&before=${utc}&limit=1`;
    const { records } = await ask(path).catch(() => ({ records: [] }));
    if (cursor.utc_s !== utc) return;
    past = records[0] ?? null;
    if (past) asset.noteNodes(past);
    draw();
  }

  /** Look up which nodes worked on the selected command, where that was not heard. */
  async function recall() {
    const command = asset.commands.get(selection.command ?? "");
    draw();
    if (!command || asset.nodesOf(command).length) return;
    const at = command.history.at(-1)?.utc ?? command.made;
    const path = `/api/records/tree?asset=${encodeURIComponent(asset.name)}&start=${command.made}&before=${at + SOON_S}&limit=${MOST_RECALLED}`;
    const { records } = await ask(path).catch(() => ({ records: [] }));
    records.forEach((each) => asset.noteNodes(each));
    draw();
  }

  /** @returns {TreeNode[]} */
  const nodes = () => shown()?.nodes ?? [];

  function render() {
    const tree = shown();
    root.classList.toggle("stale", cursor.utc_s === null && tree !== null && !isFresh());
    root.classList.toggle("past", cursor.utc_s !== null);
    empty.hidden = tree !== null;
    legend.hidden = head.hidden = tree === null;
    if (tree === null) {
      say(mode, "");
      say(why, "");
      if (asset.recording) say(empty, session.unreached(asset));
      else if (cursor.utc_s !== null) say(empty, `Nothing is kept of the tree of ${clock(cursor.utc_s)}.`);
      else say(empty, asset.isReached ? "The rover has not told of its behaviour tree yet." : session.unreached(asset));
      rows.replaceChildren();
      return;
    }
    say(mode, tree.mode);
    mode.dataset.mode = tree.mode;
    say(why, isFresh() ? tree.why : `as of ${clock(tree.utc)}: ${tree.why}`);
    drawRows(visible(tree.nodes, search.value.trim().toLowerCase(), chosen, selection.nodesOf(asset)));
  }

  function drawRows(shown) {
    const width = Math.max(320, ...shown.map((row) => row.x + 30 + 7.3 * (row.node.name.length + row.node.message.length + 4)));
    set(rows, { width, height: shown.length * ROW + 6 });
    keep(rows, shown, (row) => row.node.path, makeRow, updateRow);
  }

  function makeRow(row) {
    const title = svg("title", {}, MARKS[row.node.kind]?.[1] ?? row.node.kind);
    const made = svg(
      "g",
      { role: "treeitem", tabindex: -1 },
      svg("rect", { class: "back", x: 0, height: ROW, width: "100%" }),
      svg("path", { class: "branch" }),
      svg("text", { class: "fold" }),
      svg("g", { class: "status" }, sign(0, 0)),
      svg("text", { class: "name" }, title, svg("tspan", { class: "mark" }), svg("tspan")),
      svg("text", { class: "message" }),
    );
    made.querySelector(".fold").addEventListener("click", (event) => {
      event.stopPropagation();
      chosen.set(made.dataset.key, made.getAttribute("aria-expanded") !== "true");
      draw();
    });
    made.addEventListener("click", () => {
      const node = nodes().find((each) => each.path === made.dataset.key);
      if (node) selection.selectNode(asset, node);
    });
    return made;
  }

  function updateRow(made, row) {
    const { node, index, x, look, children, open, hit, selected } = row;
    const y = index * ROW + ROW / 2 + 3;
    const [back, branch, fold, status, name, message] = made.children;
    set(made, { class: `${look}${hit ? " hit" : ""}${selected ? " selected" : ""}`, "data-look": look });
    if (children) made.setAttribute("aria-expanded", String(open));
    set(back, { y: y - ROW / 2 });
    const up = row.parent === null ? 0 : (row.index - row.parent) * ROW;
    set(branch, {
      d: row.parent === null ? "" : `M${x - INDENT + 1} ${y - up + 9}V${y}H${x - 8}`,
    });
    set(fold, { x: x + 12, y: y + 4 });
    say(fold, children ? (open ? "▾" : "▸") : "");
    set(status, { transform: `translate(${x} ${y})` });
    const at = x + (children ? 26 : 12);
    set(name, { x: at, y: y + 4.5 });
    const [, mark, words] = name.children;
    say(mark, `${MARKS[node.kind]?.[0] ?? ""} `);
    say(words, open || !children ? node.name : `${node.name}  (${children})`);
    const label = node.name.length + (open || !children ? 0 : 3 + String(children).length) + 3;
    set(message, { x: at + 4 + 7.3 * label, y: y + 4.5 });
    say(message, look === "running" || look === "failure" ? node.message : "");
  }

  const draw = eachFrame(render);
  const offs = [asset.on("tree", draw), asset.on("links", draw), session.onSecond(draw), selection.on(recall), cursor.on(lookBack)];
  lookBack();
  return () => {
    offs.forEach((off) => off());
    root.remove();
  };
}

/** The signs of a status, of which the style shows the one that fits. */
function sign(x, y) {
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
  const matters = nodes.map((node) => ["running", "failure"].includes(node.look) || selected.has(node.path));
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
  const places = new Map();
  for (const [index, node] of nodes.entries()) {
    const parent = parents[index];
    if (parent !== null && !places.get(parent)?.open) continue;
    if (sought !== "" && !holdsHit[index]) continue;
    const open = sought !== "" || (chosen.get(node.path) ?? (matters[index] || node.depth === 0));
    const row = {
      node,
      index: rows.length,
      parent: parent === null ? null : places.get(parent).index,
      x: LEFT + node.depth * INDENT,
      look: node.look,
      children: below[index],
      open,
      hit: hits[index],
      selected: selected.has(node.path),
    };
    places.set(index, row);
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
