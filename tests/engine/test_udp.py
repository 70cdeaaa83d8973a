"""Conversations over UDP: what is one, that it ends, that there are never too many."""

from __future__ import annotations

import struct

import pytest
from hypothesis import given
from hypothesis import strategies as st

from dissect.engine.exchange import PayloadDecoder
from dissect.engine.pipeline import Options, Pipeline
from dissect.engine.transactions.side import Side
from dissect.engine.transactions.table import MAX_CONNECTIONS, ConnectionTable
from dissect.output.page.rows import Rows
from dissect.wire.text import Clock
from tests.engine.transactions.talk import CLIENT, MS, SERVER, Talk
from tests.meaning.bindings import plant


class Heard(PayloadDecoder):
    """Claims one port and writes down what it hears."""

    def __init__(self, port: int = 7000, takes: bool = True) -> None:
        super().__init__()
        self.udp_ports = {port}
        self.takes = takes
        self.heard: list[tuple[int, bytes, int]] = []
        self.ended = 0

    def claims_port(self, transport: str, connection: object) -> bool:
        assert transport == "udp"
        return self.takes

    def datagram(self, side: Side, octets: bytes, missing: int, frame: int, time_ns: int) -> None:
        self.heard.append((side.connection.number, octets, missing))

    def end(self, side: Side, frame: int, time_ns: int) -> None:
        self.ended += 1


def flows_of(talk: Talk) -> ConnectionTable:
    datagrams = talk.pipeline.datagrams
    assert datagrams is not None
    return datagrams.flows


def hearing(carrier: Heard) -> Talk:
    talk = Talk()
    talk.carry(carrier)
    return talk


def test_both_directions_are_one_conversation() -> None:
    carrier = Heard()
    talk = hearing(carrier)
    talk.datagram(CLIENT, b"one", (1, 7000))
    talk.datagram(SERVER, b"two", (1, 7000))
    talk.datagram(CLIENT, b"other", (2, 7000))
    talk.datagram(CLIENT, b"", (1, 7000))
    assert carrier.heard == [(1, b"one", 0), (1, b"two", 0), (2, b"other", 0), (1, b"", 0)]
    talk.pipeline.finish()
    assert carrier.ended == 2
    first, second = talk.connections
    assert (first.udp, first.tcp.packets, first.tcp.first_frame, first.tcp.last_frame) == (True, 3, 1, 4)
    assert (second.number, second.tcp.packets) == (2, 1)
    assert talk.pipeline.counters.packet_counts()["payload"] == 4


def test_a_page_names_their_ports_as_those_of_udp() -> None:
    talk = hearing(Heard())
    talk.datagram(CLIENT, b"one", (1, 7000))
    talk.pipeline.finish()
    (connection,) = talk.connections
    filtered = Rows(["a.pcap"], Clock(), {}).connection(connection, "")["filter"]
    assert filtered.endswith(" && udp.port == 1 && udp.port == 7000")


def test_a_cut_datagram_says_what_is_missing() -> None:
    carrier = Heard()
    talk = hearing(carrier)
    talk.datagram(CLIENT, b"0123456789", (1, 7000), cut=4)
    assert carrier.heard == [(1, b"012345", 4)]


@pytest.mark.parametrize(("port", "takes"), [(7001, True), (7000, False)])
def test_what_nobody_claims_is_only_counted(port: int, takes: bool) -> None:
    carrier = Heard(7000, takes)
    talk = hearing(carrier)
    for _ in range(3):
        talk.datagram(CLIENT, b"x", (1, port))
    talk.pipeline.finish()
    assert (carrier.heard, carrier.ended, talk.connections) == ([], 0, [])
    assert talk.pipeline.counters.packet_counts()["not_tcp"] == 3
    assert flows_of(talk).sides == {}


def test_without_a_carrier_udp_is_not_looked_at() -> None:
    talk = Talk()
    talk.datagram(CLIENT, plant.ask("Расход 1"))
    assert talk.pipeline.counters.packet_counts()["not_tcp"] == 1


def test_fragments_of_a_datagram_are_put_together() -> None:
    carrier = Heard()
    talk = hearing(carrier)
    payload = bytes(range(200))
    udp = struct.pack(">HHHH", 1, 7000, 208, 0) + payload
    for begin, end, more in ((0, 104, 1), (104, 208, 0)):
        part = udp[begin:end]
        ip = struct.pack(">BBHHHBBH", 0x45, 0, 20 + len(part), 5, more << 13 | begin // 8, 64, 17, 0)
        talk.raw(bytes(12) + b"\x08\x00" + ip + bytes((10, 0, 0, 1, 10, 0, 0, 2)) + part)
    assert carrier.heard == [(1, payload, 0)]
    counts = talk.pipeline.counters.packet_counts()
    assert sum(counts.values()) == talk.pipeline.frames == 2


def test_too_many_conversations_are_told() -> None:
    """10,000 of them: those that were silent longest are over, each is told once, nothing else is lost."""
    talk = Talk()
    talk.carry(plant.carrier())
    asked = plant.ask("Расход 1")
    for number in range(10_000):
        talk.hosts = [number & 0xFF, 2]
        talk.datagram(CLIENT, asked, (10_000 + (number >> 8), plant.MESSAGES))
    assert len(flows_of(talk).sides) <= 2 * (MAX_CONNECTIONS + 1)  # before one leaves
    gone = [connection for connection in talk.connections if connection.tcp.ended == "evicted"]
    assert len(gone) == flows_of(talk).evicted == 10_000 - len(flows_of(talk).sides) // 2
    talk.pipeline.finish()
    reasons = [one.reason for one in talk.transactions]
    assert reasons.count("connection_evicted") == len(gone) > 0
    assert reasons.count("one_sided") == 10_000 - len(gone)
    talk.pipeline.exchange.report_findings()
    assert talk.pipeline.finding_counts["stream.evicted"] == len(gone)


@given(
    st.lists(
        st.tuples(st.booleans(), st.sampled_from([7000, 7001]), st.binary(max_size=9), st.integers(0, 60)), max_size=8
    )
)
def test_every_packet_is_counted(packets: list[tuple[bool, int, bytes, int]]) -> None:
    carrier = Heard()
    talk = hearing(carrier)
    for side, port, payload, cut in packets:
        talk.first.now_ns += MS
        talk.datagram(int(side), payload, (1, port), cut)
    talk.pipeline.finish()
    assert sum(talk.pipeline.counters.packet_counts().values()) == len(packets)
    assert talk.pipeline.counters.packet_counts()["failed"] == 0


def test_a_conversation_that_the_user_leaves_out_is_not_passed_on() -> None:
    carrier = Heard()
    talk = Talk()
    talk.pipeline = Pipeline(talk, Options(strict=True, decoder=carrier, only=lambda one: one.number > 1))
    for number, port in enumerate((1, 2, 1), 1):
        talk.datagram(CLIENT, b"x%d" % number, (port, 7000))
    talk.finish()
    assert carrier.heard == [(2, b"x2", 0)]
    assert [one.number for one in talk.connections] == [2]
    counts = talk.pipeline.counters.packet_counts()
    assert (counts["left_out"], counts["payload"]) == (2, 1)
    assert talk.pipeline.connections.left_out == 1


def test_either_port_of_a_datagram_may_be_a_bound_one() -> None:
    for ports in ((7000, 1), (1, 7000), (7000, 7000), (7001, 1)):
        carrier = Heard()
        talk = hearing(carrier)
        talk.datagram(CLIENT, b"x", ports)
        assert len(carrier.heard) == (7000 in ports), ports


def test_a_conversation_has_the_times_of_its_packets_and_ends_with_the_capture() -> None:
    talk = hearing(Heard())
    first = talk.datagram(CLIENT, b"x", (1, 7000))
    talk.datagram(CLIENT, b"x", (2, 7000))
    last = talk.datagram(SERVER, b"y", (1, 7000))
    last_ns = talk.now_ns
    talk.datagram(CLIENT, b"x", (2, 7000))
    talk.finish()
    tcp = talk.connections[0].tcp
    assert (tcp.first_frame, tcp.last_frame, tcp.last_ns, tcp.packets, tcp.ended) == (first, last, last_ns, 2, "")
    assert flows_of(talk).sides == {}
