"""Stretches of time: every way to give an end, what they are counted from, and what is not a time."""

from __future__ import annotations

import time
from collections.abc import Iterator

import pytest
from hypothesis import example, given
from hypothesis import strategies as st

from dissect.meaning.select.window import parse_moment, parse_window

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
        ("23:59", FIRST - 50 * NS, MIDNIGHT - 1),
        ("23:59:51", FIRST + NS, FIRST + 2 * NS - 1),
        ("23:59:51.5", FIRST + NS + NS // 2, FIRST + NS + NS // 2 + NS // 10 - 1),
        ("23:59..00:00", FIRST - 50 * NS, MIDNIGHT),
        ("2016-02-08", MIDNIGHT - DAY, MIDNIGHT - 1),
        ("2016-02-08..2016-02-09", MIDNIGHT - DAY, MIDNIGHT + DAY - 1),
        ("2016-02-09..", MIDNIGHT, 2**63 - 1),
        ("2016-02-09+01:00", MIDNIGHT - 3600 * NS, MIDNIGHT - 3600 * NS + DAY - 1),
        ("00:59:55+01:00..+5s", FIRST + 5 * NS, FIRST + 10 * NS),
        ("18:59:55-0500..23:59:58Z", FIRST + 5 * NS, FIRST + 8 * NS),
        ("2016-02-09T00:59:55+01:00..", FIRST + 5 * NS, 2**63 - 1),
        ("..+5s", 0, FIRST + 5 * NS),
        ("+5s..+500ms", FIRST + 5 * NS, FIRST + 5 * NS + NS // 2),
        ("0..1min", FIRST, FIRST + 60 * NS),
        ("3ns..3us", FIRST + 3, FIRST + 3_000),
        ("3ms..3", FIRST + 3_000_000, FIRST + 3 * NS),
        ("1.5min..1h", FIRST + 90 * NS, FIRST + 3600 * NS),
        ("0.000000001..1.5d", FIRST + 1, FIRST + DAY + DAY // 2),
        ("1.5ns..", FIRST + 1, 2**63 - 1),
        ("..23:59:50", 0, FIRST),
        ("23:59:50..23:59:50", FIRST, FIRST),
        ("23:59:60..", MIDNIGHT, 2**63 - 1),
        ("2016-02-08T23:59:60Z", MIDNIGHT, MIDNIGHT + NS - 1),
        ("2016-02-08T23:59", MIDNIGHT - 60 * NS, MIDNIGHT - 1),
        ("2016-02-08T23:59:51.123456789", FIRST + 1_123_456_789, FIRST + 1_123_456_789),
        ("2016-02-09T00:30:00+00:30..2016-02-08T23:00-01:01", MIDNIGHT, MIDNIGHT + 60 * NS),
        ("2016-02-08T23:00-00:59..", MIDNIGHT - 60 * NS, 2**63 - 1),
        ("2016-02-08T23:59+2359..", MIDNIGHT - DAY, 2**63 - 1),
        ("2016-02-08-05:30", MIDNIGHT - DAY + 19_800 * NS, MIDNIGHT + 19_800 * NS - 1),
        ("2016-02-08Z..2016-02-08 UTC", MIDNIGHT - DAY, MIDNIGHT - 1),
        ("2016-02-08..+1d", MIDNIGHT - DAY, MIDNIGHT),
        ("2016-02-08..2016-02-08", MIDNIGHT - DAY, MIDNIGHT - 1),
        ("2016-02-08T00:00:00..2016-02-08T00:00:00", MIDNIGHT - DAY, MIDNIGHT - DAY),
        ("9999-12-31", 253_402_214_400 * NS, 253_402_214_400 * NS + DAY - 1),
        ("..9999-12-31", 0, 253_402_214_400 * NS + DAY - 1),
    ],
)
def test_a_window_is_what_it_says(text: str, begin: int, end: int) -> None:
    assert parse_window(text).resolve(FIRST, LAST) == (begin, end)


@pytest.mark.parametrize(
    ("text", "last", "begin"),
    [
        ("23:59:49..", FIRST + DAY - NS, FIRST - NS + DAY),
        ("23:59:49..", FIRST + DAY - NS - 1, FIRST - NS),
        ("23:59:50..", FIRST + 2 * DAY, FIRST),
        ("23:59:51..", FIRST + 2 * DAY, FIRST + NS),
        ("00:59:49+01:00..", FIRST + DAY - NS, FIRST - NS + DAY),
        ("00:59:50+01:00..", FIRST + 2 * DAY, FIRST),
    ],
)
def test_a_time_of_day_is_on_the_first_day_that_has_it_in_the_capture(text: str, last: int, begin: int) -> None:
    assert parse_window(text).resolve(FIRST, last) == (begin, 2**63 - 1)


@pytest.mark.parametrize(
    ("text", "begin", "end"),
    [
        ("23:59:51..23:59:52", FIRST + NS, FIRST + 2 * NS),
        ("23:59:40..23:59:50", FIRST - 10 * NS, FIRST),
        ("23:59:40..23:59:49", FIRST - 10 * NS + DAY, FIRST - NS + DAY),
        ("00:00:05..00:00:10", MIDNIGHT + 5 * NS, MIDNIGHT + 10 * NS),
        ("00:00:05", MIDNIGHT + 5 * NS, MIDNIGHT + 6 * NS - 1),
        ("..00:00:05", 0, MIDNIGHT + 5 * NS),
        ("23:59:40..00:00:10", FIRST - 10 * NS, MIDNIGHT + 10 * NS),
        ("01:00:05+01:00..01:00:10+01:00", MIDNIGHT + 5 * NS, MIDNIGHT + 10 * NS),
        ("2016-02-08T12:00..2016-02-08T13:00", MIDNIGHT - DAY // 2, MIDNIGHT - DAY // 2 + 3600 * NS),
        ("..2016-02-08T13:00", 0, MIDNIGHT - DAY // 2 + 3600 * NS),
        ("2016-02-01..00:00:05", MIDNIGHT - 8 * DAY, MIDNIGHT + 5 * NS),
        ("0..00:00:05", FIRST, MIDNIGHT + 5 * NS),
        ("00:00:05..+5s", MIDNIGHT + 5 * NS, MIDNIGHT + 10 * NS),
        ("23:59:40..+5s", FIRST - 10 * NS + DAY, FIRST - 5 * NS + DAY),
        ("23:59:40..", FIRST - 10 * NS, 2**63 - 1),
        ("2016-02-01..2016-02-02", MIDNIGHT - 8 * DAY, MIDNIGHT - 6 * DAY - 1),
        ("0..5", FIRST, FIRST + 5 * NS),
        ("5..", FIRST + 5 * NS, 2**63 - 1),
    ],
)
def test_while_the_end_of_a_capture_is_unknown_a_time_of_day_is_to_come(text: str, begin: int, end: int) -> None:
    """A window that ends before the first packet is on the next day."""
    assert parse_window(text).resolve_ahead(FIRST) == (begin, end)


def test_a_capture_in_a_year_without_calendar_has_times_of_day_nonetheless() -> None:
    first = 400_000 * 365 * DAY + 5
    assert parse_window("12:00+01:00..").resolve(first, first)[0] == first - 5 + DAY // 2
    assert parse_window("00:00:07+01:00..").resolve(first + 8 * NS, first + 2 * DAY)[0] == first - 5 + 7 * NS + DAY


@pytest.fixture
def berlin(monkeypatch: pytest.MonkeyPatch) -> Iterator[None]:
    monkeypatch.setenv("TZ", "Europe/Berlin")
    time.tzset()
    yield
    monkeypatch.undo()
    time.tzset()


@pytest.mark.usefixtures("berlin")
@pytest.mark.parametrize(
    ("text", "begin", "end"),
    [
        ("00:59:55..+5s", FIRST + 5 * NS, FIRST + 10 * NS),
        ("00:59", FIRST - 50 * NS, MIDNIGHT - 1),
        ("2016-02-09T00:59:55..", FIRST + 5 * NS, 2**63 - 1),
        ("2016-02-09", MIDNIGHT - 3600 * NS, MIDNIGHT - 3600 * NS + DAY - 1),
        ("23:59:55Z..", FIRST + 5 * NS, 2**63 - 1),
        ("2016-07-01T12:00:00..", 1_467_367_200 * NS, 2**63 - 1),
        ("2016-03-27", 1_459_033_200 * NS, 1_459_033_200 * NS + DAY - 3600 * NS - 1),
    ],
)
def test_a_window_in_local_time(text: str, begin: int, end: int) -> None:
    """A day on which clocks change has 23 hours, and summer has another offset than the day of the capture."""
    assert parse_window(text, local=True).resolve(FIRST, LAST) == (begin, end)


@pytest.mark.usefixtures("berlin")
def test_a_time_of_day_is_on_the_next_day_of_its_own_zone() -> None:
    first = 1_454_972_390 * NS  # 23:59:50 in Berlin
    assert parse_window("00:00:05..", local=True).resolve(first, first + 60 * NS)[0] == first + 15 * NS
    assert parse_window("00:00:05..00:00:06", local=True).resolve_ahead(first) == (first + 15 * NS, first + 16 * NS)


@pytest.mark.parametrize(
    ("zone", "text", "utc"),
    [
        ("Europe/Berlin", "2016-03-27T01:00", "2016-03-27T00:00Z"),
        ("Europe/Berlin", "2016-03-27T01:59:59", "2016-03-27T00:59:59Z"),
        ("Europe/Berlin", "2016-03-27T03:00", "2016-03-27T01:00Z"),
        ("Europe/Berlin", "2016-03-27T03:59", "2016-03-27T01:59Z"),
        ("Europe/Berlin", "2016-10-30T01:59:59", "2016-10-29T23:59:59Z"),
        ("Europe/Berlin", "2016-10-30T03:00", "2016-10-30T02:00Z"),
        ("America/Nuuk", "2016-03-26T21:59:59", "2016-03-27T00:59:59Z"),
        ("America/Nuuk", "2016-03-26T23:00", "2016-03-27T01:00Z"),
        ("America/Nuuk", "2016-03-26T23:59:60", "2016-03-27T02:00:00Z"),
    ],
)
def test_the_hour_decides_whether_clocks_have_changed(
    zone: str, text: str, utc: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("TZ", zone)
    time.tzset()
    try:
        assert parse_moment(text, True).ns == parse_moment(utc).ns
    finally:
        monkeypatch.undo()
        time.tzset()


@pytest.mark.usefixtures("berlin")
def test_a_moment_without_a_zone_is_in_utc_unless_local_times_are_wanted() -> None:
    assert parse_moment("2016-02-09T00:00").resolve(0, 0) == MIDNIGHT
    assert parse_moment("2016-02-09T00:00", True).resolve(0, 0) == MIDNIGHT - 3600 * NS
    assert parse_moment("2016-02-09T00:00Z", True).resolve(0, 0) == MIDNIGHT


@pytest.mark.usefixtures("berlin")
def test_a_day_before_the_calendar_begins_is_told() -> None:
    with pytest.raises(ValueError, match="'0001-01-01': there is no such day"):
        parse_window("0001-01-01", local=True)


@pytest.mark.usefixtures("berlin")
def test_messages_name_the_zone() -> None:
    with pytest.raises(ValueError, match="local time without a zone"):
        parse_window("noon", local=True)


@pytest.mark.parametrize(
    ("text", "said"),
    [
        ("", "form BEGIN..END"),
        ("..", "form BEGIN..END"),
        ("12", "the first 12 are ..12"),
        ("1:00..", "is not a time"),
        ("24:00..", "no such time of day"),
        ("2015-02-29", "no such day"),
        ("12:00+24:00", "no such time zone"),
        ("12:00+01:60..", "no such time zone"),
        ("noon", r"UTC without a zone"),
        ("-5..", "is not a time"),
        ("24:00:00..", "no such time of day"),
        ("..12:60:00", "no such time of day"),
        ("2015-02-29T00:00:00..", "no such day"),
        ("0000-01-01T00:00:00..", "no such day"),
        ("23:59:61..", "no such time of day"),
        ("12:00-23:60..", "no such time zone"),
        ("12:00-24:00..", "no such time zone"),
        ("5..4.999", "ends before it begins"),
        ("5..+", "is not a time"),
        ("0.1234567891..", "is not a time"),
        ("1234567890..", "is not a time"),
        ("+12", r"the first \+12 are ..\+12"),
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
