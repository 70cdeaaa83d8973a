// @ts-check
// The worker of the page: Python, and in it the commands. It gets files and command lines and sends back what they write.
"use strict";

/** Bytes of every how many lines are remembered: where a page of rows begins. */
const LINES = 100;
/** Least time between two messages on progress, in milliseconds. */
const OFTEN = 80;
const MOUNTED = "/captures";
const FOLDER = "/work";

/** @type {any} */
let python = null;
/** @type {any} */
let bridge = null;
/** The files at hand by name, with what of the whole precedes each. @type {Map<string, {size: number, before: number}>} */
const held = new Map();
let running = 0;
let told = 0;

/** @param {object} message */
function say(message) {
  self.postMessage(message);
}

/** @param {string} text @returns {Uint8Array} */
function decoded(text) {
  const array = /** @type {any} */ (Uint8Array);
  if (array.fromBase64) return array.fromBase64(text);
  const raw = atob(text);
  const octets = new Uint8Array(raw.length);
  for (let at = 0; at < raw.length; at += 1) octets[at] = raw.charCodeAt(at);
  return octets;
}

/** @param {Blob} piece */
async function unpacked(piece) {
  const octets = decoded((await piece.text()).trim());
  if (octets[0] !== 0x1f || octets[1] !== 0x8b) return octets;
  const stream = new Blob([/** @type {any} */ (octets)]).stream().pipeThrough(new DecompressionStream("gzip"));
  return new Uint8Array(await new Response(stream).arrayBuffer());
}

/** @param {Uint8Array} octets */
function script(octets) {
  return URL.createObjectURL(new Blob([/** @type {any} */ (octets)], { type: "text/javascript" }));
}

/** Start Python from what the page holds. @param {Record<string, Blob>} pieces @param {object} lock */
async function start(pieces, lock) {
  const names = Object.keys(pieces);
  /** @type {Record<string, Uint8Array>} */
  const parts = {};
  await Promise.all(names.map(async (name) => { parts[name] = await unpacked(pieces[name]); }));
  say({ kind: "starting", step: "Python" });
  // Nothing is fetched: what Pyodide asks for is answered from memory, and anything else is refused.
  self.fetch = async (address) => {
    const name = String(address instanceof Request ? address.url : address);
    if (name.endsWith("pyodide.asm.wasm")) return new Response(/** @type {any} */ (parts.wasm), { headers: { "content-type": "application/wasm" } });
    if (name.endsWith("python_stdlib.zip")) return new Response(/** @type {any} */ (parts.stdlib));
    throw new TypeError("this page asks the network for nothing");
  };
  // Pyodide tries it on an empty script, which the policy forbids; as it would in a worker that is a module, it fails.
  /** @type {any} */ (self).importScripts = () => { throw new TypeError("not here"); };
  const loader = await import(script(parts.loader));
  const glue = await import(script(parts.glue));
  python = await loader.loadPyodide({
    indexURL: "https://nowhere.invalid/",
    stdLibURL: "https://nowhere.invalid/python_stdlib.zip",
    createPyodideModule: glue.default,
    lockFileContents: JSON.stringify(lock),
    packageBaseUrl: "https://nowhere.invalid/",
  });
  say({ kind: "starting", step: "the analyzer" });
  python.FS.writeFile("/tmp/packages", parts.packages);
  for (const name of names) delete parts[name];
  python.runPython(`
import os, sys, tarfile
place = next(path for path in sys.path if path.endswith("site-packages"))
with tarfile.open("/tmp/packages", "r:xz") as archive:
    archive.extractall(place, filter="data")
os.unlink("/tmp/packages")
sys.dont_write_bytecode = True
from dissect.output.browser.bridge import Bridge, markup
from dissect.cli.main import run
os.makedirs("${FOLDER}", exist_ok=True)
bridge = Bridge(run, "${FOLDER}")
`);
  bridge = python.globals.get("bridge");
  watch();
  say({ kind: "ready", version: python.runPython("from dissect import __version__; __version__") });
}

/** Tell the page how far a file was read, each time a piece of it is. */
function watch() {
  const operations = python.FS.filesystems.WORKERFS.stream_ops;
  const read = operations.read;
  operations.read = (/** @type {any} */ stream, /** @type {any} */ buffer, /** @type {number} */ offset, /** @type {number} */ length, /** @type {number} */ position) => {
    const count = read(stream, buffer, offset, length, position);
    const now = performance.now();
    const file = held.get(stream.node.name);
    if (file && running && now - told > OFTEN) {
      told = now;
      say({ kind: "progress", id: running, octets: file.before + position + count });
    }
    return count;
  };
}

/** Mount the files that were chosen. @param {{name: string, data: Blob}[]} files */
function mount(files) {
  const fs = python.FS;
  if (held.size) {
    for (const name of held.keys()) fs.unlink(`${FOLDER}/${name}`);
    fs.unmount(MOUNTED);
  } else if (!fs.analyzePath(MOUNTED).exists) fs.mkdir(MOUNTED);
  held.clear();
  let before = 0;
  if (!files.length) return;
  fs.mount(fs.filesystems.WORKERFS, { blobs: files }, MOUNTED);
  for (const { name, data } of files) {
    fs.symlink(`${MOUNTED}/${name}`, `${FOLDER}/${name}`);
    held.set(name, { size: data.size, before });
    before += data.size;
  }
}

/** Run a command line. @param {number} id @param {string[]} argv @param {string[]} read the files that count for progress */
function run(id, argv, read) {
  const began = performance.now();
  let before = 0;
  for (const name of read) {
    const file = held.get(name);
    if (file) {
      file.before = before;
      before += file.size;
    }
  }
  running = id;
  told = 0;
  /** @type {Blob[]} */
  const pieces = [];
  /** Where every hundredth line begins. */
  const marks = [0];
  let lines = 0;
  let size = 0;
  const take = (/** @type {any} */ piece) => {
    const octets = piece.getBuffer("u8");
    for (let at = octets.data.indexOf(10); at >= 0; at = octets.data.indexOf(10, at + 1)) {
      lines += 1;
      if (lines % LINES === 0) marks.push(size + at + 1);
    }
    size += octets.data.length;
    pieces.push(new Blob([octets.data]));
    octets.release();
  };
  const list = python.toPy(argv);
  const ended = bridge.run(list, take);
  const [code, errors] = ended.toJs();
  ended.destroy();
  list.destroy();
  const written = bridge.written();
  const files = written.toJs().map((/** @type {string} */ name) => {
    const path = `${FOLDER}/${name}`;
    const data = new Blob([python.FS.readFile(path)]);
    python.FS.unlink(path);
    return { name, data };
  });
  written.destroy();
  running = 0;
  say({ kind: "done", id, code, errors, out: new Blob(pieces), lines, marks, files, ms: performance.now() - began, memory: python._module.HEAP8.length });
}

/** @param {any} message */
async function take(message) {
  try {
    if (message.kind === "start") await start(message.pieces, message.lock);
    else if (message.kind === "mount") mount(message.files);
    else if (message.kind === "run") run(message.id, message.argv, message.read);
    else if (message.kind === "markup") {
      const markup = python.globals.get("markup");
      say({ kind: "markup", id: message.id, html: markup(message.text) });
      markup.destroy();
    }
  } catch (error) {
    say({ kind: "fatal", id: message.id || 0, text: String((error && /** @type {any} */ (error).message) || error) });
  }
}

/** One after the other: what was asked before Python was ready waits for it. */
let last = Promise.resolve();
self.onmessage = (event) => {
  last = last.then(() => take(event.data));
};
