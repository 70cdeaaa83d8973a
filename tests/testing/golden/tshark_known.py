"""Differences between a golden and tshark, and which one is right: the only place where these are excused.

A row must match exactly its differences; one that excuses nothing fails the test, and so does a cause without a row. For a
cause it names the page that describes it, the text there, and why the golden is right.
"""

from __future__ import annotations

from collections import Counter
from typing import Final, NamedTuple

ORACLE: Final = "docs/oracle.md"
CAUSES: Final = {
    "lost-by-tcp": (
        ORACLE,
        "| `lost-by-tcp` |",
        "The segment is a retransmission to tshark, or stands behind garbage; without it only half of a transaction is left.",
    ),
    "joined-over-a-gap": (
        ORACLE,
        "| `joined-over-a-gap` |",
        "tshark joins the halves of two messages over octets that are missing; nobody sent such a PDU.",
    ),
    "rejection-refused": (ORACLE, "| `rejection-refused` |", "tshark does not read the ER, so that TCP ends first."),
    "reason-refused": (ORACLE, "| `reason-refused` |", "tshark does not read the DR that refuses the connection."),
    "cut": (
        ORACLE,
        "| `cut` |",
        "Nothing is missing to tshark where a packet was not captured whole; the request was in what was cut off.",
    ),
    "hole-shown-later": (
        "docs/golden.md",
        "the gap shows only in a later packet",
        "The answer is of a request that stood in it; tshark tells the hole where the next segment of that side comes.",
    ),
    "parts-joined": (
        ORACLE,
        "| `parts-joined` |",
        "tshark shows the list, or the length of a BSEND, where it has all parts together; it stands in the first one.",
    ),
    "no-dissector-ibh": (
        ORACLE,
        "Wireshark has no dissector for IBH-NetLink",
        "What comes through the gateway is data to tshark; the case's own script states it (tests/captures).",
    ),
    "no-dissector-plus": (
        "docs/s7plus.md",
        "cannot be compared with Wireshark",
        "S7comm-plus is data to tshark.",
    ),
    "no-dissector-scd": (
        "docs/golden.md",
        "SCD is data to tshark",
        "SCD is ours: the dictionary's own tests hold its values (tests/scd); what S7 carries of it is compared as octets.",
    ),
    "believed-reset": (
        "docs/golden.md",
        "the reset is far outside the window",
        "Data and a FIN follow in order on both sides, so nobody took the reset for one.",
    ),
    "fits-the-later-request": (
        "docs/golden.md",
        "the answer fits the later request alone",
        "tshark pairs nothing, and by the oldest request it would be an answer of 4 octets to a read of 2.",
    ),
    "one-of-two": (
        "docs/golden.md",
        "which of them was answered is only likely",
        "Two requests of one shape and one reference, and one answer: the test takes the oldest.",
    ),
    "unknown-rosctr": (
        "docs/golden.md",
        "a PDU whose ROSCTR is unknown",
        "It neither asks nor answers; `s7.unknown_rosctr` tells it.",
    ),
    "seen-in-tcp": (
        "docs/golden.md",
        "sequence numbers leap",
        "A handshake that was not captured shows in TCP before its CR does, so the old connection's addresses were reused.",
    ),
}


class Row(NamedTuple):
    """Differences with one cause: ``places`` in the golden (``connection 4``, ``29-42``), what tshark ``shows`` there."""

    capture: str
    places: str
    shows: dict[str, int]
    cause: str

    def numbers(self) -> set[str]:
        """Return every single place."""
        found = set()
        for place in self.places.split(", ") if self.places else []:
            first, _, last = place.partition("-")
            many = range(int(first), int(last) + 1) if last else ()
            found |= {str(number) for number in many} or {place}
        return found


_ORPHAN: Final = "client Read Var, answer without request"
_ANSWERED: Final = "no DB1.DBB0 BYTE x2 = <00 01>"
_LIST: Final = "# SZL 0x0000 index 0x0000"
_ER: Final = 'no ends error_tpdu by server "ER from the server: invalid parameter'

ROWS: Final = [
    Row("bsend", "4, 7", {"no # 1500 bytes": 1, "# 1500 bytes": 1}, "parts-joined"),
    Row(
        "crafted/certainty",
        "19",
        {"no no answer: reference_reused, no DB1.DBB0 BYTE x2, DB1.DBB0 BYTE x2 = <00 07>": 1},
        "one-of-two",
    ),
    Row(
        "crafted/certainty",
        "20",
        {"no DB1.DBB2 BYTE x2 = <00 07>, no answer: connection_closed, DB1.DBB2 BYTE x2": 1},
        "one-of-two",
    ),
    Row("crafted/conflicts", "4-5", {_ORPHAN: 1, f"{_ORPHAN}: hole": 1}, "lost-by-tcp"),
    Row("crafted/cotp-refused", "connection 1", {f'{_ER} value", ends fin by server': 1}, "rejection-refused"),
    Row("crafted/cotp-refused", "connection 5", {'no refused "not used"': 1}, "reason-refused"),
    Row("crafted/coverage-cotp", "connection 1", {f'{_ER} code", ends fin by server': 1}, "rejection-refused"),
    Row("crafted/disorder", "3", {f"{_ANSWERED}, no answer: hole, DB1.DBB0 BYTE x300": 1}, "lost-by-tcp"),
    Row("crafted/disorder", "4-9", {f"{_ORPHAN}: hole": 4, "client READ, no answer: hole": 1}, "lost-by-tcp"),
    Row("crafted/disorder", "11", {f"{_ORPHAN}: hole": 1}, "lost-by-tcp"),
    Row(
        "crafted/disorder", "16", {"no DB1.DBB0 BYTE x2 = <00 06>, no answer: hole, DB1.DBB0 BYTE x2": 1}, "lost-by-tcp"
    ),
    Row("crafted/endings", "connection 1", {"no ends fin by client, ends reset by server": 1}, "believed-reset"),
    Row("crafted/endings", "2-3", {f"{_ANSWERED}, no answer: connection_closed, DB1.DBB0 BYTE x2": 2}, "lost-by-tcp"),
    Row("crafted/holes", "5", {"no answer without request: hole, answer without request": 1}, "hole-shown-later"),
    Row("crafted/holes", "50", {f"{_ORPHAN}: hole": 1}, "lost-by-tcp"),
    Row(
        "crafted/holes",
        "63",
        {"client WRITE, no answer: connection_closed": 1, f"{_ORPHAN}: hole": 1},
        "joined-over-a-gap",
    ),
    Row("crafted/ip-fragments", "9", {"client Write Var, answer without request: hole": 1}, "lost-by-tcp"),
    Row("crafted/ip-headers", "6", {_ORPHAN: 1}, "lost-by-tcp"),
    Row("crafted/look-alikes", "1-6", {}, "no-dissector-plus"),
    Row("crafted/netlink", "connection 1, 1-5", {}, "no-dissector-ibh"),
    Row("crafted/plus-answers", "1-10", {}, "no-dissector-plus"),
    Row("crafted/plus-plant", "1-24", {}, "no-dissector-plus"),
    Row("s7plus/s7commplus", "connection 1, 1-13", {}, "no-dissector-plus"),
    Row("s7plus/s7commplus-tls", "connection 1, 1-13", {}, "no-dissector-plus"),
    Row(
        "crafted/netlink-faults", "connection 1, connection 2, connection 3, connection 4, 1-10", {}, "no-dissector-ibh"
    ),
    Row("crafted/reference-examples", "28-29", {f"no {_LIST}": 1, _LIST: 1}, "parts-joined"),
    Row(
        "crafted/references",
        "15",
        {"no no answer: connection_closed, no DB1.DBB0 BYTE x2, DB1.DBB0 BYTE x2 = <00 01 02 03>": 1},
        "fits-the-later-request",
    ),
    Row(
        "crafted/references",
        "16",
        {"no DB1.DBB0 BYTE x4 = <00 01 02 03>, no answer: connection_closed, DB1.DBB0 BYTE x4": 1},
        "fits-the-later-request",
    ),
    Row(
        "crafted/references",
        "22-23",
        {"no # SZL 0x0001 index 0x0203": 1, "# SZL 0x0001 index 0x0203": 1},
        "parts-joined",
    ),
    Row("crafted/retransmissions", "9, 11", {_ORPHAN: 1, f"{_ORPHAN}: hole": 1}, "lost-by-tcp"),
    Row("crafted/reuse-without-syn", "connection 3, 29-42", {}, "lost-by-tcp"),
    Row("crafted/reuse-without-syn", "connection 5", {"no ends reused, ends replaced": 1}, "seen-in-tcp"),
    Row("crafted/reuse-without-syn", "connection 6", {"no ends reused, ends fin by client": 1}, "lost-by-tcp"),
    Row("crafted/s7-mismatches", "", {"server no function, answer without request": 3}, "unknown-rosctr"),
    Row("crafted/sequence-wrap", "4", {f"{_ORPHAN}: hole": 1}, "lost-by-tcp"),
    Row("crafted/snaplen", "7-9", {"no answer without request: hole, answer without request": 3}, "cut"),
    Row("crafted/timing", "4-7", {_ORPHAN: 4}, "lost-by-tcp"),
    Row("crafted/tpkt-faults", "7, 13", {_ORPHAN: 1}, "lost-by-tcp"),
    Row("crafted/vlan", "connection 4, connection 5, connection 6, connection 7, 13-36", {}, "lost-by-tcp"),
    Row("scd/plant", "connection 2, connection 3, connection 5, 6-45", {}, "no-dissector-scd"),
]


def excused(capture: str) -> tuple[set[str], Counter[str]]:
    """Return the places of a capture that rows excuse, and what tshark shows in them."""
    places: set[str] = set()
    shows: Counter[str] = Counter()
    for row in ROWS:
        if row.capture == capture:
            assert not places & row.numbers(), f"{capture}: two rows excuse the same"
            places |= row.numbers()
            shows.update(row.shows)
    return places, shows
