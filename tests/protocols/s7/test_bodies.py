"""Bodies of all captures: every octet has a place in a structure, but for those that are named here with the reason."""

from __future__ import annotations

from collections import Counter
from functools import cache
from pathlib import Path
from typing import Final, NamedTuple

import dissect
from dissect import Pdu
from dissect.protocols.s7.bodies import parse_body
from dissect.wire.part import OCTETS, SURPLUS
from tests.cases import each

ROOT: Final = Path(__file__).resolve().parents[3]


class Left(NamedTuple):
    """Octets without a meaning: in which kind of message, as part of what; `faulty` when the PDU is known to be malformed."""

    layout: str
    group: int
    subfunction: int
    note: str
    faulty: bool


#: Payloads that nobody described.
UNKNOWN: Final = {
    (0x01, 0x06): "time measurement: no source tells what its data mean",
    (0x01, 0x07): "force selection: no source tells what its data mean",
    (0x01, 0x16): "flash LED: no source tells what its data mean",
    (0x20, 0x01): "data record routing: nobody published more than the names",
    (0x20, 0x02): "data record routing: nobody published more than the names",
    (0x20, 0x03): "data record routing: nobody published more than the names",
}
#: A part of a list in several PDUs: it is decoded whole when its parts are joined (`parse_joined`).
IN_PARTS: Final = frozenset(("continuation", "first bytes of a record"))
READ_SZL: Final = (4, 1)
#: Captures with wrong messages in them on purpose, and those whose server answers with wrong lengths.
FAULTY: Final = frozenset((
    "netlink-faults.pcapng", "s7-lengths.pcapng", "s7-mismatches.pcapng", "szl-python.pcapng",
    "transfer.pcapng",
))  # fmt: skip


@cache
def left_over(path: Path) -> Counter[Left]:
    """Count the octets of a capture that no structure has."""
    found: Counter[Left] = Counter()
    for event in dissect.open(str(path)):
        if not isinstance(event, Pdu):
            continue
        body = parse_body(event)
        head = event.parameters.userdata
        group, subfunction = (head.group, head.subfunction) if head is not None else (-1, -1)
        for part in body.parts:
            if part.layout in {OCTETS, SURPLUS}:
                faulty = bool(event.malformed or body.malformed)
                found[Left(part.layout.name, group, subfunction, part.note, faulty)] += 1
    return found


def unexplained(path: Path) -> list[Left]:
    """Return what is left over without a reason."""
    return [one for one in left_over(path) if not explained(one, path.name in FAULTY)]


def explained(one: Left, faulty: bool) -> bool:
    """Tell whether there is a reason."""
    if one.faulty:
        return faulty
    place = (one.group, one.subfunction)
    if one.layout == SURPLUS.name:
        return False
    return place in UNKNOWN or (place == READ_SZL and one.note in IN_PARTS)


OWN: Final = [
    path
    for folder in (ROOT / "captures", ROOT / "captures" / "crafted")
    for path in sorted(folder.glob("*.pc*"))
    if not path.name.startswith("cut-")
]


@each("path", OWN)
def test_no_octets_are_left_over(path: Path) -> None:
    assert unexplained(path) == []


def test_no_octets_are_left_over_in_public_captures(corpus: Path) -> None:
    paths = sorted(corpus.glob("*.pc*"))
    assert len(paths) == 20
    total: Counter[Left] = Counter()
    for path in paths:
        assert unexplained(path) == [], path.name
        total += left_over(path)
    assert {one.note for one in total} == IN_PARTS
    assert {(one.group, one.subfunction, one.layout) for one in total} == {(*READ_SZL, OCTETS.name)}


def test_every_reason_is_needed() -> None:
    assert {path.name for path in OWN if any(one.faulty for one in left_over(path))} == FAULTY
    met = {(one.group, one.subfunction) for path in OWN for one in left_over(path) if not one.faulty}
    assert met == {*UNKNOWN, READ_SZL}
