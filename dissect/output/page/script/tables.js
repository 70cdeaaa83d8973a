// @ts-check
// ---- commands to copy, and links ----------------------------------------------------------------------------------------

/** The command that shows something. @param {Session} session @param {{show: string, in?: number}} how @param {string} [more_] further options */
function command(session, how, more_ = "") {
  if (!how.show) return "";
  const { options, bare, without, all, files } = session.command;
  return `s7dissect ${how.show}${more_}${without.includes(how.show.split(" ")[0]) ? bare : options} ${how.in === undefined ? all : files[how.in] || all}`;
}
/** @param {string} text @returns {Promise<boolean>} whether it was permitted */
async function copy(text) {
  try {
    await navigator.clipboard.writeText(text);
    return true;
  } catch {  // not permitted in a frame: the older way
    const area = html("textarea", { "aria-hidden": "true", class: "aside" });
    area.value = text;
    document.body.append(area);
    const focused = document.activeElement;
    area.select();
    const copied = document.execCommand("copy");
    area.remove();
    if (focused instanceof HTMLElement || focused instanceof SVGElement) focused.focus();
    return copied;
  }
}
/** @param {() => string} text @param {string} label what is copied @param {string} [shown] */
function copier(text, label, shown = "Copy") {
  const button = html("button", { type: "button", class: "copy", text: shown, "aria-label": label });
  button.addEventListener("click", async () => {
    button.textContent = (await copy(text())) ? "Copied" : "Not permitted";
    setTimeout(() => { button.textContent = shown; }, 1500);
  });
  return button;
}
/** A command or filter, with a button that copies it. @param {string} text @param {string} [before_] what it is */
const toCopy = (text, before_ = "") => html("span", { class: "command" }, before_, html("code", { text }), copier(() => text, `Copy ${text}`));
/** A link to a row; to one that is not in the page, the command that shows it. @param {Session} session @param {number} side @param {string} key
 * @param {string} text @param {string} show */
function reference(session, side, key, text, show) {
  if (rowsByKey.has(prefixes[side] + key)) return html("a", { href: `#${prefixes[side]}${key}`, text });
  return html("span", {}, `${text} `, show && session.command.all && toCopy(command(session, { show })));
}

// ---- tables -----------------------------------------------------------------------------------------------------------

/** @type {Map<string, List>} */
const lists = new Map();
/** Of each row that the page has, the name of its table. @type {Map<string, string>} */
const rowsByKey = new Map();
sessions.forEach((session, side) => session.tables.forEach((table) => table.rows.forEach((row) => {
  if (!rowsByKey.has(prefixes[side] + row.key)) rowsByKey.set(prefixes[side] + row.key, table.name);
})));
const FIRST = 25, MORE = 200;
/** @param {Session} session @param {Kind} kind @param {Cell} value @returns {string} */
function cell(session, kind, value) {
  if (typeof value === "number") {
    if (kind === "duration") return value < 0 ? "?" : duration(value);  // captured before its request: nobody can say
    if (kind === "size") return size(value);
    if (kind === "seconds") return moment(session, value);
    if (kind === "number") return integer(value);
  }
  return value === null ? (kind === "text" || kind === "short" ? "" : "–") : String(value);
}
/** A cell for programs: numbers are numbers, times in UTC. @param {Session} session @param {Kind} kind @param {Cell} value */
function bare(session, kind, value) {
  if (value === null || (kind === "duration" && Number(value) < 0)) return "";
  if (kind === "seconds") return iso(session, Number(value));
  if (typeof value === "number") return String(value);
  const begun = value.trimStart();  // a spreadsheet would run it as a formula
  const safe = /^[=+\-@\uff1d\uff0b\uff0d\uff20]/.test(begun) && !/^[+-]?\d+(\.\d+)?([eE][+-]?\d+)?$/.test(begun) ? `'${value}` : value;
  return safe.replace(/(;\s*)(?=[=+\-@\uff1d\uff0b\uff0d\uff20])/g, "$1'");
}
/** @param {Table} table @param {number} column */
function heading(table, column) {
  const [name, kind] = table.columns[column];
  return kind === "duration" ? `${name} (ns)` : kind === "size" ? `${name} (B)` : kind === "seconds" ? `${name} (UTC)` : name;
}
/** @param {Session} session @param {Table} table @param {Row[]} rows */
const lines = (session, table, rows) => [table.columns.map((_, column) => heading(table, column)), ...rows.map((row) => row.cells.map((value, column) => bare(session, table.columns[column][1], value)))];
/** @param {string} text */
const quoted = (text) => (/[",\r\n;\t]/.test(text) ? `"${text.replaceAll('"', '""')}"` : text);
/** @param {string} name @param {string} text */
function save(name, text) {
  const address = URL.createObjectURL(new Blob([`\ufeff${text}`], { type: "text/csv" }));
  const link = html("a", { href: address, download: name });
  document.body.append(link);
  link.click();
  link.remove();
  setTimeout(() => URL.revokeObjectURL(address), 10000);
}

/** How many of a table's rows there are in the time that is shown, and whether that is exact: bins may be cut by its edges.
 * @param {Counts} counts @param {number} begin @param {number} end @returns {[number, boolean]} */
function within(counts, begin, end) {
  let found = 0, exact = true;
  for (const [from, count] of counts.bins) {
    const until = from + counts.width;
    if (until <= begin + 1e-6 || (from >= end - 1e-6 && end < span)) continue;
    found += count;
    if ((begin > 0 && from < begin - 1e-6) || (end < span && until > end + 1e-6)) exact = false;
  }
  return [found, exact];
}
/** @param {Table} table @param {number} listed how many rows the page has of the time that is shown @returns {[number, boolean]} */
function thereAre(table, listed) {
  if (whole() || !table.counts) return [whole() ? table.total : listed, true];
  if (!table.ended) return within(table.counts, view[0], view[1]);
  const [opened, one] = within(table.counts, -Infinity, view[1]), [ended, other] = within(table.ended, -Infinity, view[0]);
  return [opened - ended, one && other];
}
/** The command that lists all rows of a table, in the time that is shown. @param {Session} session @param {Table} table */
function allOf(session, table) {
  const show = table.all || "";
  if (whole() || several) return command(session, { show });
  if (table.ended) {
    const [begin, end] = view.map((seconds) => BigInt(Math.round(session.start_ms * 1e3 + seconds * 1e6)) * 1000n);
    return command(session, { show: `sql 'SELECT * FROM connections WHERE ts_ns < ${end} AND end_ns >= ${begin}'` });
  }
  const end = view[1] >= span ? "" : `${iso(session, view[1] - 1e-6).slice(0, -1)}999Z`;
  return command(session, { show }, ` --time ${view[0] <= 0 ? "" : iso(session, view[0])}..${end}`);
}

/** @param {Session} session @param {number} side @param {Table} table */
function list(session, side, table) {
  const prefix = prefixes[side], title = `${several ? `${letters[side]} ` : ""}${table.title}`;
  const follows = table.all !== undefined, timeColumn = table.columns.findIndex(([, kind]) => kind === "seconds");
  const state = { column: -1, down: false, words: /** @type {string[]} */ ([]), most: FIRST };
  const body = html("tbody", {}), further_ = html("button", { type: "button", onclick: () => { state.most += MORE; show(); } });
  const count = html("span", { class: "quiet", role: "status" }), aside = further(), rest = html("p", { class: "quiet rest", hidden: true });
  const box = html("input", { type: "search", placeholder: "search these rows", "aria-label": `Search ${title}`, oninput: () => { state.words = box.value.toLowerCase().split(/\s+/).filter(Boolean); state.most = FIRST; show(); } });
  /** @param {Kind} kind */
  const css = (kind) => (kind === "text" ? "text" : kind === "seconds" || kind === "short" ? "short" : "figure");
  const heads = table.columns.map(([name, kind], number) => html("th", { scope: "col", class: css(kind), "aria-sort": "none" }, html("button", { type: "button", text: name, title: "sort", onclick: () => sort(number) })));
  /** What a search looks at; made when something is searched for, because most tables never are. @param {Row} row */
  function textOf(row) {
    if (row.text === undefined) row.text = row.cells.map((value, number) => cell(session, table.columns[number][1], value)).join(" ").toLowerCase();
    return row.text;
  }
  let order = table.rows;
  /** @param {number} number */
  function sort(number) {
    const kind = table.columns[number][1], text = kind === "text" || kind === "short";
    if (state.column !== number) { state.column = number; state.down = !text && kind !== "seconds" && kind !== "id"; }
    else state.down = !state.down;
    const sign = state.down ? -1 : 1;
    /** @param {Cell} value */
    const empty = (value) => value === null || value === "";
    order = [...table.rows].sort((one, other) => {
      const a = one.cells[number], b = other.cells[number];
      if (empty(a) || empty(b)) return Number(empty(a)) - Number(empty(b));
      return sign * (text ? String(a).localeCompare(String(b), "en", { numeric: true }) : Number(a) - Number(b));
    });
    heads.forEach((head, column) => head.setAttribute("aria-sort", column === number ? (state.down ? "descending" : "ascending") : "none"));
    show();
  }
  /** @param {Row} row */
  function line(row) {
    /** @type {HTMLElement | null} */
    let how = null;
    const opener = html("button", { type: "button", "aria-expanded": "false", "aria-label": `How to see ${row.cells[0]}`, text: "▸", onclick: () => {
      if (how) { how.remove(); how = null; } else {
        how = html("tr", { class: "how" }, html("td", { colspan: table.columns.length + 1 },
          row.show && session.command.all && toCopy(command(session, row)), row.filter && toCopy(row.filter, "Wireshark: "),
          onPlot.has(prefix + row.key) && html("a", { href: `#pt-${prefix}${row.key}`, text: "on the plot" })));
        head.after(how);
      }
      opener.textContent = how ? "▾" : "▸"; opener.setAttribute("aria-expanded", String(Boolean(how)));
    } });
    const head = html("tr", { id: rowsByKey.get(prefix + row.key) === table.name ? prefix + row.key : null },
      html("td", {}, opener),
      ...row.cells.map((value, number) => html("td", { class: css(table.columns[number][1]), text: cell(session, table.columns[number][1], value) })));
    return head;
  }
  /** @param {Row} row */
  function isShown(row) {
    if (!follows || whole() || timeColumn < 0) return true;
    const begin = Number(row.cells[timeColumn]), end = row.until ?? begin;
    return (begin < view[1] || view[1] >= span) && (end >= view[0] || view[0] <= 0);
  }
  /** @returns {Row[]} */
  function matching() {
    const shown = follows && !whole() ? order.filter(isShown) : order;
    return state.words.length ? shown.filter((row) => state.words.every((word) => textOf(row).includes(word))) : shown;
  }
  /** How many rows there are, of which time, and the command for those that the page has not. @param {Row[]} found */
  function tell(found) {
    const shown = follows ? order.filter(isShown).length : table.rows.length;
    const [all, exact] = thereAre(table, shown), less = table.total > table.rows.length && shown < all;
    const when = whole() ? "" : follows ? " in the time shown" : " of the whole capture";
    const said = less ? `${integer(shown)} of ${exact ? "" : "about "}${counted(all, "row")}${when} are in this page` : `${counted(shown, "row")}${when}`;
    const text = `${state.words.length ? `${integer(found.length)} of ${integer(shown)} match; ` : ""}${said}.`;
    if (count.textContent !== text) count.textContent = text;
    rest.hidden = !less || !table.all || !session.command.all;
    if (!rest.hidden) rest.replaceChildren(toCopy(allOf(session, table), "All of them: "));
  }
  function show() {
    const found = matching();
    body.replaceChildren(...found.slice(0, state.most).map(line));
    tell(found);
    further_.hidden = found.length <= state.most;
    further_.textContent = `Show ${integer(Math.min(MORE, found.length - state.most))} more`;
  }
  lists.set(prefix + table.name, {
    search: (text) => { box.value = text; box.dispatchEvent(new Event("input")); },
    reveal: (key) => {
      if (matching().slice(0, state.most).some((row) => row.key === key)) return;
      box.value = ""; state.words = [];
      if (!order.some((row) => row.key === key && isShown(row))) zoom(0, span);
      state.most = Math.max(state.most, matching().findIndex((row) => row.key === key) + 1);
      show();
    },
    follow: () => { if (follows) show(); else tell(matching()); },
  });
  const buttons = html("span", { class: "buttons" },
    copier(() => lines(session, table, matching()).map((cells) => cells.map((text) => text.replace(/[\t\r\n]/g, " ")).join("\t")).join("\n"), `Copy the rows of ${title}`),
    html("button", { type: "button", class: "copy", text: "CSV", "aria-label": `Save the rows of ${title} as CSV`, onclick: () => save(`${session.name.replace(/[^\w.-]+/g, "_")}-${table.name}.csv`, lines(session, table, matching()).map((cells) => cells.map(quoted).join(",")).join("\r\n") + "\r\n") }));
  const section = html("section", { class: "table", id: `${prefix}table-${table.name}` },
    html("div", { class: "head" }, html("h3", { text: title }), box, buttons, count, aside), table.note && html("p", { class: "quiet", text: table.note }), rest,
    scrolling(html("div", { class: "scroll" }, html("table", { "aria-label": title }, html("thead", {}, html("tr", {}, html("th", { scope: "col" }, html("span", { class: "unseen", text: "how to see it" })), ...heads)), body)), aside, title), further_);
  show();
  return section;
}
/** What may be wider than the page: it says so, and can then be scrolled by keyboard as well.
 * @typedef {[wider: boolean, atEnd: boolean]} Fit
 * @type {[() => Fit, (fit: Fit) => void][]} */
const boxes = [];
function further() { return html("span", { class: "quiet aside", text: "→ more columns to the right", hidden: true }); }
/** @template {Element} E @param {E} box @param {HTMLElement | null} aside @param {string} title @returns {E} */
function scrolling(box, aside, title) {
  const atEnd = () => box.scrollLeft + box.clientWidth > box.scrollWidth - 2;
  if (aside) box.addEventListener("scroll", () => { aside.hidden = atEnd(); });
  boxes.push([() => [box.scrollWidth > box.clientWidth + 1, atEnd()], ([wider, end]) => {
    if (aside) aside.hidden = !wider || end;
    for (const [name, value] of [["tabindex", "0"], ["role", "region"], ["aria-label", title]]) { if (wider) box.setAttribute(name, value); else box.removeAttribute(name); }
  }]);
  return box;
}
/** Measures all of them before it changes one: the page is laid out once. */
function look() {
  boxes.forEach(([, show]) => show([false, true]));
  boxes.map(([measure, show]) => /** @type {[(fit: Fit) => void, Fit]} */ ([show, measure()])).forEach(([show, found]) => show(found));
}
/** Findings are in the page without a script; with it, their commands are whole, and can be copied. */
for (const one of document.querySelectorAll("code[data-show], code[data-copy]")) {
  if (!(one instanceof HTMLElement)) continue;
  const session = sessions[Number(one.dataset.side)];
  const file = one.dataset.in ? Number(one.dataset.in) : undefined;
  const text = one.dataset.show ? command(session, { show: one.dataset.show, in: file }) : one.textContent || "";
  one.textContent = text;
  one.after(copier(() => text, `Copy ${text}`));
}
for (const one of document.querySelectorAll("details .scroll")) {
  const aside = further();
  one.before(aside);
  scrolling(one, aside, `Occurrences of ${(one.closest("details")?.id || "").replace(/^([ab]-)?f-/, "")}${several ? ` ${one.closest("details")?.id.slice(0, 1).toUpperCase()}` : ""}`);
  one.closest("details")?.addEventListener("toggle", look);
}
