from __future__ import annotations

from typing import Any

import pytest
from hypothesis import given
from hypothesis import strategies as st
from scapy.packet import Packet, Raw

from dissect.layers import (
    COTP,
    COTP_AK,
    COTP_CC,
    COTP_CR,
    COTP_DC,
    COTP_DR,
    COTP_DT,
    COTP_EA,
    COTP_ED,
    COTP_ER,
    COTP_RJ,
    S7,
    TPKT,
    COTP_AK_Extended,
    COTP_DT_Extended,
    COTP_DT_Normal,
    COTP_EA_Extended,
    COTP_ED_Extended,
    COTP_ED_Normal,
    COTP_Parameter,
    COTP_RJ_Extended,
    COTP_Unknown,
    S7_ReadVarRequest,
)
from tests.layers.examples import BY_NUMBER
from tests.layers.support import mutated, survives

#: Number of the worked example, class, fields, parameters (code, value), user data.
WORKED = [
    (13, COTP_CR, {"li": 17, "credit": 0, "dst_ref": 0, "src_ref": 0x4B, "options": 0}, "c0:0a c1:0100 c2:0103", ""),
    (14, COTP_CC, {"li": 17, "dst_ref": 0x4B, "src_ref": 6, "class_": 0}, "c0:0a c1:0100 c2:0103", ""),
    (15, COTP_CR, {"li": 31, "src_ref": 0x112}, "c1:0600 c2:53494d415449432d524f4f542d484d49 c0:0a", ""),
    (16, COTP_DR, {"li": 6, "dst_ref": 0x112, "src_ref": 0, "reason": 0x82}, "", ""),
    (17, COTP_DR, {"li": 10, "dst_ref": 0x112, "reason": 3}, "e0:0102", ""),
    (18, COTP_DC, {"li": 5, "dst_ref": 6, "src_ref": 0x4B}, "", ""),
    (19, COTP_ER, {"li": 8, "dst_ref": 0x4B, "cause": 1}, "c1:11e0", ""),
    (20, COTP_CR, {"class_": 2, "options": 1, "src_ref": 0x21}, "c0:0b c1:0100 c2:0102 c6:01 c7:00", ""),
    (21, COTP_DT_Normal, {"li": 4, "dst_ref": 0x21, "eot": 1, "tpdu_nr": 3}, "", "0102030405060708"),
    (22, COTP_AK, {"li": 4, "credit": 2, "dst_ref": 0x21, "next_nr": 4}, "", ""),
    (23, COTP_RJ, {"li": 4, "credit": 1, "dst_ref": 0x21, "next_nr": 2}, "", ""),
    (24, COTP_ED_Normal, {"li": 4, "dst_ref": 0x21, "eot": 1, "tpdu_nr": 0}, "", "0102"),
    (25, COTP_EA, {"li": 4, "dst_ref": 0x21, "next_nr": 0}, "", ""),
    (99, COTP_DT, {"li": 2, "eot": 0, "tpdu_nr": 0}, "", "320100002400000e00000401"),
    (101, COTP_DT, {"li": 2, "eot": 0}, "", ""),
]  # fmt: skip


def parameters_of(text: str) -> list[tuple[int, bytes]]:
    pairs = (pair.split(":") for pair in text.split())
    return [(int(code, 16), bytes.fromhex(value)) for code, value in pairs]


@pytest.mark.parametrize(("number", "cls", "values", "parameters", "data"), WORKED)
def test_worked_examples(number: int, cls: type[Packet], values: dict[str, int], parameters: str, data: str) -> None:
    octets = BY_NUMBER[number].octets
    packet = TPKT(octets)[COTP]
    assert type(packet) is cls
    assert {name: packet.getfieldval(name) for name in values} == values
    assert [(parameter.code, parameter.value) for parameter in packet.parameters] == parameters_of(parameters)
    assert bytes(packet.payload).hex() == data


@pytest.mark.parametrize(("number", "cls", "values", "parameters", "data"), WORKED)
def test_worked_examples_are_built_from_their_values(
    number: int, cls: Any, values: dict[str, int], parameters: str, data: str
) -> None:
    values = {name: value for name, value in values.items() if name != "li"}
    listed = [COTP_Parameter(code=code, value=value) for code, value in parameters_of(parameters)]
    packet = TPKT() / cls(parameters=listed, **values)
    if data:
        packet /= Raw(bytes.fromhex(data))
    assert bytes(packet) == BY_NUMBER[number].octets


@pytest.mark.parametrize(
    ("octets", "cls", "values"),
    [
        ("07f00021800000010102", COTP_DT_Extended, {"dst_ref": 0x21, "eot": 1, "tpdu_nr": 1}),
        ("07f0002100000001", COTP_DT_Extended, {"eot": 0, "tpdu_nr": 1}),
        ("02108001", COTP_ED, {"eot": 1, "tpdu_nr": 0}),
        ("07100021800000020102", COTP_ED_Extended, {"tpdu_nr": 2}),
        ("0960002100000005000a", COTP_AK_Extended, {"next_nr": 5, "credit_extended": 10}),
        ("0720002100000006", COTP_EA_Extended, {"next_nr": 6}),
        ("0950002100000007000b", COTP_RJ_Extended, {"next_nr": 7, "credit_extended": 11}),
    ],
)
def test_the_other_forms_of_x224(octets: str, cls: type[Packet], values: dict[str, int]) -> None:
    packet = survives(COTP, bytes.fromhex(octets))
    assert type(packet) is cls
    assert {name: packet.getfieldval(name) for name in values} == values


@pytest.mark.parametrize(
    "octets",
    [
        "0240aabb",  # UD, which no connection carries
        "02b0ff",
        "00f080",  # LI 0
        "fff080",  # LI 255, and beyond the octets
        "05e00000004b00",  # LI below what a CR needs
        "05f080",  # LI beyond the octets
    ],
)
def test_a_header_that_cannot_be_read_is_an_unknown_tpdu(octets: str) -> None:
    packet = survives(COTP, bytes.fromhex(octets))
    assert type(packet) is COTP_Unknown
    assert packet.parameter(0xC2) is None
    assert packet.mysummary().startswith("COTP ")


def test_one_octet_is_no_tpdu() -> None:
    assert type(survives(COTP, b"\x02")) is Raw


def test_without_octets_it_is_a_dt() -> None:
    assert bytes(COTP()) == bytes.fromhex("02f080")


def test_every_tpdu_is_a_cotp() -> None:
    packet = TPKT(BY_NUMBER[16].octets)
    assert COTP in packet
    assert isinstance(packet[COTP], COTP_DR)
    assert isinstance(packet[COTP_DR], COTP_DR)
    assert COTP_CR not in packet


def test_s7_is_looked_for_in_a_dt_with_eot_only() -> None:
    pdu = bytes.fromhex("320100000200000e00000401120a10040003000a84000020")
    assert S7 in COTP(b"\x02\xf0\x80" + pdu)
    assert S7 in COTP(b"\x04\xf0\x00\x21\x80" + pdu)
    assert S7 not in COTP(b"\x02\xf0\x00" + pdu)
    assert S7 not in COTP(b"\x02\xf0\x80" + pdu[:1] + b"\x04" + pdu[2:])
    assert S7 not in COTP(b"\x02\xf0\x80" + b"\x72" + pdu[1:])
    assert S7 not in COTP(b"\x02\x10\x80" + pdu)


def test_a_cc_answers_its_cr_and_a_dr_refuses_it() -> None:
    request, other = COTP_CR(src_ref=0x4B), COTP_CR(src_ref=0x4C)
    for answer in (COTP_CC(dst_ref=0x4B, src_ref=6), COTP_DR(dst_ref=0x4B), COTP_ER(dst_ref=0x4B)):
        assert answer.answers(request)
        assert answer.hashret() == request.hashret()
        assert not answer.answers(other)
        assert answer.hashret() != other.hashret()
        assert not answer.answers(COTP_DT())
        assert not request.answers(answer)


def test_a_dc_answers_its_dr() -> None:
    request = COTP_DR(dst_ref=7, src_ref=8)
    assert COTP_DC(dst_ref=8, src_ref=7).answers(request)
    assert COTP_DC(dst_ref=8, src_ref=7).hashret() == request.hashret()
    assert not COTP_DC(dst_ref=8, src_ref=9).answers(request)


def test_the_empty_dt_that_follows_a_request_is_no_answer_to_it() -> None:
    request = COTP_DT() / S7(pdu_ref=1) / S7_ReadVarRequest()
    assert not COTP_DT(eot=0).answers(request)
    assert not (COTP_DT(eot=0) / Raw(b"\x32\x03")).answers(request)
    assert not COTP_AK().answers(request)


def test_a_header_that_li_cannot_say_is_refused() -> None:
    packet = COTP_CR(
        parameters=[COTP_Parameter(code=0xE0, value=bytes(200)), COTP_Parameter(code=0xE0, value=bytes(200))]
    )
    with pytest.raises(ValueError, match="LI, the size of the COTP header, would be 410"):
        bytes(packet)


@given(st.binary(max_size=80))
def test_any_octets_survive(octets: bytes) -> None:
    if octets:
        for cls in (COTP, COTP_CR, COTP_DT, COTP_DT_Extended, COTP_AK_Extended, COTP_Unknown, COTP_Parameter):
            survives(cls, octets)


@given(mutated())
def test_any_mutation_survives(octets: bytes) -> None:
    if octets[4:]:
        survives(COTP, octets[4:])
