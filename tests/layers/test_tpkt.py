from __future__ import annotations

import socket
import threading
import time

import pytest
from hypothesis import given
from hypothesis import strategies as st
from scapy.layers.inet import IP, TCP
from scapy.layers.l2 import Ether
from scapy.packet import NoPayload, Packet, Padding, Raw
from scapy.supersocket import StreamSocket

from dissect.layers import (
    COTP,
    COTP_DT,
    S7,
    TPKT,
    S7_ReadVarAnswer,
    S7_ReadVarRequest,
    S7_UserdataExtended,
    TPKT_Rest,
    at,
    bind_port,
)
from dissect.layers.tpkt import CHAIN_LIMIT
from tests.cases import each
from tests.layers.examples import BY_NUMBER, EXAMPLES, Example
from tests.layers.support import forget, mutated, survives

READ = BY_NUMBER[28].octets
ANSWER = BY_NUMBER[29].octets
EMPTY_DT = BY_NUMBER[101].octets


def segment(payload: bytes, sport: int = 49152, dport: int = 102) -> Packet:
    """A TCP segment as a capture has it."""
    return TCP(bytes(TCP(sport=sport, dport=dport)) + payload)


@each("example", EXAMPLES)
def test_every_worked_example_survives_and_is_summed_up(example: Example) -> None:
    packet = survives(TPKT, example.octets)
    assert packet.summary().removeprefix("TPKT / ").removeprefix("COTP_DT / ") == example.summary


@each("example", EXAMPLES)
def test_every_worked_example_is_built_without_its_lengths(example: Example) -> None:
    blank = forget(TPKT(example.octets))
    assert blank.length is None
    if example.number == 70:  # one part of a longer list: its head tells of more records than are here
        blank[S7_UserdataExtended].data[1].record_count = 6
    assert bytes(blank) == example.octets


def test_the_fields() -> None:
    packet = TPKT(b"\x03\x01" + READ[2:])
    assert (packet.version, packet.reserved, packet.length) == (3, 1, 31)


def test_a_payload_on_port_102_is_a_tpkt_in_both_directions() -> None:
    assert segment(READ)[S7].pdu_ref == 0x0200
    assert segment(ANSWER, sport=102, dport=49152)[S7].rosctr == 3
    assert TPKT not in segment(READ, dport=49153)


@pytest.mark.parametrize(
    "payload",
    [
        READ[:-1],  # cut
        READ[:3],
        b"GET / HTTP/1.1\r\n\r\n",
        b"\x03\x00\x00\x03" + READ[4:],  # a length that leads nowhere
        b"\x03\x00\x00\x06\x01\xf0",  # no whole TPDU
        b"\x03\x01" + READ[2:],  # a reserved octet that is not 0 is believed only where a TPKT is known to begin
        b"\x03\x00\x00\x07\x03\xf0\x80",  # LI beyond the TPKT
        b"\x03\x00\x00\x07\x02\x30\x80",  # no such TPDU
        b"\x03\x00\x00\x0c\x00\x04\x00\x00\x00\x06\x01\x03",  # Modbus with 0x0300 for a transaction
    ],
)
def test_what_is_no_whole_tpkt_stays_raw(payload: bytes) -> None:
    packet = segment(payload)
    assert type(packet.payload) is Raw
    assert packet.payload.load == payload


def test_a_port_can_be_added() -> None:
    assert TPKT not in segment(READ, dport=10102)
    before = list(TCP.payload_guess)
    try:
        bind_port(10102)
        assert S7 in segment(READ, dport=10102)
        assert S7 in segment(READ, sport=10102, dport=5)
    finally:
        TCP.payload_guess[:] = before
    with pytest.raises(ValueError, match="70000 is not a TCP port"):
        bind_port(70000)


def test_a_crafted_packet_goes_to_port_102() -> None:
    packet = Ether(
        bytes(Ether(dst="02:00:00:00:00:01", src="02:00:00:00:00:02") / IP(dst="127.0.0.1") / TCP() / TPKT(READ))
    )
    assert packet[TCP].dport == 102
    assert packet[S7].pdu_ref == 0x0200


def test_several_tpkts_in_one_segment_are_a_chain() -> None:
    packet = segment(READ + EMPTY_DT + ANSWER)
    first, second, third = (packet.getlayer(TPKT, number) for number in (1, 2, 3))
    assert first is not None
    assert second is not None
    assert third is not None
    assert packet.getlayer(TPKT, 4) is None
    assert (first[S7].rosctr, third[S7].rosctr) == (1, 3)
    assert isinstance(second.payload, COTP_DT)
    assert [tpkt.length for tpkt in chain(packet)] == [31, 7, 31]
    assert packet.summary().count("S7 ") == 2
    assert bytes(forget(packet)) == bytes(packet)


def chain(packet: Packet) -> list[Packet]:
    return [layer for layer in packet.iterpayloads() if isinstance(layer, TPKT)]


def test_a_tpkt_of_length_4_to_6_is_stepped_over() -> None:
    packet = segment(READ + b"\x03\x00\x00\x04" + b"\x03\x00\x00\x06\x02\xf0" + READ)
    assert [tpkt.length for tpkt in chain(packet)] == [31, 4, 6, 31]


@pytest.mark.parametrize("rest", [READ[:3], READ[:-1], b"\x00", b"\x03\x00\x00\x03" + READ])
def test_what_follows_the_last_whole_tpkt_stays_raw(rest: bytes) -> None:
    packet = segment(READ + rest)
    assert len(chain(packet)) == 1
    assert packet[Raw].load == rest
    assert isinstance(packet[Raw], TPKT_Rest)
    again = forget(packet)
    assert bytes(again)[20:] == READ + rest


def test_a_crafted_chain_has_the_length_of_each_tpkt() -> None:
    one = TPKT() / COTP_DT() / S7(pdu_ref=0x200) / S7_ReadVarRequest(items=[at("DB10.DBW4", 3)])
    assert bytes(one / one / one) == READ * 3
    assert bytes(one / (TPKT() / COTP_DT(eot=0)) / TPKT_Rest(b"\x03")) == READ + EMPTY_DT + b"\x03"


def test_a_long_chain_ends_in_raw_octets() -> None:
    packet = segment(EMPTY_DT * (CHAIN_LIMIT + 5))
    assert len(chain(packet)) == CHAIN_LIMIT
    assert packet[Raw].load == EMPTY_DT * 5
    packet.clear_cache()
    assert bytes(packet)[20:] == EMPTY_DT * (CHAIN_LIMIT + 5)
    full = segment(READ * CHAIN_LIMIT)
    survives(TPKT, bytes(full.payload))


@pytest.mark.parametrize(
    ("octets", "content"),
    [
        (READ[:-1], READ[4:-1]),  # cut
        (b"\x03\x00\x00\x02" + READ[4:], READ[4:]),
        (b"\x03\x00\x00\x05\x02", b"\x02"),
        (b"\x7f\x00\x00\x06\x02\xf0", b"\x02\xf0"),
    ],
)
def test_octets_of_ones_own_are_read_as_a_tpkt(octets: bytes, content: bytes) -> None:
    packet = survives(TPKT, octets)
    assert isinstance(packet, TPKT)
    assert bytes(packet.payload) == content


def test_three_octets_are_no_tpkt() -> None:
    assert type(survives(TPKT, b"\x03\x00\x00")) is Raw


def test_a_stream_is_cut_into_tpkts() -> None:
    stream = READ + ANSWER
    for size in range(len(READ)):
        assert TPKT.tcp_reassemble(stream[:size], {"seq": 1}, {}) is None
        nothing_yet = TPKT.tcp_reassemble(stream[:size], {}, {})
        assert nothing_yet is not None
        assert not nothing_yet
        assert bytes(nothing_yet) == stream[:size]
    first = TPKT.tcp_reassemble(stream, {}, {})
    assert first is not None
    assert first[Padding].load == ANSWER
    assert first.length == 31
    assert type(TPKT.tcp_reassemble(b"HTTP", {}, {})) is Raw
    assert type(TPKT.tcp_reassemble(b"\x03\x00\x00\x01", {}, {})) is Raw


def test_sr1_finds_the_answer_in_a_stream() -> None:
    ours, theirs = socket.socketpair()
    theirs.sendall(EMPTY_DT + BY_NUMBER[31].octets + ANSWER[:9])
    late = threading.Timer(0.05, theirs.sendall, (ANSWER[9:],))
    late.start()
    stream = StreamSocket(ours, TPKT)
    answer = stream.sr1(TPKT(READ), verbose=False, timeout=5)
    late.join()
    assert theirs.recv(100) == READ
    stream.close()
    theirs.close()
    assert answer is not None
    assert bytes(answer) == ANSWER


def waiting_for(octets: bytes, timeout: float = 5) -> Packet | None:
    """Return what `sr1` gives for READ over a Scapy `StreamSocket` whose peer sends these octets."""
    ours, theirs = socket.socketpair()
    theirs.sendall(octets)
    stream = StreamSocket(ours, TPKT)
    answer = stream.sr1(TPKT(READ), verbose=False, timeout=timeout)
    stream.close()
    theirs.close()
    return answer


@pytest.mark.parametrize(
    "garbage", [b"HTTP/1.1 200 OK\r\n\r\n", b"\x00", b"\x03\x00\x00\x01", b"\x03" * 9, READ[:12], bytes(70_000)]
)
def test_sr1_finds_the_answer_behind_garbage(garbage: bytes) -> None:
    answer = waiting_for(garbage + ANSWER)
    assert answer is not None
    assert bytes(answer) == ANSWER


def test_sr1_joins_an_answer_in_several_dts() -> None:
    pdu = ANSWER[7:]
    for parts in ((pdu[:3], pdu[3:]), (pdu[:9], b"", pdu[9:]), (pdu, b"")):
        octets = b"".join(
            [bytes(TPKT() / COTP_DT(eot=int(number == len(parts))) / Raw(part)) for number, part in enumerate(parts, 1)]
        )
        answer = waiting_for(EMPTY_DT + octets)
        assert answer is not None
        assert bytes(answer[S7]) == pdu
        assert answer[S7].answers(TPKT(READ)[S7])
        assert bytes(answer) == octets[-len(parts[-1]) - 7 :]


def test_a_partial_tpkt_ends_with_the_time_out() -> None:
    begin = time.monotonic()
    assert waiting_for(ANSWER[:-1], timeout=0.3) is None
    assert waiting_for(b"\x03\x00", timeout=0.3) is None
    assert waiting_for(b"nothing of the kind" * 100, timeout=0.3) is None
    assert time.monotonic() - begin < 5


def test_the_answer_is_found_through_tcp() -> None:
    request = IP(src="10.0.0.1", dst="10.0.0.2") / TCP(sport=4000, dport=102, flags="PA", seq=1, ack=9) / TPKT(READ)
    answer = IP(src="10.0.0.2", dst="10.0.0.1") / TCP(sport=102, dport=4000, flags="PA", seq=9, ack=32) / TPKT(ANSWER)
    other = answer.copy()
    other[S7].pdu_ref = 0x0201
    assert answer.answers(request)
    assert answer.hashret() == request.hashret()
    assert other.hashret() != request.hashret()
    assert answer[TPKT].answers(request[TPKT])
    assert not other[TPKT].answers(request[TPKT])
    assert not answer[TPKT].answers(request[COTP])


def test_a_tpkt_that_is_too_long_is_refused() -> None:
    with pytest.raises(ValueError, match="the TPKT length would be 65536"):
        bytes(TPKT() / COTP_DT() / Raw(bytes(65529)))
    assert len(bytes(TPKT() / COTP_DT() / Raw(bytes(65528)))) == 65535


def test_an_answer_with_its_tpkt_alone() -> None:
    assert isinstance(TPKT(ANSWER)[S7].payload, S7_ReadVarAnswer)
    assert isinstance(TPKT(ANSWER).lastlayer().payload, NoPayload)


@given(st.binary(min_size=1, max_size=80))
def test_any_octets_survive(octets: bytes) -> None:
    survives(TPKT, octets)
    assert bytes(segment(octets))[20:] == octets


@given(mutated())
def test_any_mutation_survives(octets: bytes) -> None:
    survives(TPKT, octets)
    packet = segment(octets)
    packet.clear_cache()
    assert bytes(packet)[20:] == octets
