// @ts-check
// ---- figures ------------------------------------------------------------------------------------------------------

/** @typedef {(width: number) => (Element | false)[]} Draw */
const figures = byId("figures");
/** @type {{body: HTMLElement, draw: Draw, timed: boolean}[]} */
const drawn = [];
/** Adds a plot to what is drawn again when the width or the time changes. @param {HTMLElement} body @param {Draw} draw @param {boolean} overTime */
function plot(body, draw, overTime) {
  drawn.push({ body, draw, timed: overTime });
}
/** @param {string} name @param {string} title @param {Draw} draw @param {{timed?: boolean, wide?: boolean}} [options] */
function figure(name, title, draw, options = {}) {
  const body = html("div", {});
  figures.append(html("figure", { id: `plot-${name}`, class: options.wide ? "wide" : "" }, html("figcaption", {}, html("h3", { text: title })), body));
  plot(body, draw, Boolean(options.timed));
}
/** @param {boolean} timedOnly */
function redraw(timedOnly) {
  const focused = document.activeElement;
  for (const one of drawn) {
    if (timedOnly && !one.timed) continue;
    const width = Math.max(280, one.body.clientWidth || 800);
    const had = focused instanceof SVGElement && one.body.contains(focused) ? focused.id : "";
    one.body.replaceChildren(...one.draw(width).filter((child) => child !== false));
    for (const root of one.body.querySelectorAll("svg.plot")) stopOnce(root);
    if (had) document.getElementById(had)?.focus({ preventScroll: true });
  }
}
const pen = document.createElement("canvas").getContext("2d");
if (pen) pen.font = `12px ${getComputedStyle(document.body).fontFamily}`;
/** @param {string} text */
const wide = (text) => (pen ? pen.measureText(text).width : 7 * text.length);
/** A text cut in its middle to so many pixels: names that begin alike are told apart by their ends. @param {string} text @param {number} room */
function fitted(text, room) {
  if (wide(text) <= room) return text;
  let most = text.length - 1;
  const cut = () => `${text.slice(0, Math.ceil(most / 2))}…${text.slice(text.length - Math.floor(most / 2))}`;
  while (most > 2 && wide(cut()) > room) most -= Math.max(1, Math.floor((wide(cut()) - room) / 12));
  return cut();
}
/** A round duration at an axis: above a second always in seconds, which powers of ten read best in. @param {number} ns */
const axis = (ns) => (ns < 1e9 ? round(ns) : `${integer(ns / 1e9)} s`);
/** @param {number} width @param {number} height @param {string} label */
const canvas = (width, height, label) => svg("svg", { viewBox: `0 0 ${width} ${height}`, class: "plot", role: "group", "aria-label": label });
/** @param {string} text */
const nothing = (text) => [html("p", { class: "quiet", text })];
/** @param {string} text */
const note = (text) => (text.trim() ? html("p", { class: "quiet", text: text.trim() }) : false);

/** The axis of time: times of day, below them dates and the zone.
 * @param {SVGElement} root @param {Session} session @param {(seconds: number) => number} x @param {number} left @param {number} right @param {number} bottom */
function timeAxis(root, session, x, left, right, bottom) {
  const zero = several ? 0 : session.start_ms / 1e3 + zone(session, view[0])[1];
  /** @param {number} seconds @param {number} step */
  const label = (seconds, step) => (step >= 86400 && !several ? day(session, seconds) : ofDay(session, seconds, step));
  const [step, ticks] = steps(view[0], view[1], (one) => (right - left) / (Math.max(...view.map((seconds) => wide(label(seconds, one)))) + 18), zero);
  let free = left - 20;
  for (const tick of ticks) {
    if (x(tick) > right + 1) continue;
    root.append(svg("line", { class: "grid", x1: at(x(tick)), x2: at(x(tick)), y1: 4, y2: bottom }));
    const anchor = right - x(tick) < 32 ? "end" : x(tick) - left < 32 ? "start" : "middle";
    const text = label(tick, step), room = wide(text);
    const begin = anchor === "end" ? right - room : anchor === "start" ? x(tick) : x(tick) - room / 2;
    if (begin < free) continue;
    free = begin + room + 8;
    root.append(svg("text", { class: "quiet", x: at(anchor === "end" ? right : x(tick)), y: bottom + 16, "text-anchor": anchor, text }));
  }
  root.append(svg("line", { class: "axis", x1: left, x2: right, y1: bottom, y2: bottom }));
  if (several) return;
  const named = zone(session, view[1])[2], until = right - wide(named) - 12;
  root.append(svg("text", { class: "quiet zone", x: right, y: bottom + 31, "text-anchor": "end", text: named }));
  let next = left;
  for (const tick of step >= 86400 ? [] : [view[0], ...midnights(session)]) {
    const text = day(session, tick), from = Math.max(left, x(tick));
    if (from < next || from + wide(text) > until) continue;
    root.append(svg("text", { class: "quiet date", x: at(from), y: bottom + 31, text }));
    if (tick > view[0]) root.append(svg("line", { class: "axis", x1: at(from), x2: at(from), y1: bottom, y2: bottom + 6 }));
    next = from + wide(text) + 10;
  }
}
/** The midnights that are shown, at most 400. @param {Session} session */
function midnights(session) {
  const found = [];
  const begin = session.start_ms / 1e3 + zone(session, view[0])[1] + view[0];
  for (let tick = view[0] + (86400 - (begin % 86400)); tick < view[1] && found.length < 400; tick += 86400) found.push(tick);
  return found;
}

/** The frame of a plot over time: axis, gaps, and a brush that zooms.
 * @param {number} width @param {number} height without the axis @param {number} left @param {string} label @param {Session} session
 * @param {Gap[]} gaps @returns {[SVGSVGElement, (seconds: number) => number, number, number]} */
function timed(width, height, left, label, session, gaps) {
  const bottom = height - 22, right = width - 8;
  const root = canvas(width, several ? height : height + 14, label);
  /** @param {number} seconds */
  const x = (seconds) => left + ((seconds - view[0]) / (view[1] - view[0])) * (right - left);
  timeAxis(root, session, x, left, right, bottom);
  const ticks = svg("g", {});
  for (const [begin, end, why, idle] of gaps) {
    if (end < view[0] || (idle ? end : begin) > view[1]) continue;
    const tip = `${why}\n${idle ? `between ${moment(session, begin)} and ${moment(session, end)}, idle most of that time` : `${moment(session, begin)} to ${moment(session, end)}`}`;
    if (idle) {
      ticks.append(svg("path", { class: "gap tick", d: `M${at(x(end) - 4.5)} ${bottom}h9l-4.5-8Z`, "data-tip": tip }));
      continue;
    }
    const from = Math.max(left, x(begin)), to = Math.min(right, Math.max(x(end), x(begin) + 2));
    root.append(svg("rect", { class: "gap", x: at(from), y: 4, width: at(Math.max(2, to - from)), height: bottom - 4, "data-tip": tip }));
  }
  root.append(svg("rect", { x: left, y: 4, width: Math.max(0, right - left), height: bottom - 4, fill: "none", "pointer-events": "all", class: "ground" }), ticks);
  Object.assign(root.dataset, { left, right, bottom });
  root.classList.add("timed");
  return [root, x, right, bottom];
}
/** @param {number} begin @param {number} end */
const inside = (begin, end) => end >= view[0] && begin <= view[1];
/** @param {SVGElement} root @param {number} left @param {number} bottom @param {number[]} ticks @param {(value: number) => number} y
 * @param {(value: number) => string} text @param {number} right */
function vertical(root, left, bottom, ticks, y, text, right) {
  for (const tick of ticks) {
    root.append(svg("line", { class: "grid", x1: left, x2: right, y1: at(y(tick)), y2: at(y(tick)) }));
    root.append(svg("text", { class: "quiet", x: left - 6, y: at(Math.min(y(tick) + 4, bottom)), "text-anchor": "end", text: text(tick) }));
  }
}
/** @param {[css: string, text: string, shape?: string][]} entries */
function legend(entries) {
  return html("ul", { class: "legend" }, ...entries.map(([css, text, shape]) => html("li", {},
    svg("svg", { viewBox: "0 0 14 12", "aria-hidden": "true" }, shape ? svg("path", { class: css, d: shape, transform: "translate(7 6)" }) : svg("rect", { class: css, x: 0.5, y: 1, width: 13, height: 10 })), text)));
}
/** What the gaps of a plot mean. @param {Gap[]} gaps @returns {[string, string, string?][]} */
function gapLegend(gaps) {
  /** @type {[string, string, string?][]} */
  const found = [];
  if (gaps.some((gap) => !gap[3])) found.push(["gap", "missing from the capture"]);
  if (gaps.some((gap) => gap[3])) found.push(["gap tick", "bytes missing before an idle time", "M-5 4H5L0-5Z"]);
  return found;
}

// ---- points, lines and boxes of a plot: one stop for Tab, arrow keys from there on -----------------------------------

/** @param {string} text */
const spoken = (text) => text.replaceAll("\n", ", ");
/** A link to a row. @param {string} prefix @param {string} key @param {string} label @param {Child[]} children */
const hit = (prefix, key, label, ...children) => svg("a", { class: "hit", id: `pt-${prefix}${key}`, href: `#${prefix}${key}`, "data-tip": label, "aria-label": spoken(label) }, ...children);
/** A link to elsewhere. @param {string} href @param {string} label @param {Child[]} children */
const lead = (href, label, ...children) => svg("a", { class: "hit", href, "data-tip": label, "aria-label": spoken(label) }, ...children);
/** What tells something and leads nowhere. @param {string} label @param {string} css @param {Child[]} children */
const mark = (label, css, ...children) => svg("g", { class: `stop ${css}`, role: "img", "data-tip": label, "aria-label": spoken(label) }, ...children);
/** @param {Element} root @returns {SVGElement[]} */
const stopsOf = (root) => [...root.querySelectorAll("a.hit, g.stop")].filter((one) => one instanceof SVGElement);
/** @param {Element} root */
function stopOnce(root) {
  stopsOf(root).forEach((one, number) => one.setAttribute("tabindex", number ? "-1" : "0"));
}
document.addEventListener("keydown", (event) => {
  const from = event.target;
  const root = from instanceof SVGElement && from.closest("svg.plot");
  if (!root || event.altKey || event.ctrlKey || event.metaKey) return;
  const stops = stopsOf(root), now = stops.indexOf(from);
  const next = { ArrowRight: now + 1, ArrowDown: now + 1, ArrowLeft: now - 1, ArrowUp: now - 1, Home: 0, End: stops.length - 1 }[event.key];
  if (now < 0 || next === undefined) return;
  event.preventDefault();
  stops[Math.max(0, Math.min(stops.length - 1, next))].focus();
});
/** The stop that has the focus is where Tab comes back to. */
document.addEventListener("focusin", (event) => {
  const to = event.target;
  const root = to instanceof SVGElement && to.closest("svg.plot");
  if (!root || !to.hasAttribute("tabindex")) return;
  for (const one of stopsOf(root)) one.setAttribute("tabindex", one === to ? "0" : "-1");
});
