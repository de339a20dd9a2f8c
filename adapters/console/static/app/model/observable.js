/** Observables that views subscribe to. */

export class Observable {
  /** @type {Set<(what?: any) => void>} */
  #listeners = new Set();

  /** @param {(what?: any) => void} listener @returns {() => void} ends it */
  on(listener) {
    this.#listeners.add(listener);
    return () => this.#listeners.delete(listener);
  }

  /** @param {any} [what] */
  changed(what) {
    for (const listener of [...this.#listeners]) listener(what);
  }
}

/** @template {string} Topic */
export class Topics {
  /** @type {Map<Topic, Observable>} */
  #topics = new Map();

  /** @param {Topic} topic @param {(what?: any) => void} listener @returns {() => void} ends it */
  on(topic, listener) {
    if (!this.#topics.has(topic)) this.#topics.set(topic, new Observable());
    return this.#topics.get(topic).on(listener);
  }

  /** @param {Topic} topic @param {any} [what] */
  changed(topic, what) {
    this.#topics.get(topic)?.changed(what);
  }
}
