"""Ends of connections that were none: resets, FINs and SYNs of somebody else, beside those that are genuine."""

from __future__ import annotations

from typing import Final

import pytest

from dissect.engine.transactions.table import DOUBT_NS, LINGER_NS
from tests.cases import each
from tests.engine.transactions.talk import (
    ACK,
    CLIENT,
    FIN,
    MS,
    RST,
    SECOND,
    SERVER,
    SYN,
    Talk,
    dbw,
    dt,
    read,
    words,
)
from tests.growth import assert_growth

IGNORED: Final = "stream.reset_ignored"
#: An Ethernet address for each side, and one of somebody else.
CARDS: Final = [bytes.fromhex("020000000001"), bytes.fromhex("020000000002"), bytes.fromhex("0200000000ff")]


def polled(talk: Talk, *references: int) -> Talk:
    """Read once for each reference."""
    for reference in references:
        talk.ask(read(reference, dbw(1, 0)))
        talk.tell(words(reference, 1))
    return talk


def begun() -> Talk:
    """Return a connection that is set up and has read once."""
    talk = Talk()
    talk.macs = CARDS[:2]
    talk.open()
    return polled(talk, 1)


def ended(talk: Talk) -> tuple[str, int, int]:
    """Return how the one connection ended, by whom, and with which packet."""
    (connection,) = talk.connections
    tcp = connection.tcp
    return tcp.ended, int(tcp.ended_by), int(tcp.ended_frame)


def details(talk: Talk) -> list[str]:
    """Return the details of the findings about ends that were none."""
    return [finding.detail for finding in talk.findings if finding.slug == IGNORED]


# ---- RST and FIN ----------------------------------------------------------------------------------------------------


@each("flags", [RST, RST | ACK, FIN | ACK])
@each("distance", [5000, 100, 1, -1, -60])
@pytest.mark.parametrize("side", [CLIENT, SERVER])
def test_an_end_with_a_wrong_number_is_none_when_both_sides_go_on(side: int, distance: int, flags: int) -> None:
    talk = begun()
    frame = talk.packet(side, flags=flags, seq=talk.seq[side] + distance)
    polled(talk, 2, 3, 4)
    talk.packet(SERVER, flags=FIN | ACK)
    last = int(talk.pipeline.frames)
    talk.packet(CLIENT, flags=FIN | ACK)
    talk.finish()
    assert ended(talk) == ("fin", SERVER, last)
    assert talk.outcomes() == ["answered"] * 4
    (finding,) = [finding for finding in talk.findings if finding.slug == IGNORED]
    who = f"10.0.0.{side + 1}:{talk.ports[side]}"
    what = "FIN" if flags & FIN else "reset"
    where = f"{abs(distance)} byte{'s' * (abs(distance) > 1)} {'ahead of' if distance > 0 else 'behind'}"
    assert finding.detail == f"{what} from {who}, {where} the number expected: the connection went on"
    assert (finding.frames, finding.connection) == ([frame], 1)
    assert talk.slugs() == [IGNORED]


def test_it_says_when_another_card_sent_it() -> None:
    talk = begun()
    talk.macs = [CARDS[0], CARDS[2]]
    talk.packet(SERVER, flags=RST, seq=talk.seq[SERVER] + 100)
    talk.macs = CARDS[:2]
    polled(talk, 2, 3)
    talk.finish()
    assert ended(talk) == ("", -1, 0)
    (detail,) = details(talk)
    assert detail.endswith("; sent by 02:00:00:00:00:ff, but 10.0.0.2 has 02:00:00:00:00:02")


@each("flags", [RST, FIN | ACK])
@each("distance", [5000, 0, -1])
def test_an_end_behind_bytes_that_were_lost_stands_when_nobody_goes_on(distance: int, flags: int) -> None:
    """The other side may have sent something that crossed it, and the side that ended it something captured late."""
    talk = begun()
    talk.ask(read(2, dbw(1, 0)))
    frame = talk.packet(SERVER, flags=flags, seq=talk.seq[SERVER] + distance)
    talk.ask(read(3, dbw(1, 0)))
    talk.finish()
    assert ended(talk) == ("fin" if flags & FIN else "reset", SERVER, frame)
    assert details(talk) == []


@each("flags", [RST | ACK, FIN | ACK])
def test_an_end_captured_before_its_last_bytes_stands(flags: int) -> None:
    talk = begun()
    talk.ask(read(2, dbw(1, 0)))
    answer = dt(words(2, 1))
    frame = talk.packet(SERVER, flags=flags, seq=talk.seq[SERVER] + len(answer))
    talk.ask(read(3, dbw(1, 0)))
    talk.packet(SERVER, answer)
    talk.packet(CLIENT)
    talk.finish()
    assert ended(talk) == ("fin" if flags & FIN else "reset", SERVER, frame)
    assert details(talk) == []


def test_a_fin_that_the_other_side_acknowledges_is_one() -> None:
    talk = begun()
    lost = len(dt(words(2, 1)))
    frame = talk.packet(SERVER, flags=FIN | ACK, seq=talk.seq[SERVER] + lost)
    talk.seq[SERVER] += lost + 1
    talk.packet(CLIENT)
    talk.ask(read(3, dbw(1, 0)))
    assert talk.pipeline.table.all_open()[0].tcp.doubt is None
    talk.packet(CLIENT, flags=FIN | ACK)
    talk.finish()
    assert ended(talk) == ("fin", SERVER, frame)
    assert details(talk) == []


def test_bytes_from_beyond_the_end_refute_it_where_one_side_was_captured() -> None:
    talk = begun()
    talk.packet(CLIENT, flags=FIN | ACK, seq=talk.seq[CLIENT] + 40)
    for number in range(2, 6):
        talk.ask(read(number, dbw(1, 0)))
    talk.finish()
    assert ended(talk) == ("", -1, 0)
    assert len(details(talk)) == 1


def test_an_end_that_fits_counts_when_the_one_before_it_was_none() -> None:
    """The client asks and closes; the answer shows that the reset before was not of the server."""
    talk = begun()
    talk.packet(SERVER, flags=RST, seq=talk.seq[SERVER] + 50)
    talk.ask(read(2, dbw(1, 0)))
    frame = talk.packet(CLIENT, flags=FIN | ACK)
    talk.tell(words(2, 1))
    talk.packet(SERVER, flags=FIN | ACK)
    talk.finish()
    assert ended(talk) == ("fin", CLIENT, frame)
    assert talk.connections[0].tcp.reset_by == -1
    assert len(details(talk)) == 1


def test_a_second_reset_that_fits_counts_when_the_first_was_none() -> None:
    talk = begun()
    talk.packet(CLIENT, flags=RST, seq=talk.seq[CLIENT] + 50)
    talk.ask(read(2, dbw(1, 0)))
    talk.tell(words(2, 1))
    polled(talk, 3)
    frame = talk.packet(SERVER, flags=RST)
    talk.finish()
    tcp = talk.connections[0].tcp
    assert ended(talk) == ("reset", SERVER, frame)
    assert (tcp.reset_by, tcp.reset_frame) == (SERVER, frame)


def test_a_connection_whose_end_is_in_doubt_is_kept_for_slow_polling() -> None:
    talk = begun()
    talk.packet(SERVER, flags=RST, seq=talk.seq[SERVER] + 500)
    for number in range(2, 5):
        talk.wait(3 * LINGER_NS)
        polled(talk, number)
    talk.finish()
    assert talk.outcomes() == ["answered"] * 4
    assert ended(talk) == ("", -1, 0)
    # When nothing follows it is over, a little later than others.
    talk = begun()
    talk.packet(SERVER, flags=RST, seq=talk.seq[SERVER] + 500)
    talk.silence(DOUBT_NS - SECOND)
    assert talk.connections == []
    talk.silence(2 * SECOND)
    assert [one.tcp.ended for one in talk.connections] == ["reset"]
    assert not talk.pipeline.table.lingering


def test_what_is_given_up_of_a_gap_is_no_sign_of_life() -> None:
    talk = begun()
    talk.lose(SERVER, words(2, 1))
    talk.tell(words(3, 1))
    frame = talk.packet(SERVER, flags=RST)
    talk.ask(read(4, dbw(1, 0)))
    talk.silence(2 * SECOND)
    talk.finish()
    assert ended(talk) == ("reset", SERVER, frame)
    assert details(talk) == []


# ---- SYN ------------------------------------------------------------------------------------------------------------


def test_a_syn_that_nothing_confirms_ends_no_connection() -> None:
    talk = begun()
    frame = talk.packet(CLIENT, flags=SYN, seq=77_000_000)
    talk.packet(SERVER)  # as receivers do: what they expect
    polled(talk, 2, 3, 4)
    again = talk.packet(CLIENT, flags=SYN, seq=78_000_000, after_ns=SECOND)
    polled(talk, 5)
    talk.close()
    assert talk.outcomes() == ["answered"] * 5
    assert [finding.frames for finding in talk.findings] == [[frame], [again]]
    assert details(talk) == ["SYN from 10.0.0.1:50000, with other numbers: the connection went on"] * 2
    assert len(talk.connections) == 1


def test_a_reset_and_a_syn_that_are_both_of_somebody_else() -> None:
    talk = begun()
    talk.packet(CLIENT, flags=RST, seq=talk.seq[CLIENT] + 2000)
    talk.packet(CLIENT, flags=SYN, seq=77_000_000)
    polled(talk, 2, 3, 4)
    talk.close()
    assert talk.outcomes() == ["answered"] * 4
    assert [one.tcp.ended for one in talk.connections] == ["fin"]
    assert talk.slugs() == [IGNORED] * 2


def test_a_syn_after_an_end_in_doubt_begins_another_connection() -> None:
    talk = begun()
    frame = talk.packet(CLIENT, flags=RST, seq=talk.seq[CLIENT] + 2000)
    talk.seq = [5_000_000, 7_000_000]
    talk.open()
    polled(talk, 2)
    talk.close()
    assert [(one.tcp.ended, one.tcp.ended_frame) for one in talk.connections][:1] == [("reset", frame)]
    assert talk.slugs() == []


def test_data_with_the_numbers_of_a_syn_that_the_connection_outlived_are_not_of_another_one() -> None:
    talk = begun()
    talk.packet(CLIENT, flags=SYN, seq=77_000_000)
    polled(talk, 2)
    talk.packet(CLIENT, dt(read(9, dbw(1, 0))), seq=77_000_001)
    polled(talk, 3)
    talk.close()
    assert len(talk.connections) == 1
    assert talk.outcomes() == ["answered"] * 3


def test_a_confirmed_syn_begins_another_connection() -> None:
    """By the SYN/ACK; the end of the one before is told of the SYN."""
    talk = begun()
    frame = int(talk.pipeline.frames) + 1
    talk.seq = [5_000_000, 7_000_000]
    talk.open()
    polled(talk, 2)
    talk.close()
    first, second = talk.connections
    assert (first.tcp.ended, first.tcp.ended_frame) == ("reused", frame)
    assert (second.tcp.initiator, second.tcp.first_frame) == (0, frame)
    assert talk.slugs() == ["stream.reused"]
    assert talk.findings[0].frames == [frame]


@each("beyond", [0, 600])
@pytest.mark.parametrize("side", [CLIENT, SERVER])
def test_data_that_follow_a_syn_confirm_it(side: int, beyond: int) -> None:
    """The SYN/ACK was not captured, nor perhaps some bytes after it."""
    talk = begun()
    talk.seq = [5_000_000, 7_000_000]
    talk.packet(CLIENT, flags=SYN)
    talk.seq[SERVER] += 1
    talk.seq[CLIENT] += beyond
    talk.seq[SERVER] += beyond
    if side == CLIENT:
        talk.ask(read(2, dbw(1, 0)))
        talk.tell(words(2, 1))
    else:
        talk.tell(words(2, 1))
        polled(talk, 3)
    talk.close()
    assert [one.tcp.ended for one in talk.connections] == ["reused", "fin"]
    assert talk.connections[1].tcp.initiator == 0
    answered = [one for one in talk.transactions if one.outcome == "answered"]
    assert answered[-1].connection.number == 2


def test_a_syn_ack_that_acknowledges_something_else_confirms_no_syn() -> None:
    talk = begun()
    talk.packet(CLIENT, flags=SYN, seq=77_000_000)
    talk.packet(SERVER, flags=SYN | ACK, seq=9_000_000)
    polled(talk, 2)
    talk.close()
    assert len(talk.connections) == 1
    assert talk.outcomes() == ["answered"] * 2


def test_a_server_that_restarted_refuses_the_syn() -> None:
    talk = begun()
    frame = talk.packet(CLIENT, flags=SYN, seq=77_000_000)
    talk.seq[CLIENT] = 77_000_001
    talk.packet(SERVER, flags=RST | ACK, seq=0)
    talk.finish()
    assert ended(talk) == ("reused", -1, frame)
    assert talk.slugs() == ["stream.reused", "stream.refused"]


def test_a_client_that_restarted_resets_what_was_there_and_begins_anew() -> None:
    """RFC 9293, section 3.5.1: the server acknowledges what it has, and the client resets that."""
    talk = begun()
    old = talk.seq[CLIENT]
    first = talk.packet(CLIENT, flags=SYN, seq=77_000_000)
    talk.packet(SERVER)
    frame = talk.packet(CLIENT, flags=RST, seq=old)
    talk.seq = [77_000_000, 7_000_000]
    talk.wait(SECOND)
    talk.open()
    polled(talk, 2)
    talk.close()
    assert (talk.connections[0].tcp.ended, talk.connections[0].tcp.ended_frame) == ("reset", frame)
    assert talk.connections[1].tcp.first_frame == first
    assert talk.slugs() == []


def test_a_syn_on_a_connection_that_is_dead_is_reported_without_answer() -> None:
    talk = begun()
    for _ in range(3):
        talk.packet(CLIENT, flags=SYN, seq=77_000_000, after_ns=SECOND)
    talk.finish()
    assert talk.slugs() == ["stream.unanswered"]


def test_a_repeated_syn_beside_a_connection_that_goes_on_is_no_attempt_without_answer() -> None:
    talk = begun()
    for number in range(2, 6):
        talk.packet(CLIENT, flags=SYN, seq=77_000_000, after_ns=SECOND)
        polled(talk, number)
    talk.finish()
    assert set(talk.slugs()) == {IGNORED}


# ---- what has to be as it was ---------------------------------------------------------------------------------------


def test_a_connect_request_after_a_reset_is_another_connection() -> None:
    """Its handshake was not captured."""
    talk = begun()
    talk.packet(SERVER, flags=RST, seq=talk.seq[SERVER] + 1)
    talk.seq = [50_000_000, 70_000_000]
    talk.connect()
    polled(talk, 2)
    talk.close()
    assert [one.tcp.ended for one in talk.connections] == ["reset", "fin"]
    assert talk.outcomes() == ["answered"] * 2


def test_a_genuine_end_needs_no_second_look() -> None:
    for flags in (RST, RST | ACK, FIN | ACK):
        talk = begun()
        frame = talk.packet(SERVER, flags=flags)
        assert talk.pipeline.table.all_open()[0].tcp.doubt is None
        talk.silence(LINGER_NS + 100 * MS)
        talk.finish()
        assert ended(talk)[2] == frame
        assert talk.slugs() == []


def test_packets_of_the_next_connection_are_none_of_the_one_before_it() -> None:
    """The SYN/ACK is lost, so that only the first bytes show that the SYN began another one."""
    talk = begun()
    last = int(talk.pipeline.frames)
    talk.wait(SECOND)
    talk.seq = [50_000_000, 70_000_000]
    talk.packet(CLIENT, flags=SYN)
    talk.seq[SERVER] += 1
    talk.packet(CLIENT)
    talk.connect()
    polled(talk, 2)
    talk.close()
    assert [(one.tcp.ended, int(one.tcp.first_frame)) for one in talk.connections] == [("reused", 1), ("fin", last + 1)]
    assert talk.connections[0].tcp.last_frame == last


# ---- many of them ---------------------------------------------------------------------------------------------------


def half_closed(count: int) -> Talk:
    """Return the first of so many connections of which one side sent a FIN ahead of its number, and nothing came after it."""
    first = Talk(client_port=20_000)
    for number in range(count):
        talk = first if number == 0 else Talk(client_port=20_000 + number, beside=first)
        talk.hello()
        talk.connect()
        talk.packet(CLIENT, flags=FIN | ACK, seq=talk.seq[CLIENT] + 10, after_ns=0)
    return first


def test_ends_in_doubt_take_no_work_while_nothing_comes_of_their_connections() -> None:
    def later(talk: Talk) -> None:
        for _ in range(200):
            talk.silence(SECOND)

    few, many = half_closed(10), half_closed(200)
    later(few)  # what waited for anything else is done
    later(many)
    assert_growth(lambda: later(few), lambda: later(many), 2)


def test_an_end_in_doubt_is_looked_at_however_late_both_sides_go_on() -> None:
    talk = begun()
    talk.packet(CLIENT, flags=FIN | ACK, seq=talk.seq[CLIENT] + 10)
    talk.silence(100 * SECOND)
    polled(talk, 2, 3)
    talk.silence(SECOND)
    assert len(details(talk)) == 1
    talk.close()
    assert ended(talk)[0] == "fin"


def test_a_connection_that_goes_on_keeps_no_ended_one_waiting() -> None:
    talk = begun()
    other = Talk(client_port=50_001, beside=talk)
    other.open()
    talk.packet(SERVER, flags=RST, seq=talk.seq[SERVER] + 500)
    other.packet(SERVER, flags=RST, seq=other.seq[SERVER] + 500)
    for number in range(2, 40):
        talk.wait(SECOND)
        polled(talk, number)
    assert [(one.tcp.ends[0].port, one.tcp.ended) for one in talk.connections] == [(50_001, "reset")]
