"""The edges of the path from packets to octets: header fields of any value, links, memory, time, what a source reports."""

from __future__ import annotations

import struct
from typing import Final

import pytest

from dissect.engine.pipeline import LOOK_OCTETS, Options, Pipeline
from dissect.engine.timers import FAR_FUTURE
from dissect.engine.transactions.connection import ISO
from dissect.packets.tcp.stream import FAR_AHEAD
from tests.cases import each
from tests.engine.test_payload import Heard, hearing
from tests.engine.test_pipeline import poll, ready
from tests.engine.transactions.talk import (
    ACK,
    CLIENT,
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
from tests.properties.books import Result, facts
from tests.properties.packets import LINUX_SLL, RAW, Flow, Packet, Segment
from tests.properties.packets import Talk as Sent

V4: Final = Flow()
V6: Final = Flow("2001:db8::1", "2001:db8::2")


def frame(segment: Segment, flags: int, window: int, options: bytes = b"", extra: bytes = b"") -> bytes:
    """The frame of a segment with other flags, window and TCP options, and octets behind its IP packet."""
    tcp = segment.tcp()
    offset = (20 + len(options)) << 2
    made = tcp[:12] + bytes((offset, flags)) + struct.pack(">H", window) + tcp[16:20] + options + tcp[20:]
    return segment.flow.wrap(segment.side, 6, made) + extra


def run(sent: Sent, frames: list[bytes], checksums: bool = False) -> Result:
    packets = [Packet(START_NS + at * MS, octets, len(octets), sent.flow.link) for at, octets in enumerate(frames)]
    return Result(packets, Options(strict=True, checksums=checksums))


# ---- header fields --------------------------------------------------------------------------------------------------

#: Flags that say nothing of beginning and end: PSH, URG, ECE, CWR.
QUIET: Final = (0x10, 0x18, 0x30, 0x38, 0x50, 0x58, 0x90, 0x98, 0xD0, 0xF8)


@pytest.mark.parametrize("flow", [V4, V6], ids=["IPv4", "IPv6"])
def test_flags_window_and_options_of_tcp_may_be_any(flow: Flow) -> None:
    sent = poll(ready(flow), 1, 2, 3)
    right = [facts(one) for one in run(sent, [segment.frame() for segment in sent.segments]).transactions]
    assert len(right) == 4
    windows = (0, 1, 2, 4, 7, 0x5000, 0x8018, 0xFFFF)
    for number, flags in enumerate(QUIET * 4):
        window, options = windows[number % 8], (b"", b"\1\1\1\1", b"\1" * 40)[number % 3]
        frames = [
            frame(one, one.flags | (flags if not one.flags & SYN else 0), window, options) for one in sent.segments
        ]
        result = run(sent, frames)
        assert [facts(one) for one in result.transactions] == right, (flags, window, options)
        assert result.packets == {"payload": 10, "no_payload": 3}


@pytest.mark.parametrize("flow", [V4, V6], ids=["IPv4", "IPv6"])
@each("header", [0x00, 0x10, 0x40])
def test_a_tcp_header_shorter_than_its_least_is_bad(flow: Flow, header: int) -> None:
    sent = poll(ready(flow), 1)
    octets = sent.segments[-1].frame()
    at = len(octets) - len(sent.segments[-1].payload) - 8
    result = run(
        sent, [*[one.frame() for one in sent.segments[:-1]], octets[:at] + bytes((header,)) + octets[at + 1 :]]
    )
    assert result.packets["bad_header"] == 1
    assert len(result.transactions) == 2


@pytest.mark.parametrize("flow", [V4, V6], ids=["IPv4", "IPv6"])
@each("more", [0, 1, 100])
def test_a_frame_may_be_longer_than_its_packet_and_not_shorter(flow: Flow, more: int) -> None:
    """What is behind the packet is padding; of what is missing the length says how much."""
    sent = poll(ready(flow), 1)
    result = run(sent, [one.frame() + bytes(more) for one in sent.segments])
    assert result.packets == {"payload": 6, "no_payload": 3}
    assert result.outcomes == ["answered"] * 2
    cut = [one.frame() for one in sent.segments]
    result = run(sent, [*cut[:-1], cut[-1][: len(cut[-1]) - 1 - more // 10]])
    assert result.pipeline.counters.octets.missing == 1 + more // 10


@pytest.mark.parametrize("flow", [V4, V6], ids=["IPv4", "IPv6"])
def test_wrong_checksums_are_seen_on_every_road_where_that_is_asked_for(flow: Flow) -> None:
    """Those of made packets are zero."""
    sent = poll(ready(flow), 1)
    frames = [one.frame() for one in sent.segments]
    assert run(sent, frames, checksums=True).packets == {"bad_checksum": len(frames)}
    assert "bad_checksum" not in run(sent, frames).packets


def test_a_connection_knows_the_cards_of_both_sides_on_every_road() -> None:
    """Of Ethernet, with or without a VLAN or options of IP; not of links without addresses."""
    client, server = bytes.fromhex("020000000001"), bytes.fromhex("020000000002")
    for flow in (
        V4, V6, Flow(vlans=(5,)), Flow(options=b"\x94\x04\x00\x00"),
        Flow("2001:db8::1", "2001:db8::2", vlans=(5,)),
        Flow("2001:db8::1", "2001:db8::2", options=b"\x06\x00\x01\x04" + bytes(4)),
        Flow(link=RAW), Flow(link=LINUX_SLL), Flow("2001:db8::1", "2001:db8::2", link=RAW),
    ):  # fmt: skip
        ethernet = flow.link not in {RAW, LINUX_SLL}
        for begin in (0, 1, 3, 4):  # the whole, the SYN/ACK, the connect request or its answer is captured first
            sent = poll(ready(flow), 1)
            frames = [one.frame() for one in sent.segments]
            if ethernet:
                cards = (server + client, client + server)
                frames = [cards[one.side] + octets[12:] for one, octets in zip(sent.segments, frames, strict=True)]
            (connection,) = run(sent, frames[begin:]).record.closed
            first = client + server if connection.tcp.ends[0].port != 102 else server + client
            assert connection.tcp.macs == (first if ethernet else b""), (flow.name, begin)


@pytest.mark.parametrize("side", [CLIENT, SERVER])
def test_a_connection_in_place_of_another_keeps_the_cards_of_its_sides(side: int) -> None:
    """The first captured packet of the new one may be of either side."""
    cards = [bytes.fromhex("020000000001"), bytes.fromhex("020000000002")]
    talk = Talk()
    talk.macs = cards
    talk.open()
    talk.seq = [talk.seq[CLIENT] + 50_000_000, talk.seq[SERVER] + 50_000_000]
    talk.packet(side, CONNECT)
    talk.finish()
    first, second = talk.connections
    assert (first.tcp.macs, second.tcp.macs) == (cards[0] + cards[1], cards[side] + cards[1 - side])
    assert (second.tcp.ends[0].port == 102) is (side == SERVER)


# ---- a connection that another one replaces -------------------------------------------------------------------------


@each(
    ("distance", "replaced"),
    [
        (FAR_AHEAD, False),
        (FAR_AHEAD + 1, True),
        (1 << 31, True),
        (-FAR_AHEAD - 1, False),
        (-FAR_AHEAD - 2, True),
        (-1, False),
    ],
)
def test_a_connect_request_far_away_begins_another_connection(distance: int, replaced: bool) -> None:
    talk = Talk()
    talk.open()
    talk.packet(CLIENT, CONNECT, seq=talk.seq[CLIENT] + distance)
    assert talk.pipeline.connections.count == (1 if not replaced else 2)
    assert len(talk.pipeline.table.all_open()) == 1
    assert [one.tcp.ended for one in talk.connections] == (["reused"] if replaced else [])


def test_nothing_else_far_away_does() -> None:
    talk = Talk()
    talk.open()
    talk.ask(read(1, dbw(1, 0)))
    for octets in (dt(read(2, dbw(1, 0))), CONNECT[:6], b"garbage"):
        talk.packet(CLIENT, octets, seq=talk.seq[CLIENT] + 50_000_000)
    assert talk.connections == []


def test_a_connection_without_data_is_not_replaced_by_a_connect_request() -> None:
    """It may be its own, with octets missing before it."""
    talk = Talk()
    talk.hello()
    talk.packet(CLIENT, CONNECT)
    talk.packet(CLIENT, CONNECT, seq=talk.seq[CLIENT] + 50_000_000)
    assert talk.connections == []


# ---- how connections end --------------------------------------------------------------------------------------------


def test_a_request_that_is_open_when_the_capture_ends_behind_a_fin_was_cut_off_by_it() -> None:
    for flags, reason in ((0, "capture_ended"), (FIN | ACK, "connection_closed")):
        talk = Talk()
        talk.open()
        talk.ask(read(1, dbw(1, 0)))
        if flags:
            talk.packet(SERVER, flags=flags)
        talk.finish()
        assert [one.reason for one in talk.transactions] == [reason]


def test_octets_of_what_was_never_recognised_count_on_port_102() -> None:
    for ports, skipped in (((50000, 102), 16), ((102, 50000), 16), ((50000, 2000), 0)):
        talk = Talk(*ports)
        talk.packet(CLIENT, b"GET / HTTP/1.0\r\n")
        talk.finish()
        octets = talk.pipeline.counters.octets
        assert (octets.delivered, octets.skipped, octets.framed) == (skipped, skipped, 0)


def test_the_ports_of_followed_connections_are_remembered() -> None:
    for port in (102, 2000):
        talk = Talk(server_port=port)
        talk.open()
        talk.close()
        assert talk.pipeline.counters.bare.spoken == ({} if port == 102 else {2000: 1})


def test_a_second_finish_has_nothing_left_to_do() -> None:
    talk = Talk()
    talk.open()
    talk.close()
    told = (len(talk.findings), len(talk.connections), talk.pipeline.counters.octets.delivered)
    talk.pipeline.finish()
    assert (len(talk.findings), len(talk.connections), talk.pipeline.counters.octets.delivered) == told


@each("vlan", [0, 7])
def test_each_packet_of_a_connection_is_one_of_its_packets(vlan: int) -> None:
    """With and without data, in order and not, at its beginning and its end."""
    talk = Talk()
    talk.vlan = vlan
    talk.open(8, 8)
    for ref in range(3):
        talk.ask(read(ref, dbw(1, 0)))
        talk.packet(SERVER)
        talk.tell(words(ref, 1))
        talk.packet(CLIENT)
    at = talk.seq[CLIENT]
    octets = dt(read(9, dbw(1, 0)))
    talk.packet(CLIENT, octets[20:], seq=at + 20)
    talk.packet(CLIENT, octets[:20], seq=at)
    talk.packet(CLIENT, octets, seq=at)
    talk.packet(CLIENT, octets, seq=at + 9_000_000)
    talk.seq[CLIENT] += len(octets)
    talk.packet(SERVER, octets, cut=5)
    talk.close()
    (connection,) = talk.connections
    tcp = connection.tcp
    assert (tcp.packets, tcp.first_frame, tcp.last_frame) == (talk.pipeline.frames, 1, talk.pipeline.frames)
    assert (tcp.first_ns, tcp.last_ns) == (START_NS + MS, talk.now_ns)


def test_an_older_acknowledgement_takes_nothing_back() -> None:
    """Acknowledgements may be captured out of order: the highest one counts."""
    for less in (1, 27):
        talk = Talk()
        talk.open()
        talk.ask(read(1, dbw(1, 0)))
        talk.seq[SERVER] += 27
        talk.packet(CLIENT)
        talk.acked[CLIENT] = talk.seq[SERVER] - less
        talk.packet(CLIENT)
        talk.finish()
        assert talk.pipeline.counters.octets.missing == 27


@each("acknowledged", [False, True])
def test_a_gap_that_was_acknowledged_is_given_up_soon(acknowledged: bool) -> None:
    """50 milliseconds later, or after a few packets; any other after a second."""
    for passing in (False, True):
        talk = Talk()
        talk.open(8, 8)
        talk.acked[SERVER] = talk.seq[CLIENT]
        talk.seq[CLIENT] += 31
        talk.ask(read(1, dbw(1, 0)))
        if acknowledged:
            talk.acked[SERVER] = talk.seq[CLIENT]
        talk.packet(SERVER)
        if passing:
            for _ in range(12):
                talk.packet(SERVER)
        else:
            talk.silence(150 * MS)
        assert ("stream.hole" in talk.slugs()) is acknowledged, passing


# ---- memory ---------------------------------------------------------------------------------------------------------


def fed(talk: Talk, octets: int) -> None:
    """Packets of other things, so many octets of them together."""
    noise = bytes(1_000_000)
    for _ in range(octets // len(noise)):
        talk.pipeline.frame(talk.first.now_ns, noise, 0, len(noise), len(noise), 1)


@pytest.mark.parametrize("memory", [1 << 20, 8 << 20])
def test_the_fullest_connections_are_dropped_when_all_keep_too_much(memory: int) -> None:
    """Now and then they are added up; of those that keep most as many leave as it takes to keep half of the limit."""
    talk = Talk(client_port=20_000)
    talk.pipeline = Pipeline(talk, Options(strict=True, memory=memory))
    sizes = {}
    for number in range(60):
        one = talk if number == 0 else Talk(client_port=20_000 + number, beside=talk)
        one.packet(CLIENT, CONNECT)
        size = 60_000 if number % 2 else 9_000
        one.packet(CLIENT, b"\x03\x00\xff\xf0\x02\xf0\x80\x32" + bytes(size))
        sizes[number + 1] = size
    fed(talk, LOOK_OCTETS)
    for _ in range(30):
        talk.raw(bytes(60))
    gone = [one for one in talk.findings if one.slug == "stream.evicted"]
    assert len(gone) == talk.pipeline.table.evicted
    if memory == 8 << 20:
        assert gone == []
        assert len(talk.pipeline.table.all_open()) == 60
        return
    left = len(talk.pipeline.table.all_open())
    assert left == 60 - len(gone)
    assert {sizes[int(one.connection)] for one in gone[:30]} == {60_000}  # first those that keep most
    for found in gone:
        assert found.detail.startswith("it held ")
        assert sizes[int(found.connection)] < int(found.detail.split()[2]) < 3 * sizes[int(found.connection)]
    assert [one.tcp.ended for one in talk.connections] == ["evicted"] * len(gone)
    kept = sum(2 * sizes[int(side.connection.number)] for side in talk.pipeline.table.all_open())
    assert memory // 4 < kept <= memory // 2


def test_before_so_many_octets_nothing_is_added_up() -> None:
    talk = Talk()
    talk.pipeline = Pipeline(talk, Options(strict=True, memory=1))
    evicted = talk.pipeline.table.evicted
    for number, expected in ((1, 1), (2, 2)):  # the next round is as many octets later
        one = talk if number == 1 else Talk(client_port=50_001, beside=talk)
        one.packet(CLIENT, CONNECT)
        one.packet(CLIENT, b"\x03\x00\xff\xf0\x02\xf0\x80\x32" + bytes(60_000))
        fed(talk, LOOK_OCTETS - 3_000_000)
        assert talk.pipeline.table.evicted == evicted
        fed(talk, 6_000_000)
        evicted = talk.pipeline.table.evicted
        assert evicted == expected
        assert talk.slugs().count("stream.evicted") == expected


@each("what", ["idle", "open request", "not followed", "too full"])
def test_a_connection_that_is_dropped_is_a_loss_where_something_is_lost(what: str) -> None:
    talk = Talk(server_port=2000 if what == "not followed" else 102)
    if what == "not followed":
        talk.hello()
        talk.packet(CLIENT, b"GET / HTTP/1.0\r\n")
    else:
        talk.open()
    if what == "open request":
        talk.ask(read(1, dbw(1, 0)))
    (side,) = talk.pipeline.table.all_open()
    connections = talk.pipeline.connections
    connections.note_evicted(talk.pipeline.counters, side, "it held 5 bytes" if what == "too full" else "")
    talk.pipeline.exchange.report_findings()
    detail = {"open request": [""], "too full": ["it held 5 bytes"]}.get(what, [])
    assert [(one.slug, one.detail, one.connection) for one in talk.findings] == [
        ("stream.evicted", text, 1) for text in detail
    ]
    assert connections.forgotten == (what == "idle")
    talk.pipeline.table.remove(side)
    # The rest of it may be counted twice, unless its beginning shows that it is another one.
    for begin in (False, True):
        assert connections.twice == (what == "idle" and begin)
        if begin:
            talk.seq = [5_000_000, 7_000_000]
            talk.hello()
        talk.ask(read(2, dbw(1, 0)))
        (side,) = talk.pipeline.table.all_open()
        talk.pipeline.table.remove(side)
    assert connections.twice == (what == "idle")


# ---- what a source reports ------------------------------------------------------------------------------------------


def test_damage_and_losses_are_findings_of_the_latest_packet() -> None:
    talk = Talk()
    talk.pipeline.note_damage("cut off inside packet 1")
    talk.packet(CLIENT)
    talk.pipeline.note_dropped("7 packets")
    talk.finish()
    assert [(one.slug, one.detail, one.frames) for one in talk.findings] == [
        ("capture.damaged", "cut off inside packet 1", []),
        ("capture.dropped", "7 packets", [1]),
    ]
    assert talk.findings[1].time_ns == START_NS + MS


def test_packets_that_were_lost_may_be_why_an_answer_is_missing() -> None:
    for lost in (False, True):
        talk = Talk()
        talk.watch(2 * SECOND)
        talk.open()
        talk.ask(read(1, dbw(1, 0)))
        if lost:
            talk.pipeline.note_dropped("7 packets")
        talk.silence(3 * SECOND)
        (detail,) = [one.detail for one in talk.findings if one.slug == "transaction.overdue"]
        assert ("packets were lost while capturing" in detail) is lost


def test_another_capture_closes_what_a_decoder_knows() -> None:
    class Restarted(Heard):
        def restart(self) -> None:
            self.heard.append(("restart",))

    decoder = Restarted()
    talk = hearing(decoder)
    talk.finish()
    talk.pipeline.restart_clock(talk.now_ns)
    assert decoder.heard == [("restart",)]


# ---- time -----------------------------------------------------------------------------------------------------------


def test_times_are_those_of_the_first_and_the_latest_packet() -> None:
    talk = Talk()
    assert (talk.pipeline.first_ns, talk.pipeline.now_ns, talk.pipeline.frames) == (0, 0, 0)
    for number in range(1, 4):
        talk.packet(CLIENT, after_ns=SECOND)
        assert talk.pipeline.first_ns == START_NS + SECOND
        assert (talk.pipeline.now_ns, talk.pipeline.frames) == (START_NS + number * SECOND, number)


def test_time_told_before_any_packet_or_behind_the_latest_one_changes_nothing() -> None:
    talk = Talk()
    talk.pipeline.tick(START_NS + 100 * SECOND)
    assert (talk.pipeline.now_ns, talk.pipeline.timers.deadline_ns) == (0, FAR_FUTURE)
    talk.open()
    talk.tell(words(9, 1), after_ns=2 * SECOND)
    talk.pipeline.tick(talk.now_ns)
    assert talk.transactions == []


def test_a_capture_that_begins_in_1970_has_times_as_any() -> None:
    talk = Talk()
    talk.now_ns = -MS
    talk.hello()
    talk.connect()
    assert (talk.pipeline.counters.frames, talk.pipeline.now_ns) == (5, 4 * MS)
    talk.finish()
    assert talk.slugs() == []


def test_findings_are_told_with_the_packet_or_the_time_that_shows_them() -> None:
    talk = Talk()
    talk.open()
    talk.packet(CLIENT, b"\x03\x00\x00\x05\x00" + dt(read(1, dbw(1, 0))))
    assert talk.slugs() == ["tpkt.bad_length"]
    talk.tell(words(9, 1))
    talk.silence(3 * SECOND)
    assert talk.slugs() == ["tpkt.bad_length", "transaction.orphan"]


def test_a_connection_is_iso_on_tcp_from_its_first_tpkt_on() -> None:
    talk = Talk()
    talk.hello()
    talk.packet(CLIENT, CONNECT)
    (side,) = talk.pipeline.table.all_open()
    assert (side.connection._state, side.connection.number) == (ISO, 1)
    talk.packet(SERVER, flags=RST)
    talk.silence(3 * SECOND)
    assert talk.pipeline.table.all_open() == []
