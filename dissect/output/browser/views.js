// @ts-check
// The views: each is a command of s7dissect, and the page of what it says.

/** What each kind of file is to a command. */
const ROLES = {
  capture: { title: "capture", option: "" },
  tags: { title: "tags", option: "--tags" },
  scd: { title: "SCD dictionary", option: "--scd" },
  bind: { title: "SCD bindings", option: "--bind" },
  keys: { title: "TLS keys", option: "--tls-keys" },
  none: { title: "not used", option: "" },
};

/** Which of these options a command takes. @type {Record<string, string[]>} */
const TAKES = {
  report: ["--tags", "--scd", "--bind", "-Y"],
  analyze: ["--tags", "--scd", "--bind", "-Y"],
  transactions: ["--tags", "--scd", "--bind", "-Y"],
  values: ["--tags", "--scd", "--bind", "-Y"],
  show: ["--tags", "--scd", "--bind", "-Y"],
  operations: ["--tags", "-Y"],
  devices: ["--tags", "-Y"],
  blocks: ["--tags", "-Y"],
  export: ["--tags", "--scd", "--bind", "-Y"],
  golden: ["--tags", "--scd", "--bind", "-Y"],
  cut: ["--tags", "--scd", "--bind", "-Y"],
  anonymize: ["--scd", "--bind"],
};

const COLUMNS = {
  transactions: [["number", "No."], ["time", "Time"], ["request_frame", "Packet"], ["response_frame", "Answer"], ["asked_by", "Asked by"], ["answered_by", "Answered by"], ["latency", "Latency"], ["function", "Function"], ["subject", "Items, values, reasons"], ["outcome", "Outcome"], ["error", "Errors"]],
  operations: [["number", "No."], ["time", "Began"], ["first_frame", "Packet"], ["last_frame", "to"], ["client", "Client"], ["server", "Server"], ["kind", "Kind"], ["subject", "What"], ["duration", "Duration"], ["result", "Result"], ["octets", "Bytes"]],
};
const KINDS = ["connect", "download", "upload", "long_answer", "bsend", "cyclic", "messages", "test_job", "password", "session", "delete", "control", "polling", "transfer"];

/** What a view needs of the page. @typedef {{engine: Engine, files: () => Held[], where: () => string, setRow: (row: string) => void, row: () => string, again: () => void}} Desk */

/** A command line over the captures at hand. @param {Desk} desk @param {string} command @param {string[]} options */
function argvOf(desk, command, options) {
  const argv = [command, ...options];
  const takes = TAKES[command];
  for (const { name, role, used } of desk.files()) {
    const option = ROLES[/** @type {keyof typeof ROLES} */ (role)].option;
    if (used && option && (takes.includes(option) || option === "--tls-keys")) argv.push(option, asFile(name));
  }
  if (desk.where() && takes.includes("-Y")) argv.push("-Y", desk.where());
  for (const { name, role, used } of desk.files()) if (used && role === "capture") argv.push(asFile(name));
  return argv;
}

/** Show what a command says once it is there. @param {HTMLElement} place @param {Desk} desk @param {string[]} argv @param {(result: Result) => any} show */
async function shown(place, desk, argv, show) {
  place.replaceChildren(commandLine(argv), h("p", { class: "quiet" }, "reading …"));
  try {
    const result = await desk.engine.run(argv);
    const body = await show(result);
    place.replaceChildren(commandLine(argv), ...[complaints(result), body].filter(Boolean));
  } catch (error) {
    place.replaceChildren(commandLine(argv), h("p", { role: "alert" }, /** @type {Error} */ (error).message === "cancelled" ? "Cancelled." : `Failed: ${/** @type {Error} */ (error).message}`), h("button", { type: "button", click: desk.again }, "Run it again"));
  }
  place.dataset.done = "yes";
}

/** The field for an expression of -Y, with the names of fields as they are typed. @param {Desk} desk @param {(where: string) => void} changed */
function whereField(desk, changed) {
  const list = h("datalist", { id: "fields" });
  const input = h("input", { type: "text", id: "where", value: desk.where(), list: "fields", spellcheck: "false", autocomplete: "off", placeholder: "host == 192.168.0.1 and latency > 20ms" });
  /** @type {Promise<string[]>|null} */
  let names = null;
  input.addEventListener("input", async () => {
    names = names || desk.engine.run(["fields"]).then(async ({ out }) => (await out.text()).split("\n").map((line) => line.split(" ")[0]).filter(Boolean));
    const [, before, word] = /** @type {RegExpExecArray} */ (/^(.*?)([\w.]*)$/s.exec(input.value));
    const near = word ? (await names).filter((name) => name.startsWith(word) && name !== word).slice(0, 12) : [];
    list.replaceChildren(...near.map((name) => h("option", { value: before + name })));
  });
  const submit = (/** @type {Event} */ event) => { event.preventDefault(); changed(input.value.trim()); };
  return h("form", { class: "where", submit }, h("label", { for: "where" }, "Only where"), input, list, h("button", { type: "submit" }, "Apply"), desk.where() && h("button", { type: "button", click: () => changed("") }, "Clear"));
}

/** Rows with pages; a row is chosen by click, Enter, arrow keys.
 * @param {Lines} lines @param {string[]} heads @param {(line: string) => string[]} cells @param {(cells: string[]) => void} [choose] @param {number} [page]
 * @param {boolean} [several] whether more than one row can be chosen */
async function rowsTable(lines, heads, cells, choose, page = 0, several = false) {
  const body = h("tbody", {});
  const told = h("span", { class: "quiet", role: "status" });
  const root = h("div", { class: "rows" });
  let at = Math.min(Math.max(page, 0), lines.pages - 1);
  const go = async (/** @type {number} */ to) => {
    at = Math.min(Math.max(to, 0), lines.pages - 1);
    const read = await lines.page(at);
    body.replaceChildren(...read.map((line, index) => row(cells(line), index === 0)));
    told.textContent = lines.count ? `rows ${integer(at * 100 + 1)} to ${integer(at * 100 + read.length)} of ${integer(lines.count)}` : "no rows";
    for (const button of pager.querySelectorAll("button")) button.disabled = button.dataset.to === "-" ? at === 0 : at === lines.pages - 1;
  };
  const row = (/** @type {string[]} */ texts, /** @type {boolean} */ first) => {
    const one = h("tr", choose ? { tabindex: first ? "0" : "-1", "data-key": texts[0] } : {}, ...texts.map((text, index) => h("td", { "data-head": heads[index], class: /^(\S{0,40}|.{0,24})$/.test(text) ? "short" : "text" }, text)));
    if (choose) {
      one.addEventListener("click", () => { focus(one); mark(one, texts); });
      one.addEventListener("keydown", (/** @type {KeyboardEvent} */ event) => key(event, one, texts));
    }
    return one;
  };
  const mark = (/** @type {HTMLElement} */ one, /** @type {string[]} */ texts) => {
    if (several) {
      one.setAttribute("aria-selected", String(one.getAttribute("aria-selected") !== "true"));
      if (choose) choose(texts);
      return;
    }
    for (const other of body.querySelectorAll("[aria-selected]")) other.removeAttribute("aria-selected");
    one.setAttribute("aria-selected", "true");
    if (choose) choose(texts);
  };
  const focus = (/** @type {Element|null} */ one) => {
    if (!(one instanceof HTMLElement)) return;
    for (const other of body.querySelectorAll("tr")) other.tabIndex = -1;
    one.tabIndex = 0;
    one.focus();
  };
  const key = async (/** @type {KeyboardEvent} */ event, /** @type {HTMLElement} */ one, /** @type {string[]} */ texts) => {
    const steps = { ArrowDown: one.nextElementSibling, ArrowUp: one.previousElementSibling, Home: body.firstElementChild, End: body.lastElementChild };
    if (event.key in steps) focus(steps[/** @type {keyof typeof steps} */ (event.key)]);
    else if (event.key === "PageDown" || event.key === "PageUp") { await go(at + (event.key === "PageDown" ? 1 : -1)); focus(body.firstElementChild); }
    else if (event.key === "Enter" || event.key === " ") mark(one, texts);
    else return;
    event.preventDefault();
  };
  const turn = (/** @type {string} */ text, /** @type {string} */ label, /** @type {string} */ way, /** @type {() => number} */ to) => h("button", { type: "button", "aria-label": label, "data-to": way, click: () => go(to()) }, text);
  const pager = h("div", { class: "pager" }, turn("|‹", "First rows", "-", () => 0), turn("‹", "Rows before", "-", () => at - 1), turn("›", "Next rows", "+", () => at + 1), turn("›|", "Last rows", "+", () => lines.pages - 1), told);
  root.append(pager, h("div", { class: "scroll", tabindex: "-1" }, h("table", {}, h("thead", {}, h("tr", {}, ...heads.map((head) => h("th", { scope: "col" }, head)))), body)));
  await go(at);
  return { root, go, focus: (/** @type {string} */ wanted) => {
    const found = [...body.querySelectorAll("tr")].find((one) => one.dataset.key === wanted);
    if (!found) return false;
    found.setAttribute("aria-selected", "true");
    focus(found);
    found.scrollIntoView({ block: "nearest" });
    return true;
  } };
}

/** A message taken apart: its fields, and its bytes, which light up for the field that is pointed at. @param {string} text of `show -V` */
function dissected(text) {
  const root = h("div", { class: "dissected" });
  for (const message of text.replace(/\n+$/, "").split(/\n(?=\S| {0,3}\S| {4,8}\d+ {2}\d{4}-)/)) root.append(oneMessage(message.split("\n")));
  return root;
}

/** @param {string[]} lines */
function oneMessage(lines) {
  const tree = h("div", { class: "tree", role: "list", "aria-label": "Fields" });
  const dump = h("div", { class: "dump", "aria-label": "Bytes" });
  const light = (/** @type {number} */ first, /** @type {number} */ end) => {
    for (const one of dump.querySelectorAll("b")) one.classList.toggle("lit", Number(one.dataset.at) >= first && Number(one.dataset.at) <= end);
  };
  for (const line of lines.slice(1)) {
    const octets = /^ +(\d+) {2}((?:[0-9a-f]{2} {1,2})+) *(.*)$/.exec(line);
    const field = /^ +(\d+)(?:-(\d+))? {2}(\S.*)$/.exec(line);
    if (octets && dump.dataset.begun) dump.append(dumpLine(Number(octets[1]), octets[2].trim().split(/ +/), octets[3]));
    else if (!line.trim()) dump.dataset.begun = "yes";
    else if (field) {
      const [first, end] = [Number(field[1]), Number(field[2] ?? field[1])];
      const show = () => light(first, end);
      tree.append(h("div", { class: "field", role: "listitem", tabindex: "-1", pointerenter: show, focus: show, click: show }, h("span", { class: "range" }, field[2] ? `${first}–${end}` : String(first)), h("span", {}, field[3])));
    } else tree.append(h("div", { class: "part", role: "listitem" }, line.trim()));
  }
  tree.addEventListener("keydown", (/** @type {KeyboardEvent} */ event) => {
    const fields = [...tree.querySelectorAll(".field")];
    const step = { ArrowDown: 1, ArrowUp: -1 }[event.key];
    const next = step && fields[fields.indexOf(/** @type {any} */ (document.activeElement)) + step];
    if (next) { next.focus(); event.preventDefault(); }
  });
  const first = tree.querySelector(".field");
  if (first) first.tabIndex = 0;
  return h("section", {}, h("h3", {}, lines[0].trim()), h("div", { class: "halves" }, tree, dump));
}

/** @param {number} at @param {string[]} octets @param {string} text */
function dumpLine(at, octets, text) {
  return h("div", {}, h("span", { class: "range" }, String(at)), ...octets.map((octet, index) => h("b", { "data-at": at + index }, octet)), h("span", { class: "quiet" }, text));
}

/** Packets, taken apart. @param {Desk} desk @param {HTMLElement} place @param {string[]} frames */
function showPackets(desk, place, frames) {
  const numbers = [...new Set(frames.flatMap((one) => one.split(",")))].filter((one) => /^\d+$/.test(one));
  if (!numbers.length) { place.replaceChildren(h("p", { class: "quiet" }, "No packet of it is in the capture.")); return Promise.resolve(); }
  const whole = { ...desk, where: () => "" };
  return shown(place, desk, argvOf(whole, "show", ["-V", ...numbers.flatMap((one) => ["--frame", one])]), async (result) => dissected(await result.out.text()));
}

/** @param {Desk} desk @param {HTMLElement} place @param {"transactions"|"operations"} command @param {string[]} options */
function rowsView(desk, place, command, options) {
  const columns = COLUMNS[command];
  const heads = columns.map(([, head]) => head);
  const argv = argvOf(desk, command, [...options, "-T", "fields", ...columns.flatMap(([field]) => ["-e", field])]);
  return shown(place, desk, argv, async (result) => {
    const lines = new Lines(result);
    const detail = h("div", { class: "detail", tabindex: "-1" });
    const cells = (/** @type {string} */ line) => line.split("\t").map((text, at) => (columns[at][0] === "time" ? timeText(text) : ["latency", "duration"].includes(columns[at][0]) ? (text && duration(Number(text))) : text));
    const choose = (/** @type {string[]} */ texts) => {
      desk.setRow(texts[0]);
      detail.replaceChildren(h("h3", {}, `${command === "transactions" ? "Transaction" : "Operation"} ${texts[0]}: ${texts[command === "transactions" ? 7 : 6]}`), h("p", {}, texts[command === "transactions" ? 8 : 7]));
      const packets = h("div", {});
      detail.append(packets);
      detail.scrollIntoView({ block: "nearest" });
      return showPackets(desk, packets, command === "transactions" ? texts.slice(2, 4) : [texts[2], texts[3]]);
    };
    const wanted = desk.row();
    const table = await rowsTable(lines, heads, cells, choose, wanted ? await pageOf(lines, wanted) : 0);
    if (wanted) setTimeout(async () => {
      if (table.focus(wanted)) await choose(cells((await lines.page(await pageOf(lines, wanted))).find((line) => line.startsWith(`${wanted}\t`)) || ""));
      else detail.replaceChildren(h("p", { role: "status" }, `There is no ${command === "transactions" ? "transaction" : "operation"} ${wanted} among these.`));
    });
    return h("div", { class: "beside" }, table.root, detail);
  });
}

/** The page on which a row with this number is: numbers ascend or nearly so. @param {Lines} lines @param {string} wanted */
async function pageOf(lines, wanted) {
  const guess = Math.min(lines.pages - 1, Math.max(0, Math.floor((Number(wanted) - 1) / 100)));
  const order = [guess, ...Array.from({ length: lines.pages }, (_, page) => page).filter((page) => page !== guess)];
  for (const page of order) if ((await lines.page(page)).some((line) => line.startsWith(`${wanted}\t`))) return page;
  return 0;
}

/** Devices as a table; one that is chosen tells its facts and why it is taken for what it is. @param {Desk} desk @param {HTMLElement} place */
function devicesView(desk, place) {
  const heads = ["Address", "Role", "Order number", "Firmware", "Station, module", "Mode", "Connections", "Transactions", "With errors", "Asked by", "Asks"];
  return shown(place, desk, argvOf(desk, "devices", ["-T", "json"]), async (result) => {
    /** @type {any[]} */
    const devices = result.out.size ? JSON.parse(await result.out.text()).devices : [];
    if (!devices.length) return h("p", {}, "No devices.");
    const detail = h("div", { class: "detail", tabindex: "-1" });
    const named = (/** @type {any} */ one) => (one.vlan.length ? `${one.address} VLAN ${one.vlan.join(", ")}` : one.address);
    const table = await rowsTable(listed(devices), heads, (line) => {
      const one = JSON.parse(line);
      return [named(one), one.role, one.order_number, one.firmware, [one.station_name, one.module_name].filter(Boolean).join(", "), one.operating_mode, one.connections, one.transactions, one.with_errors, one.asked_by.join(", "), one.asks.join(", ")].map((cell) => String(cell ?? ""));
    }, (texts) => {
      const one = devices.find((device) => named(device) === texts[0]);
      if (one) detail.replaceChildren(...deviceFacts(desk, one));
      detail.scrollIntoView({ block: "nearest" });
    });
    return h("div", { class: "beside" }, table.root, detail);
  });
}

/** What clients did to devices. @param {Desk} desk @param {HTMLElement} place */
function actsView(desk, place) {
  /** @type {[string, string][]} */
  const columns = [["act", "No."], ["ts", "Time"], ["first_frame", "Packet"], ["last_frame", "to"], ["client_host", "Client"], ["server_host", "Server"], ["kind", "Act"], ["subject", "What"], ["bytes", "Bytes"], ["outcome", "Outcome"], ["error_name", "Error"]];
  return shown(place, desk, argvOf(desk, "export", ["--only", "acts", "-o", "acts.csv"]), async (result) => {
    const [names, ...records] = result.files.length ? csvRows(await result.files[0].data.text()) : [[]];
    if (!records.length) return h("p", {}, "No acts: nothing was stopped, started, loaded, forced or unlocked.");
    const at = columns.map(([name]) => names.indexOf(name));
    const packets = h("div", { class: "detail", tabindex: "-1" });
    const table = await rowsTable(listed(records), columns.map(([, head]) => head), (line) => {
      const record = JSON.parse(line);
      return at.map((index, column) => (columns[column][0] === "ts" ? timeText(record[index]) : record[index] ?? ""));
    }, (texts) => showPackets(desk, packets, [texts[2], texts[3]]));
    return h("div", { class: "beside" }, table.root, packets);
  });
}

/** The records of a CSV file (RFC 4180). @param {string} text @returns {string[][]} */
function csvRows(text) {
  /** @type {string[][]} */
  const rows = [];
  /** @type {string[]} */
  let row = [];
  for (const [, quoted, plain, end] of text.matchAll(/(?:"((?:[^"]|"")*)"|([^",\r\n]*))(,|\r?\n|$)/g)) {
    if (!end && !row.length && !quoted && !plain) break;
    row.push(quoted === undefined ? plain : quoted.replaceAll('""', '"'));
    if (end === ",") continue;
    rows.push(row);
    row = [];
  }
  return rows;
}

/** Blocks as a table; one that is chosen shows its code. @param {Desk} desk @param {HTMLElement} place */
function blocksView(desk, place) {
  const heads = ["No.", "Block", "What", "PLC", "Client", "Began", "Packets", "Bytes", "Language", "Name", "State"];
  return shown(place, desk, argvOf(desk, "blocks", ["-T", "json"]), async (result) => {
    /** @type {any[]} */
    const blocks = result.out.size ? JSON.parse(await result.out.text()).blocks : [];
    if (!blocks.length) return h("p", {}, "No blocks.");
    const detail = h("div", { class: "detail", tabindex: "-1" });
    const state = (/** @type {any} */ one) => [one.complete ? "complete" : one.missing ? `incomplete: ${one.missing}` : "incomplete", one.activated === true && "activated", one.activated === false && "not activated", one.protected && "protected"].filter(Boolean).join(", ");
    const table = await rowsTable(listed(blocks), heads, (line) => {
      const one = JSON.parse(line);
      return [one.operation, one.label, one.direction, one.plc, one.client, one.begin_time && timeText(one.begin_time), [one.first_frame, one.last_frame].filter(Boolean).join("–"), one.octets, one.language, one.name, state(one)].map((cell) => String(cell ?? ""));
    }, (texts) => {
      const one = blocks.find((block) => String(block.operation) === texts[0]);
      if (one) detail.replaceChildren(...blockFacts(desk, one));
      detail.scrollIntoView({ block: "nearest" });
    });
    return h("div", { class: "beside" }, table.root, detail);
  });
}

/** The code of a block, in English or German, and its packets. @param {Desk} desk @param {any} one */
function blockFacts(desk, one) {
  const body = h("div", {});
  const mine = { ...desk, where: () => (desk.where() ? `(${desk.where()}) and number == ${one.operation}` : `number == ${one.operation}`) };
  const code = (/** @type {string} */ language) => shown(body, desk, argvOf(mine, "blocks", ["--code", language]), async (result) => (result.out.size ? h("pre", {}, await result.out.text()) : null));
  const packets = [one.first_frame, one.last_frame, one.activated_frame].filter(Boolean).map(String);
  code("STL");
  return [h("h3", {}, one.label), h("p", { class: "choice" }, h("button", { type: "button", click: () => code("STL") }, "STL"), h("button", { type: "button", click: () => code("AWL") }, "AWL"), h("button", { type: "button", click: () => showPackets(desk, body, packets) }, "Packets")), body];
}

/** Objects in pages, as `Lines` has them. @param {any[]} items @returns {any} */
function listed(items) {
  return { count: items.length, pages: Math.max(1, Math.ceil(items.length / 100)), page: async (/** @type {number} */ page) => items.slice(page * 100, page * 100 + 100).map((one) => JSON.stringify(one)) };
}

/** What a device says of itself, and what it is known by. @param {Desk} desk @param {any} one */
function deviceFacts(desk, one) {
  const packets = h("div", {});
  const packet = (/** @type {number|null} */ frame) => frame && h("button", { type: "button", class: "small", click: () => showPackets(desk, packets, [String(frame)]) }, `packet ${frame}`);
  const heads = ["Module", "Fact", "Value", "Source", "First"];
  const row = (/** @type {any[]} */ ...cells) => h("tr", {}, ...cells.map((cell, at) => h("td", { class: "text", "data-head": heads[at] }, cell || "")));
  /** @type {[string, any][]} */
  const facts = one.modules.flatMap((/** @type {any} */ module) => Object.entries(module.facts).flatMap(([name, values]) => /** @type {any[]} */ (values).map((value) => [module.module ?? "", { name, ...value }])));
  const rows = facts.map(([module, fact]) => row(module, fact.name.replaceAll("_", " "), fact.value, fact.source, packet(fact.first_frame)));
  const table = h("div", { class: "rows" }, h("table", {}, h("thead", {}, h("tr", {}, ...heads.map((head) => h("th", { scope: "col" }, head)))), h("tbody", {}, ...rows)));
  const why = one.evidence.map((/** @type {any} */ each) => h("li", {}, `${each.role}: ${each.text}${each.times > 1 ? `, on ${counted(each.times, "connection")}` : ""} `, packet(each.frame)));
  return [h("h3", {}, `${one.address}: ${one.role}`), h("p", { class: "quiet" }, [...one.macs.map((/** @type {any} */ mac) => mac.value), ...one.sessions, ...one.tsaps.map((/** @type {string} */ tsap) => `TSAP ${tsap}`)].join("; ")), rows.length > 0 && table, h("ul", {}, ...why), packets].filter(Boolean);
}
