// @ts-check
// ---- a card for each PLC ----------------------------------------------------------------------------------------------

/** A part of a card, not drawn without content. @param {string} title @param {Child[]} children */
function part(title, ...children) {
  return html("section", {}, html("h4", { text: title }), ...children);
}
/** @param {string[]} heads @param {string} label @param {Child[][]} rows @param {number[]} figures_ columns of numbers */
function small(heads, label, rows, figures_) {
  /** @param {number} column */
  const css = (column) => (figures_.includes(column) ? "figure" : null);
  return html("div", { class: "scroll" }, html("table", { "aria-label": label },
    html("thead", {}, html("tr", {}, ...heads.map((text, column) => html("th", { scope: "col", class: css(column), text })))),
    html("tbody", {}, ...rows.map((cells) => html("tr", {}, ...cells.map((content, column) => html("td", { class: css(column) }, content)))))));
}
/** @param {number} number @param {string} one @param {string} many */
const more = (number, one, many) => number > 0 && html("p", { class: "quiet", text: `and ${counted(number, `more ${one}`, `more ${many}`)}` });
/** @param {Session} session @param {number} side @param {Card} card @param {[number, number]} scale the shortest and the longest answer of all cards */
function cardOf(session, side, card, scale) {
  const prefix = prefixes[side], host = `${several ? `${letters[side]} ` : ""}${card.host}`;
  const clients = card.clients.map(([name, , transactions, reads, writes, errors, missed, did]) => [name, ...[transactions, reads, writes, errors, missed].map(integer), did]);
  const body = html("div", { class: "multiple" });
  const found = html("article", { class: "card", id: `${prefix}plc-${card.key}`, "aria-label": host },
    html("h3", {}, reference(session, side, card.key, host, "")),
    card.identity.length > 0 && html("dl", {}, ...card.identity.map(([what, text]) => html("div", {}, html("dt", { text: what }), html("dd", { text })))),
    card.modes.length > 0 && part("Operating modes", html("p", { text: card.modes.map(([seconds, mode]) => `${mode} (${moment(session, seconds)})`).join(" → ") })),
    card.times.cells.length > 0 && session.plcs.rows.length > 1 && part("Answer times", body),
    clients.length > 0 && part("Clients", small(["client", "transactions", "reads", "writes", "with errors", "no answer", "operations"], `Clients of ${host}`, clients, [1, 2, 3, 4, 5]), more(card.more_clients, "client", "clients")),
    card.writers.length > 0 && part("Writers", html("ul", {}, ...card.writers.map(([name, did]) => html("li", { text: `${name}: ${did}` })))),
    card.polls.length > 0 && part("Polls", small(["client", "request", "times", "period"], `Polls of ${host}`, card.polls.map(([name, subject, count, period, key]) => [name, reference(session, side, key, subject, ""), integer(count), duration(period)]), [2, 3]), more(card.more_polls, "poll", "polls")),
    card.slowest.length > 0 && part("Slowest answers", small(["answer", "time", "request"], `Slowest answers of ${host}`, card.slowest.map(([answer, seconds, what, about, key]) => [duration(answer), moment(session, seconds), reference(session, side, key, `${what}${about ? ` ${about}` : ""}`, `transactions -Y 'number == ${key.slice(1)}'`)]), [0])),
    card.refused.length > 0 && part("Refused addresses", small(["address", "times", "why"], `Addresses that ${host} refused`, card.refused.map(([address, count, why]) => [address, count ? integer(count) : "–", why]), [1]), more(card.more_refused, "address", "addresses")));
  if (body.isConnected || body.parentNode) plot(body, multipleOf(session, side, card, scale), true);
  return found;
}
/** Answer times of one PLC, on the scale of all. @param {Session} session @param {number} side @param {Card} card @param {[number, number]} scale @returns {Draw} */
function multipleOf(session, side, card, scale) {
  return (width) => {
    const left = 54, [root, x, right, bottom] = timed(width, 110, left, `Answer times of ${card.host}`, session, []);
    const [low, high, ticks] = decades(Math.max(scale[0], SHORTEST), scale[1]);
    const y = logScale(low, high, bottom, 8), most = cellsOf(card.times).reduce((all, cell) => Math.max(all, cell[3]), 1);
    vertical(root, left, bottom, ticks.length > 4 ? ticks.filter((_, number) => number % 2 === 0) : ticks, y, axis, right);
    density(root, session, cellsOf(card.times), card.times.width, x, y, left, right, most);
    root.classList.add(`s${side}`);
    return [root];
  };
}
/** @param {HTMLElement} into */
function drawCards(into) {
  const cells = sessions.flatMap((one) => one.plcs.rows.flatMap((card) => cellsOf(card.times)));
  /** @type {[number, number]} */
  const scale = [cells.reduce((all, cell) => Math.min(all, cell[1]), Infinity), cells.reduce((all, cell) => Math.max(all, cell[2]), 0)];
  sessions.forEach((session, side) => {
    into.append(...session.plcs.rows.map((card) => cardOf(session, side, card, scale)));
  });
  for (const one of into.querySelectorAll("div.scroll")) scrolling(one, null, one.querySelector("table")?.getAttribute("aria-label") || "");
  const left = sessions.reduce((all, one) => all + one.plcs.total - one.plcs.rows.length, 0);
  if (left > 0) into.after(html("p", { class: "quiet", text: `${counted(left, "more device that answers is", "more devices that answer are")} in the table of devices only.` }));
}
