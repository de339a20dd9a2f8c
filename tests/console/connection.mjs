/** Plays a page's connection without a browser: timers, sockets and answers are those of this file. */

let timers = [];
let now = 0;
let last = 0;
const sockets = [];
globalThis.location = { href: "http://localhost/" };
globalThis.sessionStorage = { getItem: () => "anna" };
globalThis.addEventListener = () => {};
globalThis.fetch = async () => ({ ok: true, text: async () => "{}" });
globalThis.clearTimeout = (id) => (timers = timers.filter((each) => each.id !== id));
globalThis.setTimeout = (act, ms) => {
  timers.push({ id: ++last, at: now + ms, act });
  return last;
};
globalThis.WebSocket = class {
  constructor() {
    sockets.push(this);
  }
  send() {}
  close() {}
  hello() {
    this.onopen();
    this.tell({ ty: "hello", utc: 0 });
  }
  tell(...messages) {
    this.onmessage({ data: JSON.stringify(messages) });
  }
};

async function pass(ms) {
  const end = now + ms;
  for (;;) {
    timers.sort((one, other) => one.at - other.at);
    if (!timers.length || timers[0].at > end) break;
    const { at, act } = timers.shift();
    now = at;
    await act();
  }
  now = end;
}

const { Connection } = await import(process.argv[2]);
const told = [];
const connection = new Connection((message) => told.push(message.ty), () => ({ op: "hello" }));
sockets[0].hello();
await pass(9000);
sockets[0].tell();
await pass(9000);
const before = { sockets: sockets.length, status: connection.status };
await pass(2000);
const silent = { sockets: sockets.length, status: connection.status };
sockets.at(-1).hello();
sockets[0].tell({ ty: "late" });
sockets[0].onclose();
const back = { sockets: sockets.length, status: connection.status, told };
console.log(JSON.stringify({ before, silent, back }));
process.exit();
