// @ts-check
// ---- sizes and times in words ----------------------------------------------------------------------------------------

/** A round duration, of a tick or a bin: without the decimals that are zero. @param {number} ns @returns {string} */
function round(ns) {
  const size = Math.abs(ns);
  if (size === 0) return "0 s";
  if (size < 1e3) return `${Math.round(ns)} ns`;
  /** @type {[number, number, string][]} */
  const units = [[1e6, 1e3, "µs"], [1e9, 1e6, "ms"], [120e9, 1e9, "s"], [7200e9, 60e9, "min"], [172800e9, 3600e9, "h"], [Infinity, 86400e9, "d"]];
  for (const [limit, factor, unit] of units) {
    if (size < limit) {
      const value = ns / factor;
      return `${Math.abs(value) >= 100 ? Math.round(value) : Number(value.toPrecision(3))} ${unit}`;
    }
  }
  return "";
}
/** @param {number | null | undefined} octets @returns {string} */
function size(octets) {
  if (octets === null || octets === undefined) return "–";
  /** @type {[string, number][]} */
  const units = [["GB", 1e9], ["MB", 1e6], ["kB", 1e3]];
  for (const [unit, factor] of units) if (octets >= factor) return `${(octets / factor).toFixed(1)} ${unit}`;
  return `${octets} B`;
}
/** @param {number} number */
const plain = (number) => (Number.isInteger(number) ? String(number) : String(Number(number.toPrecision(6))));
/** @param {number} number */
const two = (number) => String(number).padStart(2, "0");
/** The zone of a session at a time: [from, seconds ahead of UTC, name]. @param {Session} session @param {number} seconds */
const zone = (session, seconds) => session.zones.filter(([from]) => from <= seconds).at(-1) || session.zones[0];
/** A time as the clock of its zone shows it, or null where the calendar has none. @param {Session} session @param {number} seconds */
function local(session, seconds) {
  const when = new Date(Math.round((session.start_ms + zone(session, seconds)[1] * 1e3 + seconds * 1e3) * 1e3) / 1e3);
  return Number.isNaN(when.getTime()) ? null : when;
}
/** @param {Session} session @param {number} seconds */
function day(session, seconds) {
  const when = local(session, seconds);
  return when ? `${when.getUTCFullYear()}-${two(when.getUTCMonth() + 1)}-${two(when.getUTCDate())}` : "";
}
/** Where the day begins that times need: 10 for none, 5 for month and day past midnight, 0 for the year as well. */
const dated = sessions.map((one) => {
  const [first, last] = [day(one, 0), day(one, one.span)];
  return first === last ? 10 : first.slice(0, 4) === last.slice(0, 4) ? 5 : 0;
});
/** The time of day, as exact as a step of a scale needs. @param {Session} session @param {number} seconds @param {number} step */
function ofDay(session, seconds, step) {
  const when = local(session, seconds);
  if (several || !when) return `+${round(seconds * 1e9)}`;
  const hours = `${two(when.getUTCHours())}:${two(when.getUTCMinutes())}`;
  if (step >= 60) return hours;
  const all = `${hours}:${two(when.getUTCSeconds())}`;
  if (step >= 1) return all;
  const digits = Math.min(6, Math.max(1, -Math.floor(Math.log10(step) + 1e-9)));
  const precise = session.start_ms / 1e3 + zone(session, seconds)[1] + seconds;
  const part = (precise - Math.floor(precise)).toFixed(digits);
  return all + (part.startsWith("1") ? "." + "9".repeat(digits) : part.slice(1));
}
/** A time with its date, where the session has more than one day. @param {Session} session @param {number} seconds @param {number} step */
function clock(session, seconds, step) {
  const from = dated[sessions.indexOf(session)];
  return several || from === 10 ? ofDay(session, seconds, step) : `${day(session, seconds).slice(from)} ${ofDay(session, seconds, step)}`;
}
/** @param {Session} session @param {number} seconds */
const moment = (session, seconds) => `${clock(session, seconds, 1e-3)} ${several ? "" : zone(session, seconds)[2]}`.trim();
/** A time in UTC that programs read, to the microsecond. @param {Session} session @param {number} seconds */
function iso(session, seconds) {
  const us = BigInt(Math.round(session.start_ms * 1e3)) + BigInt(Math.round(seconds * 1e6));
  const when = new Date(Number(us / 1000n));
  return Number.isNaN(when.getTime()) ? "" : `${when.toISOString().slice(0, -1)}${String(us % 1000n).padStart(3, "0")}Z`;
}
