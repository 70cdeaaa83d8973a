// @ts-check
// ---- numbers in words, here and in the browser edition ------------------------------------------------------------

/** @param {number} number */
const integer = (number) => String(Math.round(number)).replace(/\B(?=(\d{3})+$)/g, ",");
/** A number with so many decimals; a tie goes to the even digit, as in every other output. @param {number} value @param {number} digits */
function fixed(value, digits) {
  const scale = 10 ** digits, scaled = value * scale;
  if (!Number.isInteger(value * 8) || Math.abs(scaled % 1) !== 0.5) return value.toFixed(digits);
  const below = Math.floor(scaled);
  return ((below % 2 ? below + 1 : below) / scale).toFixed(digits);
}
/** A duration as the commands write it (`duration_text`). @param {number | null | undefined} measured @returns {string} */
function duration(measured) {
  if (measured === null || measured === undefined) return "–";
  const ns = Math.round(measured), size = Math.abs(ns);
  if (size > 0 && size < 1e4) return `${fixed(ns / 1e3, 1)} µs`;
  if (size < 999500) return `${fixed(ns / 1e3, 0)} µs`;
  if (size < 99995000) return `${fixed(ns / 1e6, 2)} ms`;
  if (size < 999500000) return `${fixed(ns / 1e6, 0)} ms`;
  if (size < 600e9) return `${fixed(ns / 1e9, 2)} s`;
  const seconds = Math.floor(size / 1e9);
  /** @type {[number, string][]} */
  const units = [[Math.floor(seconds / 86400), "d"], [Math.floor(seconds / 3600) % 24, "h"], [Math.floor(seconds / 60) % 60, "min"], [seconds % 60, "s"]];
  const said = units.slice(units.findIndex(([number]) => number > 0)).map(([number, unit]) => `${number} ${unit}`);
  return (ns < 0 ? "-" : "") + said.join(" ");
}
/** @param {number} number @param {string} one @param {string} [many] */
const counted = (number, one, many) => `${integer(number)} ${number === 1 ? one : many || `${one}s`}`;
