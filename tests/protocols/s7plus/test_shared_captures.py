"""Every PDU of the shared captures, read to its last octet; and what requests and responses must have to do with each other."""

from __future__ import annotations

from pathlib import Path
from typing import Final

import pytest

from dissect.engine.observer import Observer
from dissect.engine.transactions.side import Side
from dissect.files.session import Run
from dissect.protocols.s7plus.bodies import parse_contents
from dissect.protocols.s7plus.contents import Contents
from dissect.protocols.s7plus.message import PlusPdu, parse_plus
from dissect.protocols.s7plus.tables import KEEP_ALIVE, REQUEST, RESPONSE

#: PDUs of each capture, and pairs of integrity ids in it.
CAPTURES: Final = {
    "s7comm_and_s7commplus_sll.pcap": (121, 8),
    "s7commplus_1511_opc_all_types.pcap": (18, 7),
}


class Pdus(Observer):
    """Keeps the S7comm-plus PDUs of a capture with what they carry; none is cut, unless ``cut``."""

    def __init__(self, cut: bool) -> None:
        super().__init__()
        self.cut = cut
        self.wants_pdus = True
        self.found: list[tuple[PlusPdu, Contents]] = []

    def plus_pdu(self, frame: int, time_ns: int, side: Side, octets: bytes, cut: bool) -> None:
        assert self.cut or not cut
        pdu = parse_plus(octets, frame, time_ns, side.connection.number, side.index)
        self.found.append((pdu, parse_contents(pdu)))


def pdus(path: Path, cut: bool = False) -> list[tuple[PlusPdu, Contents]]:
    observer = Pdus(cut)
    run = Run([str(path)], observer)
    while run.step():
        pass
    run.finish()
    return observer.found


def broken_integrity_ids(found: list[tuple[PlusPdu, Contents]]) -> tuple[int, list[int]]:
    """Hold the integrity id of every response to that of its request: it is larger by the sequence number.

    Returns the number of pairs, and the frames of the responses that break the rule.
    """
    asked: dict[tuple[int, int, int], int] = {}
    pairs = 0
    broken: list[int] = []
    for pdu, contents in found:
        key = (pdu.connection, pdu.side if pdu.opcode == REQUEST else 1 - pdu.side, pdu.sequence)
        if pdu.opcode == REQUEST and contents.integrity_id >= 0:
            asked[key] = contents.integrity_id
        elif pdu.opcode == RESPONSE and contents.integrity_id >= 0 and key in asked:
            pairs += 1
            if contents.integrity_id != (asked.pop(key) + pdu.sequence) & 0xFFFFFFFF:
                broken.append(pdu.frame)
    return pairs, broken


def test_every_pdu_is_read_to_its_last_octet(corpus: Path) -> None:
    """The oracle of this protocol: no other program reads it."""
    total = 0
    pairs = 0
    for path in [*sorted((corpus / "s7plus").glob("*.pcap*")), *[corpus / name for name in CAPTURES]]:
        found = pdus(path)
        for pdu, contents in found:
            assert pdu.malformed == [], f"{path.name} packet {pdu.frame}"
            assert pdu.whole, f"{path.name} packet {pdu.frame}"
            assert contents.malformed == [], f"{path.name} packet {pdu.frame}: {contents.malformed[0]}"
            assert contents.whole or pdu.version == KEEP_ALIVE, f"{path.name} packet {pdu.frame}"
            if contents.parts:
                ends = [part.end for part in contents.parts]
                assert [part.offset for part in contents.parts[1:]] == ends[:-1], f"{path.name} packet {pdu.frame}"
                assert ends[-1] == len(pdu.data), f"{path.name} packet {pdu.frame}"
        total += len(found)
        here, broken = broken_integrity_ids(found)
        assert broken == [], path.name
        pairs += here
    assert (total, pairs) == (2414, 611)


@pytest.mark.parametrize("name", CAPTURES)
def test_the_older_captures(corpus: Path, name: str) -> None:
    found = pdus(corpus / name)
    assert (len(found), broken_integrity_ids(found)[0]) == CAPTURES[name]
