"""What one direction of a connection knows of its sequence numbers and of those of the other."""

from __future__ import annotations

from typing import Final

import pytest

from dissect.engine.transactions.accounts import OctetAccount
from dissect.engine.transactions.protocol import Kept, Protocol
from dissect.engine.transactions.side import Place, Rival, Side
from dissect.engine.transactions.stray import Stray
from dissect.engine.transactions.table import ConnectionTable
from dissect.packets.tcp.stream import FAR_AHEAD, WINDOW
from dissect.protocols.ibh.framer import PacketFramer
from dissect.protocols.s7plus.tables import SET_VARIABLE
from dissect.protocols.s7plus.value_tables import DINT
from dissect.protocols.s7plus.values import Value
from tests.engine.findings.test_plus_rules import begun
from tests.engine.transactions.talk import CLIENT, SERVER, Talk, dbw, dt, read, tpkt
from tests.protocols.s7plus import bodies
from tests.protocols.s7plus.pdus import asked, framed

KEY: Final = b"\x0a\0\0\1\x0a\0\0\2\xc3\x50\0\x66"
HALF: Final = 1 << 31
#: Where octets are counted from, so that sequence numbers wrap, and so that those that matter are 0.
ZEROS: Final = [5000, 0, 2**32 - 3, 2**32 - 10, 2**32 - 100, 2**32 - 101, 2**32 - 107, 2**31 - 90]


@pytest.fixture(params=ZEROS)
def zero(request: pytest.FixtureRequest) -> int:
    return int(request.param)


def pair() -> tuple[Side, Side]:
    side = ConnectionTable().open(KEY, 0, 1, 0)
    assert side.peer is not None
    return side, side.peer


def at(zero: int, octets: int) -> int:
    return (zero + octets) & 0xFFFFFFFF


def test_nothing_is_known_at_first() -> None:
    side, peer = pair()
    assert (side.last_ack, side.acked, side.first_ack, side.end_seq, side.hole_end, side.place) == (
        -1,
        -1,
        -1,
        -1,
        -1,
        -1,
    )
    assert (side.captured, side.unfinished, side.at_rest, side.unseen) == (False, False, True, 0)
    assert not side.is_ahead(-1)
    side.peer = None
    assert (side.unseen, peer.unseen) == (0, 0)


# ---- acknowledgements -----------------------------------------------------------------------------------------------


def test_the_highest_acknowledgement_counts_and_the_first_is_kept(zero: int) -> None:
    side, _ = pair()
    side.begin(1000)
    for ack, highest in (
        (10, 10),
        (10, 10),
        (7, 10),
        (11, 11),
        (11 + HALF, 11),
        (10 + HALF, 10 + HALF),
        (11, 10 + HALF),
    ):
        side.note_ack(1000, at(zero, ack))
        assert (side.acked, side.first_ack) == (at(zero, highest), at(zero, 10))


@pytest.mark.parametrize(
    ("distance", "taken"),
    [(0, True), (FAR_AHEAD, True), (-FAR_AHEAD, True), (FAR_AHEAD + 1, False), (-FAR_AHEAD - 1, False)],
)
def test_a_packet_of_another_connection_acknowledges_nothing(zero: int, distance: int, taken: bool) -> None:
    side, _ = pair()
    side.begin(zero)
    side.note_ack(at(zero, distance), 77)
    assert side.acked == (77 if taken else -1)


def test_before_anything_was_captured_any_packet_counts() -> None:
    side, _ = pair()
    side.note_ack(12345, 77)
    assert (side.acked, side.first_ack) == (77, 77)


@pytest.mark.parametrize(
    ("ack", "ahead"), [(100, False), (101, True), (99, False), (99 + HALF, True), (100 + HALF, False)]
)
def test_whether_an_acknowledgement_is_ahead(zero: int, ack: int, ahead: bool) -> None:
    side, _ = pair()
    side.begin(at(zero, 100))
    assert side.is_ahead(at(zero, ack)) is ahead


# ---- where octets begin ---------------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("first_ack", "begin"),
    [(None, 100), (100, 100), (90, 90), (101, 100), (100 - FAR_AHEAD, 100 - FAR_AHEAD), (99 - FAR_AHEAD, 100)],
)
def test_octets_before_the_first_captured_ones_that_had_not_been_acknowledged(
    zero: int, first_ack: int | None, begin: int
) -> None:
    side, peer = pair()
    peer.first_ack = at(zero, first_ack) if first_ack is not None else -1
    side.begin_late(at(zero, 100))
    assert (side.stream.next_seq, side.stream.start_seq, side.end_seq) == (at(zero, begin),) * 3


def test_a_side_without_another_begins_with_its_first_octets() -> None:
    side, peer = pair()
    peer.first_ack = 50
    side.peer = None
    side.begin_late(100)
    assert side.end_seq == 100


@pytest.mark.parametrize(
    ("ahead", "begun"), [(7, True), (6, False), (0, False), (-1, False), (FAR_AHEAD, True), (FAR_AHEAD + 1, False)]
)
def test_a_packet_without_data_may_show_that_a_message_is_missing_before_it(zero: int, ahead: int, begun: bool) -> None:
    """From seven octets on, the shortest TPDU."""
    side, peer = pair()
    peer.first_ack = zero
    side.note_bare(at(zero, ahead), ends=True)
    assert (side.stream.next_seq == zero) is begun
    assert (side.stream.next_seq == -1) is not begun


def test_a_packet_without_data_does_not_begin_a_stream_again() -> None:
    side, peer = pair()
    side.begin(100)
    peer.first_ack = 50
    side.note_bare(90, ends=True)
    assert side.stream.next_seq == 100
    fresh, other = pair()
    fresh.note_bare(90, ends=True)  # the other side acknowledged nothing yet
    fresh.peer = None
    other.first_ack = 50
    fresh.note_bare(90, ends=True)
    assert fresh.stream.next_seq == -1


@pytest.mark.parametrize("ends", [False, True])
def test_octets_before_a_packet_without_data_were_sent(ends: bool) -> None:
    """A packet that ends the connection may be forged: it says nothing of octets before it."""
    side, peer = pair()
    side.begin(100)
    peer.note_ack(0, 100)
    side.note_bare(120, ends)
    assert peer.acked == (100 if ends else 120)
    assert side.unseen == (0 if ends else 20)


@pytest.mark.parametrize(
    ("acked", "seq", "expected"),
    [
        (100, 101, 101),
        (100, 100, 100),
        (100, 99, 100),
        (110, 105, 110),  # more is known already
        (110, 110, 110),
        (110, 111, 111),
        (100, 100 + WINDOW, 100 + WINDOW),
        (100, 101 + WINDOW, 100),  # no window is so large
        (None, 101, None),  # the other side was not captured
    ],
)
def test_what_is_known_to_have_been_sent(zero: int, acked: int | None, seq: int, expected: int | None) -> None:
    side, peer = pair()
    side.begin(at(zero, 100))
    peer.acked = at(zero, acked) if acked is not None else -1
    side.note_end(at(zero, seq))
    assert peer.acked == (at(zero, expected) if expected is not None else -1)


@pytest.mark.parametrize(
    ("acked", "unseen"),
    [(100, 0), (99, 0), (101, 0), (106, 0), (107, 7), (99 + (1 << 30), (1 << 30) - 1), (100 + (1 << 30), 0)],
)
def test_octets_that_the_other_side_got_and_the_capture_lacks(zero: int, acked: int, unseen: int) -> None:
    """Fewer than seven are no message, and as many as no window has are of something else."""
    for started in (True, False):
        side, peer = pair()
        if started:
            side.begin(at(zero, 100))
        peer.first_ack = at(zero, 100)
        peer.acked = at(zero, acked)
        assert side.unseen == unseen


@pytest.mark.parametrize(("missing", "unseen"), [(1, 0), (2, 2), (6, 6), (7, 7)])
def test_while_a_message_is_begun_two_missing_octets_are_a_part_of_it(missing: int, unseen: int) -> None:
    talk = Talk()
    talk.open()
    talk.packet(CLIENT, dt(read(1, dbw(1, 0)))[:20])
    talk.seq[CLIENT] += missing
    talk.packet(SERVER)
    side = talk.pipeline.table.all_open()[0]
    assert (side.unfinished, side.at_rest, side.unseen) == (True, False, unseen)


# ---- whether a message is unfinished --------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("octets", "unfinished", "at_rest"),
    [
        (dt(read(1, dbw(1, 0))), False, True),
        (dt(read(1, dbw(1, 0)))[:-1], True, False),  # a TPKT is begun
        (tpkt(b"\x02\xf0\x00" + read(1, dbw(1, 0))[:9]), True, False),  # a TSDU is begun
        (tpkt(b"\x02\xf0\x80"), False, True),
    ],
)
def test_a_side_is_at_rest_between_messages(octets: bytes, unfinished: bool, at_rest: bool) -> None:
    talk = Talk()
    talk.open()
    talk.packet(CLIENT, octets)
    side = talk.pipeline.table.all_open()[0]
    assert (side.unfinished, side.at_rest) == (unfinished, at_rest)


def test_a_side_of_a_protocol_that_frames_by_itself_is_never_said_to_be_at_rest() -> None:
    side, _ = pair()
    side.kept = Kept()
    assert not side.at_rest


def test_a_side_is_captured_once_it_sent_anything() -> None:
    talk = Talk()
    talk.packet(CLIENT, tpkt(b"\x02\xf0\x80"))
    side = talk.pipeline.table.all_open()[0]
    assert side.peer is not None
    assert (side.captured, side.peer.captured) == (True, False)
    talk.packet(SERVER, flags=4)  # a RST without acknowledgement
    assert (side.captured, side.peer.captured, side.peer.last_ack) == (True, True, -1)


# ---- the rest -------------------------------------------------------------------------------------------------------


def test_a_protocol_takes_both_directions() -> None:
    side, peer = pair()
    protocol = Protocol(5)
    peer.speak(protocol)
    assert side.protocol is peer.protocol is protocol
    assert side.connection._state == 5
    peer.peer = None
    peer.speak(Protocol(6))
    assert side.protocol is protocol


def test_probes_are_counted_and_the_first_and_the_last_kept() -> None:
    side, _ = pair()
    assert side.probes is None
    side.note_probe(3, 30, True)
    assert side.probes is not None
    assert (bool(side.probes), side.probes.frames) == (True, [3])
    side.note_probe(5, 50, False)
    side.note_probe(8, 80, True)
    found = side.probes
    assert (found.count, found.filled, found.frames, found.last_ns) == (3, 2, [3, 8], 80)


def test_a_place_is_made_once_and_moved() -> None:
    side, _ = pair()
    side.end_seq, side.last_ack = 70, 90
    place = side.note_place(None, 4, 40)
    assert (place.frame, place.time_ns, place.end_seq, place.ack) == (4, 40, 70, 90)
    side.end_seq, side.last_ack = 71, 91
    assert side.note_place(place, 5, 50) is place
    assert (place.frame, place.time_ns, place.end_seq, place.ack) == (5, 50, 71, 91)
    fresh = Place()
    assert (fresh.frame, fresh.ack) == (0, -1)


def test_a_gap_is_remembered_by_its_packet_and_its_end() -> None:
    side, _ = pair()
    side.note_gap(9, 400)
    assert (side.hole_frame, side.hole_end) == (9, 400)
    side.note_gap(12, -1)
    assert (side.hole_frame, side.hole_end) == (12, -1)


def test_octets_are_accounted_for_by_both_framers() -> None:
    """That of TPKTs, and what a protocol keeps that frames by itself."""
    side, _ = pair()
    protocol, account = Protocol(), OctetAccount()
    side.framer.framed, side.framer.skipped = 100, 20
    protocol.add_up(side, account)
    assert (account.framed, account.skipped, account.buffered) == (100, 20, 0)
    assert (protocol.held(side), protocol.probe(side, b"?", True), protocol.describe(), protocol.counted()) == (
        0,
        False,
        {},
        [],
    )
    kept = side.kept = Kept()
    assert (kept.framed, kept.skipped, kept.octets) == (0, 0, b"")
    kept.framed, kept.skipped, kept.octets = 7, 5, b"abc"
    protocol.add_up(side, account)
    assert (account.framed, account.skipped, account.buffered) == (207, 45, 3)
    assert protocol.held(side) == 3


def test_stray_octets_have_the_packets_of_their_first_and_last() -> None:
    stray = Stray(0x41, 5, 70, 9, 90)
    assert (stray.first, stray.skipped, stray.seen, stray.framed, stray.last_ns) == (0x41, 5, 5, 70, 90)
    assert (stray.frames, stray.garbage, stray.told) == ([9], False, False)
    stray.last_frame = 12
    assert stray.frames == [9, 12]


def test_nothing_is_missing_or_begun_at_first() -> None:
    side, _ = pair()
    numbers = (
        "addresses ports second third fourth size longest requests holes missing hole_frame told_jobs told_overdue"
    )
    assert [getattr(side, name) for name in numbers.split()] == [0] * 13
    flags = (side.numbers_fine, side.waiting, side.watched)
    assert flags == (False, False, False)
    objects = (side.also, side.ibh, side.plus, side.inner, side.kept, side.begun_tpkt, side.begun_tsdu, side.slight)
    assert objects == (None,) * 8
    assert (side.stray, side.rival, side.probes) == (None, None, None)
    tcp = side.tcp
    tcp.last_frame, tcp.last_ns = 9, 90
    rival = Rival(tcp, 5, 6, 7, 10, 100)
    found = (rival.last_frame, rival.last_ns, rival.seq, rival.octets, rival.answered, rival.frame, rival.time_ns)
    assert found == (9, 90, 5, 6, 7, 10, 100)


def test_a_side_is_not_at_rest_while_a_pdu_in_frames_is_begun() -> None:
    talk = begun()
    octets = asked(1, SET_VARIABLE, body=bodies.set_variable(0x90, [233], Value(0, DINT, 1)))
    side = talk.pipeline.table.all_open()[0]
    talk.ask(framed(octets[:20], 3, trailer=False))
    assert (side.at_rest, side.unfinished) == (False, False)
    talk.ask(framed(octets[20:], 3))
    assert side.at_rest


def test_a_side_of_ibh_netlink_is_at_rest_between_packets() -> None:
    side, _ = pair()
    framer = side.ibh = PacketFramer()
    assert side.at_rest
    framer.push(b"\x00")
    assert framer.buffered == 1
    assert not side.at_rest
