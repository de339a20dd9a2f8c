/**
 * What is selected, shared by all views: a command, with the nodes of the tree that worked on it, its
 * lines in the log and its part of the driven path. A node leads to the command that it works on, or
 * worked on last, at the moment that is looked at; one that works on none is selected by itself.
 */

/** @import { Asset } from "./asset.js" */
/** @import { TreeNode } from "./messages.js" */

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

  /** Select a node with its command, or nothing if it already was. @param {Asset} asset @param {TreeNode} node */
  selectNode(asset, node) {
    if (node.path === this.node) return this.#set(null, null);
    const command = node.command === null ? null : asset.commandOf(node.command);
    this.#set(command?.id ?? null, node.path);
  }

  /** When the selected command was carried out. @param {Asset} asset */
  spanOf(asset) {
    const command = this.command === null ? undefined : asset.commands.get(this.command);
    return command ? asset.spanOf(command) : null;
  }

  /** The paths of the nodes that are selected, or worked on the selected command. @param {Asset} asset */
  nodesOf(asset) {
    const command = this.command === null ? undefined : asset.commands.get(this.command);
    const nodes = command ? asset.nodesOf(command) : [];
    return new Set(this.node === null ? nodes : [...nodes, this.node]);
  }

  #set(command, node) {
    this.command = command;
    this.node = node;
    for (const listener of [...this.#listeners]) listener();
  }
}

/** The span of time that is looked at: that of the time conductor. */
export class Span {
  #listeners = new Set();
  /** seconds since 1970-01-01 UTC */
  start_s = Date.now() / 1000 - 300;
  end_s = Date.now() / 1000;

  /** @param {() => void} listener */
  on(listener) {
    this.#listeners.add(listener);
    return () => this.#listeners.delete(listener);
  }

  /** @param {number} start_s @param {number} end_s */
  set(start_s, end_s) {
    this.start_s = start_s;
    this.end_s = end_s;
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
