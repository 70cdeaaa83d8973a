"""Frames of a conversation: right to the last octet for other people's parsers, and nothing that Wireshark marks."""

from __future__ import annotations

import socket
from pathlib import Path

import dpkt
import pytest
from hypothesis import given
from hypothesis import strategies as st

from dissect.engine.observer import Observer
from dissect.engine.pipeline import Options, Pipeline
from dissect.engine.transactions.connection import Connection
from dissect.online.proxy.packets import ACKNOWLEDGE_AFTER, MAX_SEGMENT, Conversation, endpoint_of
from dissect.packets.source.pcapng_writer import PcapngWriter
from dissect.packets.tcp.link import ETHERNET
from dissect.packets.tcp.stream import Endpoint
from tests.online.proxy.support import WRONG, tshark

CLIENT = Endpoint(bytes((10, 0, 0, 1)), 49152)
SERVER = Endpoint(bytes((10, 0, 0, 2)), 102)
CLIENT6 = Endpoint(bytes.fromhex("fd00000000000000000000000000000a"), 49152)
SERVER6 = Endpoint(bytes.fromhex("fd00000000000000000000000000000b"), 102)
#: A conversation whose client's sequence numbers pass 2**32 after few octets.
WRAPPING = (2**32 - 3000) * pow(2_654_435_761, -1, 2**32) % 2**32

SYN, ACK, FIN, RST = 0x02, 0x10, 0x01, 0x04


def parsed(frame: bytes) -> tuple[dpkt.ip.IP | dpkt.ip6.IP6, dpkt.tcp.TCP]:
    """Parse a frame by dpkt, which also computes checksums: they must be those that stand there."""
    packet = dpkt.ethernet.Ethernet(frame).data
    segment = packet.data
    if isinstance(packet, dpkt.ip.IP):
        ours = (packet.sum, segment.sum)
        packet.sum = segment.sum = 0
        bytes(packet)
        again = dpkt.ip.IP(bytes(packet))
        assert (again.sum, again.data.sum) == ours
        packet.sum, segment.sum = ours
    return packet, segment


def written(path: Path, frames: list[bytes]) -> Path:
    writer = PcapngWriter(str(path))
    for number, frame in enumerate(frames):
        writer.packet(1_500_000_000_000_000_000 + number * 1_000_000, frame, len(frame), ETHERNET)
    writer.close()
    return path


def test_a_connection_from_beginning_to_end() -> None:
    talk = Conversation(CLIENT, SERVER)
    frames = talk.opened() + talk.sent(0, b"abc") + talk.sent(1, b"defg") + talk.closed(0) + talk.closed(1)
    told = []
    for frame in frames:
        packet, segment = parsed(frame)
        told.append((packet.src[-1], segment.flags & 0x17, segment.seq, segment.ack, bytes(segment.data)))
    mine, theirs = told[0][2], told[1][2]
    assert told == [
        (1, SYN, mine, 0, b""),
        (2, SYN | ACK, theirs, mine + 1, b""),
        (1, ACK, mine + 1, theirs + 1, b""),
        (1, ACK, mine + 1, theirs + 1, b"abc"),
        (2, ACK, theirs + 1, mine + 4, b"defg"),
        (1, FIN | ACK, mine + 4, theirs + 5, b""),
        (2, ACK, theirs + 5, mine + 5, b""),
        (2, FIN | ACK, theirs + 5, mine + 5, b""),
        (1, ACK, mine + 5, theirs + 6, b""),
    ]
    assert {(segment.sport, segment.dport) for _, segment in map(parsed, frames)} == {(49152, 102), (102, 49152)}


def test_large_pieces_become_segments_that_fit_an_ip_packet() -> None:
    talk = Conversation(CLIENT, SERVER)
    frames = talk.sent(1, bytes(2 * MAX_SEGMENT + 1))
    sizes = [(packet.len, len(segment.data), segment.flags) for packet, segment in map(parsed, frames)]
    assert sizes == [(65535, MAX_SEGMENT, ACK), (65535, MAX_SEGMENT, ACK), (41, 1, ACK | 0x08)]
    assert talk.sent(1, b"") == []


def test_who_only_listens_acknowledges_now_and_then() -> None:
    talk = Conversation(CLIENT, SERVER)
    frames = [frame for _ in range(40) for frame in talk.sent(0, bytes(60_000))]
    segments = [parsed(frame)[1] for frame in frames]
    acks = [segment.ack for segment in segments if segment.sport == 102]
    assert len(acks) == 40 * 60_000 // (ACKNOWLEDGE_AFTER + 60_000) == 2
    assert acks[0] == segments[0].seq + 18 * 60_000


@pytest.mark.parametrize("number", [0, 1, WRAPPING])
def test_wireshark_finds_nothing_to_mark(number: int, tmp_path: Path) -> None:
    talk = Conversation(CLIENT, SERVER, number)
    frames = talk.opened()
    for size in (1, 1, 3000, 70_000, 1, 200_000, 1):
        frames += talk.sent(0, bytes(size)) + talk.sent(1, bytes(range(200))) + talk.sent(1, b"\0")
    for _ in range(30):
        frames += talk.sent(1, bytes(100_000))
    frames += talk.closed(1) + talk.sent(0, b"still") + talk.closed(0)
    other = Conversation(Endpoint(CLIENT.address, 5), SERVER, number)
    frames += other.opened() + other.sent(0, b"x") + other.reset(1)
    refused = Conversation(Endpoint(CLIENT.address, 6), SERVER, number)
    frames += refused.refused()
    path = written(tmp_path / "talk.pcapng", frames)
    assert tshark(path, WRONG) == []
    assert len(tshark(path)) == len(frames)
    assert [row[1] for row in tshark(path, "tcp.flags.reset == 1", "tcp.seq")] == ["1", "1"]


def test_wireshark_sees_what_was_skipped(tmp_path: Path) -> None:
    talk = Conversation(CLIENT, SERVER)
    frames = talk.opened() + talk.sent(0, b"abc")
    talk.skipped(0, 1000)
    frames += talk.sent(0, b"def")
    assert len(tshark(written(tmp_path / "hole.pcapng", frames), "tcp.analysis.lost_segment")) == 1


@pytest.mark.parametrize(
    ("client", "server", "seen"),
    [
        (CLIENT6, SERVER6, (CLIENT6.address, SERVER6.address)),
        (CLIENT6, SERVER, (CLIENT6.address, bytes(10) + b"\xff\xff" + SERVER.address)),
        (CLIENT, SERVER6, (bytes(10) + b"\xff\xff" + CLIENT.address, SERVER6.address)),
    ],
)
def test_ipv6_on_either_side(client: Endpoint, server: Endpoint, seen: tuple[bytes, bytes], tmp_path: Path) -> None:
    talk = Conversation(client, server)
    frames = talk.opened() + talk.sent(0, bytes(70_001)) + talk.closed(0) + talk.closed(1)
    packet, segment = parsed(frames[3])
    assert (packet.src, packet.dst, packet.plen, len(segment.data)) == (*seen, 20 + MAX_SEGMENT, MAX_SEGMENT)
    assert tshark(written(tmp_path / "six.pcapng", frames), WRONG) == []


@pytest.mark.parametrize(
    ("address", "octets"),
    [
        (("10.0.0.1", 102), bytes((10, 0, 0, 1))),
        (("::1", 102, 0, 0), bytes(15) + b"\x01"),
        (("::ffff:10.0.0.1", 102, 0, 0), bytes((10, 0, 0, 1))),
        (("fe80::1%eth0", 102, 0, 2), b"\xfe\x80" + bytes(13) + b"\x01"),
    ],
)
def test_addresses_as_sockets_give_them(address: tuple[object, ...], octets: bytes) -> None:
    told = endpoint_of(address)
    assert (told.address, told.port) == (octets, 102)


def test_what_tcp_does_not_allow_is_refused() -> None:
    talk = Conversation(CLIENT, SERVER)
    talk.closed(0)
    for forbidden in (lambda: talk.sent(0, b"x"), lambda: talk.closed(0)):
        with pytest.raises(ValueError, match="side 0 has closed"):
            forbidden()
    talk.reset(1)
    with pytest.raises(ValueError, match="side 1 has closed"):
        talk.sent(1, b"x")
    with pytest.raises(ValueError, match="over"):
        talk.reset(0)


class Ends(Observer):
    def __init__(self) -> None:
        super().__init__()
        self.connections: list[Connection] = []

    def connection_closed(self, connection: Connection) -> None:
        self.connections.append(connection)


_STEPS = st.lists(st.tuples(st.integers(0, 1), st.binary(max_size=300)), max_size=12)


@given(_STEPS, st.integers(0, 2**32), st.booleans(), st.sampled_from(["fin", "reset", "open"]))
def test_the_streams_come_out_as_they_went_in(steps: list[tuple[int, bytes]], number: int, six: bool, end: str) -> None:
    client, server = (CLIENT6, SERVER6) if six else (CLIENT, SERVER)
    talk = Conversation(client, server, number)
    frames = talk.opened()
    for side, octets in steps:
        frames += talk.sent(side, octets)
    if end == "fin":
        frames += talk.closed(0) + talk.closed(1)
    elif end == "reset":
        frames += talk.reset(0)
    streams, due = [b"", b""], [None, None]
    for frame in frames:
        _, segment = parsed(frame)
        side = int(segment.sport == 102)
        assert due[side] in {None, segment.seq}
        size = len(segment.data) + bool(segment.flags & SYN) + bool(segment.flags & FIN)
        due[side] = (segment.seq + size) % 2**32
        streams[side] += bytes(segment.data)
    assert streams == [b"".join([octets for side, octets in steps if side == which]) for which in (0, 1)]


def test_the_pipeline_knows_client_end_and_who_ended_it() -> None:
    ends = Ends()
    pipeline = Pipeline(ends, Options(strict=True))
    talk = Conversation(CLIENT, SERVER)
    connect = bytes.fromhex("0300001611e00000000100c0010ac1020100c2020102")
    frames = talk.opened() + talk.sent(0, connect) + talk.sent(1, connect[:5] + b"\xd0" + connect[6:]) + talk.reset(1)
    for number, frame in enumerate(frames):
        pipeline.frame(number, frame, 0, len(frame), len(frame), ETHERNET)
    pipeline.finish()
    (connection,) = ends.connections
    assert (str(connection.client), str(connection.server), connection.client_known) == (
        "10.0.0.1:49152",
        "10.0.0.2:102",
        True,
    )
    assert connection.ending is not None
    assert connection.role(connection.ending.side) == "server"
    assert sum(pipeline.counters.packet_counts().values()) == len(frames)
    assert socket.inet_ntoa(SERVER.address) == connection.server.host
