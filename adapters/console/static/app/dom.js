/** Helpers for HTML and SVG elements, and drawing at most once a frame. */

const SVG = "http://www.w3.org/2000/svg";

/**
 * Make an HTML element. Properties are set as such (`className`, `onclick`), `data-` and `aria-` as attributes.
 * @param {string} name
 * @param {Record<string, any>} [properties]
 * @param {...(Node | string | null | undefined | false)} children
 * @returns {any}
 */
export function html(name, properties = {}, ...children) {
  const made = document.createElement(name);
  for (const [key, value] of Object.entries(properties)) {
    if (key.includes("-") || key === "role" || key === "for") made.setAttribute(key, value);
    else made[key] = value;
  }
  for (const child of children) if (child || child === "") made.append(child);
  return made;
}

/** @param {string} textContent @param {string} title @param {(event: any) => void} onclick @param {Record<string, any>} [properties] */
export const button = (textContent, title, onclick, properties = {}) =>
  html("button", { type: "button", textContent, onclick, ...(title && { title }), ...properties });

/** Make the head of a table. @param {...string} titles */
export const tableHead = (...titles) => html("thead", {}, html("tr", {}, ...titles.map((textContent) => html("th", { textContent }))));

/** Make an SVG element. @param {string} name @param {Record<string, any>} [attributes] @param {...(Node | string)} children @returns {any} */
export function svg(name, attributes = {}, ...children) {
  const made = document.createElementNS(SVG, name);
  set(made, attributes);
  made.append(...children);
  return made;
}

/** Set the attributes that differ from the present ones. @param {Element} element @param {Record<string, any>} attributes */
export function set(element, attributes) {
  for (const [key, value] of Object.entries(attributes)) {
    const text = String(value);
    if (element.getAttribute(key) !== text) element.setAttribute(key, text);
  }
}

/** Set the text of a node, if it differs from the present one. @param {Node} node @param {string} text */
export function setText(node, text) {
  if (node.textContent !== text) node.textContent = text;
}

/** Return a function that schedules one drawing in the next frame; further calls before it have no effect. @param {() => void} draw */
export function eachFrame(draw) {
  let scheduled = false;
  return () => {
    if (scheduled) return;
    scheduled = true;
    requestAnimationFrame(() => {
      scheduled = false;
      draw();
    });
  };
}

/**
 * Update the children of a container to a list of items, in its order. The element of an item is reused by its key;
 * of items with equal keys, that of the first.
 * @template T
 * @param {HTMLElement} container
 * @param {T[]} items
 * @param {(item: T) => string} keyOf
 * @param {(item: T) => any} make
 * @param {(element: any, item: T) => void} [update]
 */
export function reconcile(container, items, keyOf, make, update = () => {}) {
  const keys = items.map(keyOf);
  const wanted = new Set(keys);
  const known = new Map();
  const focused = /** @type {HTMLElement | null} */ (container.querySelector(":focus"));
  for (const child of [...container.children]) {
    const key = child.getAttribute("data-key");
    if (wanted.has(key) && !known.has(key)) known.set(key, child);
    else child.remove();
  }
  let before = null;
  items.forEach((item, index) => {
    let element = known.get(keys[index]);
    known.delete(keys[index]);
    if (!element) {
      element = make(item);
      element.setAttribute("data-key", keys[index]);
    }
    update(element, item);
    const next = before ? before.nextSibling : container.firstChild;
    if (next !== element) container.insertBefore(element, next);
    before = element;
  });
  if (focused?.isConnected) focused.focus({ preventScroll: true }); // a moved element has lost it
}
