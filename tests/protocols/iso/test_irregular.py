"""Which headers hold a DT of class 0, and where a whole PDU begins behind one that is irregular."""

from __future__ import annotations

import pytest

from dissect.protocols.iso.cotp import parse_tpdu
from dissect.protocols.iso.irregular import holds_data, is_odd, odd_place
from dissect.protocols.iso.tables import DT
from dissect.protocols.iso.upper import is_sound
from tests.cases import each
from tests.engine.transactions.talk import dbw, read, words
from tests.protocols.s7plus.pdus import asked, framed

PDUS = (read(1, dbw(1, 0)), words(1, 7), framed(asked(1)), framed(asked(1), 3))


def place(octets: bytes, class_: int = 0) -> int:
    return int(odd_place(parse_tpdu(octets), octets, class_))


@each("li", range(256))
def test_every_length_indicator(li: int) -> None:
    """Over any end mark and type, with TPDUs shorter and longer than the length indicator says."""
    for pdu in PDUS:
        for kind in (0xF0, 0xF1, 0xE0, 0x10, 0x30, 0x00):
            for eot in (0x80, 0x00, 0x05):
                octets = bytes((li, kind, eot)) + pdu
                holds = 2 <= li <= 254 and li < len(octets)
                assert holds_data(octets) == holds
                if not holds:
                    assert place(octets) == place(octets, 2) == place(octets, -1) == 3
                    continue
                odd = is_odd(parse_tpdu(octets), octets, 0)
                assert not odd or kind >> 4 == DT
                regular = kind >> 4 != DT or li == 2
                found = 3 if eot & 0x80 else li + 1 if is_sound(octets, li + 1, len(octets)) else -1
                assert place(octets) == (-1 if regular else found), (li, kind, eot)


@pytest.mark.parametrize("li", [0, 1])
def test_a_pdu_may_stand_where_the_length_indicator_says(li: int) -> None:
    for pdu in PDUS:
        octets = bytes((li, 0xF0))[: li + 1] + pdu
        assert not holds_data(octets)
        assert place(octets) == li + 1


def test_octets_may_follow_it() -> None:
    """Where the header holds no DT; a DT that is read has to be just as long as its PDU."""
    for pdu in PDUS[:2]:
        for more in (b"\0", b"\x32\x01", pdu, bytes(300)):
            for li in (0, 1, 255):
                assert place(bytes((li, 0xF0, 0x80)) + pdu + more) == 3
            assert place(b"\x03\xf0\x80" + pdu + more) == -1


def test_half_a_pdu_is_none() -> None:
    for pdu in PDUS[:2]:
        for octets in (pdu[:-1], pdu[:9], pdu[1:], b"\x32\x05" + pdu[2:] + b"\0", b""):
            for li in (0, 1, 255, 200):
                assert place(bytes((li, 0xF0, 0x80)) + octets) == -1


def test_a_connection_of_class_2_has_longer_headers() -> None:
    octets = b"\x04\xf0\x00\x21\x80" + PDUS[0]
    assert holds_data(octets)
    assert place(octets, 2) == -1  # regular there
    assert place(octets, 0) == 5
