/**
 * The connection to rover-console: requests over HTTP, and messages over a WebSocket that comes back by
 * itself and asks for what was missed meanwhile.
 */

const OPERATOR = "rover-console-operator";
const FIRST_RETRY_MS = 300;
const LONGEST_RETRY_MS = 5000;
const SILENCE_MS = 10000;

/** Who sits here. What changes something is asked for under this name. */
export const operator = {
  /** @returns {string} */
  get name() {
    const kept = sessionStorage.getItem(OPERATOR);
    if (kept) return kept;
    const made = `operator-${Math.random().toString(36).slice(2, 6)}`;
    sessionStorage.setItem(OPERATOR, made);
    return made;
  },
  set name(name) {
    sessionStorage.setItem(OPERATOR, name);
  },
};

/** What the server refused, in its words. */
export class Refused extends Error {
  /**
   * @param {number} status of HTTP; 0 where the server was not reached
   * @param {any} body
   */
  constructor(status, body) {
    super(body?.error ?? (status ? `the server answers ${status}` : "rover-console does not answer"));
    this.status = status;
    this.body = body;
  }
}

/**
 * Ask the server for something.
 * @param {string} path
 * @param {RequestInit & {json?: any}} [options] `json` is sent as the body
 * @returns {Promise<any>} what it answers
 */
export async function ask(path, options = {}) {
  const { json, headers, ...rest } = options;
  const method = options.method ?? (json === undefined ? "GET" : "POST");
  let answer;
  try {
    answer = await fetch(path, {
      ...rest,
      method,
      ...(json === undefined ? {} : { body: JSON.stringify(json) }),
      headers: {
        ...headers,
        ...(json === undefined ? {} : { "Content-Type": "application/json" }),
        ...(method === "GET" ? {} : { "X-Rover-Operator": encodeURIComponent(operator.name) }),
      },
    });
  } catch {
    throw new Refused(0, null);
  }
  const text = await answer.text();
  let body = null;
  try {
    body = text ? JSON.parse(text) : null;
  } catch {
    body = { error: text };
  }
  if (!answer.ok) throw new Refused(answer.status, body);
  return body;
}

/** A number for a command, which is never sent twice under it; `randomUUID` is there over HTTPS alone. */
export function newId() {
  return crypto.randomUUID?.() ?? `${Date.now()}-${Math.random()}`;
}

export class Connection {
  #listeners = new Set();
  #wait_ms = FIRST_RETRY_MS;
  /** @type {WebSocket | null} */
  #socket = null;
  #silence = 0;
  /** @type {"connecting" | "open" | "lost"} */
  status = "connecting";
  /** when the status began, ms since 1970 UTC */
  since_ms = Date.now();
  /** seconds by which the server's clock is ahead of this browser's */
  ahead_s = 0;

  /**
   * @param {(message: any) => void} receive gets each message
   * @param {() => object} greeting what this page says first
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
    this.#listen();
    socket.onopen = () => socket.send(JSON.stringify(this.greeting()));
    socket.onmessage = (event) => {
      if (this.#socket !== socket) return;
      this.#listen();
      const data = JSON.parse(event.data);
      for (const message of Array.isArray(data) ? data : [data]) {
        if (message.ty === "hello") {
          this.ahead_s = message.utc - Date.now() / 1000;
          this.#wait_ms = FIRST_RETRY_MS;
          this.#become("open");
        }
        this.receive(message);
      }
    };
    socket.onclose = () => this.#lose(socket);
  }

  /** @param {WebSocket | null} socket */
  #lose(socket) {
    if (this.#socket !== socket) return;
    clearTimeout(this.#silence);
    this.#socket = null;
    this.#become("lost");
    setTimeout(() => this.#socket ?? this.#open(), this.#wait_ms * (0.7 + 0.6 * Math.random()));
    this.#wait_ms = Math.min(this.#wait_ms * 1.7, LONGEST_RETRY_MS);
  }

  /**
   * Connect again after a silence: the server sends a message every 5 s, and a browser detects neither a lost
   * network nor a server that has lost power and with it the connection.
   */
  #listen() {
    clearTimeout(this.#silence);
    const socket = this.#socket;
    this.#silence = setTimeout(() => {
      socket?.close();
      this.#lose(socket);
    }, SILENCE_MS);
  }

  #become(status) {
    if (status === this.status) return;
    this.status = status;
    this.since_ms = Date.now();
    for (const listener of [...this.#listeners]) listener();
  }
}
