"""An end in doubt: what holds it, what refutes it, what says nothing of it."""

from __future__ import annotations

from hypothesis import given
from hypothesis import strategies as st

from dissect.packets.tcp.doubt import HOLDS, OPEN, REFUTED, Doubt
from dissect.packets.tcp.stream import MASK, HalfStream
from tests.cases import each


def streams(isn: int = 1000, answering: int = 5000) -> list[HalfStream]:
    """Return both directions of a connection, ten octets of each passed on."""
    both = [HalfStream(), HalfStream()]
    for stream, start in zip(both, (isn, answering), strict=True):
        stream.start(start)
        stream.passed(bytes(10), 10)
    return both


def look(doubt: Doubt, both: list[HalfStream], my_ack: int = -1, their_ack: int = -1) -> int:
    """Ask, as for an end of the first side."""
    return int(doubt.look(both[0], both[1], my_ack, their_ack))


def doubted(both: list[HalfStream], distance: int, how: str = "reset") -> Doubt:
    """Return the doubt about an end of the first side."""
    return Doubt(how, 0, (both[0].next_seq + distance) & MASK, 7, 70, both)


@each("isn", [1000, MASK - 15, 2**31 - 12])
@each("how", ["reset", "fin"])
@each("distance", [5000, 1, -1, -5000])
def test_both_sides_have_to_go_on(isn: int, how: str, distance: int) -> None:
    both = streams(isn, MASK - 15)
    doubt = doubted(both, distance, how)
    assert doubt.distance == distance
    assert look(doubt, both, both[1].next_seq, both[0].next_seq) == OPEN
    both[1].passed(bytes(10), 10)
    assert look(doubt, both, int(both[1].next_seq), both[0].next_seq) == OPEN
    both[0].passed(bytes(20), 20)
    assert look(doubt, both, (both[1].next_seq - 1) & MASK, both[0].next_seq) == (REFUTED if distance == 1 else OPEN)
    assert look(doubt, both, -1, both[0].next_seq) == (REFUTED if distance == 1 else OPEN)
    assert look(doubt, both, both[1].next_seq, both[0].next_seq) == REFUTED


def test_what_fills_up_to_the_end_is_no_sign_of_life() -> None:
    both = streams()
    doubt = doubted(both, 20)
    both[1].passed(bytes(10), 10)
    assert look(doubt, both) == OPEN
    both[0].passed(bytes(20), 20)
    assert look(doubt, both, both[1].next_seq) == OPEN
    both[0].passed(bytes(1), 1)
    assert look(doubt, both) == REFUTED


def test_octets_that_were_held_before_it_are_not_from_beyond() -> None:
    both = streams()
    both[0].accept(1030, bytes(10), 5, 50)
    doubt = doubted(both, 5)
    both[0].give_up()
    assert both[0].next_seq == 1040
    assert look(doubt, both) == OPEN
    both[0].passed(bytes(1), 1)
    assert look(doubt, both) == REFUTED


def test_nothing_is_said_while_octets_are_held() -> None:
    both = streams()
    doubt = doubted(both, -3)
    both[1].accept(5020, bytes(10), 5, 50)
    assert look(doubt, both, 5030) == OPEN
    both[1].give_up()
    assert look(doubt, both, 5030) == OPEN
    both[0].accept(1020, bytes(10), 6, 60)
    assert look(doubt, both, 5030) == OPEN
    both[0].give_up()
    assert look(doubt, both, 5030) == REFUTED


@given(st.integers(1, 2**20), st.integers(0, MASK))
def test_a_fin_that_is_acknowledged_holds(distance: int, isn: int) -> None:
    both = streams(isn)
    doubt = doubted(both, distance, "fin")
    assert look(doubt, both, -1, doubt.seq) == OPEN
    assert look(doubt, both, -1, (doubt.seq + 1) & MASK) == HOLDS
    assert look(doubted(both, distance), both, -1, (doubt.seq + 1) & MASK) == OPEN
    assert look(doubted(both, -distance, "fin"), both, -1, (both[0].next_seq - distance + 1) & MASK) == OPEN


def test_the_other_side_may_be_seen_later() -> None:
    both = streams()
    both[1] = HalfStream()
    doubt = doubted(both, -3)
    both[0].passed(bytes(5), 5)
    assert look(doubt, both, 7000) == OPEN
    both[1].start(7000)
    both[1].passed(bytes(5), 5)
    assert look(doubt, both, 7005) == OPEN
    both[0].passed(bytes(5), 5)
    assert look(doubt, both, 7005) == REFUTED


def test_the_first_end_that_is_not_in_doubt_takes_its_place() -> None:
    both = streams()
    doubt = doubted(both, 9)
    doubt.note_other("fin", 1, 8, 80, 2)
    doubt.note_other("reset", 0, 9, 90, 3)
    assert (doubt.other, doubt.other_side, doubt.other_frame, doubt.other_ns, doubt.silent) == ("fin", 1, 8, 80, 3)
