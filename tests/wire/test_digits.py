from __future__ import annotations

from hypothesis import example, given
from hypothesis import strategies as st

from dissect.wire.text import decimal, hexadecimal


@given(st.one_of(st.integers(-(2**63), 2**63 - 1), st.integers(0, 2_000_000_000)))
@example(0)
@example(999)
@example(1000)
@example(1001)
@example(999_999)
@example(1_000_000)
@example(1_000_001)
@example(999_999_999)
@example(1_000_000_000)
@example(-1)
@example(-(2**63))
def test_decimal_is_what_str_says(number: int) -> None:
    assert decimal(number) == str(number)


@given(st.binary(max_size=9))
def test_hexadecimal_is_what_hex_says(octets: bytes) -> None:
    assert hexadecimal(octets) == octets.hex()
