// @ts-check
// ---- rows on a logarithmic axis (a label names the host where there are several): distributions and polls -------------------------------------------------------------

/** @param {{host: string}[]} rows @returns {(row: {host: string}) => string} */
const hostOf = (rows) => { const one = new Set(rows.map((row) => row.host)).size === 1; return (row) => (one ? "" : `${row.host} `); };
/** @template R @param {number} width @param {R[]} rows @param {string} label @param {number} low @param {number} high
 * @param {(row: R) => string} text @param {(root: SVGElement, row: R, x: (ns: number) => number, middle: number) => void} paint */
function ranged(width, rows, label, low, high, text, paint) {
  const narrow = width < 640;
  const left = narrow ? 8 : Math.min(420, Math.round(width * 0.42));
  const each = narrow ? 42 : 26;
  const height = rows.length * each + 30;
  const root = canvas(width, height, label);
  const right = width - 14;
  const [begin, end, ticks] = decades(Math.max(low, SHORTEST), high);
  const x = logScale(begin, end, left, right);
  const every = Math.ceil(ticks.length / Math.max(2, (right - left) / 62));
  ticks.forEach((tick, number) => {
    root.append(svg("line", { class: "grid", x1: at(x(tick)), x2: at(x(tick)), y1: 2, y2: height - 22 }));
    if (number % every === 0) root.append(svg("text", { class: "quiet", x: at(x(tick)), y: height - 7, "text-anchor": number === 0 ? "start" : x(tick) > right - 20 ? "end" : "middle", text: axis(tick) }));
  });
  rows.forEach((row, number) => {
    const top = number * each + 2;
    const middle = top + (narrow ? 28 : each / 2);
    const full = text(row);
    const cut = fitted(full, narrow ? right - left : left - 14);
    const said = svg("text", { x: narrow ? left : left - 10, y: narrow ? top + 12 : middle + 4, "text-anchor": narrow ? "start" : "end", text: cut, "data-tip": full });
    root.append(said);
    paint(root, row, x, middle);
  });
  return root;
}
/** @param {number} width @returns {(Element | false)[]} */
function drawSpreads(width) {
  const rows = sessions.flatMap((session, side) => session.spreads.rows.map((row, order) => ({ ...row, side, order })));
  if (several) {
    const first = new Map(sessions[0].spreads.rows.map((row, order) => [`${row.host} ${row.function}`, order]));
    /** @param {Spread & {order: number}} row */
    const place = (row) => first.get(`${row.host} ${row.function}`) ?? 1e6 + row.order;
    rows.sort((one, other) => place(one) - place(other) || one.side - other.side);
  }
  const host = hostOf(rows);
  /** @param {Spread & {side: number}} row */
  const text = (row) => `${several ? `${letters[row.side]} ` : ""}${host(row)}${row.function} (${integer(row.count)})`;
  const root = ranged(width, rows, "Answer times by device and function", Math.min(...rows.map((row) => Math.max(row.min, 1))), Math.max(...rows.map((row) => row.max)), text, (into, row, x, y) => {
    const most = Math.max(...row.bands.map((band) => band[2]));
    const said = `${text(row)}\nmedian ${duration(row.median)}, 95 % within ${duration(row.p95)}, longest ${duration(row.max)}` + (row.errors ? `\n${integer(row.errors)} with errors` : "") + (row.missed ? `\n${integer(row.missed)} without answer` : "");
    const group = lead(`#${prefixes[row.side]}${row.key}`, said);
    for (const [from, to, count] of row.bands) {
      const shade = 1 + shadeOf(count, most);
      const high = 4 + 12 * (count / most);
      group.append(svg("rect", { class: `heat h${shade} s${row.side}`, x: at(x(from)), width: at(Math.max(2, x(to) - x(from))), y: at(y - high / 2), height: at(high) }));
    }
    group.append(svg("line", { class: "tick", x1: at(x(row.median)), x2: at(x(row.median)), y1: y - 9, y2: y + 9 }));
    group.append(svg("line", { class: "tick far", x1: at(x(row.p95)), x2: at(x(row.p95)), y1: y - 9, y2: y + 9 }));
    into.append(group);
  });
  const total = sessions.reduce((all, one) => all + one.spreads.total, 0);
  return [root, note(`Line: median; dashed line: 95 %.${total > rows.length ? ` Shown are the ${rows.length} with most answers of ${integer(total)}; the table Functions by device lists the others.` : ""}`)];
}
/** @param {number} width @returns {(Element | false)[]} */
function drawPolls(width) {
  const rows = sessions.flatMap((session, side) => session.polls.rows.map((row) => ({ ...row, side })));
  if (several) rows.sort((one, other) => `${one.host} ${one.subject}`.localeCompare(`${other.host} ${other.subject}`) || one.side - other.side);
  const host = hostOf(rows);
  /** @param {Poll & {side: number}} row */
  const text = (row) => `${several ? `${letters[row.side]} ` : ""}${host(row)}${row.subject}`;
  const root = ranged(width, rows, "Polling periods", Math.min(...rows.map((row) => Math.max(row.min, 1))), Math.max(...rows.map((row) => row.max)), text, (into, row, x, y) => {
    const said = `${text(row)}\n${integer(row.count)} times, one in ${duration(row.median)} (median)\n90 % between ${duration(row.p5)} and ${duration(row.p95)}\nshortest ${duration(row.min)}, longest ${duration(row.max)}\njitter (standard deviation) ${duration(row.jitter)}`;
    into.append(lead(`#${prefixes[row.side]}${row.key}`, said,
      svg("line", { class: "whisker", x1: at(x(row.min)), x2: at(x(row.max)), y1: y, y2: y }),
      svg("line", { class: `range s${row.side}`, x1: at(x(row.p5)), x2: at(Math.max(x(row.p95), x(row.p5) + 2)), y1: y, y2: y }),
      svg("line", { class: "tick", x1: at(x(row.median)), x2: at(x(row.median)), y1: y - 8, y2: y + 8 })));
  });
  const total = sessions.reduce((all, one) => all + one.polls.total, 0);
  const apart = sessions.some((one) => one.lanes.lanes.some((lane) => lane.spans.some((span_) => span_[2] === "polling" || span_[2] === "cyclic")));
  return [root, note(`Time from one request to the next of its kind on a connection. Line: median; thick: 90 % of them; thin: shortest to longest. Times across a gap are not counted.${apart ? " Subscriptions and the polling of S7comm-plus are among the operations." : ""}${total > rows.length ? ` Shown are the ${rows.length} most frequent of ${integer(total)}.` : ""}`)];
}
