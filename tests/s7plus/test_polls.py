"""The operating state is read again and again: the same answer is not read twice, and no change is missed."""

from __future__ import annotations

import pytest
from hypothesis import given
from hypothesis import strategies as st

from dissect.s7plus.contents import Address
from dissect.s7plus.events import REPLAYED, RUNNING, STOPPED, take
from dissect.s7plus.program import Program
from dissect.s7plus.session import Identity, PlusSession
from dissect.s7plus.tables import GET_MULTI_VARIABLES
from dissect.s7plus.value_tables import DINT, INT
from dissect.s7plus.values import Value
from tests.s7plus.bodies import get_multi, multi_got
from tests.s7plus.pdus import asked, framed, told

STATE = Address(0, 52, 2237, [3486])
WORD = Address(0, 82, 3736, [3, 100, 2])
STOP, RUN = 4, 8


class Line:
    """A connection on which the state is polled."""

    def __init__(self, version: int, *before: Address) -> None:
        self.session = PlusSession(Program(), Identity())
        self.version = version
        self.before = before
        self.number = 0

    def poll(self, state: int, ids: tuple[int, int] = (1, 2), others: int = 5) -> tuple[bool, list[str]]:
        """Give whether the poll was read, and the events in it."""
        self.number += 1
        asks, tells = ids if self.version > 1 else (-1, -1)
        values = [Value(0, INT, others) for _ in self.before]
        items = list(enumerate([*values, Value(0, DINT, state)], 1))
        request = framed(asked(self.number, body=get_multi(*self.before, STATE, integrity_id=asks)), self.version)
        answer = framed(told(self.number, body=multi_got(items, [], tells)), self.version)
        facts = take(self.session, GET_MULTI_VARIABLES, request, answer)
        return facts is not None, [event.kind for event in facts.events] if facts is not None else []


@pytest.mark.parametrize("version", [1, 2, 3])
def test_the_same_answer_is_read_once_and_a_change_is_seen(version: int) -> None:
    line = Line(version)
    assert line.poll(RUN) == (True, [])
    assert line.poll(RUN, (7, 300)) == (False, [])
    assert line.poll(STOP, (0, 0)) == (True, [STOPPED])
    assert line.poll(STOP, (0x4000, 0x200000)) == (False, [])
    assert line.poll(RUN, (128, 128)) == (True, [RUNNING])


@given(
    st.integers(1, 3),
    st.lists(
        st.tuples(
            st.sampled_from([STOP, RUN]), st.integers(0, 2**32 - 1), st.integers(0, 2**32 - 1), st.integers(-3, 3)
        ),
        max_size=12,
    ),
    st.booleans(),
)
def test_no_change_is_missed(version: int, polls: list[tuple[int, int, int, int]], other: bool) -> None:
    line = Line(version, *([WORD] if other else []))
    before = -1
    for state, asks, tells, value in polls:
        _, events = line.poll(state, (asks, tells), value)
        assert events == ([] if before in {-1, state} else [STOPPED if state == STOP else RUNNING])
        before = state


def test_what_is_kept_is_bounded() -> None:
    line = Line(3)
    for number in range(200):
        line.before = (Address(0, 82, 3736, [3, number, 2]),)
        line.poll(RUN)
    assert len(line.session.polls) == 64


def test_an_answer_with_refusals_of_which_nothing_is_known_is_read_again() -> None:
    session = PlusSession(Program(), Identity())
    for number in (1, 2):
        request = framed(asked(number, body=get_multi(STATE)), 1)
        answer = framed(told(number, body=multi_got([], [(1, 0xFFF4)], -1)), 1)
        assert take(session, GET_MULTI_VARIABLES, request, answer) is not None


@pytest.mark.parametrize("version", [2, 3])
def test_a_poll_that_is_sent_again_is_seen(version: int) -> None:
    """Which is read in its place only by its numbers: they say the same as when all of it is read."""
    read, polled = Line(version), Line(version)
    for line in (read, polled):
        line.session.given.add(0x386)
    told = []
    for number, ids in enumerate([(10, 20), (11, 21), (12, 22), (12, 22), (5, 9), (13, 0)]):
        read.session.polls.clear()
        wanted = read.poll(RUN, ids)[1]
        assert polled.poll(RUN, ids)[1] == wanted, number
        told += wanted
    assert told == [REPLAYED] * 2
