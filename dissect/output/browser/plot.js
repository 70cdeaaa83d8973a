// @ts-check
// Values over time, as steps.

const PLOT = { width: 1000, height: 190, left: 70, right: 12, top: 10, bottom: 26 };
/** A plot has no more steps than this: of more, the extremes in each column. */
const MOST_STEPS = 3000;

/** @param {string} tag @param {Record<string, any>} properties @param {...(Node|string)} children @returns {any} */
function s(tag, properties, ...children) {
  const one = document.createElementNS("http://www.w3.org/2000/svg", tag);
  for (const [name, value] of Object.entries(properties)) one.setAttribute(name, String(value));
  one.append(...children);
  return one;
}

/** @param {any} value @returns {number} */
function asNumber(value) {
  if (typeof value === "boolean") return value ? 1 : 0;
  if (typeof value === "number") return value;
  if (Array.isArray(value) && value.length === 1) return asNumber(value[0]);
  return NaN;
}

/** Nanoseconds of a time as JSON has it, after a first one. @param {string} time @param {string} first */
function after(time, first) {
  const whole = Date.parse(`${time.slice(0, 19)}Z`) - Date.parse(`${first.slice(0, 19)}Z`);
  const part = (/** @type {string} */ text) => Number((text.slice(20).replace("Z", "") || "0").padEnd(9, "0"));
  return whole * 1e6 + part(time) - part(first);
}

/** Of many steps only the first, least, greatest and last of each column. @param {number[][]} steps */
function thinned(steps) {
  if (steps.length <= MOST_STEPS) return steps;
  const kept = [];
  const size = Math.ceil((steps.length * 4) / MOST_STEPS);
  for (let at = 0; at < steps.length; at += size) {
    const piece = steps.slice(at, at + size);
    const low = piece.reduce((a, b) => (b[1] < a[1] ? b : a));
    const high = piece.reduce((a, b) => (b[1] > a[1] ? b : a));
    kept.push(...[...new Set([piece[0], low, high, piece[piece.length - 1]])].sort((a, b) => a[0] - b[0]));
  }
  return kept;
}

/** @param {number} low @param {number} high @returns {number[]} */
function ticks(low, high) {
  const rough = (high - low) / 4 || 1;
  const power = 10 ** Math.floor(Math.log10(rough));
  const step = [1, 2, 5, 10].map((one) => one * power).find((one) => one >= rough) || rough;
  const found = [];
  for (let at = Math.ceil(low / step) * step; at <= high + step / 1e6; at += step) found.push(Number(at.toPrecision(12)));
  return found;
}

/** One variable over time. @param {string} title @param {{time: string, value: any}[]} rows @param {string} first @param {number} span */
function stepPlot(title, rows, first, span) {
  const steps = thinned(rows.map((row) => [after(row.time, first), asNumber(row.value)]).filter((step) => Number.isFinite(step[1])));
  if (!steps.length) return h("figure", {}, h("figcaption", {}, title), h("p", { class: "quiet" }, "No numbers to plot; the values are in the table."));
  let low = Math.min(...steps.map((step) => step[1]));
  let high = Math.max(...steps.map((step) => step[1]));
  if (low === high) [low, high] = [low - 1, high + 1];
  const { width, height, left, right, top, bottom } = PLOT;
  const x = (/** @type {number} */ ns) => left + (ns / (span || 1)) * (width - left - right);
  const y = (/** @type {number} */ value) => top + ((high - value) / (high - low)) * (height - top - bottom);
  let path = "";
  for (const [at, value] of steps) path += path ? `H${x(at).toFixed(1)}V${y(value).toFixed(1)}` : `M${x(at).toFixed(1)} ${y(value).toFixed(1)}`;
  path += `H${width - right}`;
  const root = s("svg", { viewBox: `0 0 ${width} ${height}`, role: "img", "aria-label": `${title}: ${counted(rows.length, "value")}, from ${low} to ${high}` });
  for (const value of ticks(low, high)) {
    root.append(s("line", { class: "grid", x1: left, x2: width - right, y1: y(value), y2: y(value) }));
    root.append(s("text", { x: left - 6, y: y(value) + 4, "text-anchor": "end" }, String(value)));
  }
  for (const at of ticks(0, span / 1e9)) root.append(s("text", { x: x(at * 1e9), y: height - 6, "text-anchor": "middle" }, `${at} s`));
  root.append(s("path", { class: "line", d: path }));
  if (steps.length <= 200) for (const [at, value] of steps) root.append(s("circle", { class: "point", cx: x(at), cy: y(value), r: 3 }));
  return h("figure", {}, h("figcaption", {}, title, h("span", { class: "quiet" }, ` ${counted(rows.length, "value")}, seconds after ${first.replace("T", " ").slice(0, 19)} UTC`)), root);
}
