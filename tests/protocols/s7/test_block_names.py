from __future__ import annotations

import pytest
from hypothesis import given
from hypothesis import strategies as st

from dissect.protocols.s7.block_names import (
    block_text,
    file_system_text,
    identifier_text,
    is_block_name,
    number_text,
    type_text,
)


@pytest.mark.parametrize(
    ("octets", "text"),
    [
        (b"0800001P", "OB 1, passive"),
        (b"0A00010A", "DB 10, active"),
        (b"0b00000B", "SDB 0, active and passive"),
        (b"0F65535?", "SFB 65535, ?"),
        (b"7700001P", "77 1, passive"),
        (b"0A0001A", "0A0001A"),
        (b"XA00001P", "XA00001P"),
    ],
)
def test_blocks(octets: bytes, text: str) -> None:
    assert block_text(octets) == text


def test_identifiers() -> None:
    assert [identifier_text(one) for one in (b"_", b"$", b"x")] == ["_ complete module", "$ module header", "x"]


@given(st.binary(max_size=12))
def test_any_octets_have_a_text(octets: bytes) -> None:
    assert isinstance(block_text(octets), str)
    assert is_block_name(octets) is (block_text(octets) != octets.decode("latin-1"))
    for text in (type_text, number_text, file_system_text, identifier_text):
        assert isinstance(text(octets), str)
