// @ts-check
// ---- tags -------------------------------------------------------------------------------------------------------------

/** @param {Session} session @param {Tag} tag @returns {Draw} */
function tagOf(session, tag) {
  return (width) => {
    const height = 170, left = 62;
    const [root, x, right, bottom] = timed(width, height, left, tag.name, session, tag.gaps);
    const shown = tag.steps;
    let low = Math.min(...shown.map((step) => step[2]), ...tag.writes.map((write) => write[1])), high = Math.max(...shown.map((step) => step[3]), ...tag.writes.map((write) => write[1]));
    if (low === high) { low -= 1; high += 1; }
    /** @param {number} value */
    const y = (value) => bottom - 6 - ((value - low) / (high - low)) * (bottom - 18);
    vertical(root, left, bottom, tens(low, high), y, plain, right);
    /** @param {number} seconds */
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
      root.append(mark(said, "writer", svg("path", { class: "write", transform: `translate(${at(x(seconds))} ${at(y(value))})`, d: "M0-7L6 6H-6Z" })));
    }
    const writers = [...new Set(tag.writes.map((write) => write[2]))];
    const told = [
      `${counted(tag.values, "value")}.`,
      writers.length ? `Triangles: written by ${writers.slice(0, 4).join(", ")}${writers.length > 4 ? "…" : ""}.` : "",
      tag.writes_not_kept ? `${counted(tag.writes_not_kept, "more write")}.` : "",
      tag.width ? `Gathered in bins of ${round(tag.width * 1e9)}: smallest to largest.` : "",
      "Nothing is drawn across a gap.",
    ];
    return [root, note(told.filter(Boolean).join(" "))];
  };
}
