"""One connection in several VLANs: each direction with a tag of its own, or every packet twice; and two that stay apart."""

from __future__ import annotations

from collections.abc import Callable
from random import Random

import pytest

from dissect.engine.pipeline import Options, Pipeline
from dissect.engine.transactions.table import MAX_ALSO, MAX_CONNECTIONS, MAX_TAGS, ConnectionTable
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
