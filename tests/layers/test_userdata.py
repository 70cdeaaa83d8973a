from __future__ import annotations

import pytest
from hypothesis import given
from hypothesis import strategies as st

from dissect.layers import (
    COTP_DT,
    S7,
    S7_USEND,
    TPKT,
    S7_BSENDData,
    S7_BSENDLength,
    S7_DataHead,
    S7_DataItem,
    S7_Function,
    S7_ModeTransition,
    S7_Octets,
    S7_RId,
    S7_Surplus,
    S7_USENDData,
    S7_UserdataExtended,
    S7_UserdataShort,
)
from tests.cases import each
from tests.layers.examples import BY_NUMBER
from tests.layers.support import survives


@each("number", [*range(68, 89), *range(90, 99)])
def test_head_and_payload_of_the_worked_examples(number: int) -> None:
    octets = BY_NUMBER[number].octets
    header = TPKT(octets)[S7]
    body = header.payload
    parameters = octets[17 : 17 + header.param_length]
    assert type(body) is (S7_UserdataExtended if len(parameters) == 12 else S7_UserdataShort)
    assert (body.function, body.item_count, body.specification) == (0, 1, 0x12)
    assert (body.length, body.syntax_id) == (parameters[3], parameters[4])
    assert (body.type, body.group) == (parameters[5] >> 6, parameters[5] & 0x3F)
    assert (body.subfunction, body.sequence) == (parameters[6], parameters[7])
    if len(parameters) == 12:
        assert (body.data_unit_ref, body.last_data_unit) == (parameters[8], parameters[9])
        assert body.error_code == int.from_bytes(parameters[10:], "big")
    data = octets[17 + header.param_length :]
    head = body.data[0]
    assert type(head) is S7_DataHead
    assert (head.return_code, head.transport_size, head.length) == (data[0], data[1], len(data) - 4)
    assert b"".join(bytes(part) for part in body.data[1:]) == data[4:]
    assert body.data_rest == b""


def test_the_data_head_follows_from_what_is_behind_it() -> None:
    payload = S7_Octets(octets=bytes.fromhex("04240000"))
    request = S7(pdu_ref=0x1500) / S7_UserdataShort(group="CPU functions", subfunction=1, data=[S7_DataHead(), payload])
    assert bytes(TPKT() / COTP_DT() / request) == BY_NUMBER[68].octets
    refusal = S7(pdu_ref=0x1800) / S7_UserdataExtended(error_code=0xD402, data=[S7_DataHead()])
    assert bytes(TPKT() / COTP_DT() / refusal) == BY_NUMBER[73].octets
    follow_up = S7_UserdataExtended(type="request", sequence=3, data=[S7_DataHead()])
    assert bytes(TPKT() / COTP_DT() / S7(pdu_ref=0x1700) / follow_up) == BY_NUMBER[71].octets


def test_a_data_head_of_ones_own_is_taken_as_it_is() -> None:
    head = S7_DataHead(return_code=5, transport_size=3, length=77)
    assert bytes(S7_UserdataShort(data=[head, S7_Octets(octets=b"ab")]))[8:].hex() == "0503004d6162"
    with pytest.raises(ValueError, match="length of S7 data head would be 65536, more than it can say"):
        bytes(S7_UserdataShort(data=[S7_DataHead(), S7_Octets(octets=bytes(65536))]))


def test_a_data_item_may_stand_for_head_and_payload() -> None:
    item = S7_DataItem(transport_size=9, octets=bytes.fromhex("04240000"))
    request = S7(pdu_ref=0x1500) / S7_UserdataShort(group=4, subfunction=1, data=[item])
    assert bytes(TPKT() / COTP_DT() / request) == BY_NUMBER[68].octets


def test_the_mode_transition_push() -> None:
    packet = TPKT(BY_NUMBER[89].octets)
    push = packet[S7_ModeTransition]
    assert (push.function, push.item_count, push.unknown, push.mode, push.unknown_last) == (1, 0, 0x10100000, 0, 0)
    assert bytes(TPKT() / COTP_DT() / S7() / S7_ModeTransition(mode="STOP")) == BY_NUMBER[89].octets


def test_the_length_octet_and_the_syntax_tell_short_from_extended() -> None:
    long_but_short = survives(S7, bytes.fromhex("320700000001000c0000 000112041144010011223344"))
    assert isinstance(long_but_short.payload, S7_UserdataShort)
    assert long_but_short.parameter_rest.hex() == "11223344"
    usend = survives(S7, bytes.fromhex("320700000001000c0000 000112081346020000000001"))
    assert isinstance(usend.payload, S7_UserdataShort)
    assert usend.parameter_rest.hex() == "00000001"


@pytest.mark.parametrize("parameters", ["00", "00011204114401", "01001010000000"])
def test_a_head_that_is_not_whole_keeps_its_octets(parameters: str) -> None:
    octets = bytes.fromhex(parameters)
    packet = survives(S7, bytes((0x32, 7, 0, 0, 0, 1, 0, len(octets), 0, 0)) + octets)
    assert isinstance(packet.payload, S7_Function)
    assert b"".join(bytes(part) for part in packet.parameters) == octets


def test_what_follows_the_payload_is_left_over() -> None:
    packet = survives(S7, bytes.fromhex("32070000000100080007 0001120411440100 ff090002aabbcc"))
    assert [bytes(part) for part in packet.data[-2:]] == [b"\xaa\xbb", b"\xcc"]
    assert type(packet.data[-1]) is S7_Surplus


def test_a_response_answers_the_request_of_its_group_and_subfunction() -> None:
    request = S7(pdu_ref=1) / S7_UserdataShort(group=4, subfunction=1)
    assert (S7(pdu_ref=1) / S7_UserdataExtended(group=4, subfunction=1, sequence=9)).answers(request)
    assert (S7(pdu_ref=1) / S7_UserdataExtended(group=4, subfunction=1)).hashret() == request.hashret()
    assert not (S7(pdu_ref=2) / S7_UserdataExtended(group=4, subfunction=1)).answers(request)
    assert not (S7(pdu_ref=1) / S7_UserdataExtended(group=3, subfunction=1)).answers(request)
    assert not (S7(pdu_ref=1) / S7_UserdataExtended(group=4, subfunction=2)).answers(request)
    assert not (S7(pdu_ref=1) / S7_UserdataExtended(group=4, subfunction=1, type="push")).answers(request)
    assert not (S7(pdu_ref=1) / S7_UserdataShort(group=4, subfunction=1)).answers(request)
    assert not (S7(pdu_ref=1) / S7_ModeTransition()).answers(request)
    assert not (S7(pdu_ref=1, rosctr=3)).answers(request)


def test_each_part_of_a_long_answer_answers_its_own_request() -> None:
    first = S7(pdu_ref=1) / S7_UserdataShort(group=4, subfunction=1)
    follow_up = S7(pdu_ref=2) / S7_UserdataExtended(group=4, subfunction=1, type="request", sequence=3)
    parts = [
        S7(pdu_ref=number)
        / S7_UserdataExtended(group=4, subfunction=1, sequence=3, data_unit_ref=9, last_data_unit=more)
        for number, more in ((1, 1), (2, 0))
    ]
    assert [[part.answers(request) for request in (first, follow_up)] for part in parts] == [[1, 0], [0, 1]]


def test_a_partner_answers_a_bsend_and_nobody_a_usend() -> None:
    data = [S7_DataHead(), S7_RId(r_id=1), S7_BSENDLength(), S7_BSENDData(bsend_data=b"\xca\xfe\x00\x01")]
    bsend = S7(pdu_ref=0x2300) / S7_UserdataExtended(group=6, subfunction=1, type="request", data=data)
    assert bytes(TPKT() / COTP_DT() / bsend) == BY_NUMBER[97].octets
    answer = TPKT(BY_NUMBER[98].octets)[S7]
    assert answer.answers(bsend)
    assert answer.hashret() == bsend.hashret()
    usend = survives(S7, bytes(S7(pdu_ref=0x2300) / S7_USEND(r_id=7, data=[S7_USENDData(), S7_DataItem(octets=b"ab")])))
    assert type(usend.payload) is S7_USEND
    assert (usend.r_id, usend.data[0].item_count, usend.data[1].octets) == (7, 1, b"ab")
    assert usend.summary() == "S7 Userdata CPU services ref=0x2300 USEND R_ID 0x00000007"
    assert not answer.answers(usend)
    assert not usend.answers(bsend)


def test_an_unknown_group_shows_its_numbers() -> None:
    packet = S7(pdu_ref=1) / S7_UserdataShort(group=0x2A, subfunction=7)
    assert packet.summary() == "S7 Userdata request 0x2a: 0x07 ref=0x0001"


@given(st.binary(max_size=40), st.integers(0, 40), st.sampled_from((0, 1, 4)), st.sampled_from((4, 8, 9)))
def test_any_userdata_survives(octets: bytes, length: int, function: int, rest: int) -> None:
    parameters = bytes((function, 1, 0x12, rest)) + octets
    survives(S7, bytes((0x32, 7, 0, 0, 0, 1, 0, length, 0, len(octets))) + parameters)
