"""Whether a response refuses items, and whether it has those that were asked for.

Several threads ask at the same time: a program may analyze captures side by side.
"""

from __future__ import annotations

import sys
from concurrent.futures import ThreadPoolExecutor
from threading import Barrier

import pytest

from dissect.protocols.s7plus.check import Check, check
from dissect.protocols.s7plus.check_response import check_response, count_mismatch
from dissect.protocols.s7plus.contents import VariableAddress
from dissect.protocols.s7plus.tables import DELETE_OBJECT, GET_MULTI_VARIABLES, SET_MULTI_VARIABLES
from dissect.protocols.s7plus.value_tables import INT
from dissect.protocols.s7plus.values import Value
from dissect.wire.varint import VLQ64, build_varint
from tests.protocols.s7plus.bodies import FILL, QUALIFIER, end, get_multi, multi_got, number, rid, set_multi
from tests.protocols.s7plus.pdus import asked, framed, told

_FIVE = Value(0, INT, 5)
_REFUSED = framed(told(1, GET_MULTI_VARIABLES, multi_got([(1, _FIVE)] * 20, [(21, 2**64 - 12)])))
_GOOD = framed(told(1, GET_MULTI_VARIABLES, multi_got([(1, _FIVE)] * 9, [])))
_DENIED = framed(told(1, DELETE_OBJECT, build_varint(0xFFFF9C, VLQ64)), 3)


def test_threads_do_not_disturb_each_other() -> None:
    together = Barrier(3)

    def ask(octets: bytes) -> set[tuple[int, bool]]:
        together.wait()
        return {check_response(check(octets)) for _ in range(5000)}

    interval = sys.getswitchinterval()
    sys.setswitchinterval(1e-6)
    try:
        with ThreadPoolExecutor(3) as pool:
            found = list(pool.map(ask, (_REFUSED, _GOOD, _DENIED)))
    finally:
        sys.setswitchinterval(interval)
    assert found == [{(0, True)}, {(0, False)}, {(0xFF9C, True)}]


def read_instead(octets: bytes) -> Check:
    """The check of a PDU that is to be read, whatever it found."""
    found = check(octets)
    found.sound = False
    return found


# ---- items that were asked for --------------------------------------------------------------------------------------

_DENIED_ITEM = 2**64 - 12
_REFUSING = b"\x13"
_WORDS = [VariableAddress(0, 82, 3736, [3, 2 * at, 2]) for at in range(200)]


def _answer(*numbers: int, refused: tuple[int, ...] = (), code: bytes = b"\0") -> bytes:
    return code + multi_got([(one, _FIVE) for one in numbers], [(one, _DENIED_ITEM) for one in refused])[1:]


@pytest.mark.parametrize("version", [1, 2, 3])
@pytest.mark.parametrize(
    ("count", "answer", "said"),
    [
        (2, _answer(1, 2), ""),
        (200, _answer(*range(1, 201)), ""),
        (2, _answer(2, 1), ""),
        (2, _answer(1, refused=(2,), code=_REFUSING), ""),
        (1, _answer(1, 2), "requested 1 item, the answer has item 2, which was not requested"),
        (2, _answer(1, 2, 7), "requested 2 items, the answer has item 7, which was not requested"),
        (2, _answer(1, 2, refused=(9,)), "requested 2 items, the answer has item 9, which was not requested"),
        (2, _answer(1, 1, 2), "requested 2 items, the answer has item 1 (2 times)"),
        (2, _answer(1, 2, refused=(2,)), "requested 2 items, the answer has item 2 (2 times)"),
        (2, _answer(1), "requested 2 items, the answer has no item 2"),
        (2, _answer(), "requested 2 items, the answer has no item 1, no item 2"),
        (
            5,
            _answer(9),
            "requested 5 items, the answer has item 9, which was not requested, no item 1, no item 2 and 3 more",
        ),
        (2, _answer(1, code=b"\xff" * 8 + b"\xf4"), ""),  # refused as a whole
    ],
)
def test_an_answer_has_the_items_that_were_read(version: int, count: int, answer: bytes, said: str) -> None:
    if version == 1:  # has no integrity id
        answer = answer.removesuffix(end(9)) + FILL
    request = framed(asked(1, GET_MULTI_VARIABLES, body=get_multi(*_WORDS[:count], integrity_id=-1)), version)
    response = framed(told(1, GET_MULTI_VARIABLES, answer), version)
    assert count_mismatch(GET_MULTI_VARIABLES, request, check(response)) == said
    assert count_mismatch(GET_MULTI_VARIABLES, request, read_instead(response)) == said


def test_items_are_counted_on_the_way() -> None:
    for numbers, count in (((1, 2, 3), 3), ((1, 2, 2), 0), ((0x80, 1), 0), ((2, 1), 0), ((1, 3), 0), ((), 0)):
        assert max(check(framed(told(1, GET_MULTI_VARIABLES, _answer(*numbers)))).numbered, 0) == count
    assert check(framed(told(1, GET_MULTI_VARIABLES, _answer(1, refused=(2,))))).refuses


@pytest.mark.parametrize(
    ("refused", "said"),
    [
        ((), ""),
        ((2,), ""),
        ((3,), "requested 2 items, the answer has item 3, which was not requested"),
        ((1, 1), "requested 2 items, the answer has item 1 (2 times)"),
    ],
)
def test_an_answer_refuses_items_that_were_written(refused: tuple[int, ...], said: str) -> None:
    request = framed(asked(1, SET_MULTI_VARIABLES, body=set_multi([(one, _FIVE) for one in _WORDS[:2]])), 3)
    refusals = b"".join([number(one) + build_varint(_DENIED_ITEM, VLQ64) for one in refused])
    response = framed(told(1, SET_MULTI_VARIABLES, b"\x13" + refusals + b"\0" + end(9)), 3)
    assert count_mismatch(SET_MULTI_VARIABLES, request, check(response)) == said


def test_attributes_of_one_object_are_items_too() -> None:
    body = rid(0x3E8) + number(2) + number(2) + number(1053) + number(1049) + QUALIFIER + end(9)
    request = framed(asked(1, GET_MULTI_VARIABLES, body=body), 3)
    for numbers, said in (
        ((1, 2), ""),
        ((1, 2, 3), "requested 2 items, the answer has item 3, which was not requested"),
    ):
        response = framed(told(1, GET_MULTI_VARIABLES, _answer(*numbers)), 3)
        assert count_mismatch(GET_MULTI_VARIABLES, request, check(response)) == said


@pytest.mark.parametrize("size", range(0, 60, 7))
def test_what_is_not_whole_is_not_compared(size: int) -> None:
    request = framed(asked(1, GET_MULTI_VARIABLES, body=get_multi(*_WORDS[:2])), 3)
    response = framed(told(1, GET_MULTI_VARIABLES, _answer(1, 2, 3)), 3)
    assert count_mismatch(GET_MULTI_VARIABLES, request, check(response))
    assert count_mismatch(GET_MULTI_VARIABLES, request[:size], check(response)) == ""
    cut = response[:size]
    assert count_mismatch(GET_MULTI_VARIABLES, request, check(cut)) == ""


@pytest.mark.parametrize(("list_end", "refused"), [("00", False), ("8000", False), ("8001", True), ("80", True)])
def test_the_end_of_a_list_may_be_longer_than_one_octet(list_end: str, refused: bool) -> None:
    """Found by fuzzing: the quick look and the slow one said different things of it."""
    octets = framed(told(1, SET_MULTI_VARIABLES, b"\0" + bytes.fromhex(list_end)), 1)
    assert check_response(read_instead(octets)) == (0, refused)
    assert check_response(check(octets)) == (0, refused)
