"""The places of numbers in the output of `analyze`, `--brief`, `devices`, `operations` and `transactions`, each with its count.

A function finds the sentences of some kinds in one output and yields a `Claim` for every number, name or time in them.
`tests.recount.pages` does the same for the report page, the screens, alerts and exports.
"""

from __future__ import annotations

import re
from collections.abc import Callable, Iterable, Iterator, Mapping
from typing import Final

from tests.recount.counted import EACH, RULES, host_of
from tests.recount.details import DETAILS
from tests.recount.pages import PAGES
from tests.recount.recount import (
    DURATION,
    Capture,
    Claim,
    Json,
    Kind,
    Reader,
    answered,
    ended_ns,
    is_size,
    is_time_of_day,
    latencies,
    likely,
    median,
    not_captured,
    one_way,
    orphans,
    pushes,
    quantile,
    still_open,
    unanswered,
    with_errors,
)

Count = Callable[[Iterable[Json]], int]

#: Counts of transactions in a list after a number: in the headline, of a connection, of a host.
SAID: Final[tuple[tuple[str, str, Count], ...]] = (
    ("answered", r"(\d+) answered", answered),
    ("only likely", r"(\d+) only likely", likely),
    ("unanswered", r"(\d+) unanswered", unanswered),
    ("not captured", r"(\d+) answers? not captured", not_captured),
    ("still open", r"(\d+) still open", still_open),
    ("with errors", r"(\d+) (?:of them )?with errors", with_errors),
    ("without request", r"(\d+) answers? without request", orphans),
    ("pushes", r"(\d+) push(?:es)?", pushes),
    ("one way", r"(\d+) one-way", one_way),
)


def said_of(reader: Reader, kind: str, begin: int, end: int, rows: list[Json]) -> Iterator[Claim]:
    """Yield the claims of `SAID` in a part of a text; counts that are not mentioned must be 0."""
    for name, pattern, count in SAID:
        found = re.compile(pattern).search(reader.text, begin, end)
        if found is not None:
            yield reader.number(f"{kind}: {name}", found, 1, count(rows))
        elif count(rows) and name in {"answered", "unanswered", "with errors"}:
            yield Claim(f"{kind}: {name}", reader.face, begin, end, "nothing", str(count(rows)), False)


# ---- analyze --------------------------------------------------------------------------------------------------------


def head(capture: Capture, reader: Reader) -> Iterator[Claim]:
    """Packets, size, first time and span of the file, and how many PDUs there are."""
    packets = capture.packets
    found = re.search(r"^\S+: (\d+) packets?, (.+?)(?: compressed.*)?$", reader.text, re.MULTILINE)
    if packets is not None and found is not None:
        yield reader.number("head: packets", found, 1, len(packets))
        size = capture.path.stat().st_size
        if re.fullmatch(r"[\d.]+ k?M?B", found[2]):
            yield reader.claim("head: size of the file", found, 2, size, is_size(found[2], size))
    times = [packet.time_ns for packet in packets or []]
    found = re.search(rf"^  from (\S+ \S+ UTC), ({DURATION})$", reader.text, re.MULTILINE)
    if times and found is not None:
        yield reader.moment("head: first packet", found, 1, times[0])
        yield reader.duration("head: span", found, 2, times[-1] - times[0])
    for name, protocol in (("S7", "s7comm"), ("S7comm-plus", "s7comm_plus")):
        found = re.search(rf"^  (?:.*, )?(\d+) {name} PDUs?\b", reader.text, re.MULTILINE)
        if found is not None:
            number = sum([one["protocol"] == protocol for one in capture.s7_pdus])
            yield reader.number(f"head: {name} PDUs", found, 1, number)
    found = re.search(r"^  \d+ of (\d+) packets? used", reader.text, re.MULTILINE)
    if packets is not None and found is not None:
        yield reader.number("completeness: of packets", found, 1, len(packets))


def headline(capture: Capture, reader: Reader) -> Iterator[Claim]:
    """The line "Transactions: 8 answered, 7 with errors"."""
    found = re.search(r"^Transactions: .*$", reader.text, re.MULTILINE)
    if found is not None:
        yield from said_of(reader, "headline", *found.span(), capture.transactions)


_CONNECTION: Final = re.compile(
    r"^  (\d+)  (\S+) [→↔] (\S+?)(?:,.*)?\n(?:     .*\n)*?     ((?:\d+ PDUs?|no S7 PDU)\b[^;\n]*)", re.MULTILINE
)


def connections(capture: Capture, reader: Reader) -> Iterator[Claim]:
    """The connections: their ends, PDUs, and the results of their requests."""
    for found in _CONNECTION.finditer(reader.text):
        number = int(found[1])
        rows = capture.by_connection.get(number, [])
        ends = capture.ends_of.get(number)
        if ends is not None:
            for group in (2, 3):
                right = found[group] in ends
                yield reader.claim("connection: who", found, group, " or ".join(ends), right)
        counts = re.compile(r"(\d+|no)(?: S7)? PDUs?").match(reader.text, found.start(4))
        assert counts is not None
        yield reader.number("connection: PDUs", counts, 1, capture.pdus_of[number])
        yield from said_of(reader, "connection", *found.span(4), rows)


_TABLE: Final = re.compile(r"^  function +count .*\n(?:  .*\n)*", re.MULTILINE)
_COLUMNS: Final[Mapping[str, Count]] = {
    "count": lambda rows: len(list(rows)),
    "errors": with_errors,
    "no answer": unanswered,
    "still open": still_open,
    "not captured": not_captured,
    "no request": orphans,
    "only likely": likely,
}


def functions(capture: Capture, reader: Reader) -> Iterator[Claim]:
    """The table of functions: number of transactions and answer times."""
    table = _TABLE.search(reader.text)
    if table is None:
        return
    lines = table[0].splitlines()
    heads = re.split(r"  +", lines[0].strip())
    at = table.start() + len(lines[0]) + 1
    for line in lines[1:]:
        cells = list(re.finditer(r"\S+(?: \S+)*", line))
        if len(cells) == len(heads):
            rows = [one for one in capture.transactions if one["name"] == cells[0][0]]
            cells = cells if rows else []  # a function without a name
            heads_ = heads if rows else []
            for name, cell in zip(heads_[1:], cells[1:], strict=True):
                found = re.compile(re.escape(cell[0])).match(reader.text, at + cell.start())
                assert found is not None
                yield from _cell(reader, name, found, rows)
        at += len(line) + 1


def _cell(reader: Reader, name: str, found: re.Match[str], rows: list[Json]) -> Iterator[Claim]:
    times = latencies(rows)
    if name in _COLUMNS:
        yield reader.number(f"per function: {name}", found, 0, _COLUMNS[name](rows))
    elif name in {"median", "95 %", "max"}:
        if not times:
            yield reader.claim(f"per function: {name}", found, 0, "-", found[0] == "-")
        else:
            ns = {"median": median(times), "95 %": quantile(times, 0.95), "max": times[-1]}[name]
            yield reader.duration(f"per function: {name}", found, 0, ns)


_ROW: Final = re.compile(rf"^ +#(\d+)  (\d+|\?)→(\d+|\?) +({DURATION}|-)  ", re.MULTILINE)


def _part(reader: Reader, title: str) -> tuple[int, int]:
    found = re.search(rf"^{title}.*\n(?:.+(?:\n|\Z))*", reader.text, re.MULTILINE)
    return found.span() if found is not None else (0, 0)


def rows_of(capture: Capture, reader: Reader, kind: str, begin: int, end: int) -> Iterator[tuple[Claim, Json]]:
    """Yield the claims of rows of transactions: number, packets, answer time."""
    for found in _ROW.finditer(reader.text, begin, end):
        one = capture.by_number.get(int(found[1]))
        if one is None:
            yield reader.claim(f"{kind}: number", found, 1, "no such transaction", False), {}
            continue
        for group, name in ((2, "request_frame"), (3, "response_frame")):
            frame = "?" if one[name] is None else str(one[name])
            yield reader.word(f"{kind}: packets", found, group, frame), one
        if found[4] != "-":
            yield reader.duration(f"{kind}: answer time", found, 4, one["latency_ns"]), one


def failed(capture: Capture, reader: Reader) -> Iterator[Claim]:
    """Failed transactions: their number, packets and answer times."""
    begin, end = _part(reader, "Failed transactions")
    rows = [one for one in capture.transactions if one["errors"] or one["missed"]]
    found = re.compile(r"first (\d+) of (\d+)").search(reader.text, begin, end)
    if found is not None:
        yield reader.number("failed: of all", found, 2, len(rows))
    numbers = [int(one[1]) for one in _ROW.finditer(reader.text, begin, end)]
    if found is not None:
        yield reader.number("failed: first so many", found, 1, len(numbers))
    for claim, one in rows_of(capture, reader, "failed", begin, end):
        yield claim if not one or one in rows else claim._replace(right=False, counted="did not fail")


def slowest(capture: Capture, reader: Reader) -> Iterator[Claim]:
    """The slowest answers, one after the other."""
    begin, end = _part(reader, "Slowest answers")
    for claim, _ in rows_of(capture, reader, "slowest", begin, end):
        yield claim
    times = latencies(capture.transactions)[::-1]
    for at, found in enumerate(_ROW.finditer(reader.text, begin, end)):
        one = capture.by_number.get(int(found[1]))
        right = one is not None and one["latency_ns"] == times[at]
        yield reader.claim("slowest: rank", found, 1, f"one of {times[at]} ns", right)


# ---- findings -------------------------------------------------------------------------------------------------------

_FINDING: Final = re.compile(
    r"^  (?:error|warning|note) +(\S+?)(?: \((\d+) times\))?: .*\n((?:      .*\n)*)", re.MULTILINE
)


def findings(capture: Capture, reader: Reader) -> Iterator[Claim]:
    """How often rules applied, since when and until when, on how many connections, and the findings that are shown."""
    for found in _FINDING.finditer(reader.text):
        yield from _explained_too(capture, reader, found)
        events = capture.events(RULES, found[1])
        if events is None:
            continue
        if found[2]:
            yield reader.number("finding: times it happened", found, 2, len(events))
        else:
            yield reader.claim("finding: times it happened", found, 1, len(events), len(events) == 1)
        yield from _facts(reader, found, events)
        yield from _shown(reader, found, events, found[1] in EACH)


def _explained_too(capture: Capture, reader: Reader, found: re.Match[str]) -> Iterator[Claim]:
    """For a rule that other findings sometimes explain, both together are all events."""
    because = capture.explained.get(found[1], 0)
    if because and found[1] in EACH and found[2]:
        events = RULES[found[1]](capture.transactions)
        if events is not None:
            yield reader.number("finding: times besides those explained", found, 2, len(events) - because)


def _facts(reader: Reader, finding: re.Match[str], events: list[Json]) -> Iterator[Claim]:
    pattern = re.compile(
        r"^      (\d+) [a-z ]+? on (\d+) connections?,"
        r"(?: at ([\d:.]+)$| ([\d:.]+) to ([\d:.]+)$| (\S+ \S+) to (\S+ \S+)$)?",
        re.MULTILINE,
    )
    found = pattern.search(reader.text, *finding.span(3))
    if found is None:
        return
    yield reader.number("facts: events", found, 1, len(events))
    yield reader.number("facts: connections", found, 2, len({one["connection"] for one in events}))
    times = sorted([ended_ns(one) for one in events])
    for group, ns in ((4, times[0]), (5, times[-1])):
        if found[group]:
            name = "first" if group == 4 else "last"
            yield reader.claim(f"facts: {name}", found, group, ns, is_time_of_day(found[group], ns))


def _shown(reader: Reader, finding: re.Match[str], events: list[Json], each: bool) -> Iterator[Claim]:
    """Check the packets of the findings that are shown, and the number of the others."""
    begin, end = finding.span(3)
    shown = 0
    frames = [{one["request_frame"], one["response_frame"]} - {None} for one in events]
    for found in re.compile(r"^      connection (\d+), packets? ([\d, ]+): ", re.MULTILINE).finditer(
        reader.text, begin, end
    ):
        numbers = {int(number) for number in found[2].split(", ")}
        if each and shown < len(events):
            yield reader.number("finding: connection", found, 1, events[shown]["connection"])
            yield reader.claim("finding: packets", found, 2, sorted(frames[shown]), numbers == frames[shown])
        else:
            mine = [one for one, both in zip(events, frames, strict=True) if numbers == both]
            yield reader.claim("finding: packets", found, 2, "packets of such a transaction", bool(mine))
            if mine:
                yield reader.number("finding: connection", found, 1, mine[0]["connection"])
        shown += 1
    more = re.compile(r"^      and (\d+) more(?:: packets? ([\d, ]+))?", re.MULTILINE).search(reader.text, begin, end)
    if more is not None:
        yield reader.number("finding: more", more, 1, len(events) - shown)
        if more[2]:
            every = set().union(*frames)
            right = {int(number) for number in re.findall(r"\d+", more[2])} <= every
            yield reader.claim("finding: packets of more", more, 2, "packets of these transactions", right)


def gaps(capture: Capture, reader: Reader) -> Iterator[Claim]:
    """Bytes missing from the capture, if they can be counted in the simple way."""
    found = re.search(r"^  \d+ gaps? in the TCP streams, (\d+) bytes? missing", reader.text, re.MULTILINE)
    if found is not None and capture.missing is not None and capture.missing[0]:
        yield reader.number("completeness: bytes missing", found, 1, capture.missing[0])


# ---- brief ----------------------------------------------------------------------------------------------------------

_PLC: Final = re.compile(r"^  (\S+) +(\d+) +(\d+|\.) +(\d+|\.) +(\d+|\.) +(\d+|\.)$", re.MULTILINE)


def brief(capture: Capture, reader: Reader) -> Iterator[Claim]:
    """The rows of servers and of connections, and how often rules applied."""
    begin, end = (0, 0) if capture.in_vlans else _part(reader, "PLCs")
    servers = servers_of(capture)
    for found in _PLC.finditer(reader.text, begin, end):
        numbers = [number for number, server in servers.items() if server == found[1]]
        rows = [one for one in capture.transactions if one["connection"] in numbers]
        if not numbers:
            continue
        yield reader.number("brief: PDUs of a PLC", found, 3, sum([capture.pdus_of[number] for number in numbers]))
        for group, name, count in ((4, "answered", answered), (5, "errors", with_errors), (6, "no answer", unanswered)):
            yield reader.number(f"brief: {name} of a PLC", found, group, count(rows))
    for found in re.finditer(r"^ +(\d+)  (\S+) [→↔] (\S+?)(?: UDP)?  .*?  (\d+) PDUs?(.*)$", reader.text, re.MULTILINE):
        number = int(found[1])
        yield reader.number("brief: PDUs of a connection", found, 4, capture.pdus_of[number])
        errors = re.compile(r"(\d+) with errors").search(reader.text, *found.span(5))
        if errors is not None:
            yield reader.number("brief: errors of a connection", errors, 1, with_errors(capture.by_connection[number]))
    for found in re.finditer(
        r"^  (?:error|warning|note) +(\S+?) \((\d+)(?: [a-z ]+? on .*?)?\): ", reader.text, re.MULTILINE
    ):
        events = capture.events(RULES, found[1])
        if events is not None:
            yield reader.number("brief: times it happened", found, 2, len(events))


def servers_of(capture: Capture) -> dict[int, str]:
    """Return the host of the server of each connection: the end that answers setups and connect requests."""
    found: dict[int, str] = {}
    for one in capture.pdus:
        cotp = one.get("cotp") or {}
        if cotp.get("type") == "CR":
            found.setdefault(one["connection"], host_of(one["dst"]))
    for one in capture.transactions:
        if one["outcome"] != "unsolicited":
            found.setdefault(one["connection"], host_of(one["answered_by"]))
    for one in capture.transactions:
        found.setdefault(one["connection"], host_of(one["answered_by"]))
    for number, ends in capture.ends_of.items():
        for end in ends:
            if end.endswith(":102"):
                found.setdefault(number, host_of(end))
    return found


# ---- devices --------------------------------------------------------------------------------------------------------

_CARD: Final = re.compile(r"^(\S+)  (?:CPU|S7 server|engineering|panel|OPC|unknown)\b.*\n((?:  .*\n)*)", re.MULTILINE)


def devices(capture: Capture, reader: Reader) -> Iterator[Claim]:
    """The card of each device: its answers and their times, and the requests of each client."""
    if capture.in_vlans:
        return
    servers = servers_of(capture)
    for card in _CARD.finditer(reader.text):
        rows = [one for one in capture.transactions if host_of(one["answered_by"]) == card[1]]
        yield from _answers(reader, card, rows)
        pattern = re.compile(r"^  (asked by|asks) +(\S+): (\d+) connections?\b(.*)$", re.MULTILINE)
        for found in pattern.finditer(reader.text, *card.span(2)):
            client, server = (found[2], card[1]) if found[1] == "asked by" else (card[1], found[2])
            talk = [
                one
                for one in capture.transactions
                if servers.get(one["connection"]) == server
                and {host_of(one["asked_by"]), host_of(one["answered_by"])} == {client, server}
            ]
            numbers = {
                number
                for number, ends in capture.ends_of.items()
                if {host_of(end) for end in ends} == {client, server} and servers.get(number) == server
            }
            if numbers:
                yield reader.number("device: connections of a pair", found, 3, len(numbers))
            errors = re.compile(r"; (\d+) with errors$").search(reader.text, *found.span(4))
            if errors is not None:
                yield reader.number("device: errors of a pair", errors, 1, with_errors(talk))
    yield from _matrix(capture, reader, servers)


def _answers(reader: Reader, card: re.Match[str], rows: list[Json]) -> Iterator[Claim]:
    found = re.compile(r"^  answers +(.*)$", re.MULTILINE).search(reader.text, *card.span(2))
    if found is None:
        return
    for name, pattern, count in SAID[:3] + SAID[5:6]:
        number = re.compile(pattern).search(reader.text, *found.span(1))
        if number is not None:
            yield reader.number(f"device: {name}", number, 1, count(rows))
    times = latencies(rows)
    quantiles = re.compile(rf"median ({DURATION}), 95 % ({DURATION})").search(reader.text, *found.span(1))
    if quantiles is not None and times:
        yield reader.duration("device: median", quantiles, 1, median(times))
        yield reader.duration("device: 95 %", quantiles, 2, quantile(times, 0.95))


def _matrix(capture: Capture, reader: Reader, servers: Mapping[int, str]) -> Iterator[Claim]:
    begin, end = _part(reader, "Who talks to whom")
    lines = list(re.compile(r"^.+$", re.MULTILINE).finditer(reader.text, begin, end))
    if len(lines) < 2 or " in VLAN " in reader.text[begin:end]:
        return
    heads = lines[1][0].split()
    for line in lines[2:]:
        cells = list(re.compile(r"\S+").finditer(reader.text, *line.span()))
        if len(cells) != len(heads) + 1:
            continue
        for server, cell in zip(heads, cells[1:], strict=True):
            talk = [
                one
                for one in capture.transactions
                if servers.get(one["connection"]) == server
                and {host_of(one["asked_by"]), host_of(one["answered_by"])} == {cells[0][0], server}
            ]
            yield reader.number("device: transactions of a pair", cell, 0, len(talk))


# ---- lines ----------------------------------------------------------------------------------------------------------

_LINE: Final = re.compile(
    rf"^(\S+ \S+ UTC)  #(\d+) +(\d+|\?)→(\d+|\?) +(\S+) → (\S+?)(?::\d+)? +({DURATION}|-)  ", re.MULTILINE
)


def transactions(capture: Capture, reader: Reader) -> Iterator[Claim]:
    """The lines of `transactions`: time, packets, and duration."""
    for found in _LINE.finditer(reader.text):
        one = capture.by_number[int(found[2])]
        at = one["request_time"] or one["response_time"]
        if at:
            yield reader.moment("line: time", found, 1, ended_ns({**one, "latency_ns": 0}))
        for group, name in ((3, "request_frame"), (4, "response_frame")):
            yield reader.word("line: packets", found, group, "?" if one[name] is None else str(one[name]))
        yield reader.word("line: who", found, 5, one["asked_by" if one["request_frame"] else "answered_by"])
        if found[7] != "-":
            yield reader.duration("line: answer time", found, 7, one["latency_ns"])


def operations(capture: Capture, reader: Reader) -> Iterator[Claim]:
    """The lines of `operations`: begin and duration, by the times of their packets."""
    for found in _LINE.finditer(reader.text):
        first, last = capture.time_ns(int(found[3])), capture.time_ns(int(found[4])) if found[4] != "?" else None
        if first is not None:
            yield reader.moment("operation: time", found, 1, first)
        if first is not None and last is not None and found[7] != "-":
            yield reader.duration("operation: duration", found, 7, last - first)


_OWN: Final[Mapping[str, tuple[Kind, ...]]] = {
    "analyze.txt": (head, headline, connections, functions, failed, slowest, findings, gaps),
    "brief.txt": (brief,),
    "devices.txt": (devices,),
    "transactions.txt": (transactions,),
    "operations.txt": (operations,),
}
#: The functions for each output.
KINDS: Final[Mapping[str, tuple[Kind, ...]]] = {
    face: (*_OWN.get(face, ()), *PAGES.get(face, ()), *DETAILS.get(face, ())) for face in (*_OWN, *PAGES)
}
