// @ts-check
// ---- moving about -------------------------------------------------------------------------------------------------------

/** Rows that a plot shows as well. @type {Set<string>} */
const onPlot = new Set();
sessions.forEach((session, side) => {
  if (!several) session.points.forEach((point) => onPlot.add(prefixes[side] + point[2]));
  session.lanes.lanes.forEach((lane) => lane.spans.forEach((one) => onPlot.add(prefixes[side] + one[3])));
});
/** In a frame that is made of text or of a blob, links within the page lead elsewhere or nowhere: the script goes there itself. */
const framed = ["about:", "blob:"].includes(location.protocol);
/** What a link within the page names. @param {string} hash */
function named(hash) {
  try {
    return decodeURIComponent(hash.slice(1));
  } catch {
    return "";
  }
}
/** Shows what a link within the page leads to. @param {string} id */
function follow(id) {
  document.querySelectorAll(".found").forEach((one) => one.classList.remove("found"));
  if (!id) return;
  const name = rowsByKey.get(id);
  if (name !== undefined) {
    const side = several && id.startsWith("b-") ? 1 : 0;
    lists.get(prefixes[side] + name)?.reveal(id.slice(prefixes[side].length));
  }
  if (id.startsWith("pt-") && !document.getElementById(id)) {
    wanted = id.slice(3);
    redraw(true);
    if (!document.getElementById(id)) zoom(0, span);
  }
  const target = document.getElementById(id);
  if (!target) return;
  if (target instanceof HTMLDetailsElement) target.open = true;
  if (target.tagName === "TR" || target.classList.contains("hit")) {
    target.classList.add("found");
    if (target instanceof SVGElement) target.focus({ preventScroll: true });
    target.scrollIntoView({ block: "center" });
  } else if (framed || target.tagName === "DETAILS" || target.classList.contains("table")) target.scrollIntoView();
}
addEventListener("hashchange", () => follow(named(location.hash)));
document.addEventListener("click", (event) => {
  const link = event.target instanceof Element && event.target.closest("a[href^='#']");
  const to = link ? link.getAttribute("href") || "" : "";
  if (!to || (!framed && to !== location.hash)) return;
  if (framed) event.preventDefault();
  follow(named(to));
});

const range = html("span", { class: "quiet", role: "status" });
/** @type {[string, string, () => void][]} */
const acts = [["All", "Show all of the time", () => zoom(0, span)], ["+", "Zoom in", () => scale(0.5)], ["−", "Zoom out", () => scale(2)], ["←", "Earlier", () => shift(-0.25)], ["→", "Later", () => shift(0.25)]];
byId("zoom").append(html("span", { text: "Time" }), ...acts.map(([text, label, act]) => html("button", { type: "button", text, "aria-label": label, onclick: act })), range,
  html("span", { class: "quiet drag", text: "Drag across a plot to zoom in; the tables follow." }));
/** The widest bins that something is counted in: from edge to edge of these, counts are exact. */
const coarsest = Math.max(...sessions.flatMap((one) => [one.rates.width, ...one.tables.flatMap((table) => (table.counts ? [table.counts.width] : []))]));
/** A time widened to the edges of bins, unless it is so short that this would change much. @param {number} begin @param {number} end @returns {[number, number]} */
function snapped(begin, end) {
  if (several || end - begin < 3 * coarsest) return [begin, end];
  const start = Math.round(sessions[0].start_ms * 1e3), width = Math.round(coarsest * 1e6);
  const [low, high] = [start + Math.round(begin * 1e6), start + Math.round(end * 1e6)];
  return [(Math.floor(low / width) * width - start) / 1e6, (Math.ceil(high / width) * width - start) / 1e6];
}
/** @param {number} begin @param {number} end */
function zoom(begin, end) {
  const room = Math.min(span, Math.max(end - begin, 1e-6));
  const from = Math.max(0, Math.min(begin, span - room));
  const [low, high] = snapped(from, from + room);
  view = [Math.max(0, low), Math.min(span, high)];
  range.textContent = `${moment(sessions[0], view[0])} – ${moment(sessions[0], view[1])}`;
  redraw(true);
  for (const one of lists.values()) one.follow();
  look();
}
/** @param {number} factor */
const scale = (factor) => { const middle = (view[0] + view[1]) / 2, half = ((view[1] - view[0]) * factor) / 2; zoom(middle - half, middle + half); };
/** @param {number} share */
const shift = (share) => zoom(view[0] + (view[1] - view[0]) * share, view[1] + (view[1] - view[0]) * share);
/** @typedef {{root: SVGSVGElement, box: DOMRect, ratio: number, from: number, mark: SVGRectElement, chosen?: number[]}} Brush
 * @type {Brush | null} */
let brush = null;
/** @param {EventTarget | null} target @returns {SVGSVGElement | null} */
function timedAt(target) {
  const found = target instanceof Element ? target.closest("svg.timed") : null;
  return found instanceof SVGSVGElement ? found : null;
}
document.addEventListener("pointerdown", (event) => {
  const root = timedAt(event.target);
  if (!root || event.button || event.pointerType === "touch" || (event.target instanceof Element && event.target.closest("a"))) return;
  const box = root.getBoundingClientRect(), ratio = root.viewBox.baseVal.width / box.width;
  brush = { root, box, ratio, from: (event.clientX - box.left) * ratio, mark: svg("rect", { class: "brush", y: 4, height: Number(root.dataset.bottom) - 4 }) };
  event.preventDefault();
});
addEventListener("pointermove", (event) => {
  if (!brush) return;
  const left = Number(brush.root.dataset.left), right = Number(brush.root.dataset.right);
  /** @param {number} value */
  const bound = (value) => Math.min(right, Math.max(left, value));
  const to = bound((event.clientX - brush.box.left) * brush.ratio);
  const one = Math.min(bound(brush.from), to), other = Math.max(bound(brush.from), to);
  if (other - one < 4) return;
  if (!brush.mark.parentNode) brush.root.append(brush.mark);
  brush.mark.setAttribute("x", String(at(one))); brush.mark.setAttribute("width", String(at(other - one)));
  brush.chosen = [one, other].map((place) => view[0] + ((place - left) / (right - left)) * (view[1] - view[0]));
});
addEventListener("pointerup", () => {
  const chosen = brush && brush.chosen;
  if (brush) brush.mark.remove();
  brush = null;
  if (chosen) zoom(chosen[0], chosen[1]);
});

const tip = byId("tip");
/** @param {PointerEvent | FocusEvent} event */
function tellAbout(event) {
  const target = event.target instanceof Element ? event.target : null;
  const from = target && target.closest("[data-tip]"), over = from ? null : timedAt(target);
  let said = (from && from.getAttribute("data-tip")) || "";
  if (over && over.tipAt && event instanceof PointerEvent) {  // thousands of cells in a few elements
    const frame = over.getBoundingClientRect(), ratio = over.viewBox.baseVal.width / frame.width;
    said = over.tipAt((event.clientX - frame.left) * ratio, (event.clientY - frame.top) * ratio);
  }
  const about = from || over;
  if (!said || !about) { tip.hidden = true; return; }
  tip.textContent = said;
  tip.hidden = false;
  const box = about.getBoundingClientRect(), pointed = event instanceof PointerEvent;
  const x = pointed ? event.clientX : box.left + box.width / 2, y = pointed ? event.clientY : box.bottom;
  const left = Math.max(4, Math.min(x + 14, innerWidth - tip.offsetWidth - 8));
  const top = y + tip.offsetHeight + 20 > innerHeight ? y - tip.offsetHeight - 12 : y + 16;
  tip.style.left = `${left}px`; tip.style.top = `${Math.max(4, top)}px`;
}
document.addEventListener("pointermove", tellAbout);
document.addEventListener("focusin", tellAbout);
document.addEventListener("focusout", () => { tip.hidden = true; });
document.addEventListener("keydown", (event) => { if (event.key === "Escape") tip.hidden = true; });
