// @ts-check
// What every view uses: elements, words, and the worker with its queue of command lines.

/**
 * @typedef {{name: string, file: Blob, role: string, used: boolean}} Held
 * @typedef {{code: number, errors: string, out: Blob, lines: number, marks: number[], files: {name: string, data: Blob}[], ms: number, memory: number}} Result
 */

/** Make an element; a function among the properties listens, everything else is an attribute or text.
 * @param {string} tag @param {Record<string, any>} [properties] @param {...(Node|string|null|false)} children @returns {any} */
function h(tag, properties = {}, ...children) {
  const one = document.createElement(tag);
  for (const [name, value] of Object.entries(properties)) {
    if (typeof value === "function") one.addEventListener(name, value);
    else if (value === true) one.setAttribute(name, "");
    else if (value !== false && value !== null && value !== undefined) one.setAttribute(name, String(value));
  }
  for (const child of children) if (child !== null && child !== false) one.append(child);
  return one;
}

/** @param {number} octets */
function bytesText(octets) {
  if (octets < 1e3) return `${octets} bytes`;
  const [size, unit] = octets < 1e6 ? [octets / 1e3, "KB"] : octets < 1e9 ? [octets / 1e6, "MB"] : [octets / 1e9, "GB"];
  return `${size < 10 ? size.toFixed(1) : Math.round(size)} ${unit}`;
}

/** @param {string} time as JSON has it */
function timeText(time) {
  return time.replace(/^\d{4}-\d\d-\d\dT/, "").replace(/(\.\d{6})\d*Z$/, "$1");
}

/** Write a word so that a shell takes it as it is. @param {string} word */
function quoted(word) {
  return /^[\w@%+=:,.\/-]+$/.test(word) ? word : `'${word.replaceAll("'", "'\\''")}'`;
}

/** A name that no command takes for an option, a pattern or another machine. @param {string} name */
function asFile(name) {
  return name.startsWith("-") ? `./${name}` : name;
}

/** Hand a file to the person. @param {string} name @param {Blob} data */
function save(name, data) {
  const address = URL.createObjectURL(data);
  const link = h("a", { href: address, download: name });
  document.body.append(link);
  link.click();
  link.remove();
  setTimeout(() => URL.revokeObjectURL(address), 60000);
}

/** The command that gives the same, with a button that copies it. @param {string[]} argv */
function commandLine(argv) {
  const text = ["s7dissect", ...argv.map(quoted)].join(" ");
  const button = h("button", { type: "button", class: "small", click: () => copied(text, button) }, "Copy");
  return h("p", { class: "command" }, h("span", { class: "quiet" }, "The same on a command line: "), h("code", {}, text), " ", button);
}

/** @param {string} text @param {HTMLElement} button */
async function copied(text, button) {
  try {
    await navigator.clipboard.writeText(text);
    button.textContent = "Copied";
  } catch {
    const code = button.parentElement?.querySelector("code");
    if (code) getSelection()?.selectAllChildren(code);
    button.textContent = "Selected: copy it with Ctrl+C";
  }
}

/** What a command wrote to standard error, without what the page does better. @param {Result} result */
function complaints(result) {
  const lines = result.errors.split("\n").filter((line) => line && !/^(Usage: |Try '|s7dissect: \d+ acts? written to acts\.csv$)/.test(line));
  if (!lines.length) return null;
  const bad = result.code === 2 || result.code > 3;
  return h("div", { class: bad ? "told error" : "told", role: bad ? "alert" : "status" }, ...lines.map((line) => h("p", {}, line.replace(/^s7dissect: /, ""))));
}

/** The file in pages of a hundred lines, read only where somebody looks. */
class Lines {
  /** @param {Result} result */
  constructor(result) {
    this.result = result;
    this.count = result.lines;
    this.pages = Math.max(1, Math.ceil(this.count / 100));
  }

  /** @param {number} page @returns {Promise<string[]>} */
  async page(page) {
    const { marks, out } = this.result;
    const text = await out.slice(marks[page], marks[page + 1] ?? out.size).text();
    const lines = text.split("\n");
    if (lines[lines.length - 1] === "") lines.pop();
    return lines;
  }
}

/** The worker: one at a time works, the others wait. */
class Engine {
  /** @param {(message: any) => void} tell */
  constructor(tell) {
    this.tell = tell;
    /** @type {Record<string, Blob>} */
    this.pieces = {};
    for (const element of document.querySelectorAll("script[id^=piece-]")) {
      this.pieces[element.id.slice(6)] = new Blob([element.textContent || ""]);
      element.remove();
    }
    this.lock = JSON.parse(document.getElementById("lock")?.textContent || "{}");
    const source = document.getElementById("worker")?.textContent || "";
    this.source = URL.createObjectURL(new Blob([source], { type: "text/javascript" }));
    /** @type {Held[]} */
    this.files = [];
    /** @type {Map<number, {resolve: (result: any) => void, reject: (error: Error) => void}>} */
    this.waiting = new Map();
    /** @type {Map<string, Promise<Result>>} */
    this.known = new Map();
    this.number = 0;
    this.start();
  }

  start() {
    this.worker = new Worker(this.source);
    this.worker.onmessage = (event) => this.take(event.data);
    this.worker.onerror = (event) => this.tell({ kind: "fatal", id: 0, text: event.message || "the worker did not start" });
    this.worker.postMessage({ kind: "start", pieces: this.pieces, lock: this.lock });
    this.mount();
  }

  /** @param {any} message */
  take(message) {
    const waits = this.waiting.get(message.id);
    if (message.kind === "done" || message.kind === "markup") waits?.resolve(message);
    else if (message.kind === "fatal") waits?.reject(new Error(message.text));
    if (message.kind !== "progress" && waits) this.waiting.delete(message.id);
    this.tell(message);
  }

  mount() {
    const files = this.files.map(({ name, file }) => ({ name, data: file }));
    this.worker?.postMessage({ kind: "mount", files });
  }

  /** @param {Held[]} files */
  hold(files) {
    this.files = files;
    this.known.clear();
    if (this.waiting.size) this.cancel();
    else this.mount();
  }

  /** @param {object} message @returns {Promise<any>} */
  ask(message) {
    this.number += 1;
    const id = this.number;
    return new Promise((resolve, reject) => {
      this.waiting.set(id, { resolve, reject });
      this.worker?.postMessage({ ...message, id });
      this.tell({ kind: "asked", id });
    });
  }

  /** Run a command line; the same one is run once. @param {string[]} argv @returns {Promise<Result>} */
  run(argv) {
    const key = JSON.stringify(argv);
    let result = this.known.get(key);
    if (!result) {
      const read = this.files.filter(({ name, role }) => role === "capture" && argv.includes(asFile(name))).map(({ name }) => name);
      result = this.ask({ kind: "run", argv, read });
      this.known.set(key, result);
      result.catch(() => this.known.delete(key));
    }
    return result;
  }

  /** @param {string} text @returns {Promise<string>} */
  async markup(text) {
    return (await this.ask({ kind: "markup", text })).html;
  }

  /** Break off what goes on: the worker is ended, and a new one started. */
  cancel() {
    this.worker?.terminate();
    for (const { reject } of this.waiting.values()) reject(new Error("cancelled"));
    this.waiting.clear();
    this.known.clear();
    this.tell({ kind: "cancelled" });
    this.start();
  }
}
