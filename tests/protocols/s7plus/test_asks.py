"""Which reads ask for the operating state of the CPU or for its identification, and by which item."""

from __future__ import annotations

from typing import Final

import pytest

from dissect.protocols.s7plus.check import check
from dissect.protocols.s7plus.contents import VariableAddress
from dissect.protocols.s7plus.reads import Reads
from dissect.protocols.s7plus.tables import GET_MULTI_VARIABLES, GET_VAR_SUBSTREAMED
from dissect.protocols.s7plus.value_tables import DINT, STRUCT, WSTRING
from dissect.protocols.s7plus.values import Struct, Value
from tests.protocols.s7plus import bodies
from tests.protocols.s7plus.bodies import QUALIFIER, end, number, rid
from tests.protocols.s7plus.lines import Line
from tests.protocols.s7plus.pdus import asked, framed

WORD: Final = VariableAddress(0, 82, 3736, [3, 100, 2])
STATE: Final = VariableAddress(0, 52, 2237, [3486])
CONDITION: Final = VariableAddress(0, 52, 2237, [])


def asks(function: int, body: bytes) -> tuple[bool, int]:
    """Say whether a read asks, and for which item; several frames say the same."""
    data = asked(7, function, body=body)
    whole = check(framed(data, 3))
    assert whole.sound
    frames = check(framed(data[:25], 3, trailer=False) + framed(data[25:], 3))
    assert (frames.asks, frames.item) == (whole.asks, whole.item)
    said = Reads(whole)
    assert (said.asks, said.item) == (whole.asks, whole.item)
    return whole.asks, int(whole.item)


@pytest.mark.parametrize(
    ("wanted", "asking"),
    [
        ([STATE], [1]),
        ([CONDITION], [1]),
        ([WORD, CONDITION], [2]),
        ([WORD, WORD, STATE, WORD], [3]),
        ([STATE, CONDITION], [1, 2]),
        ([STATE, WORD, CONDITION, STATE], [1, 3, 4]),
        ([VariableAddress(0, 52, 2237, [1, 3486])], [1]),
        ([VariableAddress(0, 52, 2237, [3486, 1])], []),
        ([VariableAddress(0, 52, 2237, [2237])], []),
        ([VariableAddress(0, 52, 3486, [])], []),
        ([VariableAddress(0, 52, 2238, [])], []),
        ([VariableAddress(0, 49, 2237, [3486])], []),
        ([VariableAddress(0, 53, 2237, [])], []),
        ([WORD], []),
        ([], []),
    ],
)
def test_a_read_of_several_variables(wanted: list[VariableAddress], asking: list[int]) -> None:
    body = bodies.get_multi(*wanted)
    assert asks(GET_MULTI_VARIABLES, body) == (bool(asking), asking[0] if len(asking) == 1 else 0)


def of_object(object_id: int, ids: list[int]) -> bytes:
    listed = b"".join([number(id_) for id_ in ids])
    return rid(object_id) + number(len(ids)) * 2 + listed + QUALIFIER + end(9)


@pytest.mark.parametrize(
    ("object_id", "ids", "asking"),
    [
        (52, [2237], [1]),
        (52, [233, 2237], [2]),
        (52, [2237, 233, 2167], [1]),
        (52, [2237, 2237], [1, 2]),
        (52, [3486], []),
        (52, [0, 233], []),
        (49, [2237], []),
        (52, [], []),
    ],
)
def test_a_read_of_attributes_of_one_object(object_id: int, ids: list[int], asking: list[int]) -> None:
    assert asks(GET_MULTI_VARIABLES, of_object(object_id, ids)) == (
        bool(asking), asking[0] if len(asking) == 1 else 0
    )  # fmt: skip


@pytest.mark.parametrize(
    ("object_id", "ids", "asking"),
    [
        (52, [2237], True), (52, [2237, 3486], True), (52, [2237, 1, 3486], True), (52, [3486], True),
        (52, [2237, 5], False), (52, [2167], False), (52, [3487], False), (51, [2237], False),
        (49, [3753], True), (49, [3753, 7], True), (49, [7, 3753], False), (49, [3752], False), (49, [3754], False),
        (50, [3753], False), (48, [3753], False), (49, [2237], False),
    ],
)  # fmt: skip
def test_a_read_of_one_attribute(object_id: int, ids: list[int], asking: bool) -> None:
    assert asks(GET_VAR_SUBSTREAMED, bodies.get_stream(object_id, ids) + end(9)) == (asking, 0)


def test_a_state_that_is_read_as_an_attribute_is_compared_with_the_one_before() -> None:
    line = Line()

    def poll(state: int) -> list[str]:
        held = Struct(3481, [(3482, Value(0, DINT, 4)), (3486, Value(0, DINT, state))])
        items = [(1, Value(0, WSTRING, "CPU")), (2, Value(0, STRUCT, held))]
        events = line.take(GET_MULTI_VARIABLES, of_object(52, [233, 2237]), bodies.multi_got(items, []))
        return [kind for kind, _, _ in events]

    assert [poll(8), poll(8), poll(4), poll(8)] == [[], [], ["stopped"], ["running"]]
