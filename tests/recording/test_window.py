"""Stretches of time: every way to give an end, what they are counted from, and what is not a time."""

from __future__ import annotations

import pytest
from hypothesis import example, given
from hypothesis import strategies as st

from dissect.recording.window import parse_window

NS = 1_000_000_000
DAY = 86_400 * NS
#: 2016-02-08 23:59:50 UTC, and a minute later.
FIRST = 1_454_975_990 * NS
LAST = FIRST + 60 * NS
MIDNIGHT = 1_454_976_000 * NS


@pytest.mark.parametrize(
    ("text", "begin", "end"),
    [
        ("0..10", FIRST, FIRST + 10 * NS),
        ("1.5s..", FIRST + 1_500_000_000, 2**63 - 1),
        ("..90", 0, FIRST + 90 * NS),
        ("23:59:55..23:59:58.25", FIRST + 5 * NS, FIRST + 8_250_000_000),
        ("23:59:55..00:00:10", FIRST + 5 * NS, MIDNIGHT + 10 * NS),
        ("00:00:05..00:00:10", MIDNIGHT + 5 * NS, MIDNIGHT + 10 * NS),
        ("23:59:00..23:59:55", FIRST - 50 * NS, FIRST + 5 * NS),
        ("23:59:58..23:59:55", FIRST + 8 * NS, FIRST + 5 * NS + DAY),
        ("2016-02-08T23:59:51..2016-02-09 00:00:00.000000001Z", FIRST + NS, MIDNIGHT + 1),
        ("..2016-02-29T12:00:00Z", 0, MIDNIGHT + 20 * DAY + DAY // 2),
        ("2016-02-08 23:59:51 UTC..2016-02-09T00:00:00.5UTC", FIRST + NS, MIDNIGHT + NS // 2),
        ("5..5", FIRST + 5 * NS, FIRST + 5 * NS),
    ],
)
def test_a_window_is_what_it_says(text: str, begin: int, end: int) -> None:
    assert parse_window(text).resolve(FIRST, LAST) == (begin, end)


@pytest.mark.parametrize(
    ("text", "said"),
    [
        ("", "form BEGIN..END"),
        ("..", "form BEGIN..END"),
        ("12:00:00", "form BEGIN..END"),
        ("12:00..", "is not a time"),
        ("-5..", "is not a time"),
        ("24:00:00..", "no such time of day"),
        ("..12:60:00", "no such time of day"),
        ("2015-02-29T00:00:00..", "no such day"),
        ("0000-01-01T00:00:00..", "no such day"),
        ("1..2..3", "is not a time"),
        ("\u0661..", "is not a time"),
        ("20..10", "ends before it begins"),
        ("2016-02-08T23:59:51..2016-02-08T23:59:50", "ends before it begins"),
    ],
)
def test_what_is_no_window_is_told(text: str, said: str) -> None:
    with pytest.raises(ValueError, match=said):
        parse_window(text)


@given(st.text(alphabet="0123456789.:-TZs ", max_size=30))
@example("23:59:55..5")
def test_nothing_else_is_raised(text: str) -> None:
    try:
        begin, end = parse_window(text).resolve(FIRST, LAST)
    except ValueError:
        return
    assert isinstance(begin, int)
    assert isinstance(end, int)
