// @ts-check
// The page: files, tabs, and what each tab shows.

/** What the page takes before a capture, what a byte of captures may add at most (rows that are kept), and where it refuses. */
const MEMORY = { base: 300e6, factor: 3.2, most: 2e9 };

/** A plot is drawn of so many pages of values. */
const MOST_PAGES = 2000;

/** @typedef {{plc: string, address: string}} Variable */

/** @type {Held[]} */
let held = [];
let together = true;
let ready = false;
let where = "";
let row = "";
let tab = "files";
let began = 0;

const at = (/** @type {string} */ id) => /** @type {any} */ (document.getElementById(id));
const engine = new Engine(heard);
/** @type {Desk} */
const desk = { engine, files: () => held, where: () => where, row: () => row, setRow: (chosen) => { row = chosen; writeHash(); }, again: () => draw() };

/** @type {[string, string, (place: HTMLElement) => any][]} */
const TABS = [
  ["files", "Files", filesTab],
  ["report", "Report", reportTab],
  ["findings", "Findings", findingsTab],
  ["transactions", "Transactions", transactionsTab],
  ["values", "Values", valuesTab],
  ["operations", "Operations", (place) => operationsTab(place)],
  ["acts", "Acts", (place) => actsView(desk, place)],
  ["devices", "Devices", (place) => devicesView(desk, place)],
  ["blocks", "Blocks", blocksTab],
  ["save", "Save as …", saveTab],
  ["command", "Command", commandTab],
  ["help", "Help", helpTab],
];

// ---- the worker ------------------------------------------------------------------------------------------------------------

/** @param {any} message */
function heard(message) {
  if (message.kind === "starting") at("state").textContent = `starting ${message.step} …`;
  else if (message.kind === "ready") {
    ready = true;
    document.documentElement.dataset.ready = "yes";
    idle();
  } else if (message.kind === "asked") busy(0);
  else if (message.kind === "progress") busy(message.octets);
  else if (message.kind === "cancelled") { ready = false; document.documentElement.dataset.ready = "no"; at("work").hidden = true; at("state").textContent = "starting again …"; }
  else if (message.kind === "fatal" && !message.id) { at("state").textContent = `This browser cannot run it: ${message.text}`; at("work").hidden = true; }
  else if (message.memory) at("state").dataset.memory = message.memory;
  if (message.id && ["done", "markup", "fatal"].includes(message.kind) && !engine.waiting.size) idle();
}

function idle() {
  at("work").hidden = true;
  began = 0;
  const captures = held.filter(({ role, used }) => role === "capture" && used);
  const memory = Number(at("state").dataset.memory || 0);
  at("state").textContent = `${captures.length ? captures.map(({ name }) => name).join(", ") : "ready: choose a capture"}${memory ? ` · ${bytesText(memory)} of memory` : ""}`;
}

/** @param {number} octets */
function busy(octets) {
  if (!ready) return;
  began = began || performance.now();
  const total = held.filter(({ role, used }) => role === "capture" && used).reduce((sum, { file }) => sum + file.size, 0);
  const part = total ? Math.min(1, octets / total) : 0;
  at("work").hidden = false;
  if (part) at("bar").value = part;
  else at("bar").removeAttribute("value");
  const left = part > 0.02 ? ((performance.now() - began) / part) * (1 - part) : 0;
  at("bar-text").textContent = part ? `${bytesText(octets)} of ${bytesText(total)}${left > 1500 ? `, about ${Math.ceil(left / 1000)} s left` : ""}` : "working …";
}

// ---- files -----------------------------------------------------------------------------------------------------------------

/** What a file is, by its first bytes and its name. @param {File} file */
async function roleOf(file) {
  const head = new Uint8Array(await file.slice(0, 4096).arrayBuffer());
  const magic = [...head.slice(0, 4)].map((one) => one.toString(16).padStart(2, "0")).join("");
  if (/^(a1b2|d4c3b2a1|4d3cb2a1|0a0d0d0a|1f8b|28b52ffd)/.test(magic) || /\.(pcap|pcapng|cap)(\.gz|\.zst)?$/i.test(file.name)) return "capture";
  const text = new TextDecoder().decode(head);
  if (/^(CLIENT_RANDOM|CLIENT_HANDSHAKE|SERVER_HANDSHAKE|CLIENT_TRAFFIC|EXPORTER_SECRET|# ?SSL)/m.test(text)) return "keys";
  if (/\.toml$/i.test(file.name)) return /^\s*\[\[?(binding|bind)/m.test(text) || /bind/i.test(file.name) ? "bind" : "scd";
  if (/\.(eds|xdd|xdc|scdb?)$/i.test(file.name)) return "scd";
  return /\.(xlsx|xml|sdf|asc|seq|csv|tsv|txt|awl|scl|db|udt)$/i.test(file.name) ? "tags" : "none";
}

/** A name of its own for each file, that a path can have. @param {string} name */
function freeName(name) {
  let free = name.replace(/[\/\0]/g, "_");
  if (free === "." || free === ".." || !free) free = "_";
  for (let number = 2; held.some((one) => one.name === free); number += 1) free = name.replace(/[\/\0]/g, "_").replace(/(\.[^.]*)?$/, ` (${number})$1`);
  return free;
}

/** @param {Iterable<File>} files */
async function add(files) {
  for (const file of files) {
    const role = await roleOf(file);
    const used = role !== "capture" || together || !held.some((one) => one.role === "capture" && one.used);
    held.push({ name: freeName(file.name), file, role, used });
  }
  changed();
  if (tab !== "files" || location.hash.length < 2) return;
  const wanted = readHash();
  if (wanted.tab !== "files") select(wanted.tab, wanted.row, wanted.where);
}

function changed() {
  document.documentElement.dataset.files = String(held.length);
  engine.hold(held);
  if (ready) idle();
  draw();
}

function needed() {
  const size = held.filter(({ role, used }) => role === "capture" && used).reduce((sum, { name, file }) => sum + file.size * (/\.(gz|zst)$/i.test(name) ? 6 : 1), 0);
  return { size, memory: MEMORY.base + size * MEMORY.factor };
}

/** @param {HTMLElement} place */
function filesTab(place) {
  const input = h("input", { type: "file", id: "choose", multiple: true, change: () => { add([...input.files]); input.value = ""; } });
  const drop = h("div", { class: "drop", id: "drop" }, h("p", {}, h("strong", {}, "Drop captures here"), ", or choose them:"), input,
    h("p", { class: "quiet" }, "pcap, pcapng, plain or in gzip. Tag files, an SCD dictionary and its bindings may be dropped beside them."));
  place.append(h("p", {}, "The analyzer for Siemens S7 communication in one page. Nothing is installed, nothing is sent: captures stay on this machine."), drop);
  if (!held.length) return;
  const several = held.filter(({ role }) => role === "capture").length > 1;
  const rows = held.map((one) => h("tr", {},
    h("td", {}, h("input", { type: "checkbox", "aria-label": `Use ${one.name}`, ...(one.used ? { checked: true } : {}), change: (/** @type {any} */ event) => use(one, event.target.checked) })),
    h("td", {}, one.name), h("td", { class: "figure" }, bytesText(one.file.size)),
    h("td", {}, h("select", { "aria-label": `What ${one.name} is`, change: (/** @type {any} */ event) => { one.role = event.target.value; changed(); } }, ...Object.entries(ROLES).map(([role, { title }]) => h("option", { value: role, ...(role === one.role ? { selected: true } : {}) }, title)))),
    h("td", {}, h("button", { type: "button", click: () => { held = held.filter((other) => other !== one); changed(); } }, "Remove"))));
  place.append(h("div", { class: "scroll" }, h("table", { class: "files" }, h("thead", {}, h("tr", {}, ...["Use", "File", "Size", "What it is", ""].map((head) => h("th", { scope: "col" }, head)))), h("tbody", {}, ...rows))));
  if (several) place.append(h("p", {}, h("label", {}, h("input", { type: "checkbox", ...(together ? { checked: true } : {}), change: (/** @type {any} */ event) => { together = event.target.checked; use(held[0], true); } }), " Read all captures as one; otherwise one at a time")));
  if (held.some(({ role, used }) => role === "keys" && used)) place.append(h("p", { class: "told error", role: "alert" }, "Session keys need the package cryptography, which is compiled: use the installed s7dissect to decrypt TLS."));
  const { size, memory } = needed();
  if (memory > MEMORY.most) place.append(h("p", { class: "told error", role: "alert" }, `${bytesText(size)} of captures would need up to ${bytesText(memory)} of memory, more than a page may take: choose fewer, or cut a part with the installed s7dissect (s7dissect cut --time …).`));
  else if (size) place.append(h("p", { class: "quiet", id: "memory" }, `Reading ${bytesText(size)} takes up to ${bytesText(memory)} of memory.`), h("p", {}, h("button", { type: "button", class: "main", id: "go", click: () => select("report") }, "Analyze")));
}

/** @param {Held} one @param {boolean} used */
function use(one, used) {
  one.used = used;
  if (!together && one.role === "capture" && used) for (const other of held) if (other.role === "capture") other.used = other === one;
  changed();
}

// ---- tabs ------------------------------------------------------------------------------------------------------------------

/** @param {HTMLElement} place */
function reportTab(place) {
  return shown(place, desk, argvOf(desk, "report", ["-o", "-"]), (result) => {
    if (!result.out.size) return null;
    // It has no origin and cannot reach this page.
    const frame = h("iframe", { title: "Report", class: "report", sandbox: "allow-scripts allow-downloads", src: URL.createObjectURL(new Blob([result.out], { type: "text/html" })) });
    return h("div", {}, h("p", {}, h("button", { type: "button", click: () => save("report.html", new Blob([result.out], { type: "text/html" })) }, "Save the report")), frame);
  });
}

/** @param {HTMLElement} place */
function findingsTab(place) {
  return shown(place, desk, argvOf(desk, "analyze", ["-T", "json"]), async (result) => {
    if (!result.out.size) return null;
    const told = JSON.parse(await result.out.text());
    const packets = h("div", { class: "detail", tabindex: "-1" });
    const slugs = Object.keys(told.finding_facts);
    const about = (/** @type {string} */ slug) => told.finding_details.filter((/** @type {any} */ one) => one.slug === slug);
    const grave = (/** @type {string} */ slug) => ["error", "warning", "note"].indexOf(about(slug)[0]?.severity ?? "note");
    const list = slugs.map((slug) => {
      const facts = told.finding_facts[slug];
      const details = about(slug);
      const one = details[0] || { severity: "note", sentence: slug, advice: "" };
      const shownRows = details.slice(0, 20).map((/** @type {any} */ detail) => h("li", {}, detail.detail || detail.sentence, " ", detail.frames.length > 0 && h("button", { type: "button", class: "small", click: () => { showPackets(desk, packets, detail.frames.map(String)); packets.scrollIntoView(); } }, `packet ${detail.frames.join(", ")}`)));
      return h("details", { class: "finding", ...(grave(slug) === 0 ? { open: true } : {}) }, h("summary", {}, h("span", { class: `badge ${one.severity}` }, one.severity), ` ${one.sentence} `, h("span", { class: "quiet" }, `${slug}, ${integer(facts.events)} ×`)),
        one.advice && h("p", {}, one.advice), h("p", { class: "quiet" }, `First ${timeText(facts.first_time ?? "")} (packet ${facts.first_frame}), last ${timeText(facts.last_time ?? "")} (packet ${facts.last_frame}), ${facts.pairs.map((/** @type {any} */ pair) => `${pair.client} → ${pair.server}`).slice(0, 8).join("; ")}`),
        h("ul", {}, ...shownRows), details.length > 20 && h("p", { class: "quiet" }, `and ${counted(details.length - 20, "more detail")}`));
    });
    return h("div", {}, ...(list.length ? list : [h("p", {}, "No findings.")]), packets);
  });
}

/** @param {HTMLElement} place */
function transactionsTab(place) {
  const options = place.dataset.options ? place.dataset.options.split(" ") : [];
  const rows = h("div", {});
  const failed = h("input", { type: "checkbox", change: () => rowsView(desk, rows, "transactions", failed.checked ? ["--failed"] : []) });
  place.append(whereField(desk, (text) => select("transactions", "", text)), h("p", {}, h("label", {}, failed, " Only failed ones")), rows);
  return rowsView(desk, rows, "transactions", options);
}

/** @param {HTMLElement} place */
function operationsTab(place) {
  const rows = h("div", {});
  const kind = h("select", { id: "kind", change: () => rowsView(desk, rows, "operations", kind.value ? ["--kind", kind.value] : []) }, h("option", { value: "" }, "all"), ...KINDS.map((one) => h("option", {}, one)));
  place.append(whereField(desk, (text) => select("operations", "", text)), h("p", {}, h("label", {}, "Kind ", kind)), rows);
  return rowsView(desk, rows, "operations", []);
}

/** @param {HTMLElement} place */
function valuesTab(place) {
  /** @type {Map<string, Variable>} */
  const chosen = new Map();
  const list = h("div", {});
  const drawn = h("div", {});
  place.append(whereField(desk, (text) => select("values", "", text)), list, drawn);
  const heads = ["", "PLC", "Address", "Tag", "Type", "Values", "Changes", "Least", "Greatest", "Last"];
  return shown(list, desk, argvOf(desk, "values", ["--summary", "-T", "jsonl"]), async (result) => {
    const lines = new Lines(result);
    if (!lines.count) return h("p", {}, "No values.");
    const table = await rowsTable(lines, heads.slice(1), (line) => {
      const one = JSON.parse(line);
      return [one.vlan.length ? `${one.plc} VLAN ${one.vlan.join(", ")}` : one.plc, one.address, one.tag ?? "", one.type ?? "", one.count, one.changes, one.min ?? "", one.max ?? "", one.last ?? ""].map((cell) => (typeof cell === "object" ? JSON.stringify(cell) : String(cell)));
    }, (cells) => {
      const [plc, address] = [cells[0].replace(/ VLAN .*$/, ""), cells[1]];
      const name = `${plc} ${address}`;
      if (!chosen.delete(name)) chosen.set(name, { plc, address });
      return drawValues(drawn, [...chosen.values()].slice(0, 6));
    }, 0, true);
    return h("div", {}, h("p", { class: "quiet" }, "Choose up to six variables to plot them and to list their values."), table.root);
  });
}

/** @param {HTMLElement} place @param {Variable[]} variables */
function drawValues(place, variables) {
  if (!variables.length) { place.replaceChildren(); return Promise.resolve(); }
  const argv = [...argvOf(desk, "values", ["-T", "jsonl"]), ...new Set(variables.map(({ address }) => address))];
  return shown(place, desk, argv, async (result) => {
    const lines = new Lines(result);
    /** @type {any[]} */
    const rows = [];
    for (let page = 0; page < Math.min(lines.pages, MOST_PAGES); page += 1) for (const line of await lines.page(page)) rows.push(JSON.parse(line));
    const first = rows[0]?.time;
    if (!first) return h("p", {}, "No values.");
    const span = after(rows[rows.length - 1].time, first);
    const severalPlcs = new Set(rows.map(({ plc }) => plc)).size > 1;
    const plots = variables.map(({ plc, address }) => stepPlot(severalPlcs ? `${plc} ${address}` : address, rows.filter((one) => one.plc === plc && one.address === address), first, span));
    const left = rows.length < lines.count && h("p", { class: "told", role: "status" }, `The plots show the first ${counted(rows.length, "value")} of ${integer(lines.count)}; an expression above selects others.`);
    const heads = ["Time", "Packet", "PLC", "How", "Address", "Type", "Value", "Before"];
    const table = await rowsTable(lines, heads, (line) => {
      const one = JSON.parse(line);
      return [timeText(one.time), one.frame, one.plc, one.how, one.address, one.type ?? "", one.value_text ?? JSON.stringify(one.value), one.previous === null ? "" : JSON.stringify(one.previous)].map(String);
    });
    return h("div", {}, left, h("div", { class: "plots" }, ...plots), table.root);
  });
}

/** @param {HTMLElement} place */
function blocksTab(place) {
  const body = h("div", {});
  const list = (/** @type {string[]} */ options) => shown(body, desk, argvOf(desk, "blocks", options), async (result) => (result.out.size ? h("pre", { class: options.includes("--code") ? "" : "wrapped" }, await result.out.text()) : null));
  /** @type {[string, string[]][]} */
  const choice = [["Code (STL)", ["--code", "STL"]], ["Code (AWL)", ["--code", "AWL"]], ["References", ["--references"]], ["What changed", ["--diff"]]];
  const table = () => blocksView(desk, body);
  place.append(h("p", { class: "choice" }, h("button", { type: "button", click: table }, "List"), ...choice.map(([title, options]) => h("button", { type: "button", click: () => list(options) }, title))), h("p", { class: "quiet" }, "“What changed” compares the first version of each block with the latest; with two captures, the first capture with the second."), body);
  return table();
}

/** @param {HTMLElement} place */
function saveTab(place) {
  const one = held.filter(({ role, used }) => role === "capture" && used);
  const stem = (one[0]?.name ?? "capture").replace(/\.(pcap|pcapng|cap)(\.gz|\.zst)?$/i, "");
  /** @type {[string, string, string, string[]][]} */
  const rows = [
    ["Report", `${stem}.html`, "report", ["-o", "-"]],
    ["Summary as text", `${stem}.txt`, "analyze", []],
    ["Summary as JSON", `${stem}.json`, "analyze", ["-T", "json"]],
    ["Transactions as CSV", `${stem}.csv`, "transactions", ["-T", "csv"]],
    ["Transactions as JSON lines", `${stem}.jsonl`, "transactions", ["-T", "jsonl"]],
    ["Values as CSV", `${stem}-values.csv`, "values", ["-T", "csv"]],
    ["Operations as JSON lines", `${stem}-operations.jsonl`, "operations", ["-T", "jsonl"]],
    ["Devices as CSV", `${stem}-devices.csv`, "devices", ["-T", "csv"]],
    ["Blocks as JSON", `${stem}-blocks.json`, "blocks", ["-T", "json"]],
    ["Golden", `${stem}.s7.txt`, "golden", []],
    ["Part of the capture, findings as comments", `${stem}-part.pcapng`, "cut", ["-o"]],
    ["Anonymized capture", `${stem}-anonymized.pcapng`, "anonymize", ["-o"]],
  ];
  const told = h("div", {});
  place.append(whereField(desk, (text) => select("save", "", text)), told, h("div", { class: "scroll" }, h("table", {}, h("tbody", {}, ...rows.map(([title, name, command, options]) => {
    const argv = argvOf(desk, command, options[0] === "-o" && command !== "report" ? ["-o", asFile(name), "--force"] : options);
    const button = h("button", { type: "button", click: () => keep(told, argv, name) }, "Save");
    return h("tr", {}, h("td", {}, title), h("td", { class: "short" }, button), h("td", { class: "text" }, commandLine(argv)));
  })))));
}

/** @param {HTMLElement} told @param {string[]} argv @param {string} name */
async function keep(told, argv, name) {
  told.replaceChildren(h("p", { class: "quiet" }, "reading …"));
  try {
    const result = await engine.run(argv);
    const data = result.files[0]?.data ?? result.out;
    told.replaceChildren(...[complaints(result)].filter(Boolean));
    if (data.size) save(name, data);
  } catch (error) {
    told.replaceChildren(h("p", { role: "alert" }, `Not saved: ${/** @type {Error} */ (error).message}`));
  }
}

/** @param {HTMLElement} place */
function commandTab(place) {
  const input = h("input", { type: "text", id: "typed", spellcheck: "false", autocomplete: "off", value: "analyze --help" });
  const out = h("div", {});
  const run = (/** @type {Event} */ event) => {
    event.preventDefault();
    const argv = words(input.value.replace(/^\s*s7dissect\s+/, ""));
    return shown(out, desk, argv, async (result) => {
      const text = result.out.size > 2e6 ? `${await result.out.slice(0, 2e6).text()}\n… ` : await result.out.text();
      return h("div", {}, result.out.size > 0 && h("p", {}, h("button", { type: "button", click: () => save("output.txt", result.out) }, `Save the output, ${bytesText(result.out.size)}`)), ...result.files.map((file) => h("p", {}, h("button", { type: "button", click: () => save(file.name, file.data) }, `Save ${file.name}`))), h("pre", {}, text), h("p", { class: "quiet" }, `exit code ${result.code}, ${(result.ms / 1000).toFixed(2)} s`));
    });
  };
  place.append(h("form", { class: "where", submit: run }, h("label", { for: "typed" }, "s7dissect"), input, h("button", { type: "submit" }, "Run")), h("p", { class: "quiet" }, "Any command that needs no network and no other program, over the files that were chosen."), out);
}

/** Words as a shell would have them. @param {string} text */
function words(text) {
  const found = text.match(/(?:[^\s'"]|'[^']*'|"(?:\\.|[^"\\])*")+/g) || [];
  return found.map((word) => word.replace(/'([^']*)'|"((?:\\.|[^"\\])*)"/g, (_, single, double) => single ?? double.replace(/\\(.)/g, "$1")));
}

/** @param {HTMLElement} place */
async function helpTab(place) {
  const body = h("article", { class: "manual" });
  const show = async (/** @type {string} */ topic) => {
    const result = await engine.run(["help", topic]);
    // The manual is ours; markup in it was made text before, so the parser finds only what Markdown means.
    const made = new DOMParser().parseFromString(await engine.markup(await result.out.text()), "text/html");
    body.replaceChildren(commandLine(["help", topic]), ...made.body.childNodes);
    for (const link of body.querySelectorAll("a[href]")) if (!link.getAttribute("href")?.startsWith("#")) link.replaceWith(...link.childNodes);
  };
  const list = await engine.run(["help"]);
  const topics = (await list.out.text()).split("Topics of s7dissect help:")[1] ?? "";
  const select = h("select", { "aria-label": "Topic", change: () => show(select.value) });
  let group = select;
  for (const line of topics.split("\n")) {
    const found = /^ {2}(\S+) +(.*)$/.exec(line);
    if (found) group.append(h("option", { value: found[1] }, `${found[1]}: ${found[2]}`));
    else if (line.trim()) select.append((group = h("optgroup", { label: line.replace(/:$/, "") })));
  }
  place.append(h("p", {}, select), body);
  await show(select.value);
}

// ---- where we are ----------------------------------------------------------------------------------------------------------

function readHash() {
  const [path, text] = location.hash.slice(1).split("?");
  const [name, number] = path.split("/");
  let decoded = "";
  try { decoded = decodeURIComponent(text ?? ""); } catch { decoded = ""; }
  return { tab: TABS.some(([id]) => id === name) ? name : "files", row: /^\d+$/.test(number ?? "") ? number : "", where: decoded };
}

function writeHash() {
  const text = `#${tab}${row ? `/${row}` : ""}${where ? `?${encodeURIComponent(where)}` : ""}`;
  if (location.hash !== text) history.replaceState(null, "", text);
}

/** @param {string} name @param {string} [chosen] @param {string} [expression] */
function select(name, chosen = "", expression = where) {
  [tab, row, where] = [name, chosen, expression];
  const text = `#${tab}${row ? `/${row}` : ""}${where ? `?${encodeURIComponent(where)}` : ""}`;
  if (location.hash !== text) history.pushState(null, "", text);
  draw();
}

function draw() {
  const hasCapture = held.some(({ role, used }) => role === "capture" && used) && needed().memory <= MEMORY.most;
  const free = ["files", "command", "help"];
  for (const button of at("tabs").querySelectorAll("button")) {
    const id = button.dataset.tab;
    button.setAttribute("aria-selected", String(id === tab));
    button.tabIndex = id === tab ? 0 : -1;
    button.disabled = !hasCapture && !free.includes(id);
  }
  const [, title, show] = TABS.find(([id]) => id === tab && (hasCapture || free.includes(id))) ?? TABS[0];
  const panel = h("section", { role: "tabpanel", "aria-label": title, id: "panel" });
  at("main").replaceChildren(panel);
  Promise.resolve(show(panel)).catch((error) => panel.append(h("p", { role: "alert" }, error.message))).finally(() => { panel.dataset.drawn = "yes"; });
}

function begin() {
  for (const [id, title] of TABS) at("tabs").append(h("li", { role: "presentation" }, h("button", { type: "button", role: "tab", "data-tab": id, click: () => select(id) }, title)));
  at("tabs").addEventListener("keydown", (/** @type {KeyboardEvent} */ event) => {
    const step = { ArrowRight: 1, ArrowLeft: -1 }[event.key];
    const usable = [...at("tabs").querySelectorAll("button:not(:disabled)")];
    if (!step) return;
    const next = usable[(usable.indexOf(document.activeElement) + step + usable.length) % usable.length];
    next.focus();
    next.click();
  });
  at("cancel").addEventListener("click", () => { engine.cancel(); select("files"); });
  addEventListener("dragover", (event) => { event.preventDefault(); document.body.classList.add("over"); });
  addEventListener("dragleave", () => document.body.classList.remove("over"));
  addEventListener("drop", (event) => { event.preventDefault(); document.body.classList.remove("over"); add([...(event.dataTransfer?.files ?? [])]); });
  addEventListener("popstate", () => { const wanted = readHash(); [tab, row, where] = [wanted.tab, wanted.row, wanted.where]; draw(); });
  draw();
}

begin();
