from __future__ import annotations

import pytest

from dissect.engine.transactions.good_items import good_octets
from dissect.engine.transactions.results import ALIKE, GAPS
from dissect.engine.transactions.transaction import Transaction
from tests.engine.transactions.talk import Talk, ack_data, dbw, good, item, read, refused, write, written


def read_of(
    *answers: bytes, request: tuple[bytes, ...] = (dbw(1, 0), item(0x84, 1, 16, 2, 3), dbw(1, 8))
) -> Transaction:
    talk = Talk()
    talk.open()
    talk.ask(read(1, *request))
    talk.tell(ack_data(1, bytes((4, len(answers))), b"".join(answers)))
    talk.close()
    return talk.transactions[-1]


def test_octets_of_a_good_read_are_those_of_its_results() -> None:
    found = read_of(good(4, b"\x00\x2a"), good(4, b"\x01\x02\x03") + b"\x00", good(4, b"\x00\x2b"))
    assert good_octets(found) == [b"\x00\x2a", b"\x01\x02\x03", b"\x00\x2b"]
    assert good_octets(found) == [result.data for result in found.s7_results]


def test_no_good_octets_where_anything_is_odd() -> None:
    whole = (good(4, b"\x00\x2a"), good(4, b"\x01\x02\x03") + b"\x00", good(4, b"\x00\x2b"))
    assert good_octets(read_of(whole[0], refused(0x0A), whole[2])) is None
    assert good_octets(read_of(*whole[:2])) is None  # fewer answers than items
    assert good_octets(read_of(whole[0], whole[1], good(4, b"\x00\x2b")[:-1])) is None  # the last is cut short
    assert good_octets(read_of(good(4, b"\x00\x2a"), request=())) is None
    talk = Talk()
    talk.open()
    talk.ask(read(1, dbw(1, 0)))
    talk.ask(write(2, [dbw(1, 0)], written(4, b"\x00\x2a")))
    talk.tell(ack_data(2, b"\x05\x01", b"\xff"))
    talk.close()
    assert [good_octets(found) for found in talk.transactions] == [None, None]


@pytest.mark.parametrize("flag", [GAPS, ALIKE])
def test_a_read_that_is_only_likely_is_not_taken_for_an_ordinary_one(flag: int) -> None:
    """What steps over the items writes no mark."""
    found = read_of(good(4, b"\x00\x2a"), request=(dbw(1, 0),))
    assert good_octets(found) == [b"\x00\x2a"]
    found._flags |= flag
    assert good_octets(found) is None
    assert [result.data for result in found.s7_results] == [b"\x00\x2a"]


def test_an_item_of_no_octets_has_none() -> None:
    nothing = dbw(1, 0, 0)
    assert good_octets(read_of(good(4, b""), good(4, b"\x00\x2a"), request=(nothing, dbw(1, 2)))) == [b"", b"\x00\x2a"]
    assert good_octets(read_of(good(4, b"\0\1"), good(4, b"\x00\x2a"), request=(nothing, dbw(1, 2)))) is None
