// What the page holds as JSON (dissect/output/page/data.py), and what its script makes of it. Times are seconds after the start of a
// session, durations nanoseconds.
type Cell = string | number | null;
type Kind = "text" | "short" | "number" | "seconds" | "duration" | "size" | "id";
type Child = Node | string | false | null | undefined | 0 | "";
type Attributes = Record<string, string | number | boolean | null | undefined | ((event: any) => void)>;

/** How to see a row elsewhere: what follows `s7dissect`, the number of the file, the filter for Wireshark. */
interface How { show: string; filter: string; in?: number }
interface Row extends How { key: string; cells: Cell[]; until?: number; text?: string }
interface Counts { width: number; bins: [number, number][] }
interface Table {
  name: string; title: string; columns: [string, Kind][]; rows: Row[]; total: number;
  note?: string; all?: string; counts?: Counts; ended?: Counts;
}
type Gap = [begin: number, end: number, why: string, idle: number];
type Cells = [seconds: number, low: number, high: number, count: number][];
/** Answer times over time as the page holds them, and their cells once they were asked for (`cellsOf`). */
interface Density { width: number; origin: number; step: number; cells: [bin: number, band: number, count: number][]; made?: Cells }
interface Spread {
  key: string; host: string; function: string; count: number; errors: number; missed: number; min: number; median: number;
  p95: number; max: number; bands: [number, number, number][];
}
interface Poll {
  key: string; host: string; subject: string; count: number; p5: number; median: number; p95: number; min: number; max: number;
  jitter: number;
}
interface Pair {
  client: string; server: string; search: string; connections: number; pdus: number; octets: number; errors: number;
  missed: number; worst: string;
  /** Only where no connection of the pair has a row: the command that shows them. */
  show?: string;
}
type LaneSpan = [begin: number, end: number, kind: string, key: string, what: string];
interface Lane { host: string; spans: LaneSpan[]; modes: [number, string, number][] }
interface Tag {
  name: string; host: string; unit: string; width: number; end: number; values: number;
  steps: [time: number, first: number, smallest: number, largest: number, last: number, broken: number][];
  writes: [time: number, value: number, writer: string, packet: number][]; writes_not_kept: number; gaps: Gap[];
}
interface Card {
  key: string; host: string; identity: [string, string][];
  clients: [name: string, connections: number, transactions: number, reads: number, writes: number, errors: number, missed: number, did: string][];
  more_clients: number; writers: [name: string, did: string][];
  polls: [client: string, subject: string, count: number, period: number, key: string][]; more_polls: number;
  refused: [address: string, count: number, why: string][]; more_refused: number;
  modes: [seconds: number, mode: string, packet: number][];
  slowest: [answer: number, seconds: number, function: string, what: string, key: string][];
  times: Density;
}
interface Session {
  name: string; start_ms: number; span: number;
  zones: [from: number, ahead: number, name: string][];
  command: { options: string; bare: string; without: string[]; all: string; files: string[] };
  rates: { width: number; names: string[]; bins: number[][] };
  times: Density;
  points: [seconds: number, answer: number, key: string, what: string][];
  spreads: { rows: Spread[]; total: number; not_told_apart: number };
  polls: { rows: Poll[]; total: number; not_followed: number };
  talks: { pairs: Pair[]; total: number };
  lanes: { lanes: Lane[]; total: number; not_drawn: number };
  tags: { series: Tag[]; missing: string[]; not_numbers: string[]; refused: string[]; likely: string; total: number };
  gaps: Gap[]; gaps_not_drawn: number;
  marks: { marks: [seconds: number, severity: string, slug: string, detail: string][]; total: number };
  plcs: { rows: Card[]; total: number };
  tables: Table[];
}
/** A plot over time: how it says what is below the pointer. */
interface SVGSVGElement { tipAt?: (x: number, y: number) => string }
/** What other parts of the page ask of a table. */
interface List { search(text: string): void; reveal(key: string): void; follow(): void }
