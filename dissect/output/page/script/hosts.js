// @ts-check
// ---- who talks to whom ----------------------------------------------------------------------------------------------

/** More lines than this cross too often to be followed: they become a matrix. */
const MOST_EDGES = 60;
/** @param {Pair} pair */
const worstOf = (pair) => (pair.worst === "error" || pair.worst === "warning" ? pair.worst : "ok");
/** @param {Pair} pair */
function pairSaid(pair) {
  return [
    `${pair.client} → ${pair.server}`, `${size(pair.octets)}, ${counted(pair.pdus, "PDU")}, ${counted(pair.connections, "connection")}`,
    pair.errors ? `${integer(pair.errors)} with errors` : "", pair.missed ? `${integer(pair.missed)} without answer` : "", `gravest finding: ${pair.worst || "none"}`,
  ].filter(Boolean).join("\n");
}
/** A link to the connections of a pair; where the page has none of them, the command that shows them is copied.
 * @param {Pair} pair @param {number} side @param {Child[]} children */
function pairLink(pair, side, ...children) {
  const text = command(sessions[side], { show: pair.show || "" });
  if (text) {
    const said = `${pairSaid(pair)}\nNot in the table of this page: Enter or a click copies the command\n${text}`;
    const act = async () => { tip.textContent = `${(await copy(text)) ? "Copied" : "Copying is not permitted"}: ${text}`; tip.hidden = false; };
    return svg("g", { class: "stop", role: "button", "data-tip": said, "aria-label": spoken(said), onclick: act, onkeydown: (event) => { if (event.key === "Enter") void act(); } }, ...children);
  }
  const found = lead(`#${prefixes[side]}table-connections`, pairSaid(pair), ...children);
  found.addEventListener("click", () => lists.get(`${prefixes[side]}connections`)?.search(pair.search));
  return found;
}
/** @param {Session} session @param {number} side @returns {Draw} */
function talksOf(session, side) {
  return (width) => {
    const pairs = session.talks.pairs;
    const clients = [...new Set(pairs.map((pair) => pair.client))], servers = [...new Set(pairs.map((pair) => pair.server))];
    const matrix = pairs.length > MOST_EDGES;
    const root = matrix ? talkMatrix(width, side, pairs, clients, servers) : talkGraph(width, side, pairs, clients, servers);
    /** @type {[string, string][]} */
    const severities = [["error", "error"], ["warning", "warning"], ["ok", "no finding, or a note"]];
    const hidden = session.talks.total - pairs.length;
    const said = matrix ? "Clients in rows, servers in columns. Size: bytes; colour: the gravest finding." : "Width: bytes; colour: the gravest finding. A host that is both client and server stands on both sides.";
    return [root, legend(severities.filter(([severity]) => pairs.some((pair) => worstOf(pair) === severity))), note(`${said}${hidden > 0 ? ` ${counted(hidden, "pair with less traffic is", "pairs with less traffic are")} not drawn.` : ""}`)];
  };
}
/** @param {number} width @param {number} side @param {Pair[]} pairs @param {string[]} clients @param {string[]} servers */
function talkGraph(width, side, pairs, clients, servers) {
  const row = 34, height = Math.max(clients.length, servers.length) * row + 30;
  const root = canvas(width, height, "Who talks to whom");
  const room = Math.min(230, width * 0.36), left = room, right = width - room;
  /** @param {string[]} names @param {string} name */
  const place = (names, name) => 30 + (names.indexOf(name) + 0.5) * ((height - 30) / names.length);
  const most = Math.max(...pairs.map((pair) => pair.octets), 1);
  root.append(svg("text", { class: "quiet", x: left - 10, y: 14, "text-anchor": "end", text: "client" }), svg("text", { class: "quiet", x: right + 10, y: 14, text: "server" }));
  for (const pair of pairs) {
    const from = place(clients, pair.client), to = place(servers, pair.server), bend = (right - left) * 0.45;
    root.append(pairLink(pair, side,
      svg("path", { class: `edge ${pair.worst}`, "stroke-width": at(1.5 + 14 * Math.sqrt(pair.octets / most)), d: `M${at(left)} ${at(from)}C${at(left + bend)} ${at(from)} ${at(right - bend)} ${at(to)} ${at(right)} ${at(to)}` })));
  }
  for (const name of clients) root.append(svg("circle", { class: "node", cx: at(left), cy: at(place(clients, name)), r: 4 }), svg("text", { x: at(left - 10), y: at(place(clients, name) + 4), "text-anchor": "end", text: fitted(name, room - 16), "data-tip": name }));
  for (const name of servers) root.append(svg("circle", { class: "node", cx: at(right), cy: at(place(servers, name)), r: 4 }), svg("text", { x: at(right + 10), y: at(place(servers, name) + 4), text: fitted(name, room - 16), "data-tip": name }));
  return root;
}
/** @param {number} width @param {number} side @param {Pair[]} pairs @param {string[]} clients @param {string[]} servers */
function talkMatrix(width, side, pairs, clients, servers) {
  const left = Math.min(150, width * 0.34), each = Math.min(26, (width - left - 6) / servers.length);
  const head = Math.min(130, Math.max(...servers.map(wide)) + 12), tall = Math.max(15, Math.min(22, each));
  const root = canvas(width, head + clients.length * tall + 6, "Who talks to whom");
  const most = Math.max(...pairs.map((pair) => pair.octets), 1);
  servers.forEach((name, number) => {
    const x = left + (number + 0.5) * each;
    root.append(svg("line", { class: "grid", x1: at(x), x2: at(x), y1: head, y2: head + clients.length * tall }));
    if (each >= 11) root.append(svg("text", { x: 0, y: 4, transform: `translate(${at(x)} ${head - 6}) rotate(-90)`, text: fitted(name, head - 10), "data-tip": name }));
  });
  clients.forEach((name, number) => {
    const y = head + (number + 0.5) * tall;
    root.append(svg("line", { class: "grid", x1: left, x2: at(left + servers.length * each), y1: at(y), y2: at(y) }), svg("text", { x: left - 6, y: at(y + 4), "text-anchor": "end", text: fitted(name, left - 8), "data-tip": name }));
  });
  const order = [...pairs].sort((one, other) => clients.indexOf(one.client) - clients.indexOf(other.client) || servers.indexOf(one.server) - servers.indexOf(other.server));
  for (const pair of order) {
    const room = Math.min(each, tall) - 3, side_ = Math.max(4, room * Math.sqrt(Math.sqrt(pair.octets / most)));
    const x = left + (servers.indexOf(pair.server) + 0.5) * each - side_ / 2, y = head + (clients.indexOf(pair.client) + 0.5) * tall - side_ / 2;
    root.append(pairLink(pair, side, svg("rect", { class: `box ${worstOf(pair)}`, x: at(x), y: at(y), width: at(side_), height: at(side_) })));
  }
  return root;
}

// ---- operations and modes -------------------------------------------------------------------------------------------

/** What goes on for long stands below what is done at once, so that neither hides the other. @type {[string[], string][]} */
const GROUPS = [[["control", "delete"], "control, delete"], [["download", "upload"], "download, upload"], [["session", "password"], "password, session"], [["polling", "cyclic", "messages"], "subscription, polling"]];
/** @type {Record<string, number>} */
const TRACKS = { session: 1, cyclic: 2, polling: 2, messages: 2, test_job: 1 };
/** @param {Session} session @param {number} side @returns {Draw} */
function lanesOf(session, side) {
  return (width) => {
    const lanes = session.lanes.lanes;
    const narrow = width < 640, left = narrow ? 10 : 180;
    /** @param {LaneSpan} one */
    const track = (one) => TRACKS[one[2]] || 0;
    const rows = lanes.map((lane) => Math.max(0, ...lane.spans.map((one) => track(one) + 1)));
    const highs = lanes.map((lane, number) => (narrow ? 14 : 0) + Math.max(18, 10 * rows[number] + (lane.modes.length ? 17 : 0) + 8));
    const tops = highs.map((_, number) => 6 + highs.slice(0, number).reduce((all, one) => all + one, 0));
    const [root, x, right] = timed(width, highs.reduce((all, one) => all + one, 36), left, "Operations and operating modes", session, session.gaps);
    lanes.forEach((lane, number) => {
      const top = tops[number];
      root.append(svg("text", { x: narrow ? left : left - 8, y: top + (narrow ? 10 : 12), "text-anchor": narrow ? "start" : "end", text: fitted(lane.host, narrow ? width - 20 : left - 14), "data-tip": lane.host }));
      const y = narrow ? top + 14 : top + 3;
      const reported = y + 10 * rows[number] + 9;
      for (const one of lane.spans) {
        const [begin, end, kind, key, what] = one;
        if (!inside(begin, end)) continue;
        const from = Math.min(right - 4, Math.max(left, x(begin))), to = Math.min(right, x(end));
        root.append(hit(prefixes[side], key, `${what}\n${moment(session, begin)}, ${duration((end - begin) * 1e9)}`, svg("rect", { class: `span ${kind}`, x: at(from), y: y + 10 * track(one), width: at(Math.max(4, to - from)), height: 9 })));
      }
      for (const [seconds, text, frame] of lane.modes) {
        if (!inside(seconds, seconds)) continue;
        const stop = /stop|hold|defect/i.test(text), end = x(seconds) > right - 60;
        root.append(mark(`${lane.host} reports ${text}\npacket ${frame}, ${moment(session, seconds)}`, "mode",
          svg("path", { class: stop ? "error" : "push", d: "M0-7L6 5H-6Z", transform: `translate(${at(x(seconds))} ${reported})` }),
          svg("text", { x: at(end ? x(seconds) - 9 : x(seconds) + 9), y: reported + 4, "text-anchor": end ? "end" : "start", text: text.slice(0, 14) })));
      }
    });
    const kinds = new Set(lanes.flatMap((lane) => lane.spans.map((one) => GROUPS.findIndex(([names]) => names.includes(one[2])))));
    /** @type {[string[], string][]} */
    const groups = [...GROUPS.filter((_, number) => kinds.has(number)), ...(kinds.has(-1) ? [/** @type {[string[], string]} */ ([[""], "other"])] : [])];
    const said = [
      lanes.some((lane) => lane.modes.length) ? "Triangles: the PLC reports its operating mode." : "",
      session.lanes.not_drawn ? `${integer(session.lanes.not_drawn)} more are not drawn.` : "",
      session.lanes.total > lanes.length ? `${counted(session.lanes.total - lanes.length, "more PLC is", "more PLCs are")} not drawn.` : "",
    ];
    return [root, legend([...groups.map(([names, text]) => /** @type {[string, string]} */ ([`span ${names[0]}`, text])), ...gapLegend(session.gaps)]), note(said.filter(Boolean).join(" "))];
  };
}
