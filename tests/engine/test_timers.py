"""Time that passes on a silent line: what waits is given up as packets would do it."""

from __future__ import annotations

import pytest

from dissect.engine import timers
from dissect.engine.timers import FAR_FUTURE
from dissect.wire.build import COMPILED
from tests import build
from tests.engine.transactions.talk import (
    ACK,
    CLIENT,
    CONFIRM,
    CONNECT,
    FIN,
    MS,
    RST,
    SECOND,
    SERVER,
    START_NS,
    SYN,
    Talk,
    dbw,
    dt,
    read,
    words,
)


def test_a_hole_is_given_up() -> None:
    talk = Talk()
    talk.open(8, 8)
    talk.ask(read(1, dbw(1, 0)), read(2, dbw(1, 0)))
    talk.acked[CLIENT] = talk.seq[SERVER]
    talk.lose(SERVER, words(1, 1))
    talk.tell(words(2, 1))
    talk.silence(SECOND // 2)
    assert talk.outcomes() == []
    talk.silence(SECOND)
    assert talk.outcomes() == ["answered"]
    assert talk.slugs() == ["stream.hole"]


def test_an_answer_without_request_is_given_up() -> None:
    talk = Talk()
    talk.open()
    talk.tell(words(9, 1))
    assert talk.outcomes() == []
    talk.silence(SECOND + 2 * MS)
    assert talk.outcomes() == ["orphan_answer"]
    assert talk.slugs() == ["transaction.orphan"]


def test_a_closed_connection_is_told() -> None:
    talk = Talk()
    talk.open()
    talk.packet(CLIENT, flags=FIN | ACK)
    talk.packet(SERVER, flags=FIN | ACK)
    assert talk.connections == []
    talk.silence(2 * SECOND)
    assert len(talk.connections) == 1


def test_the_clock_of_the_packets_stays_theirs() -> None:
    """The next packet was on its way when the time was told: it is no step back."""
    talk = Talk()
    talk.open()
    last_ns = talk.now_ns
    talk.pipeline.tick(last_ns + SECOND)
    assert talk.pipeline.now_ns == last_ns
    talk.ask(read(1, dbw(1, 0)))
    talk.tell(words(1, 1))
    assert talk.findings == []
    assert talk.outcomes() == ["answered"]


def test_packets_that_were_on_their_way_are_looked_at_in_their_own_time() -> None:
    """Time was told far ahead; what waits from then on is still given up when its packets say so."""
    talk = Talk()
    talk.open()
    talk.pipeline.tick(talk.now_ns + 1000 * SECOND)
    talk.tell(words(9, 1))
    talk.packet(CLIENT, after_ns=SECOND // 2)
    other = Talk(client_port=50001, beside=talk)
    other.packet(CLIENT, after_ns=SECOND)
    assert talk.outcomes() == ["orphan_answer"]


def test_a_clock_that_is_behind_changes_nothing() -> None:
    talk = Talk()
    talk.pipeline.tick(5)
    talk.open()
    talk.tell(words(9, 1))
    talk.pipeline.tick(talk.now_ns - 1)
    talk.pipeline.tick(0)
    assert talk.outcomes() == []
    assert talk.findings == []


# ---- what waits -----------------------------------------------------------------------------------------------------


def oldest(talk: Talk) -> int:
    """The first packet of which something waits, which outputs may not pass yet."""
    return int(talk.pipeline.timers.oldest_held())


def test_the_first_packet_of_what_waits_is_known() -> None:
    talk = Talk()
    talk.open(8, 8)
    assert oldest(talk) == 0
    orphan = talk.tell(words(8, 1))
    assert oldest(talk) == orphan
    talk.tell(words(9, 1))
    assert oldest(talk) == orphan
    talk.lose(CLIENT, read(1, dbw(1, 0)))
    held = talk.ask(read(2, dbw(1, 0)))
    talk.ask(read(3, dbw(1, 0)))
    assert oldest(talk) == orphan
    talk.silence(SECOND - 2 * MS)  # the first answer has waited for more than a second, the second for one
    assert oldest(talk) == orphan + 1
    talk.silence(MS)
    assert oldest(talk) == held
    talk.silence(2 * SECOND)
    assert oldest(talk) == 0


def test_of_several_that_wait_the_earliest_counts_whichever_side_it_is_of() -> None:
    for first, second in ((CLIENT, SERVER), (SERVER, CLIENT)):
        talk = Talk()
        talk.open(8, 8)
        talk.acked = [talk.seq[SERVER], talk.seq[CLIENT]]
        frames = []
        for side in (first, second, first):
            talk.seq[side] += 10
            frames.append(talk.packet(side, dt(b"what is this")))
        assert oldest(talk) == frames[0]


def test_an_answer_behind_a_malformed_header_waits_as_well() -> None:
    talk = Talk()
    talk.open()
    talk.ask(read(9, dbw(1, 0)))
    frame = talk.packet(SERVER, build.tpkt(b"\x00\xf0\x80" + words(9, 1)))
    talk.tell(words(8, 1))
    assert oldest(talk) == frame
    talk.silence(2 * SECOND)
    assert oldest(talk) == 0


def test_what_waited_on_both_sides_is_passed_on_in_the_order_of_its_packets() -> None:
    """Two requests and their answers behind a gap of each side: each answer follows its request."""
    talk = Talk()
    talk.open(8, 8)
    talk.acked = [talk.seq[SERVER], talk.seq[CLIENT]]
    talk.lose(CLIENT, read(1, dbw(1, 0)))
    talk.lose(SERVER, words(1, 1))
    pairs = [(talk.ask(read(ref, dbw(1, 0))), talk.tell(words(ref, 1))) for ref in (2, 3)]
    assert talk.transactions == []
    talk.silence(3 * SECOND)
    assert talk.pairs() == pairs
    assert talk.outcomes() == ["answered"] * 2
    assert [finding.detail for finding in talk.findings] == [
        "31 bytes from 10.0.0.1:50000, between TPKTs",
        "27 bytes from 10.0.0.2:102, between TPKTs",
    ]


@pytest.mark.parametrize("side", [CLIENT, SERVER])
def test_an_empty_dt_in_a_gap_is_no_missing_message(side: int) -> None:
    """Seven or fourteen octets between two TPKTs hold no message; more, or octets amid one, may."""
    for size, excused in ((7, True), (14, True), (21, False), (31, False)):
        talk = Talk()
        talk.open()
        talk.ask(read(1, dbw(1, 0)))
        talk.acked = [talk.seq[SERVER], talk.seq[CLIENT]]
        talk.seq[side] += size
        if side == CLIENT:
            talk.ask(read(2, dbw(1, 0)))
        else:
            talk.tell(words(9, 1))
        talk.silence(3 * SECOND)
        (one,) = talk.pipeline.table.all_open()
        assert one.peer is not None
        end = one if side == CLIENT else one.peer
        assert (end.holes, end.missing, end.hole_frame > 0) == (1, size, not excused)


def test_a_gap_of_seven_bytes_before_the_rest_of_a_message_may_hold_its_beginning() -> None:
    talk = Talk()
    talk.open()
    asked = talk.ask(read(1, dbw(1, 0)))
    octets = dt(words(1, 1))
    talk.acked[CLIENT] = talk.seq[SERVER]
    talk.seq[SERVER] += 7
    frame = talk.packet(SERVER, octets[7:])
    talk.silence(3 * SECOND)
    (one,) = talk.pipeline.table.all_open()
    assert one.peer is not None
    assert (one.peer.hole_frame, one.peer.slight) == (frame, None)
    talk.finish()
    (transaction,) = talk.transactions
    assert (transaction.request_frame, transaction.outcome, transaction.reason) == (asked, "unanswered", "hole")


def test_gaps_are_counted_by_where_they_are_and_only_of_what_is_followed() -> None:
    talk = Talk()
    talk.open()
    talk.seq[CLIENT] += 31  # between two TPKTs
    talk.ask(read(1, dbw(1, 0)))
    talk.seq[CLIENT] += 31
    talk.ask(read(1, dbw(1, 0)))
    talk.packet(CLIENT, dt(read(2, dbw(1, 0)))[:20])
    talk.seq[CLIENT] += 11  # the rest of one
    talk.ask(read(3, dbw(1, 0)))
    web = Talk(50001, 80, beside=talk)
    web.hello()
    web.packet(CLIENT, b"GET / HTTP/1.0\r\n")
    web.seq[CLIENT] += 100
    web.packet(CLIENT, b"more")
    talk.finish()
    octets = talk.pipeline.counters.octets
    assert (octets.holes, octets.missing, octets.inside) == (3, 73, 1)
    assert [finding.detail for finding in talk.findings if finding.slug == "stream.hole"] == [
        "31 bytes from 10.0.0.1:50000, between TPKTs",
        "31 bytes from 10.0.0.1:50000, between TPKTs",
        "11 bytes from 10.0.0.1:50000, inside a TPKT",
    ]


def test_octets_outside_of_any_window_are_reported_only_of_what_is_followed() -> None:
    for port in (102, 80):
        talk = Talk(server_port=port)
        talk.hello()
        for side, octets in ((CLIENT, CONNECT), (SERVER, CONFIRM)):
            talk.packet(side, octets if port == 102 else b"GET / HTTP/1.0\r\n")
        at = talk.seq[CLIENT] + 1_000_000
        for number in range(64):
            talk.packet(CLIENT, b"0123456789", seq=at + 20 * number)
        found = [finding.detail for finding in talk.findings if finding.slug == "stream.outside_window"]
        assert found == (["640 bytes from 10.0.0.1:50000"] if port == 102 else [])


def test_time_that_passes_looks_every_50_milliseconds() -> None:
    """At multiples of it, so that what is found does not depend on other connections."""
    for after_ns, given_up in ((SECOND, False), (SECOND + 50 * MS, True)):
        talk = Talk()
        talk.open()
        talk.now_ns = START_NS + 100 * MS
        talk.tell(words(9, 1), after_ns=0)
        talk.pipeline.tick(START_NS + 100 * MS + after_ns)
        assert bool(talk.transactions) is given_up
        talk.pipeline.finish()
        assert talk.outcomes() == ["orphan_answer"]


def test_packets_look_at_what_waits_when_the_next_multiple_is_reached() -> None:
    talk = Talk()
    talk.open()
    talk.now_ns = START_NS + 101 * MS
    talk.tell(words(9, 1), after_ns=0)  # due 1101 ms after the start
    other = Talk(client_port=50001, beside=talk)
    for after_ms, given_up in ((1099, False), (1101, False), (1149, False), (1150, True)):
        talk.now_ns = START_NS + after_ms * MS
        other.packet(CLIENT, after_ns=0)
        talk.pipeline.tick(talk.now_ns)  # no later than the packet
        assert bool(talk.transactions) is given_up, after_ms


def test_a_step_back_of_the_clock_moves_what_waits_with_it() -> None:
    talk = Talk()
    talk.open()
    talk.now_ns = START_NS + 1000 * SECOND
    talk.tell(words(9, 1))
    talk.now_ns = START_NS + 500 * SECOND
    other = Talk(client_port=50001, beside=talk)
    other.open()
    other.tell(words(8, 1))
    other.packet(CLIENT, after_ns=SECOND + 50 * MS)
    assert [(one.outcome, one.connection.number) for one in talk.transactions] == [("orphan_answer", 2)]


def test_nothing_is_due_while_nothing_waits() -> None:
    talk = Talk()
    talk.open()
    talk.ask(read(1, dbw(1, 0)))
    talk.tell(words(1, 1))
    talk.silence(SECOND)
    timers = talk.pipeline.timers
    assert timers.deadline_ns == FAR_FUTURE
    talk.tell(words(9, 1))
    assert talk.now_ns < timers.deadline_ns <= talk.now_ns + 50 * MS
    talk.silence(3 * SECOND)
    assert timers.deadline_ns == FAR_FUTURE
    talk.packet(CLIENT, flags=FIN | ACK)
    talk.packet(SERVER, flags=FIN | ACK)
    assert timers.deadline_ns < FAR_FUTURE  # a closed connection waits for late packets
    talk.silence(3 * SECOND)
    assert timers.deadline_ns == FAR_FUTURE
    talk.tell(words(9, 1))
    talk.finish()
    assert timers.deadline_ns == FAR_FUTURE


def test_an_end_in_doubt_is_looked_at_again_once_what_is_held_is_passed_on() -> None:
    """The server goes on behind a gap: only when that is given up do its octets refute the reset."""
    talk = Talk()
    talk.open(8, 8)
    talk.ask(read(1, dbw(1, 0)))
    talk.tell(words(1, 1))
    talk.packet(SERVER, flags=RST, seq=talk.seq[SERVER] + 100)
    talk.acked[CLIENT] = talk.seq[SERVER]
    talk.lose(SERVER, words(2, 1))
    for ref in (3, 4, 5):
        talk.ask(read(ref, dbw(1, 0)))
        talk.tell(words(ref, 1))
    assert "stream.reset_ignored" not in talk.slugs()
    talk.silence(2 * SECOND)
    talk.silence(SECOND)
    assert talk.slugs().count("stream.reset_ignored") == 1
    talk.finish()
    assert talk.connections[0].tcp.ended == ""


@pytest.mark.skipif(COMPILED, reason="compiled constants cannot be changed")
def test_of_very_many_that_wait_those_that_wait_no_longer_are_forgotten(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(timers, "_MANY_WAITING", 5)
    first = Talk(client_port=20_000)
    talks = [first, *[Talk(client_port=20_000 + number, beside=first) for number in range(1, 12)]]
    for talk in talks:
        talk.open()
        talk.tell(words(9, 1), after_ns=0)
        talk.packet(SERVER, flags=RST)
        talk.packet(CLIENT, flags=SYN, seq=5_000_000)  # what was there is over
        talk.seq = [5_000_001, 7_000_000]
        talk.packet(SERVER, flags=SYN | ACK)
    assert len(first.pipeline.timers._waiting) <= 6
    assert first.pipeline.finding_counts["transaction.orphan"] == 12


@pytest.mark.skipif(COMPILED, reason="compiled constants cannot be changed")
def test_of_very_many_ends_in_doubt_those_that_are_known_by_now_are_looked_at(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(timers, "_MANY_WAITING", 5)
    first = Talk(client_port=20_000)
    for number in range(12):
        talk = first if number == 0 else Talk(client_port=20_000 + number, beside=first)
        talk.open()
        talk.packet(SERVER, flags=RST, seq=talk.seq[SERVER] + 500, after_ns=0)
        for ref in (1, 2):
            talk.ask(read(ref, dbw(1, 0)), after_ns=0)
            talk.tell(words(ref, 1), after_ns=0)
        assert len(first.pipeline.timers._doubts) <= 5
    first.finish()
    assert first.slugs() == ["stream.reset_ignored"] * 12
