// @ts-check
/** What the page holds: the element with an id, which is always there. @param {string} id */
function byId(id) {
  const found = document.getElementById(id);
  if (!found) throw new Error(`the page has no element ${id}`);
  return found;
}
/** @type {{sessions: Session[]}} */
const data = JSON.parse(byId("data").textContent || "");
const sessions = data.sessions;
const several = sessions.length > 1;
const letters = several ? ["A", "B"] : [""];
const prefixes = several ? ["a-", "b-"] : [""];
const SVG = "http://www.w3.org/2000/svg";
const span = Math.max(...sessions.map((one) => one.span), 1e-3);
/** The time that is shown, in seconds after the start. @type {[number, number]} */
let view = [0, span];
const whole = () => view[0] <= 0 && view[1] >= span;

// ---- elements: text is always set as text, never as markup -------------------------------------------------------

/** @template {Element} E @param {E} node @param {Attributes} attributes @param {Child[]} children @returns {E} */
function fill(node, attributes, children) {
  for (const [name, value] of Object.entries(attributes)) {
    if (value === null || value === undefined || value === false) continue;
    if (name === "text") node.textContent = String(value);
    else if (typeof value === "function") node.addEventListener(name.slice(2), value);
    else node.setAttribute(name, value === true ? "" : String(value));
  }
  for (const child of children) if (child) node.append(child);
  return node;
}
/** @template {keyof HTMLElementTagNameMap} T @param {T} tag @param {Attributes} attributes @param {Child[]} children */
const html = (tag, attributes, ...children) => fill(document.createElement(tag), attributes, children);
/** @template {keyof SVGElementTagNameMap} T @param {T} tag @param {Attributes} attributes @param {Child[]} children */
const svg = (tag, attributes, ...children) => fill(document.createElementNS(SVG, tag), attributes, children);
/** @param {number} number */
const at = (number) => Math.round(number * 100) / 100;
