"""The places of numbers in the report page, on the screens, in alerts and in exports (see `tests.recount.kinds`)."""

from __future__ import annotations

import json
import re
from collections import Counter
from collections.abc import Iterator, Mapping
from typing import Final

from tests.recount.counted import EACH, RULES, host_of
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
    iso_ns,
    latencies,
    median,
    orphans,
    quantile,
    unanswered,
    unsolicited,
    with_errors,
)

# ---- the report page ------------------------------------------------------------------------------------------------


def page_head(capture: Capture, reader: Reader) -> Iterator[Claim]:
    """The line under the title: time span, packets, connections, transactions."""
    found = re.search(
        r'<p class="quiet">from (\S+ \S+ UTC) to (\S+ \S+ UTC), ([\d,]+) packets?, ([\d,]+) connections?,'
        r" ([\d,]+) transactions?",
        reader.text,
    )
    if found is None:
        return
    packets = capture.packets
    if packets:
        yield reader.moment("page: first packet", found, 1, packets[0].time_ns)
        yield reader.moment("page: last packet", found, 2, packets[-1].time_ns)
        yield reader.number("page: packets", found, 3, len(packets))
    yield reader.number("page: transactions", found, 5, len(capture.transactions))


def verdict(capture: Capture, reader: Reader) -> Iterator[Claim]:
    """The verdict: how often, since when, until when, the hosts, the answer times, and what is missing from the capture."""
    section = re.search(r'<div class="verdict[^"]*">(.*?)</div>', reader.text, re.DOTALL)
    if section is None:
        return
    yield from _sound(capture, reader, section)
    yield from _missing(capture, reader, section)
    named = re.compile(r'<a href="#f-([^"]+)">').search(reader.text, *section.span())
    events = capture.events(RULES, named[1]) if named is not None else None
    if events is None:
        return
    times = sorted([ended_ns(one) for one in events])
    found = re.compile(r"It happened (once|twice|[\d,]+ times)").search(reader.text, *section.span())
    if found is None or len(capture.transactions) == 0:
        return
    number = re.compile(r"once|twice|[\d,]+").search(reader.text, found.start(1))
    assert number is not None
    yield reader.number("verdict: times it happened", number, 0, len(events))
    since = re.compile(rf" at (\S+ \S+ UTC)(?:, ({DURATION}) after the capture began)?").search(
        reader.text, found.end()
    )
    if since is not None and times:
        yield reader.moment("verdict: first", since, 1, times[0])
        if since[2] and capture.packets:
            yield reader.duration("verdict: after the capture began", since, 2, times[0] - capture.packets[0].time_ns)
    last = re.compile(rf"the last time ({DURATION}) later").search(reader.text, *section.span())
    if last is not None and times:
        yield reader.duration("verdict: last", last, 1, times[-1] - times[0])
    pairs = {(host_of(one["asked_by"]), host_of(one["answered_by"])) for one in events}
    who = re.compile(r"It concerns (\S+) → ([^\s,;]+)").search(reader.text, *section.span())
    if who is not None:
        right = (who[1], who[2]) in pairs
        yield reader.claim("verdict: who", who, 1, sorted(pairs), right)
        yield reader.claim("verdict: who", who, 2, sorted(pairs), right)


def _sound(capture: Capture, reader: Reader, section: re.Match[str]) -> Iterator[Claim]:
    """Check the sentences of a verdict on a capture without failures."""
    for pattern in (r"No request failed; ([\d,]+) answers? arrived", r"Nothing broke: ([\d,]+) requests? answered"):
        found = re.compile(pattern).search(reader.text, *section.span())
        if found is not None:
            yield reader.number("verdict: answers", found, 1, answered(capture.transactions))
    times = latencies(capture.transactions)
    fast = re.compile(rf"came within ({DURATION}), the slowest after ({DURATION})").search(reader.text, *section.span())
    if fast is not None and times:
        yield reader.duration("verdict: half of the answers", fast, 1, median(times))
        yield reader.duration("verdict: slowest", fast, 2, times[-1])


def _missing(capture: Capture, reader: Reader, section: re.Match[str]) -> Iterator[Claim]:
    found = re.compile(r"<p>\d[\d,]* gaps?, ([\d.]+ k?M?B), ([\d.]+) %").search(reader.text, *section.span())
    if found is None or capture.missing is None or not capture.missing[0]:
        return
    missing, captured = capture.missing
    yield reader.claim("verdict: bytes missing", found, 1, missing, is_size(found[1], missing))
    share = 100 * missing / (missing + captured)
    yield reader.claim("verdict: percent missing", found, 2, f"{share:.3f}", abs(float(found[2]) - share) <= 0.05)


_SPREAD: Final = re.compile(
    r'"host":("[^"]*"),"function":("(?:[^"\\]|\\.)*"),"count":(\d+),"errors":(\d+),"missed":(\d+),'
    r'(?:"min":(\d+),"median":(\d+),"p95":(\d+),"max":(\d+))?'
)
_PAIR: Final = re.compile(
    r'"client":("[^"]*"),"server":("[^"]*"),"search":"[^"]*","connections":(\d+),"pdus":(\d+),"octets":\d+,'
    r'"errors":(\d+),"missed":(\d+)'
)
_POINT: Final = re.compile(r'\[[\d.e-]+,(\d+),"t(\d+)","#(\d+) ')


def spreads(capture: Capture, reader: Reader) -> Iterator[Claim]:
    """The answer times of each function of each device."""
    if capture.in_vlans:
        return
    for found in _SPREAD.finditer(reader.text):
        host, function = json.loads(found[1]), json.loads(found[2])
        rows = [one for one in capture.transactions if host_of(one["answered_by"]) == host and one["name"] == function]
        if not rows:
            continue
        for group, name, count in ((4, "errors", with_errors), (5, "missed", unanswered)):
            yield reader.number(f"page: {name} of a function of a device", found, group, count(rows))
        times = latencies(rows)
        yield reader.number("page: answers of a function of a device", found, 3, len(times))
        if found[6] and times:
            # plots begin at 0, even if an answer was captured before its request
            values = (max(0, times[0]), median(times), quantile(times, 0.95), times[-1])
            for group, name, ns in zip((6, 7, 8, 9), ("fastest", "median", "95 %", "slowest"), values, strict=True):
                yield reader.number(f"page: {name} of a function of a device", found, group, ns)


def pairs(capture: Capture, reader: Reader) -> Iterator[Claim]:
    """The table of who talked to whom."""
    if capture.in_vlans:
        return
    for found in _PAIR.finditer(reader.text):
        ends = {json.loads(found[1]), json.loads(found[2])}
        numbers = {number for number, both in capture.ends_of.items() if {host_of(end) for end in both} == ends}
        rows = [one for one in capture.transactions if one["connection"] in numbers]
        yield reader.number("page: PDUs of a pair", found, 4, sum([capture.pdus_of[number] for number in numbers]))
        yield reader.number("page: errors of a pair", found, 5, with_errors(rows))
        yield reader.number("page: missed of a pair", found, 6, unanswered(rows))


def points(capture: Capture, reader: Reader) -> Iterator[Claim]:
    """The slowest answers that are drawn one by one."""
    for found in _POINT.finditer(reader.text):
        one = capture.by_number.get(int(found[2]))
        yield reader.number("page: slowest", found, 1, one["latency_ns"] if one is not None else -1)
        yield reader.number("page: slowest, number", found, 3, int(found[2]))


# ---- screens --------------------------------------------------------------------------------------------------------

_SCREEN_ROW: Final = re.compile(r"^ *(\d+) (\S+) [→↔] (\S+).*? (\d+|\.) +(\d+|\.) +(\d+|\.)$", re.MULTILINE)
_SCREEN_FINDING: Final = re.compile(r"^FINDING \S+ +(\S+) +(?:(\d+)x )? ", re.MULTILINE)
_SCREEN_ENTRY: Final = re.compile(
    rf"^ENTRY [ EUS] ([\d:.]+) #(\d+) +(\d+|\?)→(\d+|\?) +c(\d+) .*?  +({DURATION}|-)  ", re.MULTILINE
)


def screens(capture: Capture, reader: Reader) -> Iterator[Claim]:
    """The rows of connections, findings and transactions on the screens of `monitor`."""
    for found in _SCREEN_ROW.finditer(reader.text):
        rows = capture.by_connection.get(int(found[1]), [])
        if not rows:
            continue
        for group, name, count in ((4, "answered", answered), (5, "errors", with_errors), (6, "no answer", unanswered)):
            yield reader.number(f"screen: {name} of a connection", found, group, count(rows))
    for found in _SCREEN_FINDING.finditer(reader.text):
        events = capture.events(RULES, found[1]) if found[2] else None
        if events is not None:
            yield reader.number("screen: times it happened", found, 2, len(events))
    for found in _SCREEN_ENTRY.finditer(reader.text):
        one = capture.by_number.get(int(found[2]))
        if one is None:
            continue
        for group, name in ((3, "request_frame"), (4, "response_frame")):
            yield reader.word("screen: packets", found, group, "?" if one[name] is None else str(one[name]))
        yield reader.number("screen: connection", found, 5, one["connection"])
        if found[6] != "-" and one["latency_ns"] is not None:
            yield reader.duration("screen: answer time", found, 6, one["latency_ns"])


# ---- alerts and exports ---------------------------------------------------------------------------------------------


def alerts(capture: Capture, reader: Reader) -> Iterator[Claim]:
    """Alerts: each event of a rule is in one of them, or counted by one, and each names a packet of it."""
    at = 0
    first: dict[str, re.Match[str]] = {}
    told: Counter[str] = Counter()
    for line in reader.text.splitlines():
        alert = json.loads(line)
        slug = alert["finding"]["slug"]
        found = re.compile(r'"repeated": (\d+)').search(reader.text, at, at + len(line))
        assert found is not None
        if slug in EACH and capture.events(RULES, slug) is not None:
            first[slug] = found
            told[slug] += 1 + alert["repeated"]
            yield from _alert(capture, reader, alert, at, at + len(line))
        at += len(line) + 1
    for slug, found in first.items():
        events = len(capture.events(RULES, slug) or [])
        yield reader.claim("alert: times it happened", found, 1, events, told[slug] == events)


def _alert(capture: Capture, reader: Reader, alert: Json, begin: int, end: int) -> Iterator[Claim]:
    events = capture.events(RULES, alert["finding"]["slug"]) or []
    frames = re.compile(r'"frames": \[([\d, ]+)\]').search(reader.text, begin, end)
    assert frames is not None
    numbers = {int(number) for number in frames[1].split(", ")}
    mine = [one for one in events if numbers == {one["request_frame"], one["response_frame"]} - {None}]
    yield reader.claim("alert: packets", frames, 1, "packets of such a transaction", bool(mine))
    who = re.compile(r'"client": "([^"]*)", "server": "([^"]*)"').search(reader.text, begin, end)
    if who is not None and mine:
        yield reader.word("alert: who", who, 1, host_of(mine[0]["asked_by"]))
        yield reader.word("alert: who", who, 2, host_of(mine[0]["answered_by"]))
    when = re.compile(r'"frames": \[[\d, ]+\], "time": "([^"]*)"').search(reader.text, begin, end)
    if when is not None and mine:
        right = iso_ns(when[1]) in {ended_ns(one) for one in mine}
        yield reader.claim("alert: time", when, 1, ended_ns(mine[0]), right)


def tables(capture: Capture, reader: Reader) -> Iterator[Claim]:
    """Rows of exports: the facts of each connection, and each finding."""
    at = 0
    findings: Counter[str] = Counter()
    place: dict[str, re.Match[str]] = {}
    for line in reader.text.splitlines():
        row = json.loads(line)
        if row["table"] == "connections":
            yield from _connection(capture, reader, row, at, at + len(line))
        elif row["table"] == "findings" and row["slug"] in EACH and capture.events(RULES, row["slug"]) is not None:
            findings[row["slug"]] += 1
            found = re.compile(r'"slug": "([^"]*)"').search(reader.text, at, at + len(line))
            assert found is not None
            place.setdefault(row["slug"], found)
        at += len(line) + 1
    for slug, found in place.items():
        events = len(capture.events(RULES, slug) or [])
        yield reader.claim("table: findings", found, 1, events, findings[slug] == min(events, 100))


def _connection(capture: Capture, reader: Reader, row: Json, begin: int, end: int) -> Iterator[Claim]:
    number = row["connection"]
    rows = capture.by_connection.get(number, [])
    counts = {
        "pdus": capture.pdus_of[number],
        "answered": answered(rows),
        "unanswered": sum([one["outcome"] == "unanswered" for one in rows]),
        "orphans": orphans(rows),
        "unsolicited": unsolicited(rows),
        "with_errors": with_errors(rows),
    }
    for name, count in counts.items():
        found = re.compile(rf'"{name}": (\d+)').search(reader.text, begin, end)
        if found is not None:
            yield reader.number(f"table: {name} of a connection", found, 1, count)


def bundle(capture: Capture, reader: Reader) -> Iterator[Claim]:
    """Notes of a STIX bundle name packets of their subject."""
    for slug in RULES:
        events = capture.events(RULES, slug)
        if events is None:
            continue
        frames = {frame for one in events for frame in (one["request_frame"], one["response_frame"])}
        pattern = re.compile(
            r'"content": "(?:[^"\\]|\\.)*? Packets? ([\d, ]+) of (?:[^"\\]|\\.)*"[^}]*?"labels": \[\s*"'
            f'{re.escape(slug)}"',
            re.DOTALL,
        )
        for found in pattern.finditer(reader.text):
            numbers = {int(number) for number in re.findall(r"\d+", found[1])}
            yield reader.claim("bundle: packets", found, 1, "packets of such transactions", numbers <= frames)


#: The functions for each output.
PAGES: Final[Mapping[str, tuple[Kind, ...]]] = {
    "page.html": (page_head, verdict, spreads, pairs, points),
    "screens.txt": (screens,),
    "alerts.jsonl": (alerts,),
    "tables.jsonl": (tables,),
    "bundle.stix": (bundle,),
}
