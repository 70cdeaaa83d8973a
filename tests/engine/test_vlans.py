"""One connection in several VLANs: each direction with a tag of its own, or every packet twice; and two that stay apart."""

from __future__ import annotations

from collections.abc import Callable
from random import Random

import pytest

from dissect.engine.pipeline import Options, Pipeline
from dissect.engine.transactions.table import MAX_ALSO, MAX_CONNECTIONS, MAX_TAGS, ConnectionTable
from tests.cases import each
from tests.engine.test_pipeline import poll, ready
from tests.engine.transactions import talk as talks
from tests.properties.books import Record, Result, check_books, told, true
from tests.properties.packets import ACK, FIN, MS, PSH, RST, SYN, Flow, Packet, Segment, Talk, captured
from tests.properties.traffic import conversation, merged, segments

#: Tags of a packet, in the order in which it is captured with them, by the side that sends it.
Tags = Callable[[int], list[tuple[int, ...]]]

ASYMMETRIC: dict[str, Tags] = {
    "tagged, untagged": lambda side: [(10,) if side == 0 else ()],
    "untagged, tagged": lambda side: [() if side == 0 else (10,)],
    "two VLANs": lambda side: [(20,) if side == 0 else (10,)],
    "two tags, one": lambda side: [(5, 20) if side == 0 else (20,)],
}
TWICE: dict[str, Tags] = {
    "routed": lambda side: [(10,), (20,)] if side == 0 else [(20,), (10,)],
    "in one order": lambda _: [(10,), (20,)],
    "tag taken off": lambda _: [(), (10,)],
    "one direction": lambda side: [(10,), ()] if side == 0 else [()],
}


def tagged(sent: list[Segment], tags: Tags, apart_ns: int = MS) -> list[Packet]:
    """Return segments as packets with these tags, the copies of each one behind the other."""
    packets = []
    for number, segment in enumerate(sent):
        for copy, vlans in enumerate(tags(segment.side)):
            flow = Flow(str(segment.flow.addresses[0]), str(segment.flow.addresses[1]), segment.flow.ports, vlans)
            frame = segment._replace(flow=flow).frame()
            packets.append(Packet(1_700_000_000_000_000_000 + number * apart_ns + copy, frame, len(frame), 1))
    return packets


@pytest.mark.parametrize("midstream", [False, True])
@pytest.mark.parametrize("how", [*ASYMMETRIC, *TWICE])
@pytest.mark.parametrize("address", ["10.0.0.", "2001:db8::"])
def test_it_is_one_connection(how: str, midstream: bool, address: str) -> None:
    flow = Flow(f"{address}1", f"{address}2")
    for seed in range(6):
        talk = conversation(Random(seed), flow, 12, midstream=midstream)
        tags = ASYMMETRIC.get(how) or TWICE[how]
        result = Result(tagged(segments(talk, Random(seed), cut=0.2), tags))
        check_books(result.pipeline, result.record)
        assert told(result.transactions) == true([talk])
        (tcp,) = {connection.tcp for connection in result.record.closed}
        seen = {sum(vlan << 12 * at for at, vlan in enumerate(reversed(tag))) for side in (0, 1) for tag in tags(side)}
        assert {tcp.vlan, *tcp.also} == seen
        assert result.pipeline.table.sides == {}


def test_copies_are_counted_as_others_are() -> None:
    sent = poll(ready(), 1, 2).close().segments
    twice = Result(tagged(sent, TWICE["routed"]))
    same = Result(tagged(sent, lambda _: [(10,), (10,)]))
    assert twice.pipeline.counters.packet_counts() == same.pipeline.counters.packet_counts()
    assert twice.pipeline.counters.packet_counts()["retransmission"] == 8
    (connection,) = twice.record.closed
    assert connection.tcp.packets == 2 * len(sent)


def test_machines_that_are_alike_stay_apart() -> None:
    """Their connections are open at the same time, between the same addresses and ports, some met in their midst."""
    for seed in range(12):
        rng = Random(seed)
        spoken, streams = [], []
        for vlan in (1, 2, 3):
            talk = conversation(Random(100 * seed + vlan), Flow(vlans=(vlan,)), 12, midstream=rng.random() < 0.5)
            spoken.append(talk)
            streams.append(segments(talk, rng, isns=(rng.getrandbits(32), rng.getrandbits(32))))
        result = Result(captured(merged(rng, streams)))
        check_books(result.pipeline, result.record)
        assert told(result.transactions) == true(spoken)
        assert sorted([connection.tcp.vlan for connection in result.record.closed]) == [1, 2, 3]


def test_those_that_count_alike_stay_apart_when_one_begins_after_the_other() -> None:
    spoken = [poll(ready(Flow(vlans=(vlan,))), vlan) for vlan in (1, 2)]
    result = Result([packet for talk in spoken for packet in talk.packets()])
    assert [connection.tcp.vlan for connection in result.record.closed] == [1, 2]
    assert len(result.transactions) == 4


def test_a_refusal_in_another_vlan() -> None:
    talk = Talk(Flow())
    talk.put(0, SYN)
    talk.put(1, RST | ACK)
    result = Result(tagged(talk.segments, ASYMMETRIC["two VLANs"]))
    assert result.pipeline.finding_counts == {"stream.refused": 1}


def test_only_acknowledgements_come_back() -> None:
    """The other direction carries nothing, but its FIN ends the connection."""
    talk = Talk(Flow())
    talk.put(0, SYN)
    for octets in (b"\x03\x00\x00\x07\x02\xf0\x80", b"\x03\x00\x00\x07\x02\xf0\x80"):
        talk.put(0, PSH | ACK, octets)
        talk.put(1, ACK)
    talk.put(1, FIN | ACK)
    result = Result(tagged(talk.segments, ASYMMETRIC["two VLANs"]))
    (connection,) = result.record.closed
    assert (connection.tcp.packets, connection.tcp.ended, connection.tcp.ended_by) == (len(talk.segments), "fin", 1)


def test_ports_that_are_used_again() -> None:
    first, second = poll(ready(), 1), poll(ready(isns=(7_000_000, 9_000_000)), 2)
    for tags in (ASYMMETRIC["two VLANs"], TWICE["routed"]):
        result = Result(tagged(first.segments + second.segments, tags))
        assert len(result.record.closed) == 2
        assert len(result.transactions) == 4


def test_what_is_known_of_vlans_is_bounded() -> None:
    sent = poll(ready(), *range(1, 6)).segments
    result = Result(tagged(sent, lambda _: [(vlan,) for vlan in range(1, 9)]))
    assert len(result.transactions) == 6
    (connection,) = result.record.closed
    assert len(connection.tcp.also) <= 2 * MAX_ALSO
    result = Result(tagged(sent, lambda _: [(vlan,) for vlan in range(1, 100)]))
    assert len(result.pipeline.table.tags) == MAX_TAGS + 1
    assert all(len(connection.tcp.also) <= 2 * MAX_ALSO for connection in result.record.closed)
    assert result.pipeline.table.sides == {}


def test_keys_of_other_vlans_make_no_connections_leave() -> None:
    table = ConnectionTable()
    for number in range(MAX_CONNECTIONS - 600):
        key = b"%b%b%b" % (b"\n\0\0\1\n\0\0\2", number.to_bytes(2, "big"), b"\0\x66")
        table.open(key, 0, number, number)
        table.add(table.sides[key], key + (10).to_bytes(8, "big"))
        assert table.overflow() == []
    assert len(table.all_open()) == MAX_CONNECTIONS - 600
    for side in table.all_open():
        table.remove(side)
    assert table.sides == {}


def test_a_capture_that_begins_anew_knows_no_vlans() -> None:
    pipeline = Pipeline(Record(), Options())
    for packet in tagged(ready().segments, TWICE["routed"]):
        pipeline.frame(packet.time_ns, packet.octets, 0, len(packet.octets), len(packet.octets), 1)
    pipeline.finish()
    pipeline.restart_clock(0)
    assert pipeline.table.tags == {}


@pytest.mark.parametrize("vlans", [(10, 20), (0, 20), (10, 0)])
def test_a_connection_gives_way_to_one_that_is_answered_in_another_vlan(vlans: tuple[int, int]) -> None:
    """The PLC was away, so that the VLAN of its direction was not known when its client began anew from the same port."""
    talk = talks.Talk()
    talk.vlan = vlans[0]
    for number in range(2):
        talk.ask(talks.read(number, talks.dbw(1, 0)))
    talk.seq = [50_000_000, 70_000_000]
    began = talk.packet(0, flags=SYN)
    talk.vlan = vlans[1]
    talk.packet(1, flags=SYN | ACK)
    talk.vlan = vlans[0]
    talk.packet(0)
    talk.ask(talks.read(2, talks.dbw(1, 0)))
    talk.vlan = vlans[1]
    talk.tell(talks.words(2, 7))
    talk.finish()
    assert talk.outcomes() == ["unanswered", "unanswered", "answered"]
    assert [(one.tcp.ended, one.tcp.ended_frame) for one in talk.connections] == [("reused", began), ("", 0)]
    assert talk.pipeline.table.sides == {}
    assert talk.pipeline.exchange.dialogue.open == 0


def test_data_that_fit_a_syn_in_another_vlan_end_no_connection_there() -> None:
    talk = talks.Talk()
    talk.vlan = 10
    talk.open()
    talk.packet(0, flags=SYN, seq=talk.seq[0] + 20_000)
    stranger = talks.Talk(beside=talk)
    stranger.vlan = 20
    stranger.seq = [talk.seq[0] + 20_100, 70_000_000]
    stranger.tell(talks.words(9, 1))
    for number in range(1, 4):
        talk.ask(talks.read(number, talks.dbw(1, 0)))
        talk.tell(talks.words(number, 7))
    talk.finish()
    assert [one.tcp.vlan for one in talk.connections if one.answered] == [10]
    assert talk.outcomes().count("answered") == 3
    assert talk.pipeline.table.sides == {}


# ---- which numbers fit ----------------------------------------------------------------------------------------------

#: The largest distance of a number that fits: a window without scaling.
WINDOW = 65535
DISTANCES = [0, 1, -1, 100, WINDOW, -WINDOW, WINDOW + 1, -WINDOW - 1, 1 << 30, 1 << 31]


def half() -> talks.Talk:
    """A connection of which only the client was captured so far, in VLAN 10, in its midst; then comes VLAN 20."""
    talk = talks.Talk()
    talk.vlan = 10
    talk.ask(talks.read(1, talks.dbw(1, 0)))
    talk.vlan = 20
    return talk


def opened(talk: talks.Talk) -> int:
    return len(talk.pipeline.table.all_open())


@each("distance", DISTANCES)
@each("payload", [b"", talks.dt(talks.words(1, 1))])
def test_an_answer_in_another_vlan_belongs_to_the_connection_whose_numbers_it_fits(
    distance: int, payload: bytes
) -> None:
    """Both its number and what it acknowledges: within a window, as packets may be missing."""
    fits = abs(distance) <= WINDOW
    talk = half()
    talk.packet(talks.SERVER, payload, seq=talk.seq[talks.SERVER] + distance)
    assert opened(talk) == (1 if fits or not payload else 2)
    assert (talk.pipeline.table.all_open()[0].tcp.packets == 2) is fits
    talk = half()
    talk.acked[talks.SERVER] = talk.seq[talks.CLIENT] + distance
    talk.packet(talks.SERVER, payload)
    assert (talk.pipeline.table.all_open()[0].tcp.packets == 2) is fits


@each("distance", [0, 1, -1])
def test_a_reset_in_another_vlan_has_to_have_the_very_number(distance: int) -> None:
    talk = half()
    talk.packet(talks.SERVER, flags=RST, seq=talk.seq[talks.SERVER] + distance)
    (side,) = talk.pipeline.table.all_open()
    assert (side.tcp.ended, side.tcp.packets) == (("reset", 2) if distance == 0 else ("", 1))


def test_a_reset_in_another_vlan_where_nothing_was_acknowledged_fits_nothing() -> None:
    talk = talks.Talk()
    talk.vlan = 10
    talk.packet(talks.CLIENT, talks.dt(talks.read(1, talks.dbw(1, 0))), flags=0)
    talk.vlan = 20
    talk.packet(talks.SERVER, flags=RST)
    (side,) = talk.pipeline.table.all_open()
    assert side.tcp.ended == ""


@each("distance", [0, 1, -1])
def test_the_answer_to_a_syn_in_another_vlan_acknowledges_just_that(distance: int) -> None:
    talk = talks.Talk()
    talk.vlan = 10
    talk.packet(talks.CLIENT, flags=SYN)
    talk.vlan = 20
    talk.acked[talks.SERVER] = talk.seq[talks.CLIENT] + distance
    talk.packet(talks.SERVER, flags=SYN | ACK)
    (side,) = talk.pipeline.table.all_open()
    assert (side.tcp.initiator, side.tcp.vlan) == ((0, 10) if distance == 0 else (1, 20))
    assert (side.tcp.packets, sorted((side.tcp.vlan, *side.tcp.also))) == (
        (2, [10, 20]) if distance == 0 else (1, [20])
    )


@each("distance", DISTANCES)
def test_data_in_another_vlan_may_answer_a_syn_whose_answer_was_lost(distance: int) -> None:
    talk = talks.Talk()
    talk.vlan = 10
    talk.packet(talks.CLIENT, flags=SYN)
    talk.vlan = 20
    talk.acked[talks.SERVER] = talk.seq[talks.CLIENT] + distance
    talk.packet(talks.SERVER, talks.dt(talks.words(1, 1)))
    (side,) = talk.pipeline.table.all_open()
    assert (side.tcp.vlan == 10) is (abs(distance) <= WINDOW)


def both_captured() -> talks.Talk:
    """A connection of which both sides were captured in VLAN 10, so that only copies come in another."""
    talk = talks.Talk()
    talk.vlan = 10
    talk.open(8, 8)
    for ref in range(1, 6):
        talk.ask(talks.read(ref, talks.dbw(1, 0)))
        talk.tell(talks.words(ref, 1))
    talk.vlan = 20
    return talk


@each(("behind", "is_copy"), [(0, True), (1, True), (2, True), (3, False)])
def test_a_copy_in_another_vlan_is_one_of_the_latest_segments(behind: int, is_copy: bool) -> None:
    """The very next segment, the one before it, and the one before that; older ones are no longer kept."""
    talk = both_captured()
    octets = talks.dt(talks.read(6 - behind, talks.dbw(1, 0)))
    talk.packet(talks.CLIENT, octets, seq=talk.seq[talks.CLIENT] - behind * len(octets))
    assert opened(talk) == (1 if is_copy else 2)
    counts = talk.pipeline.counters.packet_counts()
    assert counts["retransmission"] == (is_copy and behind > 0)


@each(("behind", "is_copy"), [(1, True), (2, True), (3, False), (4, False)])
def test_of_equal_requests_a_copy_is_one_of_the_latest_two(behind: int, is_copy: bool) -> None:
    """A client that polls sends the same octets again and again: the place counts as well."""
    talk = talks.Talk()
    talk.vlan = 10
    talk.open(8, 8)
    octets = talks.dt(talks.read(1, talks.dbw(1, 0)))
    for _ in range(6):
        talk.packet(talks.CLIENT, octets)
        talk.tell(talks.words(1, 1))
    talk.vlan = 20
    talk.packet(talks.CLIENT, octets, seq=talk.seq[talks.CLIENT] - behind * len(octets))
    assert opened(talk) == (1 if is_copy else 2)


def test_the_latest_segment_before_a_gap_is_still_one_of_the_latest_two() -> None:
    for other in (False, True):
        talk = both_captured()
        talk.vlan = 10
        octets = talks.dt(talks.read(6, talks.dbw(1, 0)))
        talk.packet(talks.CLIENT, octets)
        at = talk.seq[talks.CLIENT] - len(octets)
        talk.packet(talks.CLIENT, talks.dt(talks.read(7, talks.dbw(1, 0))), cut=9)
        talk.vlan = 20
        talk.packet(talks.CLIENT, octets[:-1] + b"x" if other else octets, seq=at)
        assert opened(talk) == (2 if other else 1)


@each(("cut", "shift", "is_copy"), [(0, 0, True), (9, 0, True), (9, 9, False), (9, -9, False)])
def test_of_a_copy_that_the_capture_cut_its_whole_size_counts(cut: int, shift: int, is_copy: bool) -> None:
    talk = both_captured()
    octets = talks.dt(talks.read(5, talks.dbw(1, 0)))
    talk.packet(talks.CLIENT, octets, seq=talk.seq[talks.CLIENT] - len(octets) + shift, cut=cut)
    assert opened(talk) == (1 if is_copy else 2)


@each("change", [(5, 0), (-1, 0), (0, 1), (0, -1)])
def test_octets_that_are_not_the_same_are_no_copy(change: tuple[int, int]) -> None:
    """At another place of the segment or of the stream, of two segments before."""
    octet, shift = change
    talk = both_captured()
    octets = bytearray(talks.dt(talks.read(4, talks.dbw(1, 0))))
    if octet:
        octets[octet] ^= 1
    talk.packet(talks.CLIENT, bytes(octets), seq=talk.seq[talks.CLIENT] - 2 * len(octets) + shift)
    assert opened(talk) == 2


@each("size", [7, 8])
def test_fewer_than_eight_octets_may_be_equal_by_chance(size: int) -> None:
    talk = talks.Talk()
    talk.vlan = 10
    talk.open(8, 8)
    octets = talks.dt(b"x" * (size - 7))
    for _ in range(2):
        talk.packet(talks.CLIENT, octets)
        talk.packet(talks.SERVER)
    talk.vlan = 20
    talk.packet(talks.CLIENT, octets, seq=talk.seq[talks.CLIENT] - 2 * size)
    assert opened(talk) == (1 if size == 8 else 2)


@each("distance", DISTANCES)
def test_a_copy_that_is_not_the_next_segment_acknowledges_something_near(distance: int) -> None:
    talk = both_captured()
    octets = talks.dt(talks.read(4, talks.dbw(1, 0)))
    talk.acked[talks.CLIENT] = talk.seq[talks.SERVER] + distance
    talk.packet(talks.CLIENT, octets, seq=talk.seq[talks.CLIENT] - 2 * len(octets))
    assert opened(talk) == (1 if abs(distance) <= WINDOW else 2)


@each(("acked", "is_copy"), [(0, True), (-27, True), (-54, False), (1, False)])
def test_a_copy_that_ends_where_the_stream_is_acknowledges_what_its_side_did_or_all(acked: int, is_copy: bool) -> None:
    """The client acknowledged all but the last answer in its last packet; 27 octets are one answer."""
    talk = both_captured()
    octets = talks.dt(talks.read(5, talks.dbw(1, 0)))
    talk.acked[talks.CLIENT] = talk.seq[talks.SERVER] + acked
    talk.packet(talks.CLIENT, octets, seq=talk.seq[talks.CLIENT] - len(octets))
    assert opened(talk) == (1 if is_copy else 2)


@each("flags", [RST])
@each("distance", [0, 1, -1])
def test_a_copy_of_a_reset_has_the_very_number(flags: int, distance: int) -> None:
    talk = both_captured()
    talk.packet(talks.CLIENT, flags=flags, seq=talk.seq[talks.CLIENT] + distance)
    (side,) = talk.pipeline.table.all_open()
    assert (side.tcp.ended == "reset") is (distance == 0)


@each("side", [talks.CLIENT, talks.SERVER])
@each("late", [False, True])
def test_copies_of_a_handshake_come_before_anything_else(side: int, late: bool) -> None:
    """A SYN/ACK with the same numbers after data is of another machine that counts alike."""
    talk = talks.Talk()
    talk.vlan = 10
    talk.packet(talks.CLIENT, flags=SYN)
    talk.packet(talks.SERVER, flags=SYN | ACK)
    if late:
        talk.packet(side, talks.CONNECT)
    talk.vlan = 20
    talk.acked[talks.SERVER] = 1001
    talk.packet(talks.SERVER, flags=SYN | ACK, seq=90_000)
    assert opened(talk) == (2 if late else 1)


def test_a_side_that_was_captured_is_not_answered_by_somebody_else() -> None:
    """Its numbers fit, but the true answers are known: two machines with the same addresses, the one after the other."""
    talk = both_captured()
    talk.tell(talks.words(9, 1))
    assert opened(talk) == 1  # the very next segment
    other = both_captured()
    other.packet(talks.SERVER, talks.dt(talks.words(9, 1)), seq=other.seq[talks.SERVER] + 500)
    assert opened(other) == 2


def test_an_attempt_in_its_own_vlan_comes_first() -> None:
    """The answer fits a SYN of its own VLAN and a connection elsewhere."""
    talk = half()
    talk.packet(talks.CLIENT, flags=SYN, seq=talk.seq[talks.CLIENT] - 1)
    talk.packet(talks.SERVER, flags=SYN | ACK)
    sides = talk.pipeline.table.all_open()
    assert [side.tcp.vlan for side in sides] == [10, 20]
    assert sides[1].tcp.initiator == 0
