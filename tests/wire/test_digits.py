from __future__ import annotations

from collections.abc import Callable

import pytest
from hypothesis import example, given
from hypothesis import strategies as st
from librt.strings import BytesWriter

from dissect.wire.digits import write_decimal, write_digits, write_escape, write_hexadecimal, write_octets
from dissect.wire.text import decimal, hexadecimal


def written(write: Callable[..., None], *arguments: int | bytes) -> str:
    """Return what is written behind what the buffer holds."""
    out = BytesWriter()
    out.write(b"<")
    write(out, *arguments)
    out.write(b">")
    text = out.getvalue().decode("ascii")
    assert text[0] + text[-1] == "<>"
    return text[1:-1]


#: Of all counts of digits alike.
NUMBERS = st.integers(0, 18).flatmap(lambda digits: st.integers(0, 10**digits))


@given(NUMBERS, st.booleans())
def test_decimal(number: int, negative: bool) -> None:
    signed = -number if negative else number
    assert written(write_decimal, signed) == str(signed)


def test_decimal_where_a_digit_more_begins() -> None:
    for digits in range(19):
        for number in (10**digits - 1, 10**digits, 10**digits + 1):
            assert written(write_decimal, number) == str(number)


def test_where_multiplying_gives_way_to_dividing() -> None:
    for number in (2**31 - 1, 2**31, 2**31 + 1, 2**31 - 2**31 % 10_000 - 1, 2**31 - 2**31 % 10_000):
        assert written(write_decimal, number) == str(number)
        assert written(write_digits, number, 12) == f"{number:012d}"


def test_octets() -> None:
    octets = bytes(range(256))
    assert written(write_octets, octets, 0, 256) == "".join([f"{octet}," for octet in octets])
    assert written(write_octets, octets, 9, 11) == "9,10,"
    assert written(write_octets, octets, 7, 7) == ""
    with pytest.raises(IndexError):
        written(write_octets, octets, 255, 257)


@given(NUMBERS, st.integers(0, 4))
def test_digits(number: int, more: int) -> None:
    count = len(str(number)) + more
    assert written(write_digits, number, count) == str(number).rjust(count, "0")


def test_no_digits() -> None:
    assert written(write_digits, 0, 0) == ""


@given(st.binary(max_size=40))
def test_hexadecimal(octets: bytes) -> None:
    assert written(write_hexadecimal, b"<" + octets + b">", 1, 1 + len(octets)) == octets.hex()


def test_octets_that_are_not_there() -> None:
    with pytest.raises(IndexError):
        write_hexadecimal(BytesWriter(), b"\x00\x01", 0, 3)
    with pytest.raises(IndexError):
        write_hexadecimal(BytesWriter(), b"\x00\x01", 0, 4)


def test_each_octet_as_hexadecimal() -> None:
    for octets in (bytes(range(256)), bytes(range(255)), *(bytes((octet,)) for octet in range(256))):
        assert written(write_hexadecimal, b"<" + octets + b">", 1, 1 + len(octets)) == octets.hex()


def test_escape() -> None:
    for unit in range(0x10000):
        assert written(write_escape, unit) == f"\\u{unit:04x}"


# ---- as text -------------------------------------------------------------------------------------------------------


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
