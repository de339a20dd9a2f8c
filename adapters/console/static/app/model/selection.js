/**
 * The selection, shared by all views: a command, with the nodes of the tree that executed it, its lines in
 * the log and its part of the driven path. A node selects the command that it executes, or executed last, at
 * the displayed time; a node without a command is selected alone.
 */

import { Observable } from "./observable.js";

/** @import { Asset } from "./asset.js" */
/** @import { TreeNode } from "./messages.js" */

export class Selection extends Observable {
  /** @type {string | null} the key of a command */
  command = null;
  /** @type {string | null} the path of a node of the tree */
  node = null;
  /** @type {{x: number, y: number}[]} the track of a fork of the recording */
  fork = [];

  /** Show the track of a fork on the map. @param {{x: number, y: number}[]} track */
  setFork(track) {
    this.fork = track;
    this.changed();
  }

  /** Select a command, or deselect it if it was selected. @param {string | null} key */
  selectCommand(key) {
    this.#set(key === this.command ? null : key, null);
  }

  /** Select a node with its command, or deselect it if it was selected. @param {Asset} asset @param {TreeNode} node */
  selectNode(asset, node) {
    if (node.path === this.node) return this.#set(null, null);
    const command = node.command === null ? null : asset.commandOf(node.command);
    this.#set(command?.id ?? null, node.path);
  }

  /** The execution times of the selected command. @param {Asset} asset */
  spanOf(asset) {
    const command = this.command === null ? undefined : asset.commands.get(this.command);
    return command ? asset.spanOf(command) : null;
  }

  /** The paths of the selected node and of the nodes that executed the selected command. @param {Asset} asset */
  nodesOf(asset) {
    const command = this.command === null ? undefined : asset.commands.get(this.command);
    const nodes = command ? asset.nodesOf(command) : [];
    return new Set(this.node === null ? nodes : [...nodes, this.node]);
  }

  #set(command, node) {
    this.command = command;
    this.node = node;
    this.changed();
  }
}

/** The displayed time span, set by the time conductor. */
export class Span extends Observable {
  /** seconds since 1970-01-01 UTC */
  start_s = Date.now() / 1000 - 300;
  end_s = Date.now() / 1000;

  /** @param {number} start_s @param {number} end_s */
  set(start_s, end_s) {
    this.start_s = start_s;
    this.end_s = end_s;
    this.changed();
  }
}

/** The displayed time; null is now. */
export class Cursor extends Observable {
  /** @type {number | null} seconds since 1970-01-01 UTC */
  utc_s = null;

  /** @param {number | null} utc_s */
  set(utc_s) {
    if (utc_s === this.utc_s) return;
    this.utc_s = utc_s;
    this.changed();
  }
}
