"""Time that passes on a silent line: what waits is given up as packets would do it."""

from __future__ import annotations

from tests.engine.transactions.talk import ACK, CLIENT, FIN, MS, SECOND, SERVER, Talk, dbw, read, words


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
