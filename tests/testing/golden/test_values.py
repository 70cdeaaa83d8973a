from __future__ import annotations

import pytest
from hypothesis import given
from hypothesis import strategies as st

from dissect.protocols.s7.tables import ELEMENT_OCTETS
from dissect.testing.golden.values import hex_octets, hex_text, quoted, shown_value, unquoted, value_octets


@given(st.integers(0, 255), st.binary(max_size=40), st.booleans())
def test_every_value_reads_back_to_its_octets(transport_size: int, data: bytes, fits: bool) -> None:
    text, _ = shown_value(transport_size, data, fits)
    assert value_octets(text, transport_size) == data
    assert "#" not in text
    assert text.isprintable()


@given(st.sampled_from(sorted(ELEMENT_OCTETS)), st.data())
def test_one_element_of_a_numeric_type_is_a_number(transport_size: int, data: st.DataObject) -> None:
    octets = data.draw(st.binary(min_size=ELEMENT_OCTETS[transport_size], max_size=ELEMENT_OCTETS[transport_size]))
    text, _ = shown_value(transport_size, octets, True)
    assert value_octets(text, transport_size) == octets
    if transport_size in {0x02, 0x04, 0x05, 0x06, 0x07}:
        assert int(text) == int.from_bytes(octets, "big", signed=transport_size in {0x05, 0x07})


@pytest.mark.parametrize(
    ("transport_size", "octets", "text", "remark"),
    [
        (0x05, "fb2e", "-1234", ""),
        (0x04, "00010203", "[1, 515]", ""),
        (0x08, "40600000", "3.5", ""),
        (0x08, "7fc00001", "<7f c0 00 01>", "nan"),
        (0x01, "01", "true", ""),
        (0x01, "03", "<03>", ""),
        (0x02, "07", "7", ""),
        (0x02, "0708", "<07 08>", ""),
        (0x03, "4f4b", '"OK"', ""),
        (0x03, "2322ff", '"\\u0023\\u0022\\u00ff"', ""),
        (0x0B, "000003e8", "<00 00 03 e8>", "T#1s"),
        (0x04, "", "<>", ""),
        (0x08, "80000000", "-0.0", ""),
        (0x08, "7f800000", "inf", ""),
        (0x08, "7fc00000", "nan", ""),
        (0x08, "406000007fc00000", "[3.5, nan]", ""),
        (0x08, "406000007fc00001", "<40 60 00 00 7f c0 00 01>", ""),
        (0x30, "7ff8000000000000", "nan", ""),
        (0x30, "7ff8000000000001", "<7f f8 00 00 00 00 00 01>", "nan"),
    ],
)
def test_values_look_like_this(transport_size: int, octets: str, text: str, remark: str) -> None:
    assert shown_value(transport_size, bytes.fromhex(octets), True) == (text, remark)


@pytest.mark.parametrize(
    ("text", "transport_size", "why"),
    [
        ("70000", 0x04, "out of range"),
        ("-1", 0x02, "out of range"),
        ("1e40", 0x08, "out of range"),
        ("maybe", 0x01, "neither true nor false"),
        ("x", 0x04, "invalid literal"),
        ("12", 0x0B, "written as bytes"),
        ('"a"', 0x04, "only CHAR"),
        ('"\\u0416"', 0x03, "CHAR cannot hold"),
        ("<0g>", 0x04, "not hexadecimal"),
        ("<00", 0x04, "angle brackets"),
    ],
)
def test_a_value_that_the_type_does_not_have_is_refused(text: str, transport_size: int, why: str) -> None:
    with pytest.raises(ValueError, match=why):
        value_octets(text, transport_size)


@given(st.text())
def test_quoted_text_reads_back(text: str) -> None:
    said = quoted(text)
    assert unquoted(said) == text
    assert '"' not in said[1:-1]


@given(st.binary())
def test_octets_read_back(octets: bytes) -> None:
    assert hex_octets(hex_text(octets)) == octets
