/** The title of the page, "(2) jackal – Operations": what needs attention, the shown rover, and the shown object, which Open MCT writes. */

/** Parts in their order, empty if there is nothing to show. */
const parts = { link: "", alarms: "", rover: "" };
const element = document.head.querySelector("title");
let object = document.title;

/** @param {keyof typeof parts} part @param {string} text */
export function setTitle(part, text) {
  parts[part] = text;
  write();
}

function write() {
  if (changes.takeRecords().length) object = document.title;
  const { link, alarms, rover } = parts;
  const title = [link, alarms, [rover, object].filter(Boolean).join(" – ")].filter(Boolean).join(" ");
  if (document.title === title) return;
  document.title = title;
  changes.takeRecords(); // the own change
}

const changes = new MutationObserver(() => {
  object = document.title;
  write();
});
changes.observe(element, { childList: true });
