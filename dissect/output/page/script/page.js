// @ts-check
// ---- the page -----------------------------------------------------------------------------------------------------------

const some = {
  rates: sessions.some((one) => one.rates.bins.length), times: sessions.some((one) => one.times.cells.length),
  spreads: sessions.some((one) => one.spreads.rows.length), polls: sessions.some((one) => one.polls.rows.length),
};
if (some.rates) figure("rates", `Transactions per ${perWhat}`, drawRates, { timed: true, wide: true });
if (some.times) figure("times", "Answer times", drawTimes, { timed: true, wide: true });
if (some.spreads) figure("spreads", "Answer times by device and function", drawSpreads);
if (some.polls) figure("polls", "Polling periods and jitter", drawPolls);
sessions.forEach((session, side) => {
  /** @param {string} text */
  const name = (text) => `${several ? `${letters[side]}: ` : ""}${text}`;
  if (session.talks.pairs.length) figure(`${prefixes[side]}talks`, name("Who talks to whom"), talksOf(session, side));
  if (session.lanes.lanes.length) figure(`${prefixes[side]}lanes`, name("Operating modes, downloads and other operations"), lanesOf(session, side), { timed: true });
  const tags = session.tags;
  tags.series.forEach((tag, number) => figure(`${prefixes[side]}tag-${number + 1}`, name(`${tag.name} at ${tag.host}${tag.unit ? ` in ${tag.unit}` : ""}`), tagOf(session, tag), { timed: true }));
  const said = [
    tags.missing.length ? `The capture holds no value of ${tags.missing.join(", ")}.` : "",
    tags.not_numbers.length ? `Values that are not single numbers are not drawn: ${tags.not_numbers.join(", ")}.` : "",
    tags.refused.length ? `Reads or writes of ${tags.refused.join(", ")} were refused.` : "",
    tags.likely ? `${tags.likely}.` : "",
    tags.total > tags.series.length + tags.not_numbers.length ? `${counted(tags.total, "tag")} found; the first 12 are drawn.` : "",
  ].filter(Boolean);
  if (said.length) figure(`${prefixes[side]}tags`, name("Tags"), () => [note(said.join(" "))]);
});
if (!figures.childNodes.length) figures.append(html("p", { text: "There is nothing to draw." }));
const place = byId("lists");
for (const [number] of sessions[0].tables.entries()) {
  const parts = sessions.flatMap((session, side) => (session.tables[number].rows.length ? [list(session, side, session.tables[number])] : []));
  if (parts.length) place.append(parts.length > 1 ? html("div", { class: "sides broad" }, ...parts) : parts[0]);
}
if (!place.childNodes.length) place.append(html("p", { text: "There is nothing to list." }));
const cardsAt = byId("cards");
drawCards(cardsAt);
for (const one of document.querySelectorAll("#plcs, nav a[href='#plcs']")) if (one instanceof HTMLElement) one.hidden = !cardsAt.childNodes.length;
redraw(false);
zoom(0, span);
byId("zoom").hidden = !figures.querySelector("svg.timed");
let before = innerWidth;
addEventListener("resize", () => { if (innerWidth !== before) { before = innerWidth; redraw(false); look(); } });
/** Paper shows what is folded, too. @type {HTMLDetailsElement[]} */
const folded = [];
addEventListener("beforeprint", () => {
  for (const one of document.querySelectorAll("details")) {
    if (one.open) continue;
    one.open = true;
    folded.push(one);
  }
});
addEventListener("afterprint", () => { for (const one of folded.splice(0)) one.open = false; });
look();
follow(named(location.hash));
document.documentElement.dataset.ready = "yes";
