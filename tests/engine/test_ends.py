"""Ends of connections that were none: resets, FINs and SYNs of somebody else, beside those that are genuine."""

from __future__ import annotations

from typing import Final

import pytest

from dissect.engine.transactions.connection import Connection
from dissect.engine.transactions.table import DOUBT_NS, LINGER_NS
from dissect.packets.tcp.stream import WINDOW
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


# ---- what is said of them -------------------------------------------------------------------------------------------


def test_a_card_is_named_only_where_both_are_known_and_differ() -> None:
    for sender, told in ((CARDS[2], True), (CARDS[1], False), (bytes(6), True)):
        talk = begun()
        talk.macs = [CARDS[0], sender]
        talk.packet(SERVER, flags=RST, seq=talk.seq[SERVER] + 100)
        talk.macs = CARDS[:2]
        polled(talk, 2, 3)
        talk.finish()
        (detail,) = details(talk)
        assert ("; sent by" in detail) is told, sender
    talk = Talk()  # no Ethernet addresses at all
    talk.open()
    talk.packet(SERVER, flags=RST, seq=talk.seq[SERVER] + 100)
    polled(talk, 2, 3)
    talk.finish()
    (detail,) = details(talk)
    assert detail.endswith("the connection went on")


def test_the_sender_of_the_first_end_in_doubt_is_the_one_that_is_named() -> None:
    talk = begun()
    for card, distance in ((CARDS[2], 100), (CARDS[1], 50)):
        talk.macs = [CARDS[0], card]
        talk.packet(SERVER, flags=RST, seq=talk.seq[SERVER] + distance)
    talk.macs = CARDS[:2]
    polled(talk, 2, 3)
    talk.finish()
    assert details(talk)[0].endswith("; sent by 02:00:00:00:00:ff, but 10.0.0.2 has 02:00:00:00:00:02")


def test_an_end_that_was_none_has_the_time_of_its_packet() -> None:
    talk = begun()
    frame = talk.packet(SERVER, flags=RST, seq=talk.seq[SERVER] + 100)
    time_ns = talk.now_ns
    polled(talk, 2, 3)
    (finding,) = [one for one in talk.findings if one.slug == IGNORED]
    assert (finding.frames, finding.time_ns, finding.connection) == ([frame], time_ns, 1)


def test_of_connections_that_are_not_followed_nothing_is_said() -> None:
    talk = Talk(server_port=80)
    talk.hello()
    for _ in range(2):
        talk.packet(CLIENT, b"GET / HTTP/1.0\r\n")
        talk.packet(SERVER, b"HTTP/1.0 200 OK\r\n")
    talk.packet(SERVER, flags=RST, seq=talk.seq[SERVER] + 100)
    talk.packet(CLIENT, flags=SYN, seq=77_000_000)
    for _ in range(3):
        talk.packet(CLIENT, b"GET / HTTP/1.0\r\n")
        talk.packet(SERVER, b"HTTP/1.0 200 OK\r\n")
    talk.seq = [5_000_000, 7_000_000]
    talk.hello()
    talk.finish()
    assert talk.findings == []


# ---- octets that only acknowledgements show -------------------------------------------------------------------------


@each("flags", [RST, FIN | ACK])
@each("side", [CLIENT, SERVER])
def test_what_was_acknowledged_and_not_captured_is_a_gap_when_the_connection_ends(side: int, flags: int) -> None:
    """With the packet that ends it; what the end itself shows counts from there."""
    talk = begun()
    talk.ask(read(2, dbw(1, 0)))
    talk.seq[SERVER] += 27
    talk.packet(CLIENT)  # it acknowledges the answer that is not there
    talk.packet(side, flags=flags)
    if flags & FIN:
        talk.packet(1 - side, flags=flags)
    last = int(talk.pipeline.frames)
    talk.finish()
    holes = [one for one in talk.findings if one.slug == "stream.hole"]
    assert [(one.detail, one.frames) for one in holes] == [("27 bytes from 10.0.0.2:102, between TPKTs", [last])]
    assert [(one.outcome, one.reason) for one in talk.transactions] == [("answered", ""), ("unanswered", "hole")]
    octets = talk.pipeline.counters.octets
    assert (octets.missing, octets.holes) == (27, 1)


@each(("distance", "missing"), [(0, 27), (1, 0), (100, 0), (-1, 0)])
def test_what_a_reset_acknowledges_counts_where_its_number_is_right(distance: int, missing: int) -> None:
    """Any other may be of another connection."""
    talk = begun()
    talk.ask(read(2, dbw(1, 0)))
    talk.seq[SERVER] += 27
    talk.packet(CLIENT, flags=RST | ACK, seq=talk.seq[CLIENT] + distance)
    talk.finish()
    assert talk.pipeline.counters.octets.missing == missing


@each(("missing", "gap"), [(1, 0), (6, 0), (7, 7), (27, 27)])
def test_fewer_octets_than_a_message_has_are_no_gap(missing: int, gap: int) -> None:
    """They may be numbers of FINs, of which each counts one."""
    talk = begun()
    talk.ask(read(2, dbw(1, 0)))
    talk.seq[SERVER] += missing
    talk.packet(CLIENT)
    talk.finish()
    assert talk.pipeline.counters.octets.missing == gap


@each(("missing", "gap"), [(1, 0), (2, 2), (11, 11)])
def test_behind_the_begin_of_a_message_two_octets_are_a_gap(missing: int, gap: int) -> None:
    talk = begun()
    talk.ask(read(2, dbw(1, 0)))
    talk.packet(SERVER, dt(words(2, 1))[:16])
    talk.seq[SERVER] += missing
    talk.packet(CLIENT)
    talk.finish()
    assert talk.pipeline.counters.octets.missing == gap


def test_a_fin_that_nobody_acknowledges_takes_no_octet_from_a_gap() -> None:
    """The client has acknowledged the answer that is missing, and the capture ends with the FIN of the server."""
    talk = begun()
    talk.ask(read(2, dbw(1, 0)))
    talk.seq[SERVER] += 7
    talk.packet(CLIENT, flags=FIN | ACK)
    talk.packet(SERVER, flags=FIN | ACK)
    talk.finish()
    assert talk.pipeline.counters.octets.missing == 7


def test_the_number_of_a_fin_is_no_octet() -> None:
    """The client acknowledges answer and FIN, of which only the FIN was captured, or neither."""
    for captured_fin in (True, False):
        talk = begun()
        talk.ask(read(2, dbw(1, 0)))
        talk.seq[SERVER] += 27
        if captured_fin:
            talk.packet(SERVER, flags=FIN | ACK)
        else:
            talk.seq[SERVER] += 1
        talk.packet(CLIENT)
        talk.packet(CLIENT, flags=FIN | ACK)
        talk.finish()
        assert talk.pipeline.counters.octets.missing == (27 if captured_fin else 28)


class Gapped(Talk):
    """Takes the times of the gaps of both sides before the streams of a connection are forgotten."""

    def connection_closed(self, connection: Connection) -> None:
        super().connection_closed(connection)
        self.gaps = [int(stream.gap_ns) for stream in connection.tcp.streams]


@each("flags", [RST, FIN | ACK])
@each("side", [CLIENT, SERVER])
def test_a_gap_that_was_known_before_an_idle_time_is_not_of_its_end(side: int, flags: int) -> None:
    """It has the time of the packet before the end."""
    talk = Gapped()
    talk.open()
    talk.ask(read(2, dbw(1, 0)))
    talk.seq[SERVER] += 27
    talk.packet(CLIENT)
    shown_ns = talk.now_ns
    talk.packet(side, flags=flags, after_ns=100 * SECOND)
    talk.packet(1 - side, flags=FIN | ACK, after_ns=100 * SECOND)
    talk.finish()
    assert talk.gaps == [0, shown_ns]


def test_a_gap_that_the_first_fin_shows_has_its_time() -> None:
    talk = Gapped()
    talk.open()
    talk.ask(read(2, dbw(1, 0)))
    talk.seq[SERVER] += 27
    talk.packet(CLIENT, flags=FIN | ACK, after_ns=100 * SECOND)
    shown_ns = talk.now_ns
    talk.packet(SERVER, flags=FIN | ACK, after_ns=100 * SECOND)
    talk.packet(CLIENT, after_ns=100 * SECOND)
    talk.finish()
    assert talk.gaps == [0, shown_ns]


def test_octets_before_an_end_that_counts_are_missing_where_a_request_waits_for_them() -> None:
    for asks, missing in ((True, 500), (False, 0)):
        talk = begun()
        if asks:
            talk.ask(read(2, dbw(1, 0)))
        talk.packet(SERVER, flags=RST, seq=talk.seq[SERVER] + 500)
        talk.silence(11 * SECOND)
        assert talk.pipeline.counters.octets.missing == missing
        assert talk.connections[0].tcp.ended == "reset"


@each("begin", [1000, 1 << 29, 1 << 30, 1 << 31])
def test_nothing_is_missing_of_a_side_that_has_said_nothing(begin: int) -> None:
    """Wherever its numbers begin: what the other side acknowledges is its SYN."""
    for closes in (False, True):
        talk = Talk()
        talk.seq[CLIENT] = begin
        talk.hello()
        for ref in (1, 2):
            talk.tell(words(ref, 1))
        (side,) = talk.pipeline.table.all_open()
        assert (side.unseen, side.is_ahead(begin + 1), side.is_ahead(begin + 2)) == (0, False, True)
        if closes:
            talk.close()
        else:
            talk.finish()
        assert (talk.pipeline.counters.octets.missing, talk.outcomes()) == (0, ["orphan_answer"] * 2)


def test_nothing_is_missing_of_a_connection_that_is_not_followed() -> None:
    talk = Talk(server_port=80)
    talk.hello()
    talk.packet(CLIENT, b"GET / HTTP/1.0\r\n")
    talk.seq[SERVER] += 500
    talk.packet(CLIENT)
    talk.finish()
    assert (talk.pipeline.counters.octets.missing, talk.findings) == (0, [])


# ---- SYNs -----------------------------------------------------------------------------------------------------------


def test_a_syn_with_data_begins_another_connection_at_once() -> None:
    talk = begun()
    frame = talk.packet(CLIENT, b"x", flags=SYN, seq=77_000_000)
    talk.finish()
    assert [(one.tcp.ended, one.tcp.ended_frame) for one in talk.connections] == [("reused", frame)]
    assert talk.slugs()[0] == "stream.reused"


def test_a_syn_of_the_same_number_is_of_the_same_connection() -> None:
    talk = begun()
    talk.packet(CLIENT, flags=SYN, seq=1000)
    talk.packet(SERVER, flags=SYN | ACK, seq=90_000)
    polled(talk, 2)
    talk.close()
    assert len(talk.connections) == 1
    assert talk.slugs() == []


@each("side", [CLIENT, SERVER])
def test_one_side_alone_may_go_on_beside_a_syn_before_it_gets_it(side: int) -> None:
    """Only when both do is the SYN not believed; the server that says nothing more may have taken it."""
    talk = begun()
    talk.packet(CLIENT, flags=SYN, seq=77_000_000)
    for number in range(3):
        if side == CLIENT:
            talk.ask(read(10 + number, dbw(1, 0)))
        else:
            talk.tell(words(10 + number, 1))
    talk.packet(CLIENT, dt(read(9, dbw(1, 0))), seq=77_000_001)
    talk.finish()
    assert len(talk.connections) == 2
    assert IGNORED not in talk.slugs()


@each(("distance", "follows"), [(0, True), (1, True), (WINDOW, True), (WINDOW + 1, False), (-1, False)])
@each("side", [CLIENT, SERVER])
def test_data_that_confirm_a_syn_follow_it_within_a_window(side: int, distance: int, follows: bool) -> None:
    """Of the side that sent it by their number, of the other by what they acknowledge."""
    talk = begun()
    talk.packet(CLIENT, flags=SYN, seq=77_000_000)
    if side == CLIENT:
        talk.packet(CLIENT, dt(read(9, dbw(1, 0))), seq=77_000_001 + distance)
    else:
        talk.acked[SERVER] = 77_000_001 + distance
        talk.packet(SERVER, dt(words(9, 1)), seq=talk.seq[SERVER] + 5_000_000)
    talk.finish()
    assert (len(talk.connections) == 2) is follows


@each(("near", "follows"), [(0, False), (100, False), (WINDOW, False), (WINDOW + 1, True), (-WINDOW - 1, True)])
def test_data_where_the_connection_is_confirm_nothing_unless_they_have_the_very_number(
    near: int, follows: bool
) -> None:
    """A SYN may have a number near that of the connection; only what is far from it, or just behind the SYN, is of another."""
    talk = begun()
    at = talk.seq[CLIENT]
    talk.packet(CLIENT, flags=SYN, seq=at + near - 1001)
    talk.packet(CLIENT, dt(read(9, dbw(1, 0))), seq=at + near)
    talk.finish()
    assert (len(talk.connections) == 2) is follows
    talk = begun()
    talk.packet(CLIENT, flags=SYN, seq=talk.seq[CLIENT] + near + 49)
    talk.packet(CLIENT, dt(read(9, dbw(1, 0))), seq=talk.seq[CLIENT] + near + 50)
    talk.finish()
    assert len(talk.connections) == 2


def test_an_answer_that_does_not_acknowledge_the_syn_confirms_nothing() -> None:
    for flags in (ACK, 0):
        talk = begun()
        talk.packet(CLIENT, flags=SYN, seq=77_000_000)
        talk.acked[SERVER] = 88_000_000
        talk.packet(SERVER, dt(words(9, 1)), flags=flags, seq=talk.seq[SERVER] + 5_000_000)
        talk.finish()
        assert len(talk.connections) == 1


def test_a_syn_that_is_held_back_is_no_packet_of_the_connection() -> None:
    """Nor is a SYN/ACK that answers it; packets of what begins count from the SYN on."""
    talk = begun()
    count = int(talk.pipeline.frames)
    for _ in range(2):
        talk.packet(CLIENT, flags=SYN, seq=77_000_000)
        talk.acked[SERVER] = 5
        talk.packet(SERVER, flags=SYN | ACK, seq=9_000_000)
        talk.acked[SERVER] = None
    polled(talk, 2, 3)
    (side,) = talk.pipeline.table.all_open()
    assert side.tcp.packets == count + 4
    assert side.last_ack == talk.seq[SERVER] - 27  # what the client acknowledged last: all but the last answer


def test_a_fin_confirms_no_syn() -> None:
    talk = begun()
    talk.packet(CLIENT, flags=SYN, seq=77_000_000)
    talk.acked[SERVER] = 77_000_001
    frame = talk.packet(SERVER, flags=FIN | ACK)
    talk.finish()
    assert ended(talk) == ("fin", SERVER, frame)


def test_a_second_syn_takes_the_place_of_the_first_and_the_same_again_does_not() -> None:
    talk = begun()
    first = talk.packet(CLIENT, flags=SYN, seq=77_000_000)
    talk.packet(CLIENT, flags=SYN, seq=77_000_000)
    talk.packet(CLIENT, dt(read(9, dbw(1, 0))), seq=77_000_001)
    talk.finish()
    assert talk.connections[0].tcp.ended_frame == first
    talk = begun()
    talk.packet(CLIENT, flags=SYN, seq=77_000_000)
    second = talk.packet(CLIENT, flags=SYN, seq=78_000_000)
    talk.packet(CLIENT, dt(read(9, dbw(1, 0))), seq=78_000_001)
    talk.finish()
    assert talk.connections[0].tcp.ended_frame == second
    assert talk.connections[0].tcp.ended_ns == talk.connections[1].tcp.first_ns


@each("ack", [77_000_001, 77_000_002, 0])
def test_a_reset_that_acknowledges_a_syn_refuses_it_and_any_other_is_of_the_connection(ack: int) -> None:
    talk = begun()
    frame = talk.packet(CLIENT, flags=SYN, seq=77_000_000)
    talk.acked[SERVER] = ack
    reset = talk.packet(SERVER, flags=RST | ACK)
    talk.finish()
    (connection,) = talk.connections
    refused = ack == 77_000_001
    assert (connection.tcp.ended, connection.tcp.ended_frame) == (("reused", frame) if refused else ("reset", reset))


@each("sides", [(), (CLIENT,), (SERVER,), (SERVER, CLIENT)])
def test_the_last_packet_of_a_connection_that_gave_way_is_the_one_before_the_syn_unless_it_went_on(
    sides: tuple[int, ...],
) -> None:
    """What only one side, or the other, sent behind the SYN is still of it."""
    talk = begun()
    last = int(talk.pipeline.frames)
    talk.packet(CLIENT, flags=SYN, seq=77_000_000)
    for side in sides:
        last = talk.packet(side, dt(read(2, dbw(1, 0))))
    talk.seq[CLIENT] = 77_000_001
    talk.packet(SERVER, flags=SYN | ACK)
    talk.finish()
    assert talk.connections[0].tcp.last_frame == last


def test_of_a_syn_whose_connection_went_on_no_answer_is_expected() -> None:
    talk = begun()
    for _ in range(2):
        talk.packet(CLIENT, flags=SYN, seq=77_000_000, after_ns=SECOND)
    polled(talk, 2, 3)
    talk.finish()
    assert talk.slugs() == [IGNORED]
    talk = begun()
    for _ in range(2):
        talk.packet(CLIENT, flags=SYN, seq=77_000_000, after_ns=SECOND)
    talk.finish()
    assert talk.slugs() == ["stream.unanswered"]


@each(("ahead", "late"), [(0, False), (65_536, False), (65_537, True), (1 << 31, True)])
def test_octets_behind_a_reset_count_where_they_may_be_out_of_order(ahead: int, late: bool) -> None:
    talk = begun()
    talk.packet(SERVER, flags=RST)
    talk.packet(CLIENT, dt(read(2, dbw(1, 0))), seq=talk.seq[CLIENT] + ahead)
    assert talk.pipeline.counters.packet_counts()["after_close"] == late
