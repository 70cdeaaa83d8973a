// @ts-check
// ---- transactions per second --------------------------------------------------------------------------------------

const GOOD = [0, 3, 4], BAD = [1, 2];
const OUTCOME_CSS = ["ok", "errors", "missed", "push", "other"];
/** @type {Record<string, string>} */
const MARKS = { error: "M-6 0L0-6L6 0L0 6Z", warning: "M-5 5L0-5L5 5Z", note: "M-4-4H4V4H-4Z" };
/** Rates are per second; where bins are shorter than that, per bin: one request in 1 ms is not 1000 in a second. */
const perSeconds = sessions.some((one) => one.rates.bins.length) ? Math.min(1, sessions[0].rates.width) : 1, perWhat = perSeconds < 1 ? round(perSeconds * 1e9).replace(/^1 /, "") : "second";
/** @param {number} width @returns {(Element | false)[]} */
function drawRates(width) {
  const height = 250, left = 52;
  const [root, x, right, bottom] = timed(width, height, left, `Transactions per ${perWhat}`, sessions[0], several ? [] : sessions[0].gaps);
  const shownGaps = several ? [] : sessions[0].gaps;
  const middle = 160, low = middle + 12;
  /** @param {number[]} bin @param {number[]} columns */
  const sum = (bin, columns) => columns.reduce((all, column) => all + bin[column + 1], 0);
  const shown = sessions.map((one) => one.rates.bins.filter((bin) => inside(bin[0], bin[0] + one.rates.width)));
  /** @param {number[]} columns */
  const highest = (columns) => Math.max(1e-9, ...shown.map((bins, side) => Math.max(0, ...bins.map((bin) => (sum(bin, columns) / sessions[side].rates.width) * perSeconds))));
  const goodTicks = upwards(highest(GOOD), 3), top = goodTicks[goodTicks.length - 1], deep = highest(BAD), deepTicks = upwards(deep, 1), deepest = deepTicks[deepTicks.length - 1];
  /** @param {number} rate */
  const up = (rate) => middle - (rate / top) * (middle - 26);
  /** @param {number} rate */
  const down = (rate) => low + (rate / deepest) * (bottom - low);
  /** @param {number} one */
  const label = (one) => (one >= 1000 ? integer(one) : plain(one));
  vertical(root, left, Infinity, goodTicks, up, label, right);
  root.append(svg("line", { class: "axis", x1: left, x2: right, y1: middle, y2: middle }), svg("line", { class: "axis", x1: left, x2: right, y1: low, y2: low }));
  if (deep > 1e-8) root.append(svg("text", { class: "quiet", x: left - 6, y: bottom, "text-anchor": "end", text: label(deepest) }));
  root.append(svg("text", { class: "quiet", x: left + 4, y: bottom - 4, text: deep > 1e-8 ? "" : "no failures" }));
  /** @type {[number[], (rate: number) => number][]} */
  const halves = [[GOOD, up], [BAD, down]];
  sessions.forEach((session, side) => {
    const w = session.rates.width;
    if (several) {
      for (const [columns, y] of halves) {
        let path = "";
        for (const bin of shown[side]) {
          const count = sum(bin, columns);
          if (!count) continue;
          const from = Math.max(left, x(bin[0])), to = Math.min(right, Math.max(x(bin[0] + w), from + 5));
          path += `M${at(from)} ${at(y(0))}V${at(y((count / w) * perSeconds))}H${at(to)}V${at(y(0))}`;
        }
        if (path) root.append(svg("path", { class: `outline s${side}`, d: path }));
      }
      return;
    }
    for (const bin of shown[side]) {
      const from = Math.round(Math.max(left, x(bin[0]))), to = Math.round(Math.min(right, x(bin[0] + w)));
      const broad = Math.max(1, to - from - (to - from > 4 ? 1 : 0));
      const said = session.rates.names.map((name, column) => (bin[column + 1] ? `${integer(bin[column + 1])} ${name}` : "")).filter(Boolean);
      const tip = `${moment(session, bin[0])}, ${round(w * 1e9)}\n${said.join("\n")}`;
      for (const [columns, scale] of halves) {
        let reached = 0;
        for (const column of columns) {
          if (!bin[column + 1]) continue;
          const next = reached + (bin[column + 1] / w) * perSeconds;
          const [one, other] = [scale(reached), scale(next)];
          root.append(svg("rect", { class: `bar ${OUTCOME_CSS[column]}`, x: at(from), width: at(broad), y: at(Math.min(one, other)), height: at(Math.max(1, Math.abs(other - one))), "data-tip": tip }));
          reached = next;
        }
      }
    }
  });
  const session = sessions[0];
  if (!several) {
    const taken = /** @type {Set<string>} */ (new Set());
    for (const [seconds, severity, slug, detail] of session.marks.marks) {
      const place = `${severity}${Math.round(x(seconds) / 7)}`;
      if (!inside(seconds, seconds) || taken.has(place)) continue;
      taken.add(place);
      const cx = at(x(seconds)), shape = MARKS[severity];
      root.append(lead(`#f-${slug}`, `${severity} ${slug}\n${detail}\n${moment(session, seconds)}`, svg("path", { class: severity, d: shape, transform: `translate(${cx} 13)` })));
    }
  }
  /** @type {[string, string, string?][]} */
  const marks = several ? [] : ["error", "warning", "note"].filter((one) => session.marks.marks.some((mark) => mark[1] === one)).map((one) => [one, one, MARKS[one]]);
  /** @type {[string, string, string?][]} */
  const kinds = several ? [["outline s0", "A"], ["outline s1", "B (dashed)"]] : session.rates.names.map((name, column) => /** @type {[string, string]} */ ([OUTCOME_CSS[column], name])).filter((_, column) => session.rates.bins.some((bin) => bin[column + 1]));
  const marked = session.marks.marks.length, made = session.marks.total;
  const said = `${!several && made > marked ? `Of ${integer(made)} findings ${integer(marked)} are marked. ` : ""}Counted in bins of ${round(session.rates.width * 1e9)}. Failed transactions (with errors, or without an answer) point down, on a scale of their own.`;
  return [root, legend([...kinds, ...gapLegend(shownGaps), ...marks]), note(said)];
}

// ---- answer times over time ---------------------------------------------------------------------------------------

/** @param {Session} session @returns {[number, number][]} */
function medians(session) {
  /** @type {Map<number, [number, number, number][]>} */
  const bins = new Map();
  for (const [seconds, low, high, count] of cellsOf(session.times)) {
    const found = bins.get(seconds) || [];
    if (!found.length) bins.set(seconds, found);
    found.push([low, high, count]);
  }
  return [...bins].map(([seconds, cells]) => {
    const half = cells.reduce((all, cell) => all + cell[2], 0) / 2;
    let seen = 0;
    for (const [low, high, count] of cells) {
      seen += count;
      if (seen >= half) return [seconds, (low + high) / 2];
    }
    return [seconds, 0];
  });
}
/** Shades of a density: the darkest is the most, on a logarithmic scale. @param {number} count @param {number} most */
const shadeOf = (count, most) => Math.min(4, Math.floor((4.99 * Math.log(count + 1)) / Math.log(most + 1)));
/** Draws a density in a few elements, and has the plot say what is below the pointer.
 * @param {SVGSVGElement} root @param {Session} session @param {Cells} cells @param {number} w width of a cell in seconds @param {(seconds: number) => number} x
 * @param {(ns: number) => number} y @param {number} left @param {number} right @param {number} most */
function density(root, session, cells, w, x, y, left, right, most) {
  const shades = ["", "", "", "", ""];
  /** @type {[number, number, number, number, Cells[0]][]} */
  const boxes = [];
  for (const one of cells) {
    const [seconds, from, to, count] = one;
    if (!inside(seconds, seconds + w)) continue;
    const begin = Math.max(left, x(seconds)), end = Math.min(right, x(seconds + w)), upper = Math.min(y(to), y(from)), tall = Math.max(2, y(from) - y(to));
    shades[shadeOf(count, most)] += `M${at(begin)} ${at(upper)}h${at(Math.max(2, end - begin))}v${at(tall)}h${-at(Math.max(2, end - begin))}Z`;
    boxes.push([begin, upper, Math.max(2, end - begin), tall, one]);
  }
  shades.forEach((path, shade) => { if (path) root.append(svg("path", { class: `cells heat h${shade + 1}`, d: path })); });
  root.tipAt = (px, py) => {
    const found = boxes.find((box) => px >= box[0] && px <= box[0] + box[2] && py >= box[1] && py <= box[1] + box[3]);
    if (!found) return "";
    const [seconds, from, to, count] = found[4];
    return `${counted(count, "answer")} in ${duration(from)} to ${duration(to)}\n${moment(session, seconds)}, ${round(w * 1e9)}`;
  };
}
/** The row whose point is asked for: it is drawn even if others are slower. */
let wanted = "";
/** The slowest of the answers that are shown: one in 20, but at least 5 and at most 120. @param {Session} session */
function slowPoints(session) {
  const answers = cellsOf(session.times).reduce((all, [seconds, , , count]) => all + (inside(seconds, seconds + session.times.width) ? count : 0), 0);
  const most = Math.min(120, Math.max(5, Math.floor(answers / 20)));
  return session.points.filter(([seconds]) => inside(seconds, seconds)).sort((one, other) => other[1] - one[1]).filter(([, , key], number) => number < most || key === wanted);
}
/** @param {number} width @returns {(Element | false)[]} */
function drawTimes(width) {
  const cells = sessions.flatMap((one) => cellsOf(one.times));
  const height = 270, left = 62, gaps = several ? [] : sessions[0].gaps;
  const [root, x, right, bottom] = timed(width, height, left, "Answer times", sessions[0], gaps);
  const lowest = cells.reduce((all, cell) => Math.min(all, cell[1]), Infinity);
  const [low, high, ticks] = decades(Math.max(lowest, SHORTEST), cells.reduce((all, cell) => Math.max(all, cell[2]), 0));
  const y = logScale(low, high, bottom, 8);
  vertical(root, left, bottom, ticks, y, axis, right);
  const most = cells.reduce((all, cell) => Math.max(all, cell[3]), 1);
  let pointed = 0;
  sessions.forEach((session, side) => {
    const w = session.times.width;
    if (several) {
      let path = "";
      /** @type {number | null} */
      let last = null;
      for (const [seconds, middle] of medians(session)) {
        if (!inside(seconds, seconds + w)) continue;
        path += `${last !== null && seconds - last < w * 1.5 ? "L" : "M"}${at(x(seconds))} ${at(y(middle))}H${at(Math.max(x(seconds + w), x(seconds) + 7))}`;
        last = seconds;
      }
      if (path) root.append(svg("path", { class: `line s${side}`, d: path }));
      return;
    }
    density(root, session, cellsOf(session.times), w, x, y, left, right, most);
    const points = slowPoints(session).sort((one, other) => one[0] - other[0]);
    pointed = points.length;
    for (const [seconds, ns, key, what] of points) {
      root.append(hit(prefixes[side], key, `${what}\n${duration(ns)} at ${moment(session, seconds)}`, svg("circle", { class: "point", cx: at(x(seconds)), cy: at(y(ns)), r: 3.5 })));
    }
  });
  const said = several ? `Medians in bins of ${round(sessions[0].times.width * 1e9)}; no line means no answer.` : `Density in bins of ${round(sessions[0].times.width * 1e9)}; ${pointed} of the slowest answers are points that lead to their rows.${lowest < SHORTEST ? " At the lower edge: answers captured before their requests." : ""}`;
  /** @type {[string, string, string?][]} */
  const entries = several ? [["outline s0", "A"], ["outline s1", "B (dashed)"]] : [[`heat h${shadeOf(1, most) + 1}`, "1 answer"], ...(most > 1 ? [/** @type {[string, string]} */ (["heat h5", `${integer(most)} answers`])] : []), ["point", "one of the slowest"]];
  return [root, legend([...entries, ...gapLegend(gaps)]), note(said)];
}
