"""Recounts every number, name and time in the statements of s7dissect about a capture.

It knows the outputs only as a reader does and imports nothing of the package: the statements are compared with counts from the
lines of `transactions -T jsonl` and `show -T jsonl`, and from the packets of the file. A `Claim` is one number at one place of
one output; `tests.recount.kinds` knows the places and the count for each.

    python -m tests.recount.recount FOLDER CAPTURE

It reads outputs from a folder, as files named ``analyze.txt``, ``page.html`` and so on, and writes the differences.
"""

from __future__ import annotations

import json
import re
import sys
from collections import Counter, defaultdict
from collections.abc import Callable, Iterable, Iterator, Mapping
from functools import cached_property
from pathlib import Path
from typing import Any, Final, NamedTuple

from tests.recount.packets import Packet, missing_of, packets_of, segments_of

Json = dict[str, Any]

#: Reasons of requests without an answer that is no one's fault: it was not captured, or not due yet.
UNSEEN: Final = frozenset(("hole", "one_sided"))
OPEN: Final = "capture_ended"
#: A request that is younger when the capture ends may still be answered.
DUE_NS: Final = 10**9


class Claim(NamedTuple):
    """A statement of an output: ``said`` is its text from ``begin`` to ``end``; ``right`` is whether it agrees with the count.

    ``counted`` is the count, as text.
    """

    kind: str
    face: str
    begin: int
    end: int
    said: str
    counted: str
    right: bool


class Capture:
    """The contents of the lines of transactions and of PDUs, and the packets of the file (None if they cannot be read)."""

    def __init__(self, outputs: Mapping[str, str], path: Path) -> None:
        self.transactions = _lines(outputs["transactions.jsonl"])
        self.pdus = _lines(outputs["show.jsonl"])
        self.path = path
        self.explained = explained_in(outputs.get("analyze.txt", ""))
        self._mark()

    def _mark(self) -> None:
        """Add the full name of its function, and the outcome of its request, to each transaction."""
        packets = self.packets
        end_ns = packets[-1].time_ns if packets else max([iso_ns(one["time"]) for one in self.pdus], default=0)
        for one in self.transactions:
            one["name"] = _name(one)
            waits = one["outcome"] == "unanswered" and one["reason"] not in UNSEEN
            over = one["reason"] != OPEN or end_ns - iso_ns(one["request_time"] or "1970-01-01T00:00:00.0Z") > DUE_NS
            one["missed"] = waits and over
            one["open"] = waits and not one["missed"]

    @cached_property
    def packets(self) -> list[Packet] | None:
        """The packets of the file."""
        return packets_of(self.path)

    @cached_property
    def missing(self) -> tuple[int, int] | None:
        """Bytes missing between captured ones, and captured bytes; None if they cannot be counted in the simple way."""
        segments = segments_of(self.packets) if self.packets else None
        return missing_of(segments) if segments else None

    def events(self, rules: Mapping[str, Callable[[list[Json]], list[Json] | None]], slug: str) -> list[Json] | None:
        """Return the transactions that show a rule; None if they do not show it, or if other findings explain some."""
        if slug not in rules or self.explained.get(slug):
            return None
        return rules[slug](self.transactions)

    def time_ns(self, frame: int) -> int | None:
        """Return the time of a packet."""
        packets = self.packets
        return packets[frame - 1].time_ns if packets and 0 < frame <= len(packets) else None

    @cached_property
    def by_number(self) -> dict[int, Json]:
        """The transactions by their numbers."""
        return {one["number"]: one for one in self.transactions}

    @cached_property
    def by_connection(self) -> dict[int, list[Json]]:
        """The transactions of each connection."""
        return _grouped(self.transactions, lambda one: one["connection"])

    @cached_property
    def s7_pdus(self) -> list[Json]:
        """PDUs of S7comm and S7comm-plus, including those that the capture cut off, and separate messages of SCD."""
        return [
            one
            for one in self.pdus
            if one["protocol"] in {"s7comm", "s7comm_plus"}
            or (one["protocol"] == "scd" and one["connection"] not in self._speak_s7)
        ]

    @cached_property
    def _speak_s7(self) -> set[int]:
        return {one["connection"] for one in self.pdus if one["protocol"] in {"s7comm", "s7comm_plus"}}

    @cached_property
    def in_vlans(self) -> bool:
        """Whether one address may belong to several stations, which the lines do not tell apart."""
        return bool(self.packets) and any([octets_are_tagged(packet) for packet in self.packets or []])

    @cached_property
    def pdus_of(self) -> Counter[int]:
        """How many PDUs each connection has."""
        return Counter([one["connection"] for one in self.s7_pdus])

    @cached_property
    def ends_of(self) -> dict[int, tuple[str, str]]:
        """The ends of each connection, in order of address, from its PDUs."""
        found: dict[int, tuple[str, str]] = {}
        for one in self.pdus:
            found.setdefault(one["connection"], (one["src"], one["dst"]))
        return found


def _name(one: Json) -> str:
    """Return the name of a function as the tables have it: of userdata with its group, of other protocols with theirs."""
    userdata = one.get("userdata")
    if userdata:
        return f"{userdata['group_name']}: {userdata['subfunction_name']}"
    protocol = {"s7comm_plus": "S7comm-plus ", "scd": "SCD "}.get(one.get("protocol", ""), "")
    return f"{protocol}{one['function']['name'] or ('notification' if one['outcome'] == 'unsolicited' else '')}"


def _lines(text: str) -> list[Json]:
    return [json.loads(line) for line in text.splitlines() if line]


def _grouped(rows: Iterable[Json], key: Callable[[Json], Any]) -> dict[Any, list[Json]]:
    found: dict[Any, list[Json]] = defaultdict(list)
    for row in rows:
        found[key(row)].append(row)
    return dict(found)


_BECAUSE: Final = re.compile(r"^ +because of it: (.*)$", re.MULTILINE)


def explained_in(text: str) -> Counter[str]:
    """Return how often each rule applied because of another one, according to `analyze`: transactions do not show why."""
    found: Counter[str] = Counter()
    for line in _BECAUSE.findall(text):
        for slug, times in re.findall(r"([a-z_0-9]+\.[a-z_0-9]+)(?: \((\d+) times\))?", line):
            found[slug] += int(times or 1)
    return found


def octets_are_tagged(packet: Packet) -> bool:
    """Return whether a packet has a VLAN tag; unknown for other links than Ethernet."""
    return packet.link != 1 or packet.octets[12:14] in {b"\x81\x00", b"\x88\xa8", b"\x91\x00", b"\x92\x00"}


# ---- what is counted ------------------------------------------------------------------------------------------------


def answered(rows: Iterable[Json]) -> int:
    """Requests with an answer."""
    return sum([one["outcome"] == "answered" for one in rows])


def with_errors(rows: Iterable[Json]) -> int:
    """Transactions in which anything was refused."""
    return sum([bool(one["errors"]) for one in rows])


def unanswered(rows: Iterable[Json]) -> int:
    """Requests that got no answer, as far as the capture shows."""
    return sum([one["missed"] for one in rows])


def not_captured(rows: Iterable[Json]) -> int:
    """Requests whose answer is, or may be, in a gap or in a direction that was not captured."""
    return sum([one["outcome"] == "unanswered" and one["reason"] in UNSEEN for one in rows])


def still_open(rows: Iterable[Json]) -> int:
    """Requests whose answer was not due when the capture ended."""
    return sum([one["open"] for one in rows])


def orphans(rows: Iterable[Json]) -> int:
    """Answers without a request."""
    return sum([one["outcome"] == "orphan_answer" for one in rows])


def unsolicited(rows: Iterable[Json]) -> int:
    """Messages without a partner: pushes, and requests that need no answer."""
    return sum([one["outcome"] == "unsolicited" for one in rows])


def pushes(rows: Iterable[Json]) -> int:
    """Unsolicited messages."""
    return sum([one["outcome"] == "unsolicited" and one["request_frame"] is None for one in rows])


def one_way(rows: Iterable[Json]) -> int:
    """Requests that need no answer."""
    return sum([one["outcome"] == "unsolicited" and one["request_frame"] is not None for one in rows])


def likely(rows: Iterable[Json]) -> int:
    """Pairs that are only likely."""
    return sum([one["outcome"] == "answered" and one.get("certainty") == "likely" for one in rows])


def latencies(rows: Iterable[Json]) -> list[int]:
    """Answer times of sure pairs, in order."""
    found = [
        one["latency_ns"]
        for one in rows
        if one["outcome"] == "answered" and one.get("certainty") != "likely" and one["latency_ns"] is not None
    ]
    return sorted(found)


def quantile(times: list[int], share: float) -> int:
    """Return the time that this share of all times does not exceed (nearest rank)."""
    return times[max(0, -int(-share * len(times) // 1) - 1)]


def median(times: list[int]) -> int:
    """Return the median; for an even number the mean of the two in the middle."""
    middle = len(times) // 2
    return times[middle] if len(times) % 2 else (times[middle - 1] + times[middle]) // 2


def item_errors(rows: Iterable[Json]) -> list[Json]:
    """Return a transaction for each of its refused items, in order of time."""
    return [
        one
        for one in rows
        for error in one["errors"]
        if error["where"].startswith("item ") and error["code"] is not None  # without a code it is not known
    ]


def ended_ns(one: Json) -> int:
    """Return when a transaction was complete, or requested if it never was."""
    asked = iso_ns(one["request_time"]) if one["request_time"] else iso_ns(one["response_time"])
    return asked + (one["latency_ns"] or 0)


# ---- what texts say -------------------------------------------------------------------------------------------------


def iso_ns(text: str) -> int:
    """Return a time of JSON in nanoseconds since 1970."""
    from datetime import UTC, datetime

    whole, _, rest = text.rstrip("Z").partition(".")
    since = datetime.fromisoformat(whole).replace(tzinfo=UTC) - datetime(1970, 1, 1, tzinfo=UTC)
    return (since.days * 86_400 + since.seconds) * 10**9 + int(rest.ljust(9, "0"))


_UNITS: Final = {"µs": 10**3, "ms": 10**6, "s": 10**9, "min": 60 * 10**9, "h": 3600 * 10**9, "d": 86_400 * 10**9}
_PART: Final = re.compile(r"(\d+(?:\.(\d+))?) (µs|ms|s|min|h|d)\b")
#: A duration as people read it: ``52 µs``, ``1.26 ms``, ``1 h 0 min 0 s``.
DURATION: Final = r"-?\d+(?:\.\d+)? (?:µs|ms|s|min|h|d)(?: \d+ (?:h|min|s))*"


def is_duration(said: str, ns: int | None) -> bool:
    """Return whether a text is a duration: rounded to its last digit, or cut off if it has several units."""
    parts = _PART.findall(said)
    if not parts or ns is None:
        return False
    total = sum([float(number) * _UNITS[unit] for number, _, unit in parts])
    _, digits, unit = parts[-1]
    least = _UNITS[unit] / 10 ** len(digits)
    return bool(abs(total * (-1 if said.startswith("-") else 1) - ns) <= (0.5001 * least if len(parts) == 1 else least))


def is_moment(said: str, ns: int) -> bool:
    """Return whether ``2026-11-21 01:31:05.693204 UTC`` is a time; further digits are cut off."""
    return iso_ns(said.removesuffix(" UTC").replace(" ", "T")) == ns // 1000 * 1000


def is_time_of_day(said: str, ns: int) -> bool:
    """Return whether ``01:31:05.693`` is a time of its day; further digits are cut off."""
    clock, _, digits = said.partition(".")
    hours, minutes, seconds = map(int, clock.split(":"))
    told = ((hours * 60 + minutes) * 60 + seconds) * 10**9 + int(digits.ljust(9, "0") or 0)
    least = int(10 ** (9 - len(digits)))
    return told == ns % (86_400 * 10**9) // least * least


def is_size(said: str, octets: int) -> bool:
    """Return whether ``512 B``, ``5.4 kB`` is a size."""
    number, _, unit = said.partition(" ")
    factor = {"B": 1, "kB": 10**3, "MB": 10**6}[unit]
    return abs(float(number) * factor - octets) <= (0 if unit == "B" else factor / 20)


class Reader:
    """One output, in which claims are found: ``text`` is the output from ``begin`` to ``end``."""

    def __init__(self, face: str, text: str) -> None:
        self.face = face
        self.text = text

    def number(self, kind: str, found: re.Match[str], group: str | int, counted: int) -> Claim:
        """Return the claim that a group states this number; ``.`` and ``-`` mean none, ``once`` and ``twice`` are numbers."""
        said = found[group]
        value = {"once": 1, "twice": 2, ".": 0, "-": 0, "no": 0}.get(said)
        if value is None:
            value = int(said.replace(",", "").removesuffix("x"))
        return Claim(kind, self.face, *found.span(group), said, str(counted), value == counted)

    def claim(self, kind: str, found: re.Match[str], group: str | int, counted: object, right: bool) -> Claim:
        """Return a claim that was judged."""
        return Claim(kind, self.face, *found.span(group), found[group], str(counted), right)

    def duration(self, kind: str, found: re.Match[str], group: str | int, ns: int | None) -> Claim:
        """Return the claim that a group states this duration."""
        return self.claim(kind, found, group, f"{ns} ns", is_duration(found[group], ns))

    def moment(self, kind: str, found: re.Match[str], group: str | int, ns: int) -> Claim:
        """Return the claim that a group states this time."""
        return self.claim(kind, found, group, f"{ns} ns", is_moment(found[group], ns))

    def word(self, kind: str, found: re.Match[str], group: str | int, counted: str) -> Claim:
        """Return the claim that a group states this name."""
        return self.claim(kind, found, group, counted, found[group] == counted)


Kind = Callable[[Capture, Reader], Iterator[Claim]]


def recount(outputs: Mapping[str, str], path: Path, kinds: Mapping[str, Iterable[Kind]]) -> list[Claim]:
    """Return the claims of all outputs of a capture."""
    capture = Capture(outputs, path)
    return [
        claim
        for face, judges in kinds.items()
        if face in outputs
        for judge in judges
        for claim in judge(capture, Reader(face, outputs[face]))
    ]


def table(claims: Iterable[Claim]) -> list[tuple[str, int, int]]:
    """Return for each kind of sentence how many numbers were recounted, and how many of them differ."""
    counted, wrong = Counter[str](), Counter[str]()
    for claim in claims:
        counted[claim.kind] += 1
        wrong[claim.kind] += not claim.right
    return [(kind, number, wrong[kind]) for kind, number in sorted(counted.items())]


def main(folder: Path, path: Path) -> int:
    """Recount the outputs in a folder; return 1 if anything differs."""
    from tests.recount.kinds import KINDS

    outputs = {one.name: one.read_text(encoding="utf-8") for one in folder.iterdir()}
    claims = recount(outputs, path, KINDS)
    for kind, number, wrong in table(claims):
        print(f"{kind:50} {number:8} {wrong:8}")
    differences = [claim for claim in claims if not claim.right]
    for claim in differences:
        print(f"{claim.face}: {claim.kind}: says {claim.said}, counted {claim.counted}")
    return 1 if differences else 0


if __name__ == "__main__":
    sys.exit(main(Path(sys.argv[1]), Path(sys.argv[2])))
