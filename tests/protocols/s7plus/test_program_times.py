"""Times as a person reads them: the first and the last that there is of each unit."""

from __future__ import annotations

import struct
from typing import Final

import pytest

from dissect.protocols.s7plus.program_times import dtl_text, long_date_text, long_duration, long_time_of_day

SECOND: Final = 10**9
DAY: Final = 24 * 3600 * SECOND


@pytest.mark.parametrize(
    ("ns", "text"),
    [
        (0, "0ns"),
        (1, "1ns"),
        (999, "999ns"),
        (1_000, "1us"),
        (999_999, "999us999ns"),
        (1_000_000, "1ms"),
        (SECOND - 1, "999ms999us999ns"),
        (SECOND, "1s"),
        (60 * SECOND - 1, "59s999ms999us999ns"),
        (60 * SECOND, "1m"),
        (3600 * SECOND - 1, "59m59s999ms999us999ns"),
        (3600 * SECOND, "1h"),
        (DAY - 1, "23h59m59s999ms999us999ns"),
        (DAY, "1d"),
        (-1, "-1ns"),
        (-DAY - 1, "-1d1ns"),
        (-(2**63), "-106751d23h47m16s854ms775us808ns"),
        (2**63 - 1, "106751d23h47m16s854ms775us807ns"),
    ],
)
def test_a_duration_has_its_units(ns: int, text: str) -> None:
    assert long_duration(ns) == f"LT#{text}"


@pytest.mark.parametrize(
    ("ns", "text"),
    [
        (-1, None),
        (0, "LTOD#00:00:00.000000000"),
        (SECOND, "LTOD#00:00:01.000000000"),
        (60 * SECOND, "LTOD#00:01:00.000000000"),
        (3600 * SECOND, "LTOD#01:00:00.000000000"),
        (DAY - 1, "LTOD#23:59:59.999999999"),
        (DAY, None),
    ],
)
def test_a_time_of_day_is_within_a_day(ns: int, text: str | None) -> None:
    assert long_time_of_day(ns) == text


@pytest.mark.parametrize(
    ("ns", "text"),
    [
        (-1, None),
        (0, "LDT#1970-01-01T00:00:00.000000000Z"),
        (2**63 - 1, "LDT#2262-04-11T23:47:16.854775807Z"),
        (2**63, None),
    ],
)
def test_a_date_is_one_that_a_clock_shows(ns: int, text: str | None) -> None:
    assert long_date_text(ns) == text


def dtl(month: int, day: int, hour: int = 0, minute: int = 0, second: int = 0, rest: int = 0) -> str | None:
    return dtl_text(struct.pack(">HBBBBBBI", 2024, month, day, 0, hour, minute, second, rest))


def test_a_dtl_has_the_days_of_its_month() -> None:
    for month, days in enumerate((31, 29, 31, 30, 31, 30, 31, 31, 30, 31, 30, 31), 1):
        assert dtl(month, 1) == f"DTL#2024-{month:02d}-01-00:00:00.000000000"
        assert dtl(month, days) == f"DTL#2024-{month:02d}-{days}-00:00:00.000000000"
        assert dtl(month, 0) is None
        assert dtl(month, days + 1) is None
    assert dtl(0, 1) is None
    assert dtl(13, 1) is None


def test_a_dtl_has_a_time_of_day() -> None:
    assert dtl(1, 2, 23, 4, 5, 6) == "DTL#2024-01-02-23:04:05.000000006"
    assert dtl(1, 2, 3, 59, 5, 6) == "DTL#2024-01-02-03:59:05.000000006"
    assert dtl(1, 2, 3, 4, 59, 999_999_999) == "DTL#2024-01-02-03:04:59.999999999"
    for wrong in ((24, 0, 0, 0), (0, 60, 0, 0), (0, 0, 60, 0), (0, 0, 0, 1_000_000_000)):
        assert dtl(1, 2, *wrong) is None


def test_a_dtl_of_any_year() -> None:
    assert dtl_text(bytes.fromhex("0001 0203 00 040506 00000007")) == "DTL#0001-02-03-04:05:06.000000007"
