/**
 * What is selected, shared by all views: a command, with its leaf in the tree, its lines in the log and
 * its part of the driven path; or a node, with the commands that it worked on.
 */

export class Selection {
  #listeners = new Set();
  /** @type {string | null} the key of a command */
  command = null;
  /** @type {string | null} the path of a node of the tree */
  node = null;

  /** @param {() => void} listener */
  on(listener) {
    this.#listeners.add(listener);
    return () => this.#listeners.delete(listener);
  }

  /** Select a command, or nothing if it already was. @param {string | null} key */
  selectCommand(key) {
    this.#set(key === this.command ? null : key, null);
  }

  /** Select a node, or nothing if it already was. @param {string | null} path */
  selectNode(path) {
    this.#set(null, path === this.node ? null : path);
  }

  /** When the selected command was carried out. @param {import("./asset.js").Asset} asset */
  spanOf(asset) {
    const command = this.command === null ? undefined : asset.commands.get(this.command);
    return command ? asset.spanOf(command) : null;
  }

  /** The paths of the nodes that are selected, or work on the selected command. @param {import("./asset.js").Asset} asset */
  nodesOf(asset) {
    if (this.node !== null) return new Set([this.node]);
    return new Set(this.command === null ? [] : leavesOf(asset, this.command));
  }

  /** Whether a node is selected that works on a command. */
  isOfNode(asset, command) {
    return this.node !== null && leavesOf(asset, command.id).includes(this.node);
  }

  #set(command, node) {
    this.command = command;
    this.node = node;
    for (const listener of [...this.#listeners]) listener();
  }
}

/** The moment that is looked at; null is now. */
export class Cursor {
  #listeners = new Set();
  /** @type {number | null} seconds since 1970-01-01 UTC */
  utc_s = null;

  /** @param {() => void} listener */
  on(listener) {
    this.#listeners.add(listener);
    return () => this.#listeners.delete(listener);
  }

  /** @param {number | null} utc_s */
  set(utc_s) {
    if (utc_s === this.utc_s) return;
    this.utc_s = utc_s;
    for (const listener of [...this.#listeners]) listener();
  }
}

/**
 * The paths of the leaves that work on a command.
 * @param {import("./asset.js").Asset} asset
 * @param {string} id
 * @returns {string[]}
 */
function leavesOf(asset, id) {
  const name = asset.commands.get(id)?.name ?? "";
  const branch = asset.entry?.commands.find((each) => each.name === name)?.branch;
  if (!branch) return [];
  const leaves = asset.tree?.nodes.filter((node) => node.path.split("/").includes(branch)) ?? [];
  return leaves.map((node) => node.path);
}
