// Runs the script of a report without a browser: node replay_in_node.js report.html FRAGMENT...
// For each fragment, such as "#drive=0&arm=known&tick=3", it prints what the page says, as JSON.
const { readFileSync } = require("node:fs");
const vm = require("node:vm");

const page = readFileSync(process.argv[2], "utf8");
const json = page.match(/<script id="data" type="application\/json">(.*?)<\/script>/s)[1];
const script = page.match(/<script>\n(.*?)<\/script>/s)[1];

/** An object that has any property, takes any call, and draws nothing. */
const nothing = new Proxy(() => {}, {
  get: (_, name) => (name === "createImageData" ? newImage : nothing),
  set: () => true,
  apply: () => nothing,
});
const newImage = (cols, rows) => ({ data: new Uint8ClampedArray(4 * cols * rows) });

function element() {
  const sides = { clientWidth: 400, clientHeight: 300, style: {} };
  const does = ["add", "replaceChildren", "setAttribute", "scrollIntoView"];
  const calls = Object.fromEntries(does.map((name) => [name, () => {}]));
  return { ...sides, ...calls, textContent: "", value: "", getContext: () => nothing };
}

async function shown(fragment) {
  const parts = { data: { ...element(), textContent: json } };
  const document = {
    getElementById: (id) => (parts[id] ??= element()),
    createElement: element,
    addEventListener: () => {},
  };
  const window = { addEventListener: () => {}, DecompressionStream };
  const given = { document, window, location: { hash: fragment }, Option: Object };
  const known = { atob, Blob, Response, DecompressionStream, URLSearchParams };
  vm.runInNewContext(script, { ...given, ...known, Uint8Array, Int32Array });
  while (!parts.clock?.textContent) await new Promise((done) => setTimeout(done, 5));
  const names = ["clock", "speed", "limit", "reason", "outcome", "arm"];
  return Object.fromEntries(names.map((id) => [id, parts[id].textContent || parts[id].value]));
}

(async () => {
  const all = [];
  for (const fragment of process.argv.slice(3)) all.push(await shown(fragment));
  console.log(JSON.stringify(all));
})();
