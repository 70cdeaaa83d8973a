from __future__ import annotations

import socket
import threading
from pathlib import Path
from typing import Any

import pytest
from hypothesis import given
from hypothesis import strategies as st
from scapy.layers.inet import TCP
from scapy.packet import NoPayload, Packet, Raw
from scapy.sendrecv import sniff
from scapy.supersocket import StreamSocket

from dissect.layers import (
    IBH,
    MPI,
    S7,
    TPKT,
    IBH_Rest,
    MPI_Long,
    S7_DataItem,
    S7_ReadVarAnswer,
    S7_ReadVarRequest,
    S7Session,
    at,
)
from dissect.layers.ibh import CHAIN_LIMIT
from tests.engine.transactions.talk import dt
from tests.layers.support import forget, shown, survives
from tests.protocols.ibh.packets import ACK, ASK, DISCONNECT, RECEIPT, SEEN, TELL, long, short

CRAFTED = Path(__file__).resolve().parents[2] / "captures" / "crafted"
KNOWN = [bytes.fromhex(octets) for octets, *_ in SEEN]


def segment(payload: bytes, sport: int = 49152, dport: int = 1099) -> Packet:
    """A TCP segment as a capture has it."""
    return TCP(bytes(TCP(sport=sport, dport=dport)) + payload)


@pytest.mark.parametrize("octets", [*KNOWN, ASK, TELL, ACK, short(0xF0, b"\x32"), long(0x33, b"abc")])
def test_known_packets_survive_and_are_built_without_their_lengths(octets: bytes) -> None:
    packet = survives(IBH, octets)
    if packet.haslayer(MPI) and packet[MPI].number is None:
        return  # that nothing follows its function is what its length says
    blank = forget(packet)
    assert blank.length is None
    assert bytes(blank) == octets


def test_a_request_and_its_answer() -> None:
    ask = IBH(number=4) / MPI() / S7(pdu_ref=1) / S7_ReadVarRequest(items=[at("DB1.DBW0")])
    assert bytes(ask) == ASK
    tell = IBH() / MPI_Long() / S7(pdu_ref=1, rosctr=3) / S7_ReadVarAnswer(data=[S7_DataItem(octets=b"\x00\x2a")])
    assert bytes(tell)[:17] == bytes.fromhex("ff071d000000c20214140200002216f101")
    asked, told = IBH(ASK), IBH(TELL)
    assert (asked[S7].pdu_ref, told[S7].rosctr) == (1, 3)
    assert type(told[MPI]) is MPI_Long
    assert told.answers(asked)
    assert not told.answers(IBH(short(0xF1, ASK[15:], station=3)))
    assert not asked.answers(told)
    assert asked.summary() == "IBH / MPI / S7 Job Read Var ref=0x0001 DB1.DBW0"
    assert IBH(DISCONNECT).summary() == "IBH / MPI disconnect"


def test_flags_and_functions_have_names() -> None:
    assert "r_flags   = MPI request" in shown(IBH(ASK))
    assert "function  = data" in shown(IBH(ASK))
    assert "r_flags   = 0x1234" in shown(IBH(ASK[:6] + b"\x34\x12" + ASK[8:]))


def test_a_disconnect_has_no_number() -> None:
    packet = IBH(DISCONNECT)
    assert packet[MPI].number is None
    assert bytes(IBH(number=8) / MPI(function=0x80, number=None)) == DISCONNECT


def test_a_segment_with_several_packets_is_a_chain() -> None:
    octets = RECEIPT + ACK + TELL + ASK[:11]
    packet: Any = segment(octets, 1099, 49152)
    assert [bytes(packet.getlayer(IBH, number))[:8] for number in (1, 2, 3)] == [RECEIPT[:8], ACK[:8], TELL[:8]]
    assert packet.getlayer(IBH, 3)[S7].rosctr == 3
    assert packet.lastlayer().load == ASK[:11]
    assert type(packet.lastlayer()) is IBH_Rest
    packet.clear_cache()
    assert bytes(packet)[20:] == octets
    for number in (1, 2, 3):
        packet.getlayer(IBH, number).length = None
    assert bytes(packet)[20:] == octets


def test_a_chain_has_an_end() -> None:
    packet = segment(ACK * (CHAIN_LIMIT + 5))
    layers = 0
    layer: Packet = packet
    while not isinstance(layer, NoPayload):
        layers += isinstance(layer, IBH)
        layer = layer.payload
    assert layers == CHAIN_LIMIT
    assert bytes(packet)[20:] == ACK * (CHAIN_LIMIT + 5)


@pytest.mark.parametrize(
    "payload",
    [ASK[:-1], ASK[:5], b"GET / HTTP/1.1\r\n\r\n", b"JRMI\x00\x02K\x00\x00", bytes(30), b"\x07\xff" + bytes(20)],
)
def test_what_is_no_whole_packet_stays_raw(payload: bytes) -> None:
    packet = segment(payload)
    assert type(packet.payload) is Raw
    assert packet.payload.load == payload


def test_ordinary_s7_on_the_same_port_is_read() -> None:
    packet = segment(dt(ASK[15:]))
    assert packet[TPKT][S7].pdu_ref == 1


def test_lengths_that_disagree_are_kept() -> None:
    octets = ASK[:12] + b"\x05" + ASK[13:]
    packet = survives(IBH, octets)
    assert S7 not in packet
    assert packet[MPI].length == 5


@given(
    st.one_of(
        st.binary(max_size=80),
        st.builds(
            lambda a, n, b: a[:n] + b, st.sampled_from([ASK, TELL, ACK]), st.integers(0, 40), st.binary(max_size=60)
        ),
    )
)
def test_any_octets_survive(octets: bytes) -> None:
    if octets:
        survives(IBH, octets)
        assert bytes(segment(octets))[20:] == octets


def test_too_much_for_the_length() -> None:
    with pytest.raises(ValueError, match="the MPI length would be 302, more than its 1 byte"):
        bytes(IBH() / MPI() / bytes(300))


def test_over_a_stream() -> None:
    ours, theirs = socket.socketpair()
    stream: Any = StreamSocket(ours, IBH)

    def trickle() -> None:
        for octet in ASK + ACK:
            theirs.sendall(bytes((octet,)))

    thread = threading.Thread(target=trickle)
    thread.start()
    try:
        assert [bytes(stream.recv()) for _ in range(2)] == [ASK, ACK]
    finally:
        thread.join()
        theirs.close()
        stream.close()


def test_a_session_delivers_packets_and_their_pdus() -> None:
    packets = list(sniff(offline=str(CRAFTED / "netlink-faults.pcapng"), session=S7Session))
    assert sum(S7 in packet for packet in packets) == 23
    # The answer in two fragments is whole on the last of them.
    fragment = next(packet for packet in packets if packet.haslayer(MPI) and packet[MPI].function == 0xF0)
    assert type(fragment[MPI].payload) is Raw
    answers = [packet[S7] for packet in packets if packet.haslayer(MPI_Long) and packet.haslayer(S7_ReadVarAnswer)]
    assert len(answers[0][S7_ReadVarAnswer].data[0].octets) == 20
    assert {packet[TCP].dport for packet in packets if packet.haslayer(MPI_Long)} == {49152, 49153, 49154, 49155}
