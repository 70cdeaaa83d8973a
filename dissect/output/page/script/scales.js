// @ts-check
// ---- scales -------------------------------------------------------------------------------------------------------

const SECONDS = [...[-6, -5, -4, -3, -2, -1].flatMap((power) => [1, 2, 5].map((one) => Number(`${one}e${power}`))),
  1, 2, 5, 10, 15, 30, 60, 120, 300, 600, 900, 1800, 3600, 7200, 14400, 21600, 43200, ...[1, 2, 7, 14, 28, 91, 182, 365].map((days) => days * 86400)];
/** Ticks at round times, as many as `fits(step)` says there is room for; `zero` is the time at 0.
 * @param {number} begin @param {number} end @param {(step: number) => number} fits @param {number} zero @returns {[number, number[]]} */
function steps(begin, end, fits, zero = 0) {
  const step = SECONDS.find((one) => (end - begin) / one <= fits(one)) || SECONDS[SECONDS.length - 1];
  const found = [];
  const shift = ((zero % step) + step) % step;
  for (let tick = Math.ceil((begin + shift) / step - 1e-9) * step - shift; tick <= end + step * 1e-6 && found.length < 50; tick += step) found.push(tick);
  return [step, found];
}
/** Round numbers from 0 to at least `high`; of counts of things, whole ones. @param {number} high @param {number} wanted */
function upwards(high, wanted) {
  const rough = Math.max(high, 1e-9) / wanted, base = 10 ** Math.floor(Math.log10(rough));
  const step = Math.max([1, 2, 5, 10].map((one) => one * base).find((one) => one >= rough * 0.999) || base, high >= 1 ? 1 : 0);
  const found = [0];
  for (let number = 1; found[number - 1] < high * 0.999; number += 1) found.push(Number((number * step).toPrecision(12)));
  return found;
}
/** Two to five round numbers between two numbers. @param {number} low @param {number} high */
function tens(low, high) {
  const base = 10 ** Math.floor(Math.log10((high - low) / 2));
  const step = [5, 2, 1, 0.5].map((one) => one * base).find((one) => (high - low) / one >= 2) || base;
  const found = [];
  for (let tick = Math.ceil(low / step) * step; tick <= high + step * 1e-9 && found.length < 8; tick += step) found.push(Number(tick.toPrecision(12)));
  return found;
}
/** Powers of ten: the first, the last, all. @param {number} low @param {number} high @returns {[number, number, number[]]} */
function decades(low, high) {
  const begin = Math.floor(Math.log10(Math.max(low, 1)));
  const end = Math.max(begin + 1, Math.ceil(Math.log10(Math.max(high, 10))));
  const ticks = [];
  for (let one = begin; one <= end; one += 1) ticks.push(10 ** one);
  return [10 ** begin, 10 ** end, ticks];
}
/** The shortest duration of a bucket of a distribution, in nanoseconds (`lower_end`). @param {number} number */
function lowerEnd(number) {
  if (number < 64) return number;
  const shift = Math.floor(number / 32) - 1;
  return (number - 32 * shift) * 2 ** shift;
}
/** Answer times over time: seconds, shortest, longest, how many. @param {Density} of @returns {Cells} */
function cellsOf(of) {
  of.made ||= of.cells.map(([bin, band, count]) => [of.origin + bin * of.width, lowerEnd(band * of.step), lowerEnd((band + 1) * of.step), count]);
  return of.made;
}
/** Answers that seem to come sooner are of reordered packets; they stand at the edge of a plot. */
const SHORTEST = 1e3;
/** @param {number} low @param {number} high @param {number} from @param {number} to @returns {(value: number) => number} */
const logScale = (low, high, from, to) => (value) => from + ((Math.log10(Math.max(value, low)) - Math.log10(low)) / (Math.log10(high) - Math.log10(low))) * (to - from);
