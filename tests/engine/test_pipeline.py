"""The lower half of the path, case by case: packets to octets in order, and what becomes of connections."""

from __future__ import annotations

import struct
from random import Random
from typing import Final

import pytest

from dissect.engine.findings.reporter import MAX_DETAILED
from dissect.engine.pipeline import Options
from dissect.engine.timers import _MANY_WAITING
from dissect.engine.transactions.connection import Connection
from dissect.engine.transactions.table import MAX_CONNECTIONS, MAX_HALF_OPEN, MAX_LINGERING
from dissect.engine.transactions.transaction import Transaction
from dissect.packets.tcp.ip import MAX_DATAGRAMS
from tests.cases import each
from tests.engine.transactions import talk as lines
from tests.properties.books import Record, Result, check_books, facts, told, true
from tests.properties.messages import (
    EMPTY_DT,
    JOB,
    Item,
    connect,
    dt,
    read_answer,
    read_job,
    setup,
    write_answer,
    write_job,
)
from tests.properties.packets import (
    ACK,
    EPOCH_NS,
    ETHERNET,
    FIN,
    LINUX_SLL,
    LINUX_SLL2,
    MS,
    NULL,
    PSH,
    RAW,
    RST,
    SYN,
    Flow,
    Packet,
    Segment,
    Talk,
    capture,
    captured,
    cut_to,
)
from tests.properties.traffic import Conversation, conversation, merged, segments

SECOND: Final = 1_000_000_000
WORD: Final = Item(0x04, 1, 10, 0x84, 4 * 8)


def asked(ref: int, item: Item = WORD) -> bytes:
    """Return a read of one item in its TPKT."""
    return dt(read_job(ref, [item]))


def answered(ref: int, content: bytes = b"\x00\x2a", item: Item = WORD) -> bytes:
    """Return the answer to it."""
    return dt(read_answer(ref, [item], [content]))


def ready(flow: Flow | None = None, isns: tuple[int, int] = (1000, 500_000)) -> Talk:
    """Return a connection that is set up."""
    talk = Talk(flow, isns).handshake()
    talk.send(0, connect(0xE0)).send(1, connect(0xD0))
    talk.send(0, dt(setup(JOB, 0, 8))).send(1, dt(setup(3, 0, 8)))
    return talk


def poll(talk: Talk, *refs: int) -> Talk:
    """Read once for each reference."""
    for ref in refs:
        talk.send(0, asked(ref)).send(1, answered(ref))
    return talk


def run(*talks: Talk) -> Result:
    """Give the segments of connections to a pipeline, one connection after the other, and check its books."""
    result = Result(captured([segment for talk in talks for segment in talk.segments]))
    check_books(result.pipeline, result.record)
    return result


def only(result: Result) -> Connection:
    """Return the one connection there is."""
    (connection,) = result.record.closed
    return connection


# ---- links and IP ---------------------------------------------------------------------------------------------------


def made(flow: Flow) -> Conversation:
    """Return the same conversation for each flow."""
    return conversation(Random(7), flow, 12)


def v6(vlans: tuple[int, ...] = (), link: int = ETHERNET, options: bytes = b"") -> Flow:
    """Return a flow over IPv6."""
    return Flow("2001:db8::1", "2001:db8::2", vlans=vlans, link=link, options=options)


FLOWS: Final = {
    "ethernet": Flow(),
    "vlan": Flow(vlans=(5,)),
    "priority tag": Flow(vlans=(0,)),
    "qinq": Flow(vlans=(5, 7)),
    "ipv4 options": Flow(options=b"\x94\x04\x00\x00"),
    "ipv6": v6(),
    "ipv6 options": v6(options=b"\x06\x00\x01\x04\x00\x00\x00\x00"),
    "ipv6 in a vlan": v6(vlans=(5,)),
    "linux cooked": Flow(link=LINUX_SLL),
    "linux cooked 2": Flow(link=LINUX_SLL2),
    "loopback": Flow(link=NULL),
    "loopback ipv6": v6(link=NULL),
    "raw": Flow(link=RAW),
    "raw ipv6": v6(link=RAW),
}


def content(one: Transaction) -> tuple[object, ...]:
    """Return what a transaction says, without the addresses."""
    return facts(one)[2:]


@pytest.mark.parametrize("name", FLOWS)
def test_every_link_carries_the_same_conversation(name: str) -> None:
    one = made(FLOWS[name])
    result = Result(captured(segments(one, Random(1), cut=0.3, join=0.3)))
    check_books(result.pipeline, result.record)
    assert told(result.transactions) == true([one])
    plain = Result(captured(segments(made(Flow()), Random(1), cut=0.3, join=0.3)))
    assert [content(one) for one in result.transactions] == [content(one) for one in plain.transactions]
    assert only(result).tcp.vlan == (5 * 4096 + 7 if name == "qinq" else 5 if "vlan" in name else 0)


@pytest.mark.parametrize("name", ["ethernet", "vlan", "ipv4 options", "ipv6", "raw ipv6"])
def test_fragments_carry_the_same_conversation(name: str) -> None:
    flow = FLOWS[name]
    one = made(flow)
    rng = Random(2)
    frames: list[bytes] = []
    for ident, segment in enumerate(segments(one)):
        pieces = flow.fragments(segment, 32, ident)
        rng.shuffle(pieces)
        frames += pieces
        if rng.random() < 0.2:
            frames.append(pieces[0])  # comes when its datagram is whole, and waits for the rest of another
    result = Result(capture(frames, flow.link))
    check_books(result.pipeline, result.record)
    assert told(result.transactions) == true([one])
    counts = result.packets
    assert counts["fragment_used"] > 20
    assert counts["fragment_waiting"] > 0


def test_two_vlans_stay_apart() -> None:
    first, second = made(Flow(vlans=(1,))), conversation(Random(8), Flow(vlans=(2,)), 12)
    others = segments(second, isns=(70_000_000, 1_800_000_000))  # no two machines count alike
    result = Result(captured(merged(Random(3), [segments(first), others])))
    check_books(result.pipeline, result.record)
    assert told(result.transactions) == true([first, second])
    assert sorted([connection.tcp.vlan for connection in result.record.closed]) == [1, 2]


def test_octets_behind_the_ip_length_are_no_data() -> None:
    talk = poll(ready(), 1, 2)
    frames = [segment.frame() + asked(0x77) for segment in talk.segments]
    result = Result(capture(frames))
    check_books(result.pipeline, result.record)
    assert result.outcomes == ["answered"] * 3
    assert result.packets == {"payload": 8, "no_payload": 3}


def test_packets_that_are_no_tcp_are_counted() -> None:
    flow = Flow()
    segment = Segment(flow, 0, 1, 1, ACK, b"")
    frames = [
        b"\xff" * 12 + b"\x08\x06" + bytes(46),  # ARP
        flow.wrap(0, 17, bytes(20)),  # UDP
        flow.wrap(0, 6, segment.tcp()[:10]),  # no TCP header fits
        flow.wrap(0, 6, segment.tcp()[:12] + b"\x40" + segment.tcp()[13:]),  # a TCP header of 16 octets
        flow.link_frame(b"\x4f" + flow.ip_packet(0, 6, b"")[1:]),  # an IP header that reaches beyond the packet
        flow.link_frame(b"\x55" + bytes(40))[:12] + b"\x08\x00\x55" + bytes(40),  # IP version 5
        flow.wrap(0, 6, segment.tcp())[:20],  # cut in the IP header
        b"",
    ]
    result = Result(capture(frames))
    check_books(result.pipeline)
    assert result.packets == {"not_ip": 1, "not_tcp": 1, "bad_header": 4, "cut": 2}
    other = Result(capture([bytes(60)], link=147))
    assert other.packets == {"link_type": 1}


def test_conflicting_fragments_are_told_and_the_first_copy_wins() -> None:
    talk = poll(ready(), 1)
    flow = talk.flow
    frames: list[bytes] = []
    for ident, segment in enumerate(talk.segments):
        pieces = flow.fragments(segment, 24, ident)
        if len(pieces) > 2:
            other = bytearray(pieces[1])
            other[-1] ^= 1
            pieces.insert(2, bytes(other))
        frames += pieces
    result = Result(capture(frames))
    check_books(result.pipeline, result.record)
    assert result.outcomes == ["answered"] * 2
    assert result.transactions[1].s7_results[0].value == 42
    assert result.counts["ip.fragment_conflict"] > 0


def test_a_flood_of_unfinished_datagrams_is_bounded() -> None:
    flow = Flow()
    segment = Segment(flow, 0, 1, 1, ACK, bytes(64))
    extra = 50
    result = Result(
        capture([flow.fragments(segment, 24, ident)[0] for ident in range(MAX_DATAGRAMS + extra)], step_ns=0)
    )
    check_books(result.pipeline, result.record)
    assert result.packets == {"fragment_waiting": MAX_DATAGRAMS, "fragment_dropped": extra}
    assert result.counts == {"ip.fragments_evicted": extra}


# ---- frames that the capture cut ------------------------------------------------------------------------------------

CUT_ITEMS: Final = [WORD, Item(0x02, 8, 10, 0x84, 80), Item(0x05, 1, 0, 0x83, 160)]
CUT_CONTENTS: Final = [b"\x01\x02", b"\xa1\xa2\xa3\xa4\xa5\xa6\xa7\xa8", b"\xff\xfe"]
CUT_VALUES: Final = [0x0102, list(CUT_CONTENTS[1]), -2]


@each("kept", range(54, 54 + 7 + 14 + 26 + 1))
def test_a_cut_answer_is_paired_and_never_invented(kept: int) -> None:
    talk = ready()
    talk.send(0, dt(read_job(9, CUT_ITEMS))).send(1, dt(read_answer(9, CUT_ITEMS, CUT_CONTENTS)))
    poll(talk, 10, 11)
    packets = talk.packets()
    whole = len(packets[8].octets)
    packets[8] = cut_to(packets[8], kept)
    result = Result(packets)
    check_books(result.pipeline, result.record)
    cut = kept < whole
    assert result.pipeline.counters.cut_frames == int(cut)
    # An S7 header has twelve octets; with less nothing is known of the answer.
    known = kept - 54 >= 7 + 12
    asks = {one.pdu_ref: one for one in result.transactions if one.request_frame}
    assert sorted(asks) == [0, 9, 10, 11]
    assert [asks[ref].outcome for ref in (0, 10, 11)] == ["answered"] * 3
    assert asks[9].outcome == ("answered" if known else "unanswered")
    for number, found in enumerate(asks[9].s7_results):
        assert found.value is None or found.value == CUT_VALUES[number]
        assert found.data is None or CUT_CONTENTS[number].startswith(found.data)
        if found.data != CUT_CONTENTS[number]:
            assert found.value is None
    assert set(result.counts) <= {"capture.cut_frames"}
    assert result.pipeline.s7.cut_pdus == int(cut and kept - 54 >= 7 + 10)


def test_a_cut_request_is_paired_with_its_answer() -> None:
    talk = ready()
    talk.send(0, dt(write_job(9, CUT_ITEMS, CUT_CONTENTS))).send(1, dt(write_answer(9, [0xFF, 0x05, 0xFF])))
    packets = talk.packets()
    # The head, the item count, one item and a half.
    packets[7] = cut_to(packets[7], 54 + 7 + 10 + 2 + 18)
    result = Result(packets)
    check_books(result.pipeline, result.record)
    (one,) = [one for one in result.transactions if one.pdu_ref == 9]
    assert one.outcome == "answered"
    assert [found.return_code for found in one.s7_results] == [0xFF, 0x05, 0xFF]
    assert [found.value for found in one.s7_results] == [None, None, None]
    assert [found.data or b"" for found in one.s7_results] == [b"", b"", b""]


def test_a_message_with_a_cut_fragment_is_not_joined() -> None:
    job = write_job(9, CUT_ITEMS, CUT_CONTENTS)
    talk = ready()
    talk.send(0, dt(job[:20], eot=False), dt(job[20:40], eot=False), dt(job[40:]))
    poll(talk, 10)
    packets = talk.packets()
    packets[8] = cut_to(packets[8], 54 + 12)
    result = Result(packets)
    check_books(result.pipeline, result.record)
    assert [one.pdu_ref for one in result.transactions] == [0, 10]
    assert "s7.malformed" not in result.counts
    assert result.counts["cotp.unfinished_tsdu"] == 1


def test_every_packet_cut_to_its_headers_is_counted() -> None:
    packets = [cut_to(packet, 54) for packet in poll(ready(), 1, 2, 3).packets()]
    result = Result(packets)
    check_books(result.pipeline, result.record)
    assert result.pipeline.counters.cut_frames == 10
    assert result.counts == {"capture.cut_frames": 10}
    assert result.transactions == []


# ---- floods and bounds ----------------------------------------------------------------------------------------------


def test_a_syn_flood_is_bounded() -> None:
    extra = 30
    flows = [Flow(f"10.1.{number >> 8}.{number & 255}") for number in range(MAX_HALF_OPEN + extra)]
    result = Result(captured([Segment(flow, 0, 5, 0, SYN) for flow in flows], step_ns=0))
    check_books(result.pipeline, result.record)
    assert result.packets == {"no_payload": MAX_HALF_OPEN + extra}
    assert len(result.pipeline.table._half_open) == MAX_HALF_OPEN
    assert len(result.pipeline.table.sides) == 0
    assert result.pipeline.table.half_open_evicted == extra
    assert result.counts == {"stream.half_open_evicted": extra}
    assert len(result.details("stream.half_open_evicted")) == min(extra, MAX_DETAILED)


def test_the_latest_attempt_counts() -> None:
    flow = Flow()
    attempt = Talk(flow, isns=(77, 0))
    attempt.put(0, SYN)
    talk = poll(ready(flow, isns=(9_000_000, 3)), 1)
    result = run(attempt, talk)
    assert result.outcomes == ["answered"] * 2
    assert result.counts == {}


@pytest.mark.parametrize(("verify", "value", "slug"), [(False, 7, "stream.conflict"), (True, 8, "stream.bad_checksum")])
def test_what_its_receiver_dropped_is_left_out_where_that_is_asked_for(verify: bool, value: int, slug: str) -> None:
    """Somebody puts in an answer that the client never takes, because its checksum is wrong."""
    talk = lines.Talk()
    if verify:
        talk.verify()
    talk.sums = True
    talk.open()
    talk.ask(lines.read(1, lines.dbw(1, 0)))
    talk.sums = False
    at = talk.seq[1]
    forged = talk.tell(lines.words(1, 7))
    talk.sums = True
    talk.seq[1] = at
    true_one = talk.tell(lines.words(1, 8))
    talk.close()
    (transaction,) = talk.transactions
    assert [result.value for result in transaction.s7_results] == [value]
    (finding,) = talk.findings
    assert (finding.slug, finding.detail, finding.connection) == (slug, f"27 bytes at TCP sequence number {at}", 1)
    assert finding.frames == [forged if verify else true_one]
    counts = talk.pipeline.counters.packet_counts()
    assert counts["bad_checksum"] == verify
    assert sum(counts.values()) == talk.pipeline.frames


def test_too_many_connections_push_out_the_idle_ones() -> None:
    evicted = 100
    count = MAX_CONNECTIONS + 1 + evicted
    opened = [
        Segment(Flow(f"10.{1 + (number >> 16)}.{number >> 8 & 255}.{number & 255}"), 0, 1, 1, ACK, connect() + asked(1))
        for number in range(count)
    ]
    result = Result(captured(opened, step_ns=1000))
    check_books(result.pipeline, result.record)
    assert result.pipeline.table.evicted == evicted
    assert result.counts["stream.evicted"] == evicted
    reasons = [one.reason for one in result.transactions]
    assert reasons.count("connection_evicted") == evicted
    assert reasons.count("one_sided") == count - evicted
    # The longest idle ones had to go.
    assert [one.reason for one in result.transactions[:evicted]] == ["connection_evicted"] * evicted
    assert {one.request_frame for one in result.transactions[:evicted]} == set(range(1, evicted + 1))


def test_idle_connections_are_forgotten_without_a_warning() -> None:
    """Nothing is open or unread on them; one that goes on may have been counted twice."""
    count = MAX_CONNECTIONS + 101
    flows = [Flow(f"10.{1 + (number >> 16)}.{number >> 8 & 255}.{number & 255}") for number in range(count)]
    opened = [Segment(flow, 0, 1, 1, ACK, connect()) for flow in flows]
    result = Result(captured(opened, step_ns=1000))
    connections = result.pipeline.connections
    assert (result.pipeline.table.evicted, connections.forgotten, connections.twice) == (100, 100, 0)
    assert "stream.evicted" not in result.counts
    size = len(connect())
    again = [*opened, Segment(flows[0], 0, 1 + size, 1, ACK, asked(1))]
    result = Result(captured(again, step_ns=1000))
    connections = result.pipeline.connections
    assert (connections.forgotten, connections.twice) == (101, 1)
    assert connections.count == count + 1


def test_what_waits_is_bounded_when_the_clock_stands_still() -> None:
    closed = MAX_LINGERING + 300
    talks = []
    for number in range(closed):
        talk = Talk(Flow(f"10.3.{number >> 8}.{number & 255}")).handshake()
        talk.send(0, connect()).skip(0, 10).send(0, asked(1))  # something is held to the end
        talks.append(talk.reset(1))
    result = Result(captured([segment for talk in talks for segment in talk.segments], step_ns=0), finish=False)
    assert len(result.pipeline.table._lingering) == MAX_LINGERING
    assert len(result.pipeline.table.sides) == 2 * MAX_LINGERING
    assert len(result.record.closed) == closed - MAX_LINGERING
    assert len(result.pipeline.timers._waiting) <= _MANY_WAITING
    result.pipeline.finish()
    check_books(result.pipeline, result.record)


def test_a_flood_of_resets_does_not_push_out_others() -> None:
    first = poll(ready(Flow("10.0.0.9")), 1).close()
    second = poll(ready(), 1)
    resets = [Segment(second.flow, 0, second.next[0], second.next[1], RST | ACK)] * (MAX_LINGERING + 10)
    result = Result(captured([*first.segments, *second.segments, *resets], step_ns=0), finish=False)
    assert len(result.pipeline.table._lingering) == 2
    assert len(result.record.closed) == 0
    result.pipeline.finish()
    check_books(result.pipeline, result.record)


# ---- which protocol -------------------------------------------------------------------------------------------------

HTTP: Final = (b"GET / HTTP/1.1\r\nHost: plc\r\n\r\n", b"HTTP/1.1 200 OK\r\nContent-Length: 2\r\n\r\nok")
TLS: Final = (bytes.fromhex("160301002f0100002b0303") + bytes(41), bytes.fromhex("1703030010") + bytes(16))


@pytest.mark.parametrize("messages", [HTTP, TLS], ids=["http", "tls"])
@pytest.mark.parametrize("port", [80, 443, 4840, 50000])
def test_other_protocols_on_other_ports_are_counted(messages: tuple[bytes, bytes], port: int) -> None:
    talk = Talk(Flow(ports=(40000, port))).handshake()
    for _ in range(6):
        talk.send(0, messages[0]).send(1, messages[1])
    result = run(talk.close())
    assert result.packets == {"other_protocol": 12, "no_payload": 6}
    assert result.counts == {}
    assert result.record.opened == []
    # It was never ours, so it is no loss of ours.
    assert result.pipeline.counters.octets.skipped == 0


def test_another_protocol_met_in_its_midst_is_counted() -> None:
    talk = Talk(Flow(ports=(40000, 80)))
    for _ in range(20):
        talk.send(1, HTTP[1])
    result = run(talk)
    assert result.packets == {"other_protocol": 20}
    assert result.pipeline.counters.octets.skipped == 0


@pytest.mark.parametrize(("messages", "name"), [(HTTP, "unknown"), (TLS, "tls")], ids=["http", "tls"])
@pytest.mark.parametrize("rounds", [1, 100])
def test_another_protocol_on_port_102_is_told_once(messages: tuple[bytes, bytes], name: str, rounds: int) -> None:
    talk = Talk().handshake()
    for _ in range(rounds):
        talk.send(0, messages[0]).send(1, messages[1])
    result = run(talk.close())
    assert result.packets["other_protocol"] == 2 * rounds
    identity = {"unknown": "begins with 47 45 54 20 2f 20 48 54", "tls": "TLS 1.2 ClientHello"}[name]
    assert result.details("session.foreign_on_102") == [f"{name}: {identity}"]
    assert result.record.opened == []


def test_rdp_is_named_and_left_alone() -> None:
    cookie = b"Cookie: mstshash=op\r\n\x01\x00\x08\x00\x03\x00\x00\x00"
    request = bytes((6 + len(cookie),)) + b"\xe0\x00\x00\x00\x01\x00" + cookie
    talk = Talk().handshake().send(0, b"\x03\x00" + (4 + len(request)).to_bytes(2, "big") + request)
    for _ in range(3):
        talk.send(1, TLS[0]).send(0, TLS[1])
    result = run(talk.close())
    identity = "cookie mstshash=op, asks for TLS or CredSSP"
    assert result.details("session.foreign_on_102") == [f"rdp: {identity}"]
    assert result.packets["other_protocol"] == 7
    connection = only(result)
    assert (connection.protocol, connection.identified_by) == ("rdp", identity)
    assert connection.tcp.ended == "fin"
    assert result.transactions == []


@pytest.mark.parametrize("port", [1102, 2000, 48898])
def test_s7_on_any_port_is_recognised(port: int) -> None:
    result = run(poll(ready(Flow(ports=(40000, port))), 1, 2))
    assert result.outcomes == ["answered"] * 3
    assert result.counts == {"session.unusual_port": 1}
    assert str(only(result).server) == f"10.0.0.2:{port}"


@pytest.mark.parametrize("port", [102, 2000])
def test_s7_met_in_its_midst_is_recognised(port: int) -> None:
    talk = Talk(Flow(ports=(40000, port)))
    talk.send(1, answered(1)[9:])  # the tail of a TPKT
    poll(talk, 2, 3)
    talk.send(1, answered(4))
    result = run(talk)
    assert sorted(result.outcomes) == ["answered", "answered", "orphan_answer"]
    assert only(result).mid_stream
    assert "transaction.orphan" in result.counts  # its request was not before the capture: others were captured since
    assert result.pipeline.counters.octets.skipped == len(answered(1)) - 9


def test_a_tpkt_inside_the_first_segment_on_port_102_is_found() -> None:
    talk = Talk()
    talk.send(1, answered(1)[9:] + answered(2))
    result = run(talk)
    assert [one.pdu_ref for one in result.transactions] == [2]
    assert result.counts == {}


def test_garbage_before_the_first_tpkt_is_told() -> None:
    talk = Talk().handshake().send(0, b"\x00\xff garbage" + connect(0xE0)).send(1, connect(0xD0))
    result = run(poll(talk, 1))
    assert result.outcomes == ["answered"]
    assert result.counts["tpkt.garbage"] == 1
    assert result.pipeline.counters.octets.skipped == 10


# ---- connections begin and end --------------------------------------------------------------------------------------


def test_the_same_addresses_again_after_a_syn() -> None:
    flow = Flow()
    first = poll(ready(flow), 1)
    first.send(0, asked(2))
    second = poll(ready(flow, isns=(70_000_000, 9)), 1)
    result = run(first, second)
    assert sorted(result.outcomes) == ["answered"] * 4 + ["unanswered"]
    (lost,) = [one for one in result.transactions if one.outcome == "unanswered"]
    assert lost.reason == "connection_closed"
    assert result.counts == {"stream.reused": 1, "transaction.unanswered": 1}
    one, other = result.record.closed
    assert (one.tcp.ended, one.open_at_end) == ("reused", 1)
    assert (other.tcp.ended, other.open_at_end) == ("", 0)
    assert other.number == 2


def test_a_syn_sent_again_begins_nothing() -> None:
    talk = Talk()
    syn = talk.put(0, SYN)
    talk.put(1, SYN | ACK)
    talk.segments.append(syn)
    talk.put(0, ACK)
    talk.send(0, connect(0xE0)).send(1, connect(0xD0))
    talk.segments.append(syn)
    result = run(poll(talk, 1))
    assert result.outcomes == ["answered"]
    assert len(result.record.closed) == 1


def test_a_syn_captured_behind_its_answer_and_behind_data() -> None:
    talk = poll(ready(), 1)
    syn, both, ack, request, confirm, *rest = talk.segments
    for order in (
        [both, syn, ack, request, confirm],
        [request, syn, both, ack, confirm],
        [both, ack, request, syn, confirm],
    ):
        result = Result(captured([*order, *rest]))
        check_books(result.pipeline, result.record)
        assert result.outcomes == ["answered"] * 2, order
        assert len(result.record.closed) == 1


@pytest.mark.parametrize("distance", [0, 2**20 + 5000, 2**31 - 5, 2**31 + 5, 2**32 - 2**21])
def test_a_connect_request_after_data_begins_another_connection(distance: int) -> None:
    first = poll(ready(), 1, 2)
    first.send(0, asked(3))
    second = Talk(first.flow, isns=(first.next[0] + distance, first.next[1] + distance))
    second.send(0, connect(0xE0)).send(1, connect(0xD0))
    second.send(0, dt(setup(JOB, 1))).send(1, dt(setup(3, 1)))
    result = run(first, poll(second, 1, 2, 3))
    assert len(result.record.closed) == 2
    assert sorted(result.outcomes) == ["answered"] * 7 + ["unanswered"]
    (lost,) = [one for one in result.transactions if one.outcome == "unanswered"]
    assert (lost.connection.number, lost.pdu_ref, lost.reason) == (1, 3, "connection_closed")
    assert {one.connection.number for one in result.transactions} == {1, 2}


@pytest.mark.parametrize("distance", [0, 2**20 + 5000, 2**31 + 5])
@pytest.mark.parametrize("wanted", [1, 2, 3])
def test_connections_keep_their_numbers_where_only_one_of_them_is_read(distance: int, wanted: int) -> None:
    """A repeated and a damaged connect request begin no other one, whether the connection is read or not."""
    first = poll(ready(), 1, 2)
    damaged = bytearray(connect(0xE0))
    damaged[4] += 9  # the length indicator says more than there is
    first.send(0, bytes(damaged))
    second = Talk(first.flow, isns=(first.next[0] + distance, first.next[1] + distance))
    second.send(0, connect(0xE0)).send(0, connect(0xE0)).send(1, connect(0xD0))
    second.send(0, dt(setup(JOB, 1))).send(1, dt(setup(3, 1)))
    third = poll(ready(Flow(ports=(50_000, 102))), 5)
    packets = captured([segment for talk in (first, poll(second, 1, 2, 3), third) for segment in talk.segments])
    every = Result(packets)
    assert [one.number for one in every.record.closed] == [1, 2, 3]
    told_of = {one.number: (one.tcp.first_frame, one.pdus, one.answered) for one in every.record.closed}
    part = Result(packets, Options(strict=True, only=lambda one: one.number == wanted))
    assert part.pipeline.connections.count == 3
    assert {
        one.number: (one.tcp.first_frame, one.pdus, one.answered) for one in part.record.closed if one.number == wanted
    } == {wanted: told_of[wanted]}


@pytest.mark.parametrize("side", [0, 1])
@pytest.mark.parametrize("how", ["fin", "reset"])
def test_who_ended_it_and_what_was_open_then(side: int, how: str) -> None:
    talk = poll(ready(), 1)
    talk.send(0, asked(2), asked(3))
    if how == "fin":
        talk.close(side)
    else:
        talk.reset(side)
    result = run(talk)
    connection = only(result)
    assert (connection.tcp.ended, connection.tcp.ended_by) == (how, side)
    assert connection.tcp.ended_frame == (len(talk.segments) - 2 if how == "fin" else len(talk.segments))
    assert connection.open_at_end == 2
    assert [one.reason for one in result.transactions if one.outcome == "unanswered"] == ["connection_closed"] * 2
    assert result.counts == {"transaction.unanswered": 2, "session.cut": 1}


def test_a_connection_of_which_the_capture_ends_is_still_open() -> None:
    talk = poll(ready(), 1)
    talk.send(0, asked(2))
    result = run(talk)
    connection = only(result)
    assert (connection.tcp.ended, connection.tcp.ended_by, connection.open_at_end) == ("", -1, 0)
    assert result.transactions[-1].reason == "capture_ended"
    assert result.counts == {}  # it ends too soon to say that the answer is late


def test_an_answer_after_the_fin_counts() -> None:
    talk = poll(ready(), 1)
    talk.send(0, asked(2))
    talk.put(0, FIN | ACK)
    talk.send(1, answered(2))
    talk.put(1, FIN | ACK)
    result = run(talk)
    assert result.outcomes == ["answered"] * 3
    assert only(result).tcp.ended_by == 0


def test_a_reset_that_does_not_fit_is_not_believed() -> None:
    talk = poll(ready(), 1)
    talk.segments.append(Segment(talk.flow, 1, talk.next[1] + 5_000_000, talk.next[0], RST))
    result = run(poll(talk, 2, 3))
    assert result.outcomes == ["answered"] * 4
    assert only(result).tcp.ended == ""
    assert result.counts == {"stream.reset_ignored": 1}
    assert result.packets["reset_ignored"] == 1


def test_a_fin_that_does_not_fit_is_not_believed() -> None:
    talk = poll(ready(), 1)
    talk.segments.append(Segment(talk.flow, 1, talk.next[1] + 5_000_000, talk.next[0], FIN | ACK))
    result = run(poll(talk, 2, 3))
    assert result.outcomes == ["answered"] * 4
    assert only(result).tcp.ended == ""
    assert result.counts == {"stream.reset_ignored": 1}
    assert result.details("stream.reset_ignored") == ["FIN from 10.0.0.2:102"]


def test_data_behind_a_reset_counts_when_it_is_only_out_of_order() -> None:
    talk = poll(ready(), 1)
    talk.send(0, asked(2))
    talk.send(1, answered(2)[:9], answered(2)[9:20], answered(2)[20:]).reset(0)
    *before, request, first, second, third, reset = talk.segments
    result = Result(captured([*before, request, reset, second, third, first]))
    check_books(result.pipeline, result.record)
    assert result.outcomes == ["answered"] * 3
    assert only(result).tcp.ended == "reset"
    # What is far from there belongs to nothing any more.
    late = [Segment(talk.flow, 1, talk.next[1] + 10_000_000, 0, ACK, b"\x00" * 9), *before[-1:]]
    other = Result(captured([*talk.segments, *late]))
    check_books(other.pipeline, other.record)
    assert other.packets["after_close"] == 2


def test_a_closed_connection_is_told_a_second_later() -> None:
    talk = poll(ready(), 1).close()
    packets = talk.packets()
    end = packets[-1].time_ns
    noise = Flow().wrap(0, 17, bytes(20))
    result = Result([*packets, Packet(end + SECOND - MS, noise, len(noise))], finish=False)
    assert result.record.closed == []
    result.feed(Packet(end + SECOND + 100 * MS, noise, len(noise)))
    assert len(result.record.closed) == 1


# ---- order and time -------------------------------------------------------------------------------------------------


def test_an_answer_captured_before_its_request() -> None:
    talk = poll(ready(), 1, 2)
    *before, request, answer = talk.segments
    result = Result(captured([*before, answer, request]))
    check_books(result.pipeline, result.record)
    assert result.outcomes == ["answered"] * 3
    assert result.transactions[-1].latency_ns == -MS
    assert result.counts == {"transaction.reordered": 1}


def test_a_hole_is_given_up_after_a_second_of_capture_time() -> None:
    talk = ready(Flow())
    talk.skip(0, len(EMPTY_DT))
    talk.send(0, asked(1))
    packets = talk.packets()
    noise = Flow().wrap(0, 17, bytes(20))
    end = packets[-1].time_ns
    result = Result([*packets, Packet(end + SECOND, noise, len(noise))], finish=False)
    assert result.pipeline.s7.pdus == 2
    result.feed(Packet(end + SECOND + 51 * MS, noise, len(noise)))
    assert result.pipeline.s7.pdus == 3
    assert result.details("stream.hole") == ["7 bytes from 10.0.0.1:49152, between TPKTs"]


def test_a_clock_that_runs_backwards_is_told_and_stops_nothing() -> None:
    talk = poll(ready(), 1, 2)
    packets = talk.packets()
    hour = 3600 * SECOND
    back = [
        packet._replace(time_ns=packet.time_ns - hour) for packet in poll(talk, 3).close().packets()[len(packets) :]
    ]
    result = Result([*packets, *back], finish=False)
    assert result.outcomes == ["answered"] * 4
    assert result.counts == {"capture.time_backwards": 1}
    assert result.details("capture.time_backwards") == ["by 59 min 59 s"]
    # What waits for time to pass does not wait for the hour.
    noise = Flow().wrap(0, 17, bytes(20))
    result.feed(Packet(back[-1].time_ns + SECOND + 51 * MS, noise, len(noise)))
    assert len(result.record.closed) == 1
    # A millisecond of disorder is no such thing.
    swapped = [packets[0], packets[2]._replace(time_ns=packets[1].time_ns), packets[1]]
    assert Result(swapped).counts == {}


def test_a_clock_that_steps_back_by_little_again_and_again_runs_backwards() -> None:
    talk = poll(ready(), 1, 2, 3)
    start = talk.packets()[0].time_ns
    packets = [one._replace(time_ns=start - number * MS) for number, one in enumerate(talk.packets())]
    result = Result(packets)
    steps = (len(packets) - 1) // 2
    assert result.counts["capture.time_backwards"] == steps  # each second packet is 2 ms behind the step told before
    assert set(result.details("capture.time_backwards")) == {"by 2.00 ms"}
    assert {one.latency_ns for one in result.transactions} == {-MS}
    # Forwards again, it is the latest time that counts; two queues are no such thing.
    for steps_us, told_times in (([0, -600, -1200], 1), ([0, -600, 500, -400], 0), ([0, -5000, -5600], 1)):
        noise = Flow().wrap(0, 17, bytes(20))
        result = Result([Packet(start + step * 1000, noise, len(noise)) for step in steps_us])
        assert result.counts.get("capture.time_backwards", 0) == told_times


def test_an_answer_time_below_zero_is_always_explained() -> None:
    """Within what two queues do, at the transaction."""
    talk = poll(ready(), 1, 2)
    packets = talk.packets()
    packets[-1] = packets[-1]._replace(time_ns=packets[-2].time_ns - MS // 2)
    result = Result(packets)
    assert result.transactions[-1].latency_ns == -MS // 2
    assert result.counts == {"transaction.reordered": 1}
    (detail,) = result.details("transaction.reordered")
    assert detail.endswith("by the times of the packets the answer precedes the request by 500 µs")


def test_another_protocol_on_port_102_is_told_of_its_first_bytes() -> None:
    talk = Talk().handshake()
    talk.send(0, b"GET / HTTP/1.0\r\n\r\n").send(1, b"HTTP/1.0 200 OK\r\n").close()
    assert [one.frames for one in run(talk).record.findings] == [[4]]
    talk = Talk().handshake()
    for _ in range(20):
        talk.send(0, b"GET / HTTP/1.0\r\n\r\n").send(1, b"HTTP/1.0 200 OK\r\n")
    result = run(talk)
    assert result.counts == {"session.foreign_on_102": 1}
    (finding,) = result.record.findings
    assert (finding.frames, finding.time_ns) == ([4], EPOCH_NS + 3 * MS)


def test_a_connection_of_which_one_side_was_captured() -> None:
    talk = poll(ready(), 1, 2, 3)
    for side in (0, 1):
        result = Result(captured([segment for segment in talk.segments if segment.side == side]))
        check_books(result.pipeline, result.record)
        assert result.counts == {"capture.one_sided": 1}
        assert result.outcomes == [["unanswered", "orphan_answer"][side]] * 4


# ---- bugs of ours ---------------------------------------------------------------------------------------------------


class Faulty(Record):
    """Fails on some calls of one kind."""

    def __init__(self, kind: str, share: int) -> None:
        super().__init__()
        self.wants_pdus = self.wants_tpdus = True
        self.kind = kind
        self.share = share
        self.calls = 0
        self.failed = 0

    def _call(self, kind: str) -> None:
        if kind == self.kind:
            self.calls += 1
            if self.calls % self.share == 0:
                self.failed += 1
                raise RuntimeError(kind)

    def tpdu(self, *arguments: object) -> None:
        self._call("tpdu")

    def pdu(self, *arguments: object) -> None:
        self._call("pdu")

    def transaction(self, transaction: Transaction) -> None:
        super().transaction(transaction)
        self._call("transaction")

    def connection_opened(self, connection: Connection) -> None:
        super().connection_opened(connection)
        self._call("connection_opened")

    def connection_closed(self, connection: Connection) -> None:
        super().connection_closed(connection)
        self._call("connection_closed")

    def finding(self, finding: object) -> None:
        self._call("finding")


KINDS: Final = ("tpdu", "pdu", "transaction", "connection_opened", "connection_closed", "finding")


def troubled() -> list[Packet]:
    """Return packets that cause every kind of call, in order and late, and connections that close before the end."""
    rng = Random(5)
    streams = []
    for number in range(12):
        one = conversation(rng, Flow(f"10.0.1.{number}"), 6)
        one.ending = "fin"
        stream = segments(one, rng, cut=0.4, join=0.4)
        if number % 3 == 0:
            del stream[9]
        streams.append(stream)
    packets = captured(merged(rng, streams))
    noise = Flow().wrap(0, 17, bytes(20))
    return [*packets, *[Packet(packets[-1].time_ns + step * SECOND, noise, len(noise)) for step in range(1, 4)]]


@pytest.mark.parametrize("share", [1, 3])
@pytest.mark.parametrize("kind", KINDS)
def test_a_bug_of_ours_costs_what_was_at_hand_and_no_more(kind: str, share: int) -> None:
    packets = troubled()
    result = Result([], Options())
    result.record = Faulty(kind, share)
    pipeline = type(result.pipeline)(result.record, Options())
    result.pipeline = pipeline
    for packet in packets:
        result.feed(packet)
    pipeline.finish()
    assert result.record.failed > 0
    assert pipeline.frames == len(packets)
    check_books(pipeline)
    assert pipeline.finding_counts["internal.bug"] == result.record.failed
    healthy = Result(packets)
    if kind in {"tpdu", "pdu"} and share == 3:
        assert 0 < len(result.record.transactions) < len(healthy.transactions)
    if kind not in {"tpdu", "pdu", "connection_opened"}:
        assert pipeline.s7.pdus == healthy.pipeline.s7.pdus
        assert len(result.record.closed) == len(healthy.record.closed)


@pytest.mark.parametrize("kind", KINDS)
def test_a_bug_of_ours_raises_in_strict_mode(kind: str) -> None:
    record = Faulty(kind, 1)
    pipeline = type(Result([]).pipeline)(record, Options(strict=True))

    def feed() -> None:
        for packet in troubled():
            size = len(packet.octets)
            pipeline.frame(packet.time_ns, packet.octets, 0, size, packet.wire_length, packet.link_type)
        pipeline.finish()

    with pytest.raises(RuntimeError, match=kind):
        feed()


# ---- another capture ------------------------------------------------------------------------------------------------


def test_another_capture_knows_nothing_of_the_one_before() -> None:
    flow = Flow()
    attempt = Segment(flow, 0, 5, 0, SYN)
    piece = flow.fragments(Segment(flow, 0, 1, 1, PSH | ACK, bytes(64)), 24, 1)[0]
    talk = poll(ready(flow), 1)
    result = Result([*captured([attempt]), *capture([piece])], finish=False)
    result.pipeline.finish()
    result.pipeline.restart_clock(EPOCH_NS - SECOND)
    assert result.packets == {"no_payload": 1, "fragment_dropped": 1}
    # Without the SYN of this capture: the attempt of the other one says nothing about where its octets begin.
    for packet in captured(talk.segments[3:], start_ns=EPOCH_NS - SECOND):
        result.feed(packet)
    result.pipeline.finish()
    check_books(result.pipeline, result.record)
    assert result.outcomes == ["answered"] * 2
    assert result.counts == {}


def test_the_fast_and_the_slow_way_read_the_same() -> None:
    # Ethernet, IPv4 without options goes the fast way, the same with a priority tag the slow one.
    rng = Random(11)
    for seed in range(20):
        stream = segments(conversation(Random(seed), Flow(), 5), rng, cut=0.3)
        tagged = segments(conversation(Random(seed), Flow(vlans=(0,)), 5), Random(0), cut=0.0)
        fast, slow = Result(captured(stream)), Result(captured(tagged))
        assert [facts(one) for one in fast.transactions] == [facts(one) for one in slow.transactions]


def test_lying_ip_and_tcp_lengths_are_seen_on_the_fast_way() -> None:
    talk = poll(ready(), 1)
    frame = talk.segments[-1].frame()
    lies = {
        "total beyond the frame": (16, struct.pack(">H", 1500)),
        "total shorter than the headers": (16, struct.pack(">H", 30)),
        "data offset beyond the segment": (46, b"\xf0"),
        "data offset below the header": (46, b"\x10"),
    }
    for name, (place, octets) in lies.items():
        lied = frame[:place] + octets + frame[place + len(octets) :]
        result = Result(captured(talk.segments[:-1]) + capture([lied]))
        check_books(result.pipeline, result.record)
        assert len(result.record.closed) == 1, name
        used = sum([count for category, count in result.packets.items() if category in {"payload", "no_payload"}])
        assert (used == len(talk.segments)) is (name == "total beyond the frame"), name


def test_a_connection_of_an_address_with_itself_is_accounted_for() -> None:
    talk = Talk(Flow("10.0.0.1", "10.0.0.1", (102, 102))).handshake()
    talk.send(0, connect(0xE0)).send(1, connect(0xD0)).send(0, dt(setup(JOB, 1)))
    result = Result(talk.packets())
    check_books(result.pipeline, result.record)
    assert [one.number for one in result.record.closed] == [1]
    assert result.outcomes == ["unanswered"]


def far(talk: lines.Talk, ahead: int, size: int = 0) -> None:
    """A write of the client far ahead of where it is; the server acknowledges what it has."""
    talk.open()
    octets = lines.dt(lines.write(9, [lines.dbw(1, 0)], lines.written(4, b"\x00\x01")))
    for number in range(1 + size):
        talk.packet(lines.CLIENT, octets, seq=talk.seq[lines.CLIENT] + ahead + number * len(octets))


@pytest.mark.parametrize("ahead", [100_000, 1 << 20, 1 << 30])
@pytest.mark.parametrize("more", [0, 1, 40])
def test_what_is_far_outside_the_window_is_believed_only_when_acknowledged(ahead: int, more: int) -> None:
    talk = lines.Talk()
    far(talk, ahead, more)
    talk.acked[lines.SERVER] = talk.seq[lines.CLIENT]
    for number in range(20):  # the connection goes on where it was
        talk.packet(lines.SERVER)
        talk.ask(lines.read(10 + number, lines.dbw(1, 0)))
        talk.acked[lines.SERVER] = talk.seq[lines.CLIENT]
        talk.tell(lines.words(10 + number, 1))
    talk.close()
    assert {transaction.function for transaction in talk.transactions} == {4}
    assert talk.outcomes() == ["answered"] * 20
    assert talk.pipeline.counters.octets.missing == 0
    assert "stream.outside_window" in talk.slugs()


def test_what_is_far_ahead_and_acknowledged_counts() -> None:
    talk = lines.Talk()
    far(talk, 1 << 30)
    talk.acked[lines.SERVER] = talk.seq[lines.CLIENT] + (1 << 30) + 36
    talk.packet(lines.SERVER)
    talk.close()
    assert 5 in {transaction.function for transaction in talk.transactions}
    assert "stream.outside_window" not in talk.slugs()


@pytest.mark.parametrize(("empty", "reason", "slugs"), [(False, "capture_ended", []), (True, "hole", ["stream.hole"])])
def test_an_empty_packet_shows_that_octets_before_it_were_sent(empty: bool, reason: str, slugs: list[str]) -> None:
    """The answer was not captured, and the client acknowledges nothing of it: only the next packet of the server tells."""
    talk = lines.Talk()
    talk.open()
    talk.ask(lines.read(1, lines.dbw(1, 0)))
    talk.acked = [talk.seq[lines.SERVER], None]
    talk.lose(lines.SERVER, lines.words(1, 1))
    if empty:
        talk.packet(lines.SERVER)
    talk.packet(lines.CLIENT)
    talk.finish()
    (transaction,) = talk.transactions
    assert (transaction.outcome, transaction.reason, transaction.unseen) == ("unanswered", reason, empty)
    assert talk.slugs() == slugs
