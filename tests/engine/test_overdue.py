"""Requests that wait too long are told while they wait: once, at the right time, and never for what the capture lost."""

from __future__ import annotations

from typing import Final

import pytest

from dissect.engine import timers
from dissect.wire.build import COMPILED
from tests.engine.transactions.talk import CLIENT, MS, SECOND, SERVER, START_NS, Talk, ack_data, dbw, read, words

LIMIT: Final = 2 * SECOND


@pytest.fixture
def talk() -> Talk:
    talk = Talk()
    talk.watch(LIMIT)
    talk.open()
    talk.findings.clear()
    return talk


def told(talk: Talk) -> list[int]:
    """The packets of the requests that were told to be overdue."""
    return [finding.frames[0] for finding in talk.findings if finding.slug == "transaction.overdue"]


def test_it_says_what_waits_for_how_long(talk: Talk) -> None:
    asked = talk.ask(read(7, dbw(10, 4)))
    talk.silence(LIMIT - 1)
    assert talk.findings == []
    talk.silence(1)
    (finding,) = talk.findings
    assert finding.detail == f"Read Var DB10.DBW4: sent 2.00 s ago in packet {asked}, still unanswered"
    assert (finding.frames, finding.time_ns, finding.connection) == ([asked], talk.now_ns, 1)
    assert finding.severity == "warning"


def test_once_for_a_request_however_long_it_waits(talk: Talk) -> None:
    asked = talk.ask(read(1, dbw(1, 0)))
    for _ in range(100):
        talk.silence(SECOND // 3)
    assert told(talk) == [asked]


def test_each_request_when_it_is_its_turn(talk: Talk) -> None:
    first = talk.ask(read(1, dbw(1, 0)))
    second = talk.ask(read(2, dbw(1, 2)), after_ns=SECOND)
    talk.silence(SECOND)
    assert told(talk) == [first]
    talk.tell(words(1, 1))
    talk.silence(SECOND)
    assert told(talk) == [first, second]


def test_packets_tell_the_time_as_well(talk: Talk) -> None:
    """Another connection keeps the line busy."""
    asked = talk.ask(read(1, dbw(1, 0)))
    other = Talk(client_port=50001, beside=talk)
    other.open()
    for number in range(22):
        other.ask(read(number, dbw(1, 0)), after_ns=100 * MS)
        other.tell(words(number, 1))
    assert told(talk) == [asked]
    assert talk.findings[-1].time_ns - talk.now_ns < SECOND


def test_what_becomes_of_it_is_told_as_ever(talk: Talk) -> None:
    talk.ask(read(1, dbw(1, 0)))
    talk.silence(3 * SECOND)
    talk.tell(words(1, 1))
    talk.ask(read(2, dbw(1, 0)))
    talk.silence(3 * SECOND)
    talk.close()
    assert talk.slugs() == ["transaction.overdue", "transaction.slow", "transaction.overdue", "transaction.unanswered"]
    assert talk.outcomes() == ["answered", "unanswered"]


def test_either_end_asks(talk: Talk) -> None:
    asked = talk.tell(read(1, dbw(1, 0)))
    talk.silence(LIMIT)
    assert told(talk) == [asked]


def test_identical_requests_are_told_one_by_one(talk: Talk) -> None:
    frames = [talk.ask(read(1, dbw(1, 0)), after_ns=100 * MS) for _ in range(3)]
    talk.silence(LIMIT)
    assert told(talk) == frames[-1:] or told(talk) == frames
    talk.silence(LIMIT)
    assert told(talk) == frames


def test_a_side_that_was_left_alone_is_looked_at_again(talk: Talk) -> None:
    talk.ask(read(1, dbw(1, 0)))
    talk.tell(words(1, 1))
    talk.silence(10 * SECOND)
    asked = talk.ask(read(2, dbw(1, 0)))
    talk.silence(LIMIT)
    assert told(talk) == [asked]


def test_an_answer_that_may_be_in_a_hole_is_not_missed(talk: Talk) -> None:
    talk.ask(read(1, dbw(1, 0)))
    talk.lose(SERVER, words(1, 1))
    talk.ask(read(2, dbw(1, 0)))
    talk.tell(words(2, 1))
    talk.silence(10 * SECOND)
    assert talk.slugs() == ["stream.hole"]


def test_a_side_that_was_never_captured_cannot_be_late() -> None:
    talk = Talk()
    talk.watch(LIMIT)
    talk.ask(read(1, dbw(1, 0)))
    talk.silence(10 * SECOND)
    assert told(talk) == []


def test_a_refusal_is_an_answer(talk: Talk) -> None:
    talk.ask(read(1, dbw(1, 0)))
    talk.tell(ack_data(1, b"\x04\x01", b"\x05\0\0\0"))
    talk.silence(10 * SECOND)
    assert told(talk) == []


def test_a_closed_connection_is_told_of_by_its_end_alone(talk: Talk) -> None:
    talk.ask(read(1, dbw(1, 0)))
    talk.packet(CLIENT, flags=0x11)
    talk.packet(SERVER, flags=0x11)
    talk.silence(2 * SECOND)
    talk.silence(2 * SECOND)
    assert talk.slugs() == ["transaction.unanswered"]


def test_files_are_not_watched_unless_asked() -> None:
    talk = Talk()
    talk.open()
    talk.ask(read(1, dbw(1, 0)))
    talk.silence(60 * SECOND)
    assert talk.findings == []
    assert not talk.pipeline.exchange.dialogue.watching


def test_a_capture_after_another_is_watched_as_well(talk: Talk) -> None:
    talk.finish()
    talk.pipeline.restart_clock(talk.now_ns)
    other = Talk(client_port=50001, beside=talk)
    other.open()
    asked = other.ask(read(1, dbw(1, 0)))
    talk.silence(LIMIT)
    assert told(talk) == [asked]


# ---- bounds ---------------------------------------------------------------------------------------------------------


def crowd(talk: Talk, count: int) -> None:
    """So many connections, each with a request that is never answered."""
    talks = [Talk(client_port=1024 + number, beside=talk) for number in range(count)]
    for one in talks:
        one.packet(SERVER)  # there is another side
        one.ask(read(1, dbw(1, 0)), after_ns=1000)
        one.packet(SERVER, after_ns=0)


def test_a_look_at_a_crowd_is_bounded_and_nobody_is_forgotten(talk: Talk) -> None:
    count = 3 * timers._SIDES_AT_ONCE // 2
    crowd(talk, count)
    talk.silence(LIMIT)
    first = talk.pipeline.finding_counts["transaction.overdue"]
    assert 0 < first <= timers._SIDES_AT_ONCE
    talk.silence(50 * MS)
    assert talk.pipeline.finding_counts["transaction.overdue"] == count


def test_sides_that_poll_are_kept_once(talk: Talk) -> None:
    for number in range(500):
        talk.ask(read(number, dbw(1, 0)), after_ns=10 * MS)
        talk.tell(words(number, 1))
    watch = talk.pipeline.timers._overdue
    assert watch is not None
    assert len(watch._due) + len(talk.pipeline.exchange.dialogue.asking) == 1


def test_connections_that_are_over_are_not_kept(talk: Talk) -> None:
    for number in range(300):
        one = Talk(client_port=1024 + number, beside=talk)
        one.packet(SERVER)
        one.ask(read(1, dbw(1, 0)))
        one.packet(CLIENT, flags=4 | 16)
    talk.silence(10 * SECOND)
    talk.silence(10 * SECOND)
    watch = talk.pipeline.timers._overdue
    assert watch is not None
    assert (len(watch._due), len(talk.pipeline.exchange.dialogue.asking)) == (0, 0)
    assert told(talk) == []


# ---- answers that may be there --------------------------------------------------------------------------------------


def test_an_answer_that_may_be_among_segments_that_are_held_is_not_missed() -> None:
    """The answer, or what is before it, was captured out of order; when the gap is given up it may be in that."""
    talk = Talk()
    talk.watch(SECOND // 2)
    talk.open()
    talk.ask(read(1, dbw(1, 0)))
    talk.acked[CLIENT] = talk.seq[SERVER]
    talk.seq[SERVER] += 27
    talk.tell(words(8, 1))
    for _ in range(20):
        talk.silence(SECOND // 10)
    assert told(talk) == []


def test_requests_are_told_with_the_tick_behind_their_limit(talk: Talk) -> None:
    """Every 50 milliseconds: requests that are due between two of them come with the second one."""
    talk.now_ns = START_NS + SECOND
    frames = [talk.ask(read(number, dbw(1, 0)), after_ns=20 * MS) for number in range(4)]
    when: dict[int, int] = {}
    for number in range(2000, 2200):
        talk.pipeline.tick(START_NS + SECOND + number * MS)
        for frame in told(talk):
            when.setdefault(frame, number)
    assert list(when) == frames
    for frame, number in when.items():
        due = 2000 + 20 * (frame - frames[0] + 1)
        assert due <= number <= due + 50


@pytest.mark.skipif(COMPILED, reason="compiled constants cannot be changed")
@pytest.mark.parametrize(
    ("sides", "requests", "counts"),
    [(2, 8192, [1, 3, 5, 6]), (1024, 2, [2, 4, 6, 6]), (1024, 8192, [6, 6, 6, 6]), (3, 8192, [2, 5, 6, 6])],
)
def test_a_look_ends_when_it_has_seen_enough(
    sides: int, requests: int, counts: list[int], talk: Talk, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Six sides with a request each, and one whose request was answered; the others wait for the next look."""
    monkeypatch.setattr(timers, "_SIDES_AT_ONCE", sides)
    monkeypatch.setattr(timers, "_REQUESTS_AT_ONCE", requests)
    crowd(talk, 6)
    found = []
    talk.silence(LIMIT)
    for _ in range(4):
        found.append(talk.pipeline.finding_counts.get("transaction.overdue", 0))
        talk.silence(50 * MS)
    assert found == counts


@pytest.mark.skipif(COMPILED, reason="compiled constants cannot be changed")
def test_of_very_many_sides_those_whose_connection_is_over_are_forgotten(
    talk: Talk, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(timers, "_MANY", 5)
    for number in range(30):
        one = Talk(client_port=1024 + number, beside=talk)
        one.packet(SERVER)
        one.ask(read(1, dbw(1, 0)))
        one.packet(CLIENT, flags=4 | 16)
        talk.silence(1100 * MS)
    watch = talk.pipeline.timers._overdue
    assert watch is not None
    assert len(watch._due) <= 6
    asked = talk.ask(read(9, dbw(1, 0)))
    talk.silence(LIMIT)
    talk.silence(LIMIT)
    assert told(talk) == [asked]
