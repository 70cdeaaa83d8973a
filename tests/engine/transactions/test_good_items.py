from __future__ import annotations

import pytest

from dissect.engine.transactions.good_items import GoodItems, good_octets
from dissect.engine.transactions.naming import Naming
from dissect.engine.transactions.results import ALIKE, GAPS, REORDERED
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


@pytest.mark.parametrize(
    ("name", "value"),
    [
        ("_outcome", 0),
        ("response_parameters", None),
        ("response_rosctr", 2),
        ("rosctr", 7),
        ("request_size", 0),
        ("has_errors", True),
    ],
)
def test_what_is_no_answered_read_has_no_good_octets(name: str, value: object) -> None:
    found = read_of(good(4, b"\x00\x2a"), request=(dbw(1, 0),))
    stepper = GoodItems()
    assert stepper.begin(found)
    setattr(found, name, value)
    assert not stepper.begin(found)
    assert good_octets(found) is None


def test_with_tags_items_are_not_stepped_over() -> None:
    found = read_of(good(4, b"\x00\x2a"), request=(dbw(1, 0),))
    found.connection.naming = Naming()
    assert good_octets(found) is None


def test_the_answer_to_another_function_has_no_good_octets() -> None:
    talk = Talk()
    talk.open()
    talk.ask(read(1, dbw(1, 0)))
    talk.tell(ack_data(1, b"\x05\x01", b"\xff"))
    talk.close()
    stepper = GoodItems()
    assert not stepper.begin(talk.transactions[0])
    assert not stepper.whole


def test_areas_of_one_item_are_left_to_the_results() -> None:
    areas = bytes.fromhex("120cb00202004401600100480030")
    found = read_of(b"\xff\x09\x00\x05" + bytes.fromhex("ff0001ff7a"), request=(areas,))
    assert not found.has_errors
    assert good_octets(found) is None


def test_it_steps_from_item_to_item() -> None:
    found = read_of(good(4, b"\x00\x2a"), good(4, b"\x01\x02\x03") + b"\x00", good(4, b"\x00\x2b"))
    stepper = GoodItems()
    assert stepper.begin(found)
    places = []
    while stepper.step():
        places.append((int(stepper.index), stepper.buf[stepper.at : stepper.at + stepper.size].hex(), stepper.whole))
    assert places == [(0, "002a", False), (1, "010203", False), (2, "002b", False)]
    assert stepper.whole
    assert stepper.begin(found)  # once more
    assert (stepper.index, stepper.whole) == (-1, False)


@pytest.mark.parametrize(
    ("data", "whole"),
    [
        (b"\xff\x04\x00\x18abc", True),  # without the fill octet
        (b"\xff\x04\x00\x18abc\0", True),
        (b"\xff\x09\x00\x03abc", True),
        (b"\xff\x04\x00\x10ab\0", False),  # two octets instead of three
        (b"\xff\x04\x00\x20abcd", False),
        (b"\xff\x04\x00\x18ab", False),
        (b"\xff\x04\x00", False),
        (b"\x0a\x04\x00\x18abc", False),
    ],
)
@pytest.mark.parametrize("begins", [False, True])
def test_an_answer_with_some_fault_is_judged_item_by_item(begins: bool, data: bytes, whole: bool) -> None:
    """``begins``: a good item comes before it. Where a flag of the transaction is set, sizes are not trusted."""
    answers = [good(4, b"\x00\x2a"), data] if begins else [data]
    places = [dbw(1, 8), item(0x84, 1, 16, 2, 3)] if begins else [item(0x84, 1, 16, 2, 3)]
    found = read_of(*answers, request=tuple(places))
    for flag in (0, REORDERED):
        found._flags |= flag
        found.has_errors = False
        octets = good_octets(found)
        assert octets == ([b"\x00\x2a"] * begins + [b"abc"] if whole else None)


def test_octets_after_the_answer_are_not_its_own() -> None:
    """The answer is in a segment with others."""
    talk = Talk()
    talk.open(8, 8)
    talk.ask(read(1, dbw(1, 0)), read(2, dbw(1, 2)))
    talk.tell(ack_data(1, b"\x04\x01", good(4, b"\0\1")[:-1]), ack_data(2, b"\x04\x01", good(4, b"\0\2")))
    first, second = talk.transactions
    assert (good_octets(first), good_octets(second)) == (None, [b"\0\2"])


@pytest.mark.parametrize("length", [4, 32])
def test_a_length_in_bits_or_octets_is_taken_by_the_octets_that_are_there(length: int) -> None:
    """Transport size 6 counts octets for some devices, bits for others."""
    found = read_of(b"\xff\x06\x00" + bytes((length,)) + b"\0\0\0\1", request=(item(0x84, 1, 0, 7, 1),))
    assert found._flags
    assert good_octets(found) == [b"\0\0\0\1"]
