from __future__ import annotations

import calendar
import datetime
import math
import struct

import pytest
from hypothesis import given
from hypothesis import strategies as st

from dissect.protocols.s7.tables import ELEMENT_OCTETS, TRANSPORT_SIZES
from dissect.protocols.s7.values import (
    Value,
    bcd,
    date_and_time,
    date_text,
    decode_value,
    duration,
    s5time,
    time_of_day,
)
from tests.cases import each

BIT, BYTE, CHAR, WORD, INT, DWORD, DINT, REAL, DATE, TOD, TIME, S5TIME = range(1, 13)
DATE_AND_TIME, WCHAR, COUNTER, TIMER, LREAL = 0x0F, 0x13, 0x1C, 0x1D, 0x30


@each(
    ("transport_size", "octets", "value"),
    [
        (BIT, "00", False),
        (BIT, "01", True),
        (BIT, "000101", [False, True, True]),
        (BYTE, "ff", 255),
        (BYTE, "a1b2c3", [0xA1, 0xB2, 0xC3]),
        (CHAR, "616263", "abc"),
        (CHAR, "e4", "ä"),
        (CHAR, "", ""),
        (WORD, "ffff", 65535),
        (WORD, "001102200333", [0x11, 0x220, 0x333]),
        (INT, "ffff", -1),
        (INT, "80007fff", [-32768, 32767]),
        (DWORD, "ffffffff", 4294967295),
        (DWORD, "0000000180000000", [1, 2147483648]),
        (DINT, "fffffffe", -2),
        (DINT, "800000007fffffff", [-2147483648, 2147483647]),
        (REAL, "42f6e979", 123.456),
        (REAL, "42f6e97900000000", [123.456, 0.0]),
        (LREAL, "405edd2f1a9fbe77", 123.456),
        (LREAL, "3ff0000000000000c000000000000000", [1.0, -2.0]),
        (DATE, "0000", "D#1990-01-01"),
        (DATE, "ffff", "D#2169-06-06"),
        (DATE, "0000003b", ["D#1990-01-01", "D#1990-03-01"]),
        (TOD, "00000000", "TOD#00:00:00.000"),
        (TOD, "05265bff", "TOD#23:59:59.999"),
        (TOD, "05265c00", None),
        (TOD, "ffffffff", None),
        (TIME, "00000000", "T#0ms"),
        (TIME, "ffffffff", "T#-1ms"),
        (TIME, "80000000", "T#-24d20h31m23s648ms"),
        (TIME, "7fffffff", "T#24d20h31m23s647ms"),
        (S5TIME, "0150", "S5T#1s500ms"),
        (S5TIME, "3999", "S5T#2h46m30s"),
        (TIMER, "10051006", ["S5T#500ms", "S5T#600ms"]),
        (TIMER, "1a05", None),
        (TIMER, "10051fff", ["S5T#500ms", None]),
        (COUNTER, "0123", 123),
        (COUNTER, "0999", 999),
        (COUNTER, "f123", 123),
        (COUNTER, "0a00", None),
        (COUNTER, "0001000f", [1, None]),
        (DATE_AND_TIME, "1602081451379162", "DT#2016-02-08-14:51:37.916"),
        (DATE_AND_TIME, "8912312359599995", "DT#2089-12-31-23:59:59.999"),
        (DATE_AND_TIME, "9001010000000002", "DT#1990-01-01-00:00:00.000"),
        (WCHAR, "00480069", "Hi"),
        (WCHAR, "20ac", "€"),
        (WCHAR, "d83ddd0c", "🔌"),
        (WCHAR, "d800", "\ufffd"),
        (WCHAR, "004800", None),
        # Nothing known to decode.
        (0x00, "01", None),
        (0x1E, "0001", None),
        (0x1F, "0001", None),
        (0x20, "00000001", None),
        (0xFF, "01", None),
        (-1, "01", None),
        # Not a whole number of elements.
        (BYTE, "", None),
        (WORD, "", None),
        (WORD, "001122", None),
        (REAL, "42f6e9", None),
        (DATE_AND_TIME, "160208145137", None),
    ],
)
def test_values(transport_size: int, octets: str, value: Value) -> None:
    decoded = decode_value(transport_size, bytes.fromhex(octets))
    assert decoded == value
    assert type(decoded) is type(value)


@given(st.integers(-1, 300), st.binary(max_size=40))
def test_any_octets(transport_size: int, octets: bytes) -> None:
    decoded = decode_value(transport_size, octets)
    if transport_size in {CHAR, WCHAR}:
        assert decoded is None or isinstance(decoded, str)
        return
    size = ELEMENT_OCTETS.get(transport_size, 0)
    if not size or not octets or len(octets) % size:
        assert decoded is None
    elif len(octets) > size:
        assert isinstance(decoded, list)
        assert len(decoded) == len(octets) // size
    else:
        assert not isinstance(decoded, list)


@given(st.binary(min_size=1, max_size=8))
def test_an_array_is_its_elements(octets: bytes) -> None:
    for row in TRANSPORT_SIZES:
        size = ELEMENT_OCTETS.get(row.number, 0)
        if not size or row.number in {CHAR, WCHAR}:
            continue
        first = (octets * 8)[:size]
        second = bytes(reversed(first))
        both = decode_value(row.number, first + second)
        assert isinstance(both, list)
        assert [str(value) for value in both] == [str(decode_value(row.number, one)) for one in (first, second)]


@given(st.binary(min_size=8, max_size=8))
def test_numbers_are_what_struct_reads(octets: bytes) -> None:
    for transport_size, code, size in (
        (BYTE, ">B", 1),
        (WORD, ">H", 2),
        (INT, ">h", 2),
        (DWORD, ">I", 4),
        (DINT, ">i", 4),
    ):
        assert decode_value(transport_size, octets[:size]) == struct.unpack(code, octets[:size])[0]
    wide = decode_value(LREAL, octets)
    assert isinstance(wide, float)
    assert struct.pack(">d", wide) == octets or math.isnan(wide)


@given(st.binary(max_size=20))
def test_characters_are_kept_one_for_one(octets: bytes) -> None:
    text = decode_value(CHAR, octets)
    assert isinstance(text, str)
    assert text.encode("latin-1") == octets


# ---- times ----------------------------------------------------------------------------------------------------------


@given(st.integers(0, 0xFF), st.integers(0, 0xFF))
def test_bcd(high: int, low: int) -> None:
    text = f"{high:02x}{low:02x}"
    assert bcd(high, low) == (int(text) if text.isdigit() else None)


@given(st.integers(0, 0xFFFF))
def test_s5time(word: int) -> None:
    text = s5time(word.to_bytes(2, "big"))
    digits = f"{word & 0xFFF:03x}"
    if not digits.isdigit():
        assert text is None
        return
    assert text is not None
    assert milliseconds(text.removeprefix("S5")) == int(digits) * 10 * 10 ** (word >> 12 & 3)


def milliseconds(text: str) -> int:
    """Read an IEC duration."""
    assert text.startswith("T#")
    left = text.removeprefix("T#")
    sign = -1 if left.startswith("-") else 1
    left = left.removeprefix("-")
    total = 0
    for unit, size in (("d", 86_400_000), ("h", 3_600_000), ("m", 60_000), ("s", 1000), ("ms", 1)):
        number = left[: len(left) - len(left.lstrip("0123456789"))]
        rest = left[len(number) :]
        if number and rest.startswith(unit) and not (unit == "m" and rest.startswith("ms")):
            total += int(number) * size
            left = rest[len(unit) :]
    assert left == ""
    return sign * total


@given(st.integers(-(2**31), 2**31 - 1))
def test_duration_reads_back(ms: int) -> None:
    assert milliseconds(duration(ms)) == ms


@given(st.integers(0, 2**32 - 1))
def test_time_of_day(ms: int) -> None:
    text = time_of_day(ms)
    if ms >= 86_400_000:
        assert text is None
    else:
        expected = (datetime.datetime(2000, 1, 1, tzinfo=datetime.UTC) + datetime.timedelta(milliseconds=ms)).time()
        assert text == f"TOD#{expected.isoformat('milliseconds')}"


@given(st.integers(0, 0xFFFF))
def test_date(days: int) -> None:
    assert date_text(days) == f"D#{datetime.date(1990, 1, 1) + datetime.timedelta(days=days)}"


@given(st.dates(datetime.date(1990, 1, 1), datetime.date(2089, 12, 31)), st.times(), st.integers(1, 7))
def test_date_and_time(day: datetime.date, time: datetime.time, weekday: int) -> None:
    ms = time.microsecond // 1000
    octets = bytes.fromhex(f"{day:%y%m%d}{time:%H%M%S}{ms:03d}{weekday}")
    assert date_and_time(octets) == f"DT#{day}-{time:%H:%M:%S}.{ms:03d}"


@each("month", range(1, 13))
@each("year", [1990, 1996, 1999, 2000, 2001, 2024, 2089])
def test_days_of_a_month(year: int, month: int) -> None:
    last = calendar.monthrange(year, month)[1]
    for day in (1, last, last + 1):
        text = date_and_time(bytes.fromhex(f"{year % 100:02d}{month:02d}{day:02d}0000000001"))
        assert text == (f"DT#{year}-{month:02d}-{day:02d}-00:00:00.000" if day <= last else None)


@pytest.mark.parametrize(
    "octets",
    [
        "1600081451379162",  # month 0
        "1613081451379162",
        "1602001451379162",  # day 0
        "1602082451379162",  # hour 24
        "1602081460379162",
        "1602081451609162",
        "16020814513791a2",  # no digit
        "1602081451379a62",
        "1a02081451379162",
        "0000000000000000",
        "ffffffffffffffff",
    ],
)
def test_what_is_no_time(octets: str) -> None:
    assert date_and_time(bytes.fromhex(octets)) is None
