/**
 * The connection to rover-console: requests over HTTP, and messages over a WebSocket. The WebSocket
 * reconnects by itself and requests the missed messages.
 */

import { serverClock } from "./server_clock.js";

const OPERATOR = "rover-console-operator";
const MIN_RETRY_MS = 300;
const MAX_RETRY_MS = 5000;
const RECEIVE_TIMEOUT_MS = 10000;

/** The operator of this page. Requests that change state carry this name. */
export const operator = {
  /** @returns {string} */
  get name() {
    const stored = sessionStorage.getItem(OPERATOR);
    if (stored) return stored;
    const made = `operator-${Math.random().toString(36).slice(2, 6)}`;
    sessionStorage.setItem(OPERATOR, made);
    return made;
  },
  set name(name) {
    sessionStorage.setItem(OPERATOR, name);
  },
};

/** A request that failed or was refused, with the text of the server. */
export class RequestError extends Error {
  /**
   * @param {number} status of HTTP; 0 if the server was not reached
   * @param {any} body
   */
  constructor(status, body) {
    super(body?.error ?? (status ? `the server responds with status ${status}` : "rover-console does not answer"));
    this.status = status;
    this.body = body;
  }
}

/**
 * Send a request to the server and return the JSON body of its response.
 * @param {string} path
 * @param {RequestInit & {json?: any}} [options] `json` is sent as the body
 * @returns {Promise<any>} the body; a RequestError is thrown for any status but 2xx, an AbortError if the caller aborts
 */
export async function fetchJson(path, options = {}) {
  const { json, headers, ...rest } = options;
  const method = options.method ?? (json === undefined ? "GET" : "POST");
  let response;
  try {
    response = await fetch(path, {
      ...rest,
      method,
      ...(json === undefined ? {} : { body: JSON.stringify(json) }),
      headers: {
        ...headers,
        ...(json === undefined ? {} : { "Content-Type": "application/json" }),
        ...(method === "GET" ? {} : { "X-Rover-Operator": encodeURIComponent(operator.name) }),
      },
    });
  } catch (error) {
    throw error.name === "AbortError" ? error : new RequestError(0, null);
  }
  const text = await response.text();
  let body = null;
  try {
    body = text ? JSON.parse(text) : null;
  } catch {
    body = { error: text };
  }
  if (!response.ok) throw new RequestError(response.status, body);
  return body;
}

/** Return an id for one command, the key of its deduplication; browsers offer `randomUUID` over HTTPS only. */
export function newId() {
  return crypto.randomUUID?.() ?? `${Date.now()}-${Math.random()}`;
}

export class Connection {
  #listeners = new Set();
  #wait_ms = MIN_RETRY_MS;
  /** @type {WebSocket | null} */
  #socket = null;
  #timeout = 0;
  /** @type {"connecting" | "open" | "lost"} */
  status = "connecting";
  /** when the status began, ms since 1970 UTC */
  since_ms = Date.now();

  /**
   * @param {(message: any) => void} receive called with each message
   * @param {() => object} greeting returns the first message of this page
   */
  constructor(receive, greeting) {
    this.receive = receive;
    this.greeting = greeting;
    this.#open();
    addEventListener("online", () => this.#socket === null && this.#open());
  }

  /** @param {() => void} listener called when the status changes */
  on(listener) {
    this.#listeners.add(listener);
    return () => this.#listeners.delete(listener);
  }

  /** @param {object} message */
  send(message) {
    if (this.#socket?.readyState === WebSocket.OPEN) this.#socket.send(JSON.stringify(message));
  }

  #open() {
    const socket = new WebSocket(new URL("/ws", location.href.replace(/^http/, "ws")));
    this.#socket = socket;
    this.#restartTimeout();
    socket.onopen = () => socket.send(JSON.stringify(this.greeting()));
    socket.onmessage = (event) => {
      if (this.#socket !== socket) return;
      this.#restartTimeout();
      const data = JSON.parse(event.data);
      for (const message of Array.isArray(data) ? data : [data]) {
        if (message.ty === "hello") {
          serverClock.offset_s = message.utc - Date.now() / 1000;
          this.#wait_ms = MIN_RETRY_MS;
          this.#setStatus("open");
        }
        this.receive(message);
      }
    };
    socket.onclose = () => this.#onClosed(socket);
  }

  /** @param {WebSocket | null} socket */
  #onClosed(socket) {
    if (this.#socket !== socket) return;
    clearTimeout(this.#timeout);
    this.#socket = null;
    this.#setStatus("lost");
    setTimeout(() => this.#socket ?? this.#open(), this.#wait_ms * (0.7 + 0.6 * Math.random()));
    this.#wait_ms = Math.min(this.#wait_ms * 1.7, MAX_RETRY_MS);
  }

  /**
   * Reconnect after RECEIVE_TIMEOUT_MS without a message. The server sends one every 5 s; a browser detects
   * neither a lost network nor a server without power.
   */
  #restartTimeout() {
    clearTimeout(this.#timeout);
    const socket = this.#socket;
    this.#timeout = setTimeout(() => {
      socket?.close();
      this.#onClosed(socket);
    }, RECEIVE_TIMEOUT_MS);
  }

  #setStatus(status) {
    if (status === this.status) return;
    this.status = status;
    this.since_ms = Date.now();
    for (const listener of [...this.#listeners]) listener();
  }
}
