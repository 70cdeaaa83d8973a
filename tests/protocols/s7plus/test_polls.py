"""The operating state is read again and again: no change is missed, in whatever form the answer comes."""

from __future__ import annotations

import pytest
from hypothesis import given
from hypothesis import strategies as st

from dissect.protocols.s7plus.contents import VariableAddress
from dissect.protocols.s7plus.event import REPLAYED, RUNNING, STOPPED
from dissect.protocols.s7plus.events import take
from dissect.protocols.s7plus.program import Program
from dissect.protocols.s7plus.session import Identity, PlusSession
from dissect.protocols.s7plus.tables import GET_MULTI_VARIABLES
from dissect.protocols.s7plus.value_tables import DINT, INT
from dissect.protocols.s7plus.values import Value
from tests.protocols.s7plus.bodies import get_multi, multi_got
from tests.protocols.s7plus.pdus import asked, framed, told

STATE = VariableAddress(0, 52, 2237, [3486])
WORD = VariableAddress(0, 82, 3736, [3, 100, 2])
STOP, RUN = 4, 8


class Line:
    """A connection on which the state is polled."""

    def __init__(self, version: int, *before: VariableAddress) -> None:
        self.session = PlusSession(Program(), Identity())
        self.version = version
        self.before = before
        self.number = 0

    def poll(self, state: int, ids: tuple[int, int] = (1, 2), others: int = 5, plain: bool = True) -> list[str]:
        """Give the events in a poll; one that is not plain refuses an item that nobody asked for."""
        self.number += 1
        asks, tells = ids if self.version > 1 else (-1, -1)
        values = [Value(0, INT, others) for _ in self.before]
        items = list(enumerate([*values, Value(0, DINT, state)], 1))
        request = framed(asked(self.number, body=get_multi(*self.before, STATE, integrity_id=asks)), self.version)
        refusals = [] if plain else [(len(items) + 1, 0xFFF4)]
        answer = framed(told(self.number, body=multi_got(items, refusals, tells)), self.version)
        facts = take(self.session, GET_MULTI_VARIABLES, request, answer)
        return [event.kind for event in facts.events] if facts is not None else []


@pytest.mark.parametrize("version", [1, 2, 3])
def test_a_change_is_seen(version: int) -> None:
    line = Line(version)
    assert line.poll(RUN) == []
    assert line.poll(RUN, (7, 300), plain=False) == []
    assert line.poll(STOP, (0, 0)) == [STOPPED]
    assert line.poll(STOP, (0x4000, 0x200000)) == []
    assert line.poll(RUN, (128, 128), plain=False) == [RUNNING]


@pytest.mark.parametrize(("state", "said"), [(STOP, "STOP"), (RUN, "RUN"), (6, "state 6"), (0, "state 0")])
@pytest.mark.parametrize("plain", [True, False])
def test_a_state_without_a_name_is_told_by_its_number(state: int, said: str, plain: bool) -> None:
    line = Line(2)
    line.poll(RUN)
    line.session.identity.told = []
    line.poll(state, plain=plain)
    assert line.session.identity.told == [("operating_mode", said, "operating state variable")]


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
        events = line.poll(state, (asks, tells), value)
        assert events == ([] if before in {-1, state} else [STOPPED if state == STOP else RUNNING])
        before = state


@pytest.mark.parametrize("version", [2, 3])
def test_a_poll_that_is_sent_again_is_seen(version: int) -> None:
    """Reading one item and reading all judge the integrity id alike."""
    read, polled = Line(version), Line(version)
    for line in (read, polled):
        line.session.given.add(0x386)
    told = []
    for number, ids in enumerate([(10, 20), (11, 21), (12, 22), (12, 22), (5, 9), (13, 0)]):
        wanted = read.poll(RUN, ids, plain=False)
        assert polled.poll(RUN, ids) == wanted, number
        told += wanted
    assert told == [REPLAYED] * 2
