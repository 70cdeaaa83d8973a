"""Numbers in the details of connections, findings and devices: TSAPs, sizes, ends, pending requests, addresses, names."""

from __future__ import annotations

import re
from collections.abc import Iterator, Mapping
from functools import cache
from typing import Final

from tests.recount.counted import RULES, host_of
from tests.recount.packets import Segment, segments_of
from tests.recount.recount import Capture, Claim, Kind, Reader, unanswered, with_errors

_BLOCK: Final = re.compile(r"^  (\d+)  (\S+) [→↔] (\S+?)(?:,.*)?\n((?:     .*\n)*)", re.MULTILINE)
_TSAP: Final = re.compile(
    r'^     TSAP "?([^\s"]+)"?(?: \([^)]*\))? → "?([^\s",]+)"?(?: \([^)]*\))?(?:, TPDU size (\d+))?', re.MULTILINE
)
_SIZES: Final = re.compile(
    r"^     PDU length (\d+)(?: \(requested (\d+)\))?, parallel jobs \(AmQ\): client (\d+), server (\d+)", re.MULTILINE
)


def negotiated(capture: Capture, reader: Reader) -> Iterator[Claim]:
    """TSAPs and sizes of connections, from connect requests and setups."""
    for block in _BLOCK.finditer(reader.text):
        number = int(block[1])
        cotp = [one["cotp"] for one in capture.pdus if one["connection"] == number and one.get("cotp")]
        asked = [one for one in cotp if one["type"] == "CR" and one.get("called_tsap")]
        told = [one for one in cotp if one["type"] == "CC"]
        found = _TSAP.search(reader.text, *block.span(4))
        if found is not None and len(asked) == 1:
            yield reader.word("connection: TSAP", found, 1, asked[0]["calling_tsap"]["text"])
            yield reader.word("connection: TSAP", found, 2, asked[0]["called_tsap"]["text"])
            if found[3] and len(told) == 1 and told[0].get("tpdu_size"):
                yield reader.number("connection: TPDU size", found, 3, told[0]["tpdu_size"])
        setups = [one for one in capture.by_connection.get(number, []) if (one.get("setup") or {}).get("granted")]
        found = _SIZES.search(reader.text, *block.span(4))
        if found is not None and len(setups) == 1 and setups[0]["setup"].get("asked"):
            granted = setups[0]["setup"]["granted"]
            yield reader.number("connection: PDU length", found, 1, granted["pdu_length"])
            yield reader.number("connection: parallel jobs", found, 3, granted["max_amq_called"])
            yield reader.number("connection: parallel jobs", found, 4, granted["max_amq_calling"])
            if found[2]:
                yield reader.number("connection: PDU length asked", found, 2, setups[0]["setup"]["asked"]["pdu_length"])


def endings(capture: Capture, reader: Reader) -> Iterator[Claim]:
    """The side that closed or reset a connection, and the packet; the requests pending then."""
    segments = _segments(capture)
    for block in _BLOCK.finditer(reader.text):
        pattern = re.compile(r"(closed|reset) by the (client|server) at packet (\d+)")
        for found in pattern.finditer(reader.text, *block.span(4)):
            if segments is None:
                continue
            frame = int(found[3])
            segment = segments[frame - 1] if 0 < frame <= len(segments) else None
            bit = 1 if found[1] == "closed" else 4
            who = block[2] if found[2] == "client" else block[3]
            right = segment is not None and bool(segment.flags & bit) and end_of(segment.flow[0]) == who
            yield reader.claim("connection: who closed it", found, 3, "a FIN or RST of that side", right)
        rows = [
            one
            for one in capture.by_connection.get(int(block[1]), [])
            if one["outcome"] == "unanswered" and one["reason"] in {"capture_ended", "connection_closed"}
        ]
        pending = re.compile(r"with (\d+) requests? pending: .*?\(packet (\d+)\)").search(reader.text, *block.span(4))
        if pending is not None and rows:
            yield reader.number("connection: pending", pending, 1, len(rows))
            yield reader.number("connection: oldest pending", pending, 2, min([one["request_frame"] for one in rows]))


def _segments(capture: Capture) -> list[Segment] | None:
    return segments_of(capture.packets) if capture.packets else None


@cache
def end_of(octets: bytes) -> str:
    """Return ``10.0.0.1:102`` for an address with its port."""
    return f"{'.'.join(map(str, octets[:4]))}:{int.from_bytes(octets[4:], 'big')}"


_ADDRESS: Final = re.compile(
    r"^ +#(\d+)  \S+→\S+ +(?:-|\S+ \S+)  (?:Read|Write) Var +(?!NO |REFUSED|MISMATCH)([A-Z]+[\w.]*(?::\w+)?)(?= |,|:|$)",
    re.MULTILINE,
)
_WHO: Final = re.compile(r"^      connection (\d+), packets? [\d, ]+: (\S+:\d+) to (\S+:\d+): ", re.MULTILINE)


def names(capture: Capture, reader: Reader) -> Iterator[Claim]:
    """Addresses in rows of transactions, and the ends that findings name."""
    for found in _ADDRESS.finditer(reader.text):
        one = capture.by_number.get(int(found[1]))
        if one is not None and one["items"] and not one["errors"]:
            yield reader.word("row: address", found, 2, one["items"][0]["address"])
    for found in _WHO.finditer(reader.text):
        ends = capture.ends_of.get(int(found[1]))
        if ends is not None:
            for group in (2, 3):
                yield reader.claim("finding: who", found, group, " or ".join(ends), found[group] in ends)


def brief_head(capture: Capture, reader: Reader) -> Iterator[Claim]:
    """The second line of `--brief`: the time span, and the outcomes of the transactions."""
    found = re.search(
        r"^  from (\S+ \S+ UTC) to (\S+ \S+ UTC); (\d+) transactions?(?:, (\d+) with errors)?(?:, (\d+) unanswered)?",
        reader.text,
        re.MULTILINE,
    )
    if found is None or not capture.packets:
        return
    yield reader.moment("brief: first packet", found, 1, capture.packets[0].time_ns)
    yield reader.moment("brief: last packet", found, 2, capture.packets[-1].time_ns)
    yield reader.number("brief: transactions", found, 3, len(capture.transactions))
    for group, name, count in ((4, "with errors", with_errors), (5, "unanswered", unanswered)):
        if found[group]:
            yield reader.number(f"brief: {name}", found, group, count(capture.transactions))
    used = re.search(r"^\d+ of (\d+) packets? used", reader.text, re.MULTILINE)
    if used is not None:
        yield reader.number("brief: packets", used, 1, len(capture.packets))


_CARD: Final = re.compile(r"^(\S+)  (?:CPU|S7 server|engineering|panel|OPC|unknown)\b.*\n((?:  .*\n)*)", re.MULTILINE)


def cards(capture: Capture, reader: Reader) -> Iterator[Claim]:
    """When a device was seen, the packet that shows its answers, and the numbers of reads and writes."""
    if capture.in_vlans:
        return
    for card in _CARD.finditer(reader.text):
        seen = re.compile(r"^  seen +(\S+ \S+ UTC) to (\S+ \S+ UTC), packets (\d+) to (\d+)", re.MULTILINE)
        found = seen.search(reader.text, *card.span(2))
        if found is not None and capture.packets:
            for group, frame in ((1, 3), (2, 4)):
                ns = capture.time_ns(int(found[frame]))
                if ns is not None:
                    yield reader.moment("device: seen", found, group, ns)
        answers = [
            one
            for one in capture.transactions
            if host_of(one["answered_by"]) == card[1] and one["outcome"] == "answered"
        ]
        role = re.compile(r"answers S7comm requests \(packet (\d+)").search(reader.text, *card.span(2))
        classic = [one["response_frame"] for one in answers if not one.get("protocol")]
        if role is not None and classic:
            right = int(role[1]) in classic
            yield reader.claim("device: packet that shows its role", role, 1, "a packet with an answer", right)
        yield from _uses(capture, reader, card)


def _uses(capture: Capture, reader: Reader, card: re.Match[str]) -> Iterator[Claim]:
    pattern = re.compile(r"^  asked by +(\S+): (.*)$", re.MULTILINE)
    for found in pattern.finditer(reader.text, *card.span(2)):
        rows = [
            one
            for one in capture.transactions
            if host_of(one["asked_by"]) == found[1]
            and host_of(one["answered_by"]) == card[1]
            and one["request_frame"]
            and one["outcome"] != "unsolicited"
        ]
        if any([one.get("protocol") for one in rows]):
            continue
        for name, code in (("read", 4), ("write", 5)):
            number = re.compile(rf"; (\d+) {name}s?: ").search(reader.text, *found.span(2))
            if number is not None:
                of = [one for one in rows if one["rosctr"] == 1 and one["function"]["code"] == code]
                count = sum([any([item.get("address") for item in one["items"]]) for one in of])
                yield reader.number(f"device: {name}s of a pair", number, 1, count)


def page_findings(capture: Capture, reader: Reader) -> Iterator[Claim]:
    """How often rules applied, according to the headings of findings on the page."""
    for found in re.finditer(r'<span class="quiet">([a-z_0-9]+\.[a-z_0-9]+), ([\d,]+) times', reader.text):
        events = capture.events(RULES, found[1])
        if events is not None:
            yield reader.number("page: times it happened", found, 2, len(events))


#: The functions for each output.
DETAILS: Final[Mapping[str, tuple[Kind, ...]]] = {
    "analyze.txt": (negotiated, endings, names),
    "brief.txt": (brief_head,),
    "devices.txt": (cards,),
    "page.html": (page_findings,),
}
