from __future__ import annotations

from pathlib import Path

import pytest
from hypothesis import given
from hypothesis import strategies as st
from scapy.packet import NoPayload, Packet, Raw, fuzz

from dissect.layers import (
    COTP_DT,
    TPKT,
    S7Plus,
    S7Plus_Event,
    S7Plus_KeepAlive,
    S7Plus_Notification,
    S7Plus_Request,
    S7Plus_Response,
)
from dissect.layers.s7plus import is_s7plus
from dissect.protocols.s7plus.message import parse_plus
from tests.layers.support import shown, survives, tpkts_of
from tests.protocols.s7plus.pdus import (
    ERROR,
    KEEP_ALIVE,
    NOTIFICATION_V3,
    RESPONSE_V3,
    asked,
    event,
    framed,
    notified,
    told,
)

EXAMPLES = [
    (framed(asked(5)), "S7comm-plus V2 Request GetMultiVariables seq=5 session=0x00000386"),
    (framed(asked(5, flags=0x74), 1), "S7comm-plus V1 Request GetMultiVariables seq=5 session=0x00000386 no-response"),
    (framed(told(5), 3), "S7comm-plus V3 Response GetMultiVariables seq=5"),
    (framed(told(5, opcode=2)), "S7comm-plus V2 Response2 GetMultiVariables seq=5"),
    (framed(notified()), "S7comm-plus V2 Notification subscription=0x70000e51"),
    (framed(notified(), 1), "S7comm-plus V1 Notification"),
    (framed(told(5), trailer=False), "S7comm-plus V2 Response GetMultiVariables seq=5 goes on"),
    (framed(b"more of it", 3, trailer=False), "S7comm-plus V3 fragment goes on"),
    (event(12, b"LOGOUT"), "S7comm-plus system event confirmed=12"),
    (KEEP_ALIVE, "S7comm-plus keep-alive 7"),
    (RESPONSE_V3, "S7comm-plus V3 Response GetMultiVariables seq=33565"),
    (NOTIFICATION_V3, "S7comm-plus V3 Notification subscription=0x70000e51"),
]


@pytest.mark.parametrize(("octets", "line"), EXAMPLES)
def test_a_frame_dissects_builds_and_is_summed_up(octets: bytes, line: str) -> None:
    packet = survives(S7Plus, octets)
    assert packet.summary() == line
    assert isinstance(packet.payload, NoPayload)
    blank = packet.copy()
    for name in ("length", "digest_length"):
        if name in blank.fields:
            blank.delfieldval(name)
    assert bytes(blank) == octets


@pytest.mark.parametrize(("octets", "line"), EXAMPLES)
def test_inside_a_dt(octets: bytes, line: str) -> None:
    packet = TPKT(bytes(TPKT() / COTP_DT() / Raw(octets)))
    assert packet.summary() == f"TPKT / COTP_DT / {line}"
    assert is_s7plus(octets)
    assert type(TPKT(bytes(TPKT() / COTP_DT(eot=0) / Raw(octets))).lastlayer()) is Raw


@pytest.mark.parametrize(("octets", "line"), EXAMPLES)
def test_cut_at_every_octet_and_with_a_tail(octets: bytes, line: str) -> None:
    for size in range(1, len(octets)):
        survives(S7Plus, octets[:size])
    survives(S7Plus, octets + b"tail")


def test_crafting() -> None:
    request = S7Plus(content=[S7Plus_Request(function="InitSSL", sequence=1, session_id=0, body=bytes(4))], version=1)
    assert bytes(request).hex() == "7201001231000005b30000000100000000340000000072010000"
    answer = S7Plus(version=1, content=[S7Plus_Response(function="InitSSL", sequence=1, body=b"\x00")])
    assert parse_plus(bytes(answer)).malformed == []
    protected = S7Plus(
        version=3, digest=bytes(32), content=[S7Plus_Notification(subscription_id=0x70000007, body=b"\x05\x01")]
    )
    read = parse_plus(bytes(protected))
    assert (read.integrity, read.subscription_id, read.sequence, read.malformed) == (bytes(32), 0x70000007, 5, [])
    part = S7Plus(content=[Raw(b"more")], trailer=b"")
    assert bytes(part) == framed(b"more", trailer=False)
    assert bytes(S7Plus(version=0xFE, content=[S7Plus_Event(confirmed_octets=9)])) == event(9)
    assert bytes(S7Plus_KeepAlive(number=7)) == KEEP_ALIVE
    body = S7Plus(bytes(request)).body
    assert body is not None
    assert body.function == 0x05B3
    assert S7Plus().body is None


def test_too_much_for_the_length_is_the_users_error() -> None:
    with pytest.raises(ValueError, match="S7comm-plus length"):
        bytes(S7Plus(content=[Raw(bytes(65536))]))


def test_answers() -> None:
    request, answer = S7Plus(framed(asked(5))), S7Plus(framed(told(5)))
    assert answer.answers(request)
    assert answer.hashret() == request.hashret()
    assert S7Plus(framed(told(5, ERROR))).answers(request)
    for other in (told(6), told(5, 0x04CA), notified(), asked(5)):
        assert not S7Plus(framed(other)).answers(request)
    assert not request.answers(answer)
    assert not answer.answers(Raw(b"x"))
    carried = [TPKT(bytes(TPKT() / COTP_DT() / layer)) for layer in (request, answer)]
    assert carried[1].answers(carried[0])


def test_a_fuzzed_frame_has_a_summary_and_a_view() -> None:
    packet = S7Plus(content=[fuzz(S7Plus_Request())])
    packet.summary()
    shown(packet)
    bytes(fuzz(S7Plus()))


def same(packet: Packet, octets: bytes) -> None:
    pdu = parse_plus(octets)
    assert (packet.version, packet.length) == (pdu.version, int.from_bytes(octets[2:4], "big"))
    body = packet.body
    for name in ("opcode", "function", "sequence", "session_id", "transport_flags", "subscription_id", "credit_tick"):
        if name in body.default_fields:
            assert body.getfieldval(name) == getattr(pdu, name), name
    assert b"".join([bytes(part) for part in body.body]) == pdu.body
    if pdu.version == 3:
        assert packet.digest == pdu.integrity


@pytest.mark.parametrize(
    ("name", "count"), [("s7commplus_1511_opc_all_types.pcap", 18), ("s7comm_and_s7commplus_sll.pcap", 121)]
)
def test_shared_captures_read_as_the_engine_reads_them(corpus: Path, name: str, count: int) -> None:
    found = 0
    for octets in tpkts_of(corpus / name):
        packet = TPKT(octets)
        if S7Plus in packet:
            found += 1
            same(survives(S7Plus, octets[7:]), octets[7:])
    assert found == count


@given(st.sampled_from([octets for octets, _ in EXAMPLES]), st.integers(1, 60), st.binary(max_size=8))
def test_never_raises(octets: bytes, at: int, other: bytes) -> None:
    survives(S7Plus, octets[:at] + other + octets[at + len(other) :])
