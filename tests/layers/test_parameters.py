from __future__ import annotations

import pytest

from dissect.layers import COTP_CR, COTP_ER, COTP_Parameter
from dissect.layers.parameters import tsap_octets
from dissect.protocols.iso.tables import PARAMETERS
from tests.cases import each
from tests.layers.support import shown, survives


@each("code", [row.number for row in PARAMETERS])
def test_every_parameter_of_the_table_is_named_and_survives(code: int) -> None:
    packet = survives(COTP_CR, bytes((10, 0xE0, 0, 0, 0, 1, 0, code, 2, 0x12, 0x34)))
    (parameter,) = packet.parameters
    assert (parameter.code, parameter.length, parameter.value) == (code, 2, b"\x12\x34")
    assert PARAMETERS.name(code) in shown(packet)


@pytest.mark.parametrize(
    ("code", "value", "text"),
    [
        (0xC0, "0a", "0a (1024 bytes)"),
        (0xC0, "10", "10 (65531 bytes)"),
        (0xC0, "05", "05"),
        (0xC1, "0100", "01.00 (PG, rack 0 slot 0)"),
        (0xC2, "0322", "03.22 (S7 basic, rack 1 slot 2)"),
        (0xC2, "53494d41", '"SIMA"'),
        (0xF0, "0080", "0080 (16384 bytes)"),
        (0x85, "00c8", "00c8 (200 ms)"),
        (0x8B, "0005", "0005 (5 s)"),
        (0xF2, "00007530", "00007530 (30000 ms)"),
        (0x85, "", ""),
        (0xC3, "abcd", "abcd"),
    ],
)
def test_a_value_is_shown_by_its_code(code: int, value: str, text: str) -> None:
    octets = bytes.fromhex(value)
    parameter = COTP_Parameter(bytes((code, len(octets))) + octets)
    assert parameter.describe(octets) == text
    assert f"value     = {text}" in shown(parameter)
    assert parameter.mysummary() == f"{PARAMETERS.name(code)} {text}"


def test_parameter_0xc1_of_an_er_is_no_tsap() -> None:
    error = COTP_ER(bytes.fromhex("0870004b01c10211e0"))
    assert "11e0\n" in shown(error)
    assert "rack" not in shown(error)


def test_the_length_is_filled_in() -> None:
    assert bytes(COTP_Parameter(code=0xE0, value=b"\x01\x02\x03")) == bytes.fromhex("e003010203")
    assert bytes(COTP_Parameter(code=0xE0, length=9, value=b"\x01")) == bytes.fromhex("e00901")


def test_the_three_of_every_connection() -> None:
    assert bytes(COTP_Parameter.tpdu_size(1024)) == bytes.fromhex("c0010a")
    assert bytes(COTP_Parameter.tpdu_size(65531)) == bytes.fromhex("c00110")
    assert bytes(COTP_Parameter.calling("01.00")) == bytes.fromhex("c1020100")
    assert bytes(COTP_Parameter.called(b"\x01\x02")) == bytes.fromhex("c2020102")
    assert bytes(COTP_Parameter(code=0xC2, value="MW")) == bytes.fromhex("c2024d57")


def test_a_tpdu_size_that_cannot_be_said_is_refused() -> None:
    with pytest.raises(ValueError, match="a TPDU size of 1000 bytes cannot be encoded: give one of 128, 256"):
        COTP_Parameter.tpdu_size(1000)


def test_a_tsap_is_two_octets_or_a_text() -> None:
    assert tsap_octets("1F.a2") == b"\x1f\xa2"
    assert tsap_octets("SIMATIC-ROOT-HMI") == b"SIMATIC-ROOT-HMI"
    with pytest.raises(ValueError, match="is not ASCII"):
        tsap_octets("Größe")


@pytest.mark.parametrize(
    ("variable", "parameters", "raw"),
    [
        ("c0010ac1", 1, "c1"),  # a code without its length
        ("c0010ac205", 1, "c205"),  # a length beyond LI
        ("0100080003000000", 0, "0100080003000000"),  # RDP's negotiation structure would read as four empty parameters
        ("436f6f6b69653a20", 0, "436f6f6b69653a20"),  # RDP's cookie
    ],
)
def test_what_is_no_parameter_stays_raw(variable: str, parameters: int, raw: str) -> None:
    octets = bytes.fromhex(variable)
    packet = survives(COTP_CR, bytes((6 + len(octets), 0xE0, 0, 0, 0, 1, 0)) + octets)
    assert len(packet.parameters) == parameters + 1
    assert bytes(packet.parameters[-1]).hex() == raw


def test_the_last_of_two_equal_codes_counts() -> None:
    packet = COTP_CR(parameters=[COTP_Parameter.called("01.00"), COTP_Parameter.called("01.02")])
    assert packet.parameter(0xC2) == b"\x01\x02"
    assert packet.parameter(0xC1) is None
