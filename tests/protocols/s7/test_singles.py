from __future__ import annotations

import json
import math
import struct

from hypothesis import given
from hypothesis import strategies as st
from librt.strings import BytesWriter

from dissect.protocols.s7 import singles
from dissect.protocols.s7.singles import real, real_json, real_repr, real_text, write_real_json
from tests.cases import each


def digits_of(text: str) -> int:
    """Significant digits of a number as it is written."""
    mantissa = text.lower().partition("e")[0].lstrip("-").replace(".", "").strip("0")
    return len(mantissa) or 1


def is_well_inside(octets: bytes, number: float) -> bool:
    """Tell whether a number lies nearer to a single than halfway to the nearer of its neighbours."""
    bits = int.from_bytes(octets, "big") & 0x7FFFFFFF
    exact = struct.unpack(">f", bits.to_bytes(4, "big"))[0]
    below = struct.unpack(">f", (bits - 1).to_bytes(4, "big"))[0] if bits else -(2.0**-149)
    above = struct.unpack(">f", (bits + 1).to_bytes(4, "big"))[0] if bits < 0x7F7FFFFF else 2.0**128
    return bool(abs(abs(number) - exact) < min(above - exact, exact - below) / 2) or abs(number) == exact


#: Singles: any, subnormal, near powers of two (which begin with nine at 2**-10), and what people write.
SINGLES = st.one_of(
    st.integers(0, 0xFFFFFFFF).map(lambda bits: bits.to_bytes(4, "big")),
    st.integers(0, 0x7FFFFF).map(lambda bits: bits.to_bytes(4, "big")),
    st.tuples(st.integers(1, 254), st.integers(-40, 40)).map(lambda at: ((at[0] << 23) + at[1]).to_bytes(4, "big")),
    st.integers(9766, 9999).map(lambda number: struct.pack(">f", number * 1e-7)),
    st.decimals(-100_000, 100_000, places=2).map(lambda number: struct.pack(">f", float(number))),
)


@given(SINGLES)
def test_a_real_reads_back_to_the_same_octets(octets: bytes) -> None:
    number = real(octets)
    assert float(real_text(octets)) == number or math.isnan(number)
    if math.isnan(number):
        assert octets[0] & 0x7F == 0x7F
        assert real_text(octets) == "nan"
    else:
        assert struct.pack(">f", number) == octets


def test_powers_of_two_read_back() -> None:
    """Below them the singles lie twice as close as above."""
    for exponent in range(1, 255):
        octets = (exponent << 23).to_bytes(4, "big")
        assert struct.pack(">f", real(octets)) == octets


@given(SINGLES)
def test_a_real_is_written_as_short_as_can_be(octets: bytes) -> None:
    exact = struct.unpack(">f", octets)[0]
    if not math.isfinite(exact):
        return
    text = real_text(octets)
    shorter = (f"{exact:.{digits}g}" for digits in range(1, digits_of(text)))
    assert not any(is_well_inside(octets, float(candidate)) for candidate in shorter)


@given(st.decimals(-9999, 9999, places=2))
def test_what_people_write_is_what_they_see(number: object) -> None:
    octets = struct.pack(">f", float(str(number)))
    assert real(octets) == float(str(number))


@each(
    ("octets", "text"),
    [
        ("00000000", "0"),
        ("80000000", "-0"),
        ("3dcccccd", "0.1"),
        ("3a80049d", "0.0009767"),
        ("7f7fffff", "3.4028235e+38"),
        ("ff7fffff", "-3.4028235e+38"),
        ("00800000", "1.1754944e-38"),
        ("00000001", "1e-45"),
        ("80000001", "-1e-45"),
        ("7f800000", "inf"),
        ("ff800000", "-inf"),
        ("7fc00000", "nan"),
        ("ffffffff", "nan"),
    ],
)
def test_single_reals(octets: str, text: str) -> None:
    assert real_text(bytes.fromhex(octets)) == text
    assert repr(real(bytes.fromhex(octets))) == repr(float(text))


# ---- the same in native arithmetic ----------------------------------------------------------------------------------


def exact_text(octets: bytes) -> str:
    """`real_text` by Python's own conversions, which round every digit as it has to be."""
    exact = struct.unpack(">f", octets)[0]
    if not math.isfinite(exact):
        return repr(exact)
    power = (int.from_bytes(octets, "big") & 0x7F800000).to_bytes(4, "big")
    low, above = struct.unpack(">f", power)[0], struct.unpack(">f", power[:3] + b"\x01")[0]
    # Six digits are tried first where neighbours differ by more than the seventh.
    first = 1 if low == 0 else 6 if above - low > 10.0 ** (int(f"{low:e}".partition("e")[2]) - 6) else 7
    for digits in range(first, 9):
        if is_well_inside(octets, float(f"{exact:.{digits}g}")):
            return f"{exact:.{digits}g}"
    return f"{exact:.9g}"


@given(SINGLES)
def test_native_arithmetic_gives_the_same_digits(octets: bytes) -> None:
    """Both roads in either build: what is compiled takes the native one, and the exact one near a tie."""
    text = exact_text(octets)
    assert real_text(octets) == text
    word = int.from_bytes(octets, "big")
    found = singles._shortest(word)
    if found >= 0:
        assert singles._written(word, found, singles._GENERAL) == text
        assert singles._written(word, found, singles._REPR) == repr(float(text))
        power = singles._power(found)
        assert abs(int(power)) > singles._EXACT_POWER or singles._double(word, found, power) == float(text)


def test_native_arithmetic_around_powers_of_ten() -> None:
    """Where the number of digits changes, and where rounding goes up to the next power."""
    for power in range(-37, 39):
        middle = int.from_bytes(struct.pack(">f", 10.0**power), "big")
        for word in range(middle - 40, middle + 40):
            text = exact_text(word.to_bytes(4, "big"))
            found = singles._shortest(word)
            assert found < 0 or singles._written(word, found, singles._GENERAL) == text


def test_native_arithmetic_decides_nearly_always() -> None:
    undecided = [number for number in range(20_000) if singles._shortest(0x3F800000 + 397 * number) < 0]
    assert len(undecided) < 100


@given(SINGLES)
def test_as_json_and_as_python(octets: bytes) -> None:
    number = real(octets)
    assert real_repr(octets) == repr(number)
    out = BytesWriter()
    write_real_json(out, b"\xff" + octets + b"\xff", 1)
    assert out.getvalue().decode("ascii") == real_json(octets)
    read = json.loads(real_json(octets))
    if math.isfinite(number):
        assert isinstance(read, float)
        assert struct.pack(">d", read) == struct.pack(">d", number)  # the sign of zero as well
    else:
        assert read == repr(number)
