"use strict";
(() => {
  const data = JSON.parse(document.getElementById("data").textContent);
  const sessions = data.sessions;
  const several = sessions.length > 1;
  const letters = several ? ["A", "B"] : [""];
  const prefixes = several ? ["a-", "b-"] : [""];
  const SVG = "http://www.w3.org/2000/svg";
  const span = Math.max(...sessions.map((one) => one.span), 1e-3);
  let view = [0, span];

  // ---- elements: text is always set as text, never as markup -------------------------------------------------------

  function fill(node, attributes, children) {
    for (const [name, value] of Object.entries(attributes || {})) {
      if (value === null || value === undefined || value === false) continue;
      if (name === "text") node.textContent = value;
      else if (name.startsWith("on")) node.addEventListener(name.slice(2), value);
      else node.setAttribute(name, value === true ? "" : value);
    }
    for (const child of children) if (child) node.append(child);
    return node;
  }
  const html = (tag, attributes, ...children) => fill(document.createElement(tag), attributes, children);
  const svg = (tag, attributes, ...children) => fill(document.createElementNS(SVG, tag), attributes, children);
  const at = (number) => Math.round(number * 100) / 100;

  // ---- numbers in words ---------------------------------------------------------------------------------------------

  const integer = (number) => String(Math.round(number)).replace(/\B(?=(\d{3})+$)/g, ",");
  /** A number with so many decimals; a tie goes to the even digit, as in every other output. */
  function fixed(value, digits) {
    const scale = 10 ** digits, scaled = value * scale;
    if (!Number.isInteger(value * 8) || Math.abs(scaled % 1) !== 0.5) return value.toFixed(digits);
    const below = Math.floor(scaled);
    return ((below % 2 ? below + 1 : below) / scale).toFixed(digits);
  }
  /** A duration as the commands write it (`duration_text`). */
  function duration(measured) {
    if (measured === null || measured === undefined) return "–";
    const ns = Math.round(measured), size = Math.abs(ns);
    if (size > 0 && size < 1e4) return `${fixed(ns / 1e3, 1)} µs`;
    if (size < 999500) return `${fixed(ns / 1e3, 0)} µs`;
    if (size < 99995000) return `${fixed(ns / 1e6, 2)} ms`;
    if (size < 999500000) return `${fixed(ns / 1e6, 0)} ms`;
    if (size < 600e9) return `${fixed(ns / 1e9, 2)} s`;
    const seconds = Math.floor(size / 1e9);
    const units = [[Math.floor(seconds / 86400), "d"], [Math.floor(seconds / 3600) % 24, "h"], [Math.floor(seconds / 60) % 60, "min"], [seconds % 60, "s"]];
    const said = units.slice(units.findIndex(([number]) => number > 0)).map(([number, unit]) => `${number} ${unit}`);
    return (ns < 0 ? "-" : "") + said.join(" ");
  }
  /** A round duration, of a tick or a bin: without the decimals that are zero. */
  function round(ns) {
    const size = Math.abs(ns);
    if (size === 0) return "0 s";
    if (size < 1e3) return `${Math.round(ns)} ns`;
    for (const [limit, factor, unit] of [[1e6, 1e3, "µs"], [1e9, 1e6, "ms"], [120e9, 1e9, "s"], [7200e9, 60e9, "min"], [172800e9, 3600e9, "h"], [Infinity, 86400e9, "d"]]) {
      if (size < limit) {
        const value = ns / factor;
        return `${Math.abs(value) >= 100 ? Math.round(value) : Number(value.toPrecision(3))} ${unit}`;
      }
    }
    return "";
  }
  function size(octets) {
    if (octets === null || octets === undefined) return "–";
    for (const [unit, factor] of [["GB", 1e9], ["MB", 1e6], ["kB", 1e3]]) if (octets >= factor) return `${(octets / factor).toFixed(1)} ${unit}`;
    return `${octets} B`;
  }
  const plain = (number) => (Number.isInteger(number) ? String(number) : String(Number(number.toPrecision(6))));
  const two = (number) => String(number).padStart(2, "0");
  /** Where the day begins that times need: 10 for none, 5 for month and day past midnight, 0 for the year as well. */
  const dated = sessions.map((one) => {
    const days = [0, one.span].map((seconds) => new Date(one.start_ms + (one.offset_s + seconds) * 1e3)).map((when) => (Number.isNaN(when.getTime()) ? "" : when.toISOString().slice(0, 10)));
    return days[0] === days[1] ? 10 : days[0].slice(0, 4) === days[1].slice(0, 4) ? 5 : 0;
  });
  function clock(session, seconds, step) {
    if (several) return `+${round(seconds * 1e9)}`;
    const when = new Date(Math.round((session.start_ms + session.offset_s * 1e3 + seconds * 1e3) * 1e3) / 1e3);
    if (Number.isNaN(when.getTime())) return `+${round(seconds * 1e9)}`;
    const day = `${when.getUTCFullYear()}-${two(when.getUTCMonth() + 1)}-${two(when.getUTCDate())}`;
    if (step >= 86400) return day;
    const hours = `${two(when.getUTCHours())}:${two(when.getUTCMinutes())}`;
    const from = dated[sessions.indexOf(session)], date = from < 10 ? `${day.slice(from)} ` : "";
    if (step >= 60) return date + hours;
    const whole = `${date}${hours}:${two(when.getUTCSeconds())}`;
    if (step >= 1) return whole;
    const digits = Math.min(6, Math.max(1, -Math.floor(Math.log10(step) + 1e-9)));
    let part = session.start_ms / 1e3 + session.offset_s + seconds;
    part = (part - Math.floor(part)).toFixed(digits);
    return whole + (part.startsWith("1") ? "." + "9".repeat(digits) : part.slice(1));
  }
  const moment = (session, seconds) => `${clock(session, seconds, 1e-3)} ${several ? "" : session.zone}`.trim();

  // ---- scales -------------------------------------------------------------------------------------------------------

  const SECONDS = [...[-6, -5, -4, -3, -2, -1].flatMap((power) => [1, 2, 5].map((one) => Number(`${one}e${power}`))),
    1, 2, 5, 10, 15, 30, 60, 120, 300, 600, 900, 1800, 3600, 7200, 14400, 21600, 43200, ...[1, 2, 7, 14, 28, 91, 182, 365].map((days) => days * 86400)];
  /** Ticks at round times, as many as `fits(step)` says there is room for; `zero` is the time at 0. */
  function steps(begin, end, fits, zero = 0) {
    const step = SECONDS.find((one) => (end - begin) / one <= fits(one)) || SECONDS.at(-1);
    const found = [];
    const shift = ((zero % step) + step) % step;
    for (let tick = Math.ceil((begin + shift) / step - 1e-9) * step - shift; tick <= end + step * 1e-6 && found.length < 50; tick += step) found.push(tick);
    return [step, found];
  }
  /** Round numbers from 0 to at least `high`; of counts of things, whole ones. */
  function upwards(high, wanted) {
    const rough = Math.max(high, 1e-9) / wanted, base = 10 ** Math.floor(Math.log10(rough));
    const step = Math.max([1, 2, 5, 10].map((one) => one * base).find((one) => one >= rough * 0.999), high >= 1 ? 1 : 0);
    const found = [];
    for (let number = 0; number === 0 || found.at(-1) < high * 0.999; number += 1) found.push(Number((number * step).toPrecision(12)));
    return found;
  }
  /** Two to five round numbers between two numbers. */
  function tens(low, high) {
    const base = 10 ** Math.floor(Math.log10((high - low) / 2));
    const step = [5, 2, 1, 0.5].map((one) => one * base).find((one) => (high - low) / one >= 2) || base;
    const found = [];
    for (let tick = Math.ceil(low / step) * step; tick <= high + step * 1e-9 && found.length < 8; tick += step) found.push(Number(tick.toPrecision(12)));
    return found;
  }
  function decades(low, high) {
    const begin = Math.floor(Math.log10(Math.max(low, 1)));
    const end = Math.max(begin + 1, Math.ceil(Math.log10(Math.max(high, 10))));
    const ticks = [];
    for (let one = begin; one <= end; one += 1) ticks.push(10 ** one);
    return [10 ** begin, 10 ** end, ticks];
  }
  /** Answers that seem to come sooner are of reordered packets; they stand at the edge of a plot. */
  const SHORTEST = 1e3;
  const logScale = (low, high, from, to) => (value) => from + ((Math.log10(Math.max(value, low)) - Math.log10(low)) / (Math.log10(high) - Math.log10(low))) * (to - from);

  // ---- figures ------------------------------------------------------------------------------------------------------

  const figures = document.getElementById("figures");
  const drawn = [];
  function figure(name, title, note, draw, options) {
    const body = html("div", {});
    const frame = html("figure", { id: `plot-${name}`, class: options && options.wide ? "wide" : "" },
      html("figcaption", {}, html("h3", { text: title }), note && html("p", { class: "quiet", text: note })), body);
    figures.append(frame);
    drawn.push({ body, draw, timed: Boolean(options && options.timed) });
  }
  function redraw(timedOnly) {
    for (const one of drawn) {
      if (timedOnly && !one.timed) continue;
      const width = Math.max(280, one.body.clientWidth || 800);
      one.body.replaceChildren(...one.draw(width));
    }
  }
  const pen = document.createElement("canvas").getContext("2d");
  pen.font = `12px ${getComputedStyle(document.body).fontFamily}`;
  const wide = (text) => pen.measureText(text).width;
  /** A text cut to so many pixels. */
  function fitted(text, room) {
    if (wide(text) <= room) return text;
    let most = text.length - 1;
    while (most > 1 && wide(`${text.slice(0, most)}…`) > room) most -= Math.max(1, Math.floor((wide(text.slice(0, most)) - room) / 12));
    return `${text.slice(0, Math.max(1, most))}…`;
  }
  /** A round duration at an axis: above a second always in seconds, which powers of ten read best in. */
  const axis = (ns) => (ns < 1e9 ? round(ns) : `${integer(ns / 1e9)} s`);
  const canvas = (width, height, label) => svg("svg", { viewBox: `0 0 ${width} ${height}`, role: "group", "aria-label": label });
  const nothing = (text) => [html("p", { class: "quiet", text })];

  /** The frame of a plot over time: axis, gaps, and a brush that zooms. Returns [root, x]. */
  function timed(width, height, left, label, session, gaps) {
    const root = canvas(width, height, label);
    const right = width - 8, bottom = height - 22;
    const x = (seconds) => left + ((seconds - view[0]) / (view[1] - view[0])) * (right - left);
    const zero = several ? 0 : session.start_ms / 1e3 + session.offset_s;
    const [step, ticks] = steps(view[0], view[1], (one) => (right - left) / (Math.max(...view.map((seconds) => wide(clock(session, seconds, one)))) + 18), zero);
    let free = left - 20;
    for (const tick of ticks) {
      if (x(tick) > right + 1) continue;
      root.append(svg("line", { class: "grid", x1: at(x(tick)), x2: at(x(tick)), y1: 4, y2: bottom }));
      const anchor = right - x(tick) < 32 ? "end" : x(tick) - left < 32 ? "start" : "middle";
      const room = wide(clock(session, tick, step));
      const begin = anchor === "end" ? right - room : anchor === "start" ? x(tick) : x(tick) - room / 2;
      if (begin < free) continue;
      free = begin + room + 8;
      root.append(svg("text", { class: "quiet", x: at(anchor === "end" ? right : x(tick)), y: bottom + 16, "text-anchor": anchor, text: clock(session, tick, step) }));
    }
    root.append(svg("line", { class: "axis", x1: left, x2: right, y1: bottom, y2: bottom }));
    for (const [begin, end, why] of gaps || []) {
      if (end < view[0] || begin > view[1]) continue;
      const from = Math.max(left, x(begin)), to = Math.min(right, Math.max(x(end), x(begin) + 2));
      root.append(svg("rect", { class: "gap", x: at(from), y: 4, width: at(Math.max(2, to - from)), height: bottom - 4, "data-tip": why ? `${why}\n${moment(session, end)}` : "missing from the capture" }));
    }
    root.append(svg("rect", { x: left, y: 4, width: right - left, height: bottom - 4, fill: "none", "pointer-events": "all", class: "ground" }));
    root.dataset.left = left; root.dataset.right = right; root.dataset.bottom = bottom;
    root.classList.add("timed");
    return [root, x, right, bottom];
  }
  const inside = (begin, end) => end >= view[0] && begin <= view[1];
  function vertical(root, left, top, bottom, ticks, y, text, right) {
    for (const tick of ticks) {
      root.append(svg("line", { class: "grid", x1: left, x2: right, y1: at(y(tick)), y2: at(y(tick)) }));
      root.append(svg("text", { class: "quiet", x: left - 6, y: at(Math.min(y(tick) + 4, bottom || Infinity)), "text-anchor": "end", text: text(tick) }));
    }
  }
  function legend(entries) {
    return html("ul", { class: "legend" }, ...entries.map(([css, text, shape]) => html("li", {},
      svg("svg", { viewBox: "0 0 14 12", "aria-hidden": "true" }, shape ? svg("path", { class: css, d: shape, transform: "translate(7 6)" }) : svg("rect", { class: css, x: 0.5, y: 1, width: 13, height: 10 })), text)));
  }
  const hit = (prefix, key, label, ...children) => svg("a", { class: "hit", id: `pt-${prefix}${key}`, href: `#${prefix}${key}`, "data-tip": label, "aria-label": label }, ...children);

  // ---- transactions per second --------------------------------------------------------------------------------------

  const GOOD = [0, 3, 4], BAD = [1, 2];
  const OUTCOME_CSS = ["ok", "errors", "missed", "push", "other"];
  const MARKS = { error: "M-6 0L0-6L6 0L0 6Z", warning: "M-5 5L0-5L5 5Z", note: "M-4-4H4V4H-4Z" };
  /** Rates are per second; where bins are shorter than that, per bin: one request in 1 ms is not 1000 in a second. */
  const perSeconds = sessions.some((one) => one.rates.bins.length) ? Math.min(1, sessions[0].rates.width) : 1, perWhat = perSeconds < 1 ? round(perSeconds * 1e9).replace(/^1 /, "") : "second";
  function drawRates(width) {
    if (!sessions.some((one) => one.rates.bins.length)) return nothing("No transactions.");
    const height = 250, left = 52;
    const [root, x, right, bottom] = timed(width, height, left, `Transactions per ${perWhat}`, sessions[0], several ? [] : sessions[0].gaps);
    const middle = 160, low = middle + 12;
    const sum = (bin, columns) => columns.reduce((all, column) => all + bin[column + 1], 0);
    const shown = sessions.map((one) => one.rates.bins.filter((bin) => inside(bin[0], bin[0] + one.rates.width)));
    const highest = (columns) => Math.max(1e-9, ...shown.map((bins, side) => Math.max(0, ...bins.map((bin) => (sum(bin, columns) / sessions[side].rates.width) * perSeconds))));
    const goodTicks = upwards(highest(GOOD), 3), top = goodTicks.at(-1), deep = highest(BAD), deepTicks = upwards(deep, 1);
    const up = (rate) => middle - (rate / top) * (middle - 26);
    const down = (rate) => low + (rate / deepTicks.at(-1)) * (bottom - low);
    const label = (one) => (one >= 1000 ? integer(one) : plain(one));
    vertical(root, left, 0, middle, goodTicks, up, label, right);
    root.append(svg("line", { class: "axis", x1: left, x2: right, y1: middle, y2: middle }), svg("line", { class: "axis", x1: left, x2: right, y1: low, y2: low }));
    if (deep > 1e-8) root.append(svg("text", { class: "quiet", x: left - 6, y: bottom, "text-anchor": "end", text: label(deepTicks.at(-1)) }));
    root.append(svg("text", { class: "quiet", x: left + 4, y: bottom - 4, text: deep > 1e-8 ? "" : "no failures" }));
    sessions.forEach((session, side) => {
      const w = session.rates.width;
      if (several) {
        for (const [columns, y] of [[GOOD, up], [BAD, down]]) {
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
        for (const [columns, scale] of [[GOOD, up], [BAD, down]]) {
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
      const taken = new Set();
      for (const [seconds, severity, slug, detail] of session.marks.marks) {
        const place = `${severity}${Math.round(x(seconds) / 7)}`;
        if (!inside(seconds, seconds) || taken.has(place)) continue;
        taken.add(place);
        const cx = at(x(seconds)), shape = MARKS[severity];
        root.append(svg("a", { class: "hit", href: `#f-${slug}`, "aria-label": `${severity} ${slug}`, "data-tip": `${severity} ${slug}\n${detail}\n${moment(session, seconds)}` },
          svg("path", { class: severity, d: shape, transform: `translate(${cx} 13)` })));
      }
    }
    const marks = several ? [] : ["error", "warning", "note"].filter((one) => session.marks.marks.some((mark) => mark[1] === one)).map((one) => [one, one, MARKS[one]]);
    const bands = !several && session.gaps.length ? [["gap", "missing from the capture"]] : [];
    const kinds = several ? [["outline s0", "A"], ["outline s1", "B (dashed)"]] : session.rates.names.map((name, column) => [OUTCOME_CSS[column], name]).filter((_, column) => session.rates.bins.some((bin) => bin[column + 1]));
    const marked = session.marks.marks.length, made = session.marks.total;
    const note = `${!several && made > marked ? `Of ${integer(made)} findings ${integer(marked)} are marked. ` : ""}Counted in bins of ${round(session.rates.width * 1e9)}. Failures point down, on a scale of their own.`;
    return [root, legend([...kinds, ...bands, ...marks]), html("p", { class: "quiet", text: note })];
  }

  // ---- answer times over time ---------------------------------------------------------------------------------------

  function medians(session) {
    const bins = new Map();
    for (const [seconds, low, high, count] of session.times.cells) {
      if (!bins.has(seconds)) bins.set(seconds, []);
      bins.get(seconds).push([low, high, count]);
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
  function drawTimes(width) {
    const cells = sessions.flatMap((one) => one.times.cells);
    if (!cells.length) return nothing("No answer time could be measured.");
    const height = 270, left = 62;
    const [root, x, right, bottom] = timed(width, height, left, "Answer times", sessions[0], several ? [] : sessions[0].gaps);
    const lowest = cells.reduce((all, cell) => Math.min(all, cell[1]), Infinity);
    const [low, high, ticks] = decades(Math.max(lowest, SHORTEST), cells.reduce((all, cell) => Math.max(all, cell[2]), 0));
    const y = logScale(low, high, bottom, 8);
    vertical(root, left, 8, bottom, ticks, y, axis, right);
    const most = cells.reduce((all, cell) => Math.max(all, cell[3]), 1);
    const shadeOf = (count) => Math.min(4, Math.floor((4.99 * Math.log(count + 1)) / Math.log(most + 1)));
    sessions.forEach((session, side) => {
      const w = session.times.width;
      if (several) {
        let path = "", last = null;
        for (const [seconds, middle] of medians(session)) {
          if (!inside(seconds, seconds + w)) continue;
          path += `${last !== null && seconds - last < w * 1.5 ? "L" : "M"}${at(x(seconds))} ${at(y(middle))}H${at(Math.max(x(seconds + w), x(seconds) + 7))}`;
          last = seconds;
        }
        if (path) root.append(svg("path", { class: `line s${side}`, d: path }));
        return;
      }
      const shades = ["", "", "", "", ""], drawnCells = [];
      for (const one of session.times.cells) {
        const [seconds, from, to, count] = one;
        if (!inside(seconds, seconds + w)) continue;
        const begin = Math.max(left, x(seconds)), end = Math.min(right, x(seconds + w));
        const shade = shadeOf(count);
        const box = [at(begin), at(y(to)), at(Math.max(2, end - begin)), at(Math.max(2, y(from) - y(to)))];
        shades[shade] += `M${box[0]} ${box[1]}h${box[2]}v${box[3]}h${-box[2]}Z`;
        drawnCells.push([...box, one]);
      }
      shades.forEach((path, shade) => { if (path) root.append(svg("path", { class: `cells heat h${shade + 1}`, d: path })); });
      root.tipAt = (px, py) => {
        const found = drawnCells.find((box) => px >= box[0] && px <= box[0] + box[2] && py >= box[1] && py <= box[1] + box[3]);
        if (!found) return "";
        const [seconds, from, to, count] = found[4];
        return `${integer(count)} answer${count === 1 ? "" : "s"} in ${duration(from)} to ${duration(to)}\n${moment(session, seconds)}, ${round(w * 1e9)}`;
      };
      for (const [seconds, ns, key, what] of session.points) {
        if (!inside(seconds, seconds)) continue;
        root.append(hit(prefixes[side], key, `${what}\n${duration(ns)} at ${moment(session, seconds)}`, svg("circle", { class: "point", cx: at(x(seconds)), cy: at(y(ns)), r: 3.5 })));
      }
    });
    const note = several ? `Medians in bins of ${round(sessions[0].times.width * 1e9)}; no line means no answer.` : `Density in bins of ${round(sessions[0].times.width * 1e9)}; the ${sessions[0].points.length} slowest answers are points that lead to their rows.${lowest < SHORTEST ? " At the lower edge: answers captured before their requests." : ""}`;
    return [root, several ? legend([["outline s0", "A"], ["outline s1", "B (dashed)"]]) : legend([[`heat h${shadeOf(1) + 1}`, "1 answer"], ...(most > 1 ? [["heat h5", `${integer(most)} answers`]] : []), ["point", "one of the slowest"]]), html("p", { class: "quiet", text: note })];
  }

  // ---- rows on a logarithmic axis (a label names the host where there are several): distributions and polls -------------------------------------------------------------

  const hostOf = (rows) => { const one = new Set(rows.map((row) => row.host)).size === 1; return (row) => (one ? "" : `${row.host} `); };
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
  function drawSpreads(width) {
    const rows = sessions.flatMap((session, side) => session.spreads.rows.map((row, order) => ({ ...row, side, order })));
    if (!rows.length) return nothing("No answer time could be measured.");
    if (several) {
      const first = new Map(sessions[0].spreads.rows.map((row, order) => [`${row.host} ${row.function}`, order]));
      const place = (row) => (first.has(`${row.host} ${row.function}`) ? first.get(`${row.host} ${row.function}`) : 1e6 + row.order);
      rows.sort((one, other) => place(one) - place(other) || one.side - other.side);
    }
    const host = hostOf(rows);
    const text = (row) => `${several ? `${letters[row.side]} ` : ""}${host(row)}${row.function} (${integer(row.count)})`;
    const root = ranged(width, rows, "Answer times by device and function", Math.min(...rows.map((row) => Math.max(row.min, 1))), Math.max(...rows.map((row) => row.max)), text, (into, row, x, y) => {
      const most = Math.max(...row.bands.map((band) => band[2]));
      const said = `${text(row)}\nmedian ${duration(row.median)}, 95 % within ${duration(row.p95)}, longest ${duration(row.max)}` + (row.errors ? `\n${integer(row.errors)} with errors` : "") + (row.missed ? `\n${integer(row.missed)} without answer` : "");
      const group = svg("a", { class: "hit", href: `#${prefixes[row.side]}${row.key}`, "data-tip": said, "aria-label": said });
      for (const [from, to, count] of row.bands) {
        const shade = 1 + Math.min(4, Math.floor((4.99 * Math.log(count + 1)) / Math.log(most + 1)));
        const high = 4 + 12 * (count / most);
        group.append(svg("rect", { class: `heat h${shade} s${row.side}`, x: at(x(from)), width: at(Math.max(2, x(to) - x(from))), y: at(y - high / 2), height: at(high) }));
      }
      group.append(svg("line", { class: "tick", x1: at(x(row.median)), x2: at(x(row.median)), y1: y - 9, y2: y + 9 }));
      group.append(svg("line", { class: "tick far", x1: at(x(row.p95)), x2: at(x(row.p95)), y1: y - 9, y2: y + 9 }));
      into.append(group);
    });
    const total = sessions.reduce((all, one) => all + one.spreads.total, 0);
    return [root, html("p", { class: "quiet", text: `Line: median; dashed line: 95 %.${total > rows.length ? ` Shown are the ${rows.length} with most answers of ${integer(total)}; the table Functions by device lists the others.` : ""}` })];
  }
  function drawPolls(width) {
    const rows = sessions.flatMap((session, side) => session.polls.rows.map((row) => ({ ...row, side })));
    if (!rows.length) {
      const apart = sessions.some((one) => one.lanes.lanes.some((lane) => lane.spans.some((span_) => span_[2] === "polling" || span_[2] === "cyclic")));
      return nothing(`${apart ? "Subscriptions and the polling of S7comm-plus are among the operations; no other" : "No"} request came often enough to be a poll.${sessions.some((one) => one.gaps.length) ? " Times across a gap are not counted." : ""}`);
    }
    if (several) rows.sort((one, other) => `${one.host} ${one.subject}`.localeCompare(`${other.host} ${other.subject}`) || one.side - other.side);
    const host = hostOf(rows);
    const text = (row) => `${several ? `${letters[row.side]} ` : ""}${host(row)}${row.subject}`;
    const root = ranged(width, rows, "Polling periods", Math.min(...rows.map((row) => Math.max(row.min, 1))), Math.max(...rows.map((row) => row.max)), text, (into, row, x, y) => {
      const said = `${text(row)}\n${integer(row.count)} times, one in ${duration(row.median)} (median)\n90 % between ${duration(row.p5)} and ${duration(row.p95)}\nshortest ${duration(row.min)}, longest ${duration(row.max)}\njitter (standard deviation) ${duration(row.jitter)}`;
      into.append(svg("a", { class: "hit", href: `#${prefixes[row.side]}${row.key}`, "data-tip": said, "aria-label": said },
        svg("line", { class: "whisker", x1: at(x(row.min)), x2: at(x(row.max)), y1: y, y2: y }),
        svg("line", { class: `range s${row.side}`, x1: at(x(row.p5)), x2: at(Math.max(x(row.p95), x(row.p5) + 2)), y1: y, y2: y }),
        svg("line", { class: "tick", x1: at(x(row.median)), x2: at(x(row.median)), y1: y - 8, y2: y + 8 })));
    });
    const total = sessions.reduce((all, one) => all + one.polls.total, 0);
    return [root, html("p", { class: "quiet", text: `Time from one request to the next of its kind on a connection. Line: median; thick: 90 % of them; thin: shortest to longest. Times across a gap are not counted.${total > rows.length ? ` Shown are the ${rows.length} most frequent of ${integer(total)}.` : ""}` })];
  }

  // ---- who talks to whom ----------------------------------------------------------------------------------------------

  function talksOf(session, side) {
    return (width) => {
      const pairs = session.talks.pairs;
      if (!pairs.length) return nothing("No connections.");
      const order = (name) => [...new Set(pairs.map((pair) => pair[name]))];
      const clients = order("client"), servers = order("server");
      const row = 34, height = Math.max(clients.length, servers.length) * row + 30;
      const root = canvas(width, height, "Who talks to whom");
      const room = Math.min(230, width * 0.36);
      const left = room, right = width - room;
      const place = (names, name) => 30 + (names.indexOf(name) + 0.5) * ((height - 30) / names.length);
      const most = Math.max(...pairs.map((pair) => pair.octets), 1);
      root.append(svg("text", { class: "quiet", x: left - 10, y: 14, "text-anchor": "end", text: "client" }), svg("text", { class: "quiet", x: right + 10, y: 14, text: "server" }));
      for (const pair of pairs) {
        const from = place(clients, pair.client), to = place(servers, pair.server), bend = (right - left) * 0.45;
        const said = `${pair.client} → ${pair.server}\n${size(pair.octets)}, ${integer(pair.pdus)} PDUs, ${integer(pair.connections)} connection${pair.connections === 1 ? "" : "s"}` + (pair.errors ? `\n${integer(pair.errors)} with errors` : "") + (pair.missed ? `\n${integer(pair.missed)} without answer` : "") + `\nworst finding: ${pair.worst || "none"}`;
        root.append(svg("a", { class: "hit", href: `#${prefixes[side]}table-connections`, "data-tip": said, "aria-label": said, onclick: () => lists.get(`${prefixes[side]}connections`).search(pair.search) },
          svg("path", { class: `edge ${pair.worst}`, "stroke-width": at(1.5 + 14 * Math.sqrt(pair.octets / most)), d: `M${at(left)} ${at(from)}C${at(left + bend)} ${at(from)} ${at(right - bend)} ${at(to)} ${at(right)} ${at(to)}` })));
      }
      const cut = (name) => fitted(name, room - 16);
      for (const name of clients) root.append(svg("circle", { class: "node", cx: at(left), cy: at(place(clients, name)), r: 4 }), svg("text", { x: at(left - 10), y: at(place(clients, name) + 4), "text-anchor": "end", text: cut(name), "data-tip": name }));
      for (const name of servers) root.append(svg("circle", { class: "node", cx: at(right), cy: at(place(servers, name)), r: 4 }), svg("text", { x: at(right + 10), y: at(place(servers, name) + 4), text: cut(name), "data-tip": name }));
      const hidden = session.talks.total - pairs.length;
      return [root, legend([["error", "error"], ["warning", "warning"], ["ok", "no finding, or a note"]].filter(([severity]) => pairs.some((pair) => (pair.worst === "error" || pair.worst === "warning" ? pair.worst : "ok") === severity))), html("p", { class: "quiet", text: `Width: bytes; colour: the worst finding. A host that is both client and server stands on both sides.${hidden > 0 ? ` ${integer(hidden)} pairs with less traffic are not drawn.` : ""}` })];
    };
  }

  // ---- operations and modes -------------------------------------------------------------------------------------------

  /** What goes on for long stands below what is done at once, so that neither hides the other. */
  const GROUPS = [[["control", "delete"], "control, delete"], [["download", "upload"], "download, upload"], [["session", "password"], "password, session"], [["polling", "cyclic", "messages"], "subscription, polling"]];
  const TRACKS = { session: 1, cyclic: 2, polling: 2, messages: 2, test_job: 1 };
  function lanesOf(session, side) {
    return (width) => {
      const lanes = session.lanes.lanes;
      if (!lanes.length) return nothing("No operation and no change of the operating mode was seen.");
      const narrow = width < 640, left = narrow ? 10 : 180;
      const track = ([, , kind]) => TRACKS[kind] || 0;
      const rows = lanes.map((lane) => Math.max(0, ...lane.spans.map((one) => track(one) + 1)));
      const highs = lanes.map((lane, number) => (narrow ? 14 : 0) + Math.max(18, 10 * rows[number] + (lane.modes.length ? 17 : 0) + 8));
      const tops = highs.map((_, number) => 6 + highs.slice(0, number).reduce((all, one) => all + one, 0));
      const [root, x, right] = timed(width, highs.reduce((all, one) => all + one, 36), left, "Operations and operating modes", session, session.gaps);
      lanes.forEach((lane, number) => {
        const top = tops[number];
        root.append(svg("text", { x: narrow ? left : left - 8, y: top + (narrow ? 10 : 12), "text-anchor": narrow ? "start" : "end", text: fitted(lane.host, narrow ? width - 20 : left - 14), "data-tip": lane.host }));
        const y = narrow ? top + 14 : top + 3;
        const reported = y + 10 * rows[number] + 9;
        lane.spans.forEach(([begin, end, kind, key, what]) => {
          if (!inside(begin, end)) return;
          const from = Math.max(left, x(begin)), to = Math.min(right, x(end));
          root.append(hit(prefixes[side], key, `${what}\n${moment(session, begin)}, ${duration((end - begin) * 1e9)}`, svg("rect", { class: `span ${kind}`, x: at(from), y: y + 10 * track([begin, end, kind]), width: at(Math.max(4, to - from)), height: 9 })));
        });
        lane.modes.forEach(([seconds, text, frame]) => {
          if (!inside(seconds, seconds)) return;
          const stop = /stop|hold|defect/i.test(text);
          root.append(svg("g", { "data-tip": `${lane.host} reports ${text}\npacket ${frame}, ${moment(session, seconds)}`, tabindex: 0 },
            svg("path", { class: stop ? "error" : "push", d: "M0-7L6 5H-6Z", transform: `translate(${at(x(seconds))} ${reported})` }),
            svg("text", { x: at(x(seconds) > right - 60 ? x(seconds) - 9 : x(seconds) + 9), y: reported + 4, "text-anchor": x(seconds) > right - 60 ? "end" : "start", text: text.slice(0, 14) })));
        });
      });
      const kinds = new Set(lanes.flatMap((lane) => lane.spans.map((one) => GROUPS.findIndex(([names]) => names.includes(one[2])))));
      const groups = [...GROUPS.filter((_, number) => kinds.has(number)), ...(kinds.has(-1) ? [[[""], "other"]] : [])];
      const said = [];
      if (lanes.some((lane) => lane.modes.length)) said.push("Triangles: the PLC reports its operating mode.");
      if (session.lanes.not_drawn) said.push(`${integer(session.lanes.not_drawn)} more are not drawn.`);
      if (session.lanes.total > lanes.length) said.push(`${integer(session.lanes.total - lanes.length)} more PLCs.`);
      return [root, legend(groups.map(([names, text]) => [`span ${names[0]}`, text])), html("p", { class: "quiet", text: said.join(" ") })];
    };
  }

  // ---- tags -------------------------------------------------------------------------------------------------------------

  function tagOf(session, side, tag) {
    return (width) => {
      const height = 170, left = 62;
      const [root, x, right, bottom] = timed(width, height, left, tag.name, session, tag.gaps);
      const shown = tag.steps;
      let low = Math.min(...shown.map((step) => step[2]), ...tag.writes.map((write) => write[1])), high = Math.max(...shown.map((step) => step[3]), ...tag.writes.map((write) => write[1]));
      if (low === high) { low -= 1; high += 1; }
      const y = (value) => bottom - 6 - ((value - low) / (high - low)) * (bottom - 18);
      vertical(root, left, 8, bottom, tens(low, high), y, plain, right);
      const edge = (seconds) => Math.min(right, Math.max(left, x(seconds)));
      let path = "";
      shown.forEach((step, number) => {
        const next = shown[number + 1];
        const until = next ? (next[5] ? step[0] : next[0]) : tag.end;
        const broken = number === 0 || step[5];
        if (!inside(step[0], Math.max(until, step[0]))) return;
        path += `${broken || !path ? "M" : "L"}${at(edge(step[0]))} ${at(y(step[1]))}`;
        if (tag.width && step[2] !== step[3]) root.append(svg("rect", { class: "band", x: at(edge(step[0])), width: at(Math.max(1, edge(step[0] + tag.width) - edge(step[0]))), y: at(y(step[3])), height: at(Math.max(1, y(step[2]) - y(step[3]))) }));
        if (step[4] !== step[1]) path += `V${at(y(step[4]))}`;
        path += `H${at(Math.max(edge(until), edge(step[0]) + 1))}`;
        root.append(svg("rect", { x: at(edge(step[0])), width: at(Math.max(3, edge(until) - edge(step[0]))), y: 8, height: bottom - 8, fill: "none", "pointer-events": "all", "data-tip": `${plain(step[4])} ${tag.unit}\nsince ${moment(session, step[0])}` }));
      });
      root.append(svg("path", { class: "line", d: path || "M0 0" }));
      for (const [seconds, value, writer, number] of tag.writes) {
        if (!inside(seconds, seconds)) continue;
        const said = `${writer} writes ${plain(value)} ${tag.unit}\npacket ${number}, ${moment(session, seconds)}`;
        root.append(svg("g", { class: "writer", "data-tip": said, tabindex: 0, "aria-label": said }, svg("path", { class: "write", transform: `translate(${at(x(seconds))} ${at(y(value))})`, d: "M0-7L6 6H-6Z" })));
      }
      const writers = [...new Set(tag.writes.map((write) => write[2]))];
      const gathered = tag.width ? ` Gathered in bins of ${round(tag.width * 1e9)}: smallest to largest.` : "";
      return [root, html("p", { class: "quiet", text: `${integer(tag.values)} values.${writers.length ? ` Triangles: written by ${writers.slice(0, 4).join(", ")}${writers.length > 4 ? "…" : ""}.` : ""}${tag.writes_not_kept ? ` ${integer(tag.writes_not_kept)} more writes.` : ""}${gathered} Nothing is drawn across a gap.` })];
    };
  }

  // ---- tables -----------------------------------------------------------------------------------------------------------

  const lists = new Map();
  const rowsByKey = new Map();
  const FIRST = 25, MORE = 200;
  function cell(session, kind, value) {
    if (kind === "duration") return value < 0 ? "?" : duration(value);  // captured before its request: nobody can say
    if (kind === "size") return size(value);
    if (kind === "seconds") return moment(session, value);
    if (kind === "number") return value === null ? "–" : integer(value);
    if (kind === "id") return value === null ? "–" : String(value);
    return value === null ? "" : String(value);
  }
  function list(session, side, table) {
    const prefix = prefixes[side];
    const state = { column: -1, down: false, words: [], most: FIRST };
    const body = html("tbody", {}), more = html("button", { type: "button", onclick: () => { state.most += MORE; show(); } });
    const count = html("span", { class: "quiet", role: "status" }), aside = further();
    const box = html("input", { type: "search", placeholder: "search these rows", "aria-label": `Search ${table.title}`, oninput: () => { state.words = box.value.toLowerCase().split(/\s+/).filter(Boolean); state.most = FIRST; show(); } });
    const css = (kind) => (kind === "text" ? "text" : kind === "seconds" || kind === "short" ? "short" : "figure");
    const heads = table.columns.map(([name, kind], number) => html("th", { scope: "col", class: css(kind), "aria-sort": "none" }, html("button", { type: "button", text: name, title: "sort", onclick: () => sort(number) })));
    /** What a search looks at; made when something is searched for, because most tables never are. */
    function textOf(row) {
      if (row.text === undefined) row.text = row.cells.map((value, number) => cell(session, table.columns[number][1], value)).join(" ").toLowerCase();
      return row.text;
    }
    let order = table.rows;
    function sort(number) {
      const kind = table.columns[number][1];
      if (state.column !== number) { state.column = number; state.down = kind !== "text" && kind !== "short" && kind !== "seconds" && kind !== "id"; }
      else state.down = !state.down;
      const sign = state.down ? -1 : 1;
      const empty = (value) => value === null || value === "";
      order = [...table.rows].sort((one, other) => {
        const a = one.cells[number], b = other.cells[number];
        if (empty(a) || empty(b)) return Number(empty(a)) - Number(empty(b));
        return sign * (kind === "text" || kind === "short" ? String(a).localeCompare(String(b), "en", { numeric: true }) : a - b);
      });
      heads.forEach((head, column) => head.setAttribute("aria-sort", column === number ? (state.down ? "descending" : "ascending") : "none"));
      show();
    }
    function line(row) {
      let how = null;
      const opener = html("button", { type: "button", "aria-expanded": "false", "aria-label": `How to see ${row.cells[0]}`, text: "▸", onclick: () => {
        if (how) { how.remove(); how = null; } else {
          how = html("tr", { class: "how" }, html("td", { colspan: table.columns.length + 1 },
            row.show && html("code", { text: row.show }), row.filter && html("code", { text: `Wireshark: ${row.filter}` }),
            onPlot.has(prefix + row.key) && html("a", { href: `#pt-${prefix}${row.key}`, text: "on the plot" })));
          head.after(how);
        }
        opener.textContent = how ? "▾" : "▸"; opener.setAttribute("aria-expanded", String(Boolean(how)));
      } });
      const head = html("tr", { id: lists.get(prefix + table.name) && rowsByKey.get(prefix + row.key) === table.name ? prefix + row.key : null },
        html("td", {}, opener),
        ...row.cells.map((value, number) => html("td", { class: css(table.columns[number][1]), text: cell(session, table.columns[number][1], value) })));
      return head;
    }
    function matching() {
      return state.words.length ? order.filter((row) => state.words.every((word) => textOf(row).includes(word))) : order;
    }
    function show() {
      const found = matching();
      body.replaceChildren(...found.slice(0, state.most).map(line));
      const kept = table.total > table.rows.length ? ` The report holds ${integer(table.rows.length)} of ${integer(table.total)}.` : "";
      count.textContent = `${state.words.length ? `${integer(found.length)} of ${integer(table.rows.length)} rows match.` : `${integer(table.rows.length)} row${table.rows.length === 1 ? "" : "s"}.`}${kept}`;
      more.hidden = found.length <= state.most;
      more.textContent = `Show ${integer(Math.min(MORE, found.length - state.most))} more`;
    }
    const control = {
      search: (text) => { box.value = text; box.dispatchEvent(new Event("input")); },
      reveal: (key) => {
        if (!matching().slice(0, state.most).some((row) => row.key === key)) {
          box.value = ""; state.words = [];
          state.most = Math.max(state.most, order.findIndex((row) => row.key === key) + 1);
          show();
        }
      },
    };
    lists.set(prefix + table.name, control);
    for (const row of table.rows) if (!rowsByKey.has(prefix + row.key)) rowsByKey.set(prefix + row.key, table.name);
    const section = html("section", { class: "table", id: `${prefix}table-${table.name}` },
      html("div", { class: "head" }, html("h3", { text: `${several ? `${letters[side]} ` : ""}${table.title}` }), box, count, aside),
      scrolling(html("div", { class: "scroll" }, html("table", { "aria-label": table.title }, html("thead", {}, html("tr", {}, html("th", { scope: "col", "aria-label": "how to see it" }), ...heads)), body)), aside, table.title), more);
    show();
    return section;
  }
  /** What may be wider than the page: it says so, and can then be scrolled by keyboard as well. */
  const boxes = [];
  function further() { return html("span", { class: "quiet aside", text: "→ more columns to the right", hidden: true }); }
  function scrolling(box, aside, title) {
    const atEnd = () => box.scrollLeft + box.clientWidth > box.scrollWidth - 2;
    box.addEventListener("scroll", () => { aside.hidden = atEnd(); });
    boxes.push([() => [box.scrollWidth > box.clientWidth + 1, atEnd()], ([wider, end]) => {
      aside.hidden = !wider || end;
      for (const [name, value] of [["tabindex", "0"], ["role", "region"], ["aria-label", title]]) { if (wider) box.setAttribute(name, value); else box.removeAttribute(name); }
    }]);
    return box;
  }
  /** Measures all of them before it changes one: the page is laid out once. */
  const look = () => {
    boxes.forEach(([, show]) => show([false, true]));
    boxes.map(([measure, show]) => [show, measure()]).forEach(([show, found]) => show(found));
  };
  for (const one of document.querySelectorAll("details .scroll")) {
    const aside = further();
    one.before(aside);
    scrolling(one, aside, "Occurrences");
    one.closest("details").addEventListener("toggle", look);
  }

  // ---- moving about -------------------------------------------------------------------------------------------------------

  const onPlot = new Set();
  sessions.forEach((session, side) => {
    if (!several) session.points.forEach((point) => onPlot.add(prefixes[side] + point[2]));
    session.lanes.lanes.forEach((lane) => lane.spans.forEach((one) => onPlot.add(prefixes[side] + one[3])));
  });
  function follow() {
    const id = decodeURIComponent(location.hash.slice(1));
    document.querySelectorAll(".found").forEach((one) => one.classList.remove("found"));
    if (!id) return;
    const name = rowsByKey.get(id);
    if (name !== undefined) {
      const side = several && id.startsWith("b-") ? 1 : 0;
      lists.get(prefixes[side] + name).reveal(id.slice(prefixes[side].length));
    }
    if (id.startsWith("pt-") && !document.getElementById(id)) zoom(0, span);
    const target = document.getElementById(id);
    if (!target) return;
    if (target.tagName === "DETAILS") target.open = true;
    if (target.tagName === "TR" || target.classList.contains("hit")) {
      target.classList.add("found");
      if (target.classList.contains("hit")) target.focus({ preventScroll: true });
      target.scrollIntoView({ block: "center" });
    } else if (target.tagName === "DETAILS" || target.classList.contains("table")) target.scrollIntoView();
  }
  addEventListener("hashchange", follow);
  document.addEventListener("click", (event) => {
    const link = event.target.closest && event.target.closest("a[href^='#']");
    if (link && link.getAttribute("href") === location.hash) follow();
  });

  const range = html("span", { class: "quiet", role: "status" });
  const buttons = [["All", () => zoom(0, span)], ["+", () => scale(0.5)], ["−", () => scale(2)], ["←", () => shift(-0.25)], ["→", () => shift(0.25)]]
    .map(([text, act]) => html("button", { type: "button", text, "aria-label": { All: "Show all of the time", "+": "Zoom in", "−": "Zoom out", "←": "Earlier", "→": "Later" }[text], onclick: act }));
  document.getElementById("zoom").append(html("span", { text: "Time" }), ...buttons, range, html("span", { class: "quiet drag", text: "Drag across a plot to zoom in." }));
  function zoom(begin, end) {
    const wide = Math.min(span, Math.max(end - begin, 1e-6));
    const from = Math.max(0, Math.min(begin, span - wide));
    view = [from, from + wide];
    range.textContent = `${moment(sessions[0], view[0])} – ${moment(sessions[0], view[1])}`;
    redraw(true);
  }
  const scale = (factor) => { const middle = (view[0] + view[1]) / 2, half = ((view[1] - view[0]) * factor) / 2; zoom(middle - half, middle + half); };
  const shift = (share) => zoom(view[0] + (view[1] - view[0]) * share, view[1] + (view[1] - view[0]) * share);
  let brush = null;
  figures.addEventListener("pointerdown", (event) => {
    const root = event.target.closest("svg.timed");
    if (!root || event.button || event.pointerType === "touch" || event.target.closest("a")) return;
    const box = root.getBoundingClientRect(), ratio = root.viewBox.baseVal.width / box.width;
    brush = { root, box, ratio, from: (event.clientX - box.left) * ratio, mark: svg("rect", { class: "brush", y: 4, height: Number(root.dataset.bottom) - 4 }) };
  });
  addEventListener("pointermove", (event) => {
    if (!brush) return;
    const left = Number(brush.root.dataset.left), right = Number(brush.root.dataset.right);
    const bound = (value) => Math.min(right, Math.max(left, value));
    brush.to = bound((event.clientX - brush.box.left) * brush.ratio);
    const one = Math.min(bound(brush.from), brush.to), other = Math.max(bound(brush.from), brush.to);
    if (other - one < 4) return;
    if (!brush.mark.parentNode) brush.root.append(brush.mark);
    brush.mark.setAttribute("x", at(one)); brush.mark.setAttribute("width", at(other - one));
    brush.chosen = [one, other].map((place) => view[0] + ((place - left) / (right - left)) * (view[1] - view[0]));
  });
  addEventListener("pointerup", () => {
    const chosen = brush && brush.chosen;
    if (brush) brush.mark.remove();
    brush = null;
    if (chosen) zoom(chosen[0], chosen[1]);
  });

  const tip = document.getElementById("tip");
  function tell(event) {
    const from = event.target.closest && event.target.closest("[data-tip]");
    const plot = !from && event.target.closest && event.target.closest("svg.timed");
    let said = from ? from.dataset.tip : "";
    if (plot && plot.tipAt && event.clientX !== undefined) {  // thousands of cells in a few elements
      const frame = plot.getBoundingClientRect(), ratio = plot.viewBox.baseVal.width / frame.width;
      said = plot.tipAt((event.clientX - frame.left) * ratio, (event.clientY - frame.top) * ratio);
    }
    if (!said) { tip.hidden = true; return; }
    tip.textContent = said;
    tip.hidden = false;
    const box = (from || plot).getBoundingClientRect();
    const x = event.clientX || box.left + box.width / 2, y = event.clientY || box.bottom;
    const left = Math.max(4, Math.min(x + 14, innerWidth - tip.offsetWidth - 8));
    const top = y + tip.offsetHeight + 20 > innerHeight ? y - tip.offsetHeight - 12 : y + 16;
    tip.style.left = `${left}px`; tip.style.top = `${Math.max(4, top)}px`;
  }
  for (const kind of ["pointermove", "focusin"]) document.addEventListener(kind, tell);
  document.addEventListener("focusout", () => { tip.hidden = true; });
  document.addEventListener("keydown", (event) => { if (event.key === "Escape") tip.hidden = true; });

  // ---- the page -----------------------------------------------------------------------------------------------------------

  figure("rates", `Transactions per ${perWhat}`, "", drawRates, { timed: true, wide: true });
  figure("times", "Answer times", "", drawTimes, { timed: true, wide: true });
  figure("spreads", "Answer times by device and function", "", drawSpreads);
  figure("polls", "Polling periods and jitter", "", drawPolls);
  sessions.forEach((session, side) => {
    const name = (text) => `${several ? `${letters[side]}: ` : ""}${text}`;
    figure(`${prefixes[side]}talks`, name("Who talks to whom"), "", talksOf(session, side));
    figure(`${prefixes[side]}lanes`, name("Operating modes, downloads and other operations"), "", lanesOf(session, side), { timed: true });
    session.tags.series.forEach((tag, number) => figure(`${prefixes[side]}tag-${number + 1}`, name(`${tag.name} at ${tag.host}${tag.unit ? ` in ${tag.unit}` : ""}`), "", tagOf(session, side, tag), { timed: true }));
    const said = [];
    if (session.tags.missing.length) said.push(`The capture holds no value of ${session.tags.missing.join(", ")}.`);
    if (session.tags.not_numbers.length) said.push(`Values that are not single numbers are not drawn: ${session.tags.not_numbers.join(", ")}.`);
    if (session.tags.refused.length) said.push(`Reads or writes of ${session.tags.refused.join(", ")} were refused.`);
    if (session.tags.likely) said.push(`${session.tags.likely}.`);
    if (session.tags.total > session.tags.series.length + session.tags.not_numbers.length) said.push(`${integer(session.tags.total)} tags were found; the first 12 are drawn.`);
    if (said.length) figure(`${prefixes[side]}tags`, name("Tags"), said.join(" "), () => []);
  });
  const place = document.getElementById("lists");
  const tables = sessions[0].tables.map((_, number) => sessions.map((session, side) => [session, side, session.tables[number]]));
  for (const row of tables) {
    const parts = row.filter(([, , table]) => table.rows.length).map(([session, side, table]) => list(session, side, table));
    if (parts.length) place.append(parts.length > 1 ? html("div", { class: "sides broad" }, ...parts) : parts[0]);
  }
  if (!place.childNodes.length) place.append(html("p", { text: "There is nothing to list." }));
  zoom(0, span);
  redraw(false);
  document.getElementById("zoom").hidden = !figures.querySelector("svg.timed");
  let before = innerWidth;
  addEventListener("resize", () => { if (innerWidth !== before) { before = innerWidth; redraw(false); look(); } });
  /** Paper shows what is folded, too. */
  const folded = [];
  addEventListener("beforeprint", () => { for (const one of document.querySelectorAll("details:not([open])")) { one.open = true; folded.push(one); } });
  addEventListener("afterprint", () => { for (const one of folded.splice(0)) one.open = false; });
  look();
  follow();
  document.documentElement.dataset.ready = "yes";
})();
