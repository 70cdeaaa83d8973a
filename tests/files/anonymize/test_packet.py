"""Packets made anew: segments cut anywhere, octets sent again, damage, other protocols, options; nothing gets through."""

from __future__ import annotations

import struct
from pathlib import Path
from random import Random

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from dissect.files.anonymize.account import Choices
from dissect.packets.source.files import open_capture
from dissect.packets.tcp import ip, link
from tests.files.anonymize.support import anonymized, told
from tests.meaning.report.support import ROOT, begun, read, saved
from tests.packets.source.craft import drain
from tests.properties import messages
from tests.properties.messages import dt
from tests.properties.packets import ACK, EPOCH_NS, MS, PSH, Flow, Packet, Segment, Talk
from tests.protocols.ibh.packets import CLAIM, CLAIMED, RECEIPT, long, short

TSAP = b"PLANT-NORTH-7"
FLOW = Flow()


def written(path: Path) -> list[bytes]:
    return [frame.octets for frame in drain(open_capture(str(path))).frames]


def payload(octets: bytes) -> bytes:
    """Return what a TCP segment in an Ethernet frame carries."""
    at, _ = link.find_ip(octets, 0, len(octets), 1)
    packet = ip.parse_ip(octets, at, len(octets))
    return octets[packet.start + (octets[packet.start + 12] >> 4) * 4 : packet.end]


def talk_of(request: bytes, sizes: list[int]) -> list[Packet]:
    """Return a connection whose first segments carry ``request`` cut into ``sizes``, and all of it once more."""
    packets = Talk(FLOW).handshake().packets()
    at, time_ns = 0, packets[-1].time_ns
    first = seq_of(packets)
    for size in [*sizes, len(request)]:
        if at < len(request):
            part = request[at : at + size]
            packets.append(segment(first + at, part, time_ns := time_ns + MS))
            at += size
    packets.append(segment(first, request, time_ns + MS))
    packets.append(segment(first + 3, request[3:], time_ns + 2 * MS))
    return packets


def seq_of(packets: list[Packet]) -> int:
    """Return the sequence number of the first octet behind the handshake."""
    return int(struct.unpack_from(">I", packets[-1].octets, 14 + 20 + 4)[0])


def segment(seq: int, part: bytes, time_ns: int) -> Packet:
    octets = Segment(FLOW, 0, seq, 1, ACK | PSH, part).frame()
    return Packet(time_ns, octets, len(octets))


@given(st.lists(st.integers(1, 9), max_size=12))
@settings(max_examples=40)
def test_a_text_over_several_segments_becomes_one_text_and_the_same_again(
    tmp_path_factory: pytest.TempPathFactory, sizes: list[int]
) -> None:
    directory = tmp_path_factory.mktemp("cut")
    request = messages.connect(0xE0, called=TSAP)
    account = anonymized(saved(directory / "in.pcapng", talk_of(request, sizes)), directory / "out.pcapng")
    parts = [payload(octets) for octets in written(directory / "out.pcapng")]
    whole = parts[-2]
    assert b"".join(parts[:-2]) == whole
    assert parts[-1] == whole[3:]
    assert len(whole) == len(request)
    at = request.index(TSAP)
    assert whole[:at] == request[:at]
    assert whole[at:] != TSAP
    assert whole[at + 5 : at + 6] == whole[at + 11 : at + 12] == b"-"
    assert account.replaced["tsap_texts"] == 1


def test_octets_sent_again_that_differ_are_not_shown(tmp_path: Path) -> None:
    request = messages.connect(0xE0)
    packets = talk_of(request, [])
    first = seq_of(packets[:3])
    secret = request[:4] + b"a secret in a copy"[: len(request) - 4]
    packets.append(segment(first, secret, packets[-1].time_ns + MS))
    packets.append(segment(first - 20, b"before the beginning", packets[-1].time_ns + MS))
    packets.append(segment(first + 5000, b"far behind the end", packets[-1].time_ns + MS))
    anonymized(saved(tmp_path / "in.pcapng", packets), tmp_path / "out.pcapng")
    parts = [payload(octets) for octets in written(tmp_path / "out.pcapng")]
    same = [one == other for one, other in zip(secret, request, strict=False)]
    assert parts[-3] == bytes(one if same[at] else 0 for at, one in enumerate(secret))
    assert [set(part) for part in parts[-2:]] == [{0}, {0}]


def test_a_message_that_never_ends_and_garbage_become_zeros(tmp_path: Path) -> None:
    talk = begun(FLOW).send(0, b"GARBAGE " * 3).send(0, dt(messages.read_job(1, [])))
    talk.send(0, dt(b"\x32\x01secret beginning", eot=False))
    source = saved(tmp_path / "in.pcapng", talk.packets())
    anonymized(source, tmp_path / "out.pcapng")
    octets = b"".join(written(tmp_path / "out.pcapng"))
    assert b"GARBAGE" not in octets
    assert b"secret" not in octets
    assert told(tmp_path / "out.pcapng") == told(source)


def test_other_protocols_go_or_lose_their_contents(tmp_path: Path) -> None:
    mail = Talk(Flow(ports=(40000, 25))).handshake().send(0, b"MAIL FROM:<me@plant>")
    datagram = FLOW.wrap(0, 17, struct.pack(">HHHH", 5000, 53, 20, 0) + b"name of host")
    arp = bytes.fromhex(
        "ffffffffffff 020000000001 0806 0001 0800 06 04 0001 020000000001 c0a80001 000000000000 c0a80002"
    )
    lldp = bytes.fromhex("0180c200000e 020000000001 88cc") + b"station PUMP"
    more = [Packet(EPOCH_NS + 10**9, octets, len(octets)) for octets in (datagram, arp, lldp)]
    source = saved(tmp_path / "in.pcapng", [*read(begun(FLOW), 1).packets(), *mail.packets(), *more])
    account = anonymized(source, tmp_path / "out.pcapng")
    assert sum(account.dropped.values()) == len(mail.packets()) + 3
    account = anonymized(source, tmp_path / "all.pcapng", Choices(keep_others=True))
    assert account.dropped == {}
    got = written(tmp_path / "all.pcapng")
    octets = b"".join(got)
    for secret in (
        b"MAIL",
        b"name",
        b"PUMP",
        bytes.fromhex("020000000001"),
        bytes.fromhex("c0a80001c0"),
        b"\x0a\0\0\1\x0a",
    ):
        assert secret not in octets
    assert [len(one) for one in got] == [len(one) for one in written(source)]
    assert got[-3][34:42] == datagram[34:42]
    assert got[-2][12:22] == arp[12:22]
    assert got[-1][12:] == b"\x88\xcc" + bytes(12)
    assert told(tmp_path / "all.pcapng") == told(tmp_path / "out.pcapng") == told(source)


def test_options_that_may_tell_something_become_none(tmp_path: Path) -> None:
    request = messages.connect(0xE0)
    tcp = struct.pack(">HHIIBBHHH", 49152, 102, 5000, 1, 0x90, ACK | PSH, 8192, 0, 0)
    tcp += b"\x01\x01\x08\x0a" + bytes(range(8)) + b"\xfd\x04AB" + request
    route = b"\x07\x07\x08" + bytes((10, 9, 8, 7)) + b"\0"  # record route
    octets = Flow(options=route).wrap(0, 6, tcp)
    packets = [Packet(EPOCH_NS, octets, len(octets))]
    anonymized(saved(tmp_path / "in.pcapng", packets), tmp_path / "out.pcapng")
    (new,) = written(tmp_path / "out.pcapng")
    assert bytes((10, 9, 8, 7)) not in new
    assert b"AB" not in new
    at = octets.index(b"\x08\x0a\x00\x01")
    assert new[at : at + 10] == octets[at : at + 10]
    assert new[at + 10 : at + 14] == b"\x01" * 4
    assert payload(new)[:4] == request[:4]


def test_what_stands_behind_the_ip_packet_becomes_zeros(tmp_path: Path) -> None:
    packets = [
        packet._replace(octets=packet.octets + b"leak", wire_length=packet.wire_length + 4)
        for packet in begun(FLOW).packets()
    ]
    account = anonymized(saved(tmp_path / "in.pcapng", packets), tmp_path / "out.pcapng")
    assert all(octets.endswith(bytes(4)) for octets in written(tmp_path / "out.pcapng"))
    assert account.masked["octets_behind_ip"] == (len(packets), 4 * len(packets))


@given(st.randoms(use_true_random=False))
@settings(max_examples=25)
def test_damaged_captures_never_raise(tmp_path_factory: pytest.TempPathFactory, random: Random) -> None:
    directory = tmp_path_factory.mktemp("damaged")
    names = ("coverage-userdata", "coverage-szl", "link-types", "ip-fragments", "netlink-faults", "snaplen", "ipv6")
    source = ROOT / f"captures/crafted/{random.choice(names)}.pcapng"
    packets = []
    for frame in drain(open_capture(str(source))).frames[:80]:
        octets = bytearray(frame.octets)
        for _ in range(random.choice((0, 1, 3))):
            octets[random.randrange(len(octets))] = random.randrange(256)
        cut = random.choice((len(octets), len(octets), random.randrange(len(octets) + 1)))
        packets.append(Packet(frame.time_ns, bytes(octets[:cut]), len(octets), frame.link_type))
    random.choice((list.sort, lambda _: None))(packets)
    account = anonymized(
        saved(directory / "in.pcapng", packets),
        directory / "out.pcapng",
        Choices(random.choice(("keep", "mask", "scramble")), keep_others=random.random() < 0.5),
    )
    assert account.written + sum(account.dropped.values()) == len(packets)


def test_a_receipt_between_two_parts_of_a_message_costs_neither(tmp_path: Path) -> None:
    request = messages.read_job(1, [messages.Item(0x02, 20)])
    answer = messages.read_answer(1, [messages.Item(0x02, 20)], [b"\x5a" * 20])
    talk = Talk(Flow(ports=(49152, 1099))).handshake()
    talk.send(0, CLAIM).send(1, CLAIMED).send(0, short(0xF1, messages.setup(1, 0)))
    talk.send(1, long(0xF1, messages.setup(3, 0))).send(0, short(0xF1, request))
    talk.send(1, RECEIPT, long(0xF0, answer[:24])).send(0, short(0x05)).send(1, RECEIPT, long(0xF1, answer[24:]))
    saved(tmp_path / "a.pcapng", talk.packets())
    anonymized(tmp_path / "a.pcapng", tmp_path / "b.pcapng")
    assert told(tmp_path / "b.pcapng") == told(tmp_path / "a.pcapng")
    assert [row[4] for row in told(tmp_path / "b.pcapng")] == ["answered", "answered"]
    assert payload(written(tmp_path / "b.pcapng")[9])[:-6] == long(0xF0, answer[:24])[:-6]
    assert b"\x5a\x5a" not in b"".join(written(tmp_path / "b.pcapng"))


def test_times_are_never_moved_past_what_can_be_read(tmp_path: Path) -> None:
    last = 2**63 - 1
    saved(tmp_path / "a.pcapng", [packet._replace(time_ns=last - 5) for packet in read(begun(), 1).packets()])
    anonymized(tmp_path / "a.pcapng", tmp_path / "b.pcapng", Choices(shift_time=True))
    made = drain(open_capture(str(tmp_path / "b.pcapng")))
    assert {frame.time_ns for frame in made.frames} == {last}
    reader = open_capture(str(tmp_path / "b.pcapng"))
    drain(reader)
    assert reader.notes == []
