from __future__ import annotations

import time
from collections.abc import Iterator
from datetime import UTC, date, datetime, timedelta
from zoneinfo import ZoneInfo

import pytest
from hypothesis import example, given
from hypothesis import strategies as st
from librt.strings import BytesWriter

from dissect.wire.digits import Moments, Times
from dissect.wire.text import Clock, civil

NS = 10**9
EPOCH = datetime(1970, 1, 1, tzinfo=UTC)
#: What 64 bits hold: 1677-09-21 to 2262-04-11.
ANY_TIME = st.integers(-(2**63), 2**63 - 1)


def expected(time_ns: int) -> str:
    second, ns = divmod(time_ns, NS)
    moment = EPOCH + timedelta(seconds=second)
    return f"{moment.strftime('%Y-%m-%dT%H:%M:%S')}.{ns:09d}Z"


def written(times: Times | Moments, time_ns: int) -> str:
    out = BytesWriter()
    times.write(out, time_ns)
    return out.getvalue().decode()


@given(ANY_TIME)
@example(0)
@example(-1)  # the first second asked for is the one before 1970
@example(2**63 - 1)
@example(-(2**63))
def test_iso_is_what_datetime_says(time_ns: int) -> None:
    assert Clock().iso(time_ns) == written(Times(), time_ns) == expected(time_ns)


@given(st.lists(st.tuples(ANY_TIME, st.integers(0, NS - 1)), min_size=1, max_size=8))
def test_one_clock_writes_many_times(times: list[tuple[int, int]]) -> None:
    clock = Clock()
    octets = Times()
    moments = Moments(clock)
    for time_ns, fraction in times:
        # The same second twice: the text kept from the first must fit the other.
        again = max(-(2**63), min(time_ns - time_ns % NS + fraction, 2**63 - 1))
        assert [clock.iso(time_ns), clock.iso(again)] == [expected(time_ns), expected(again)]
        assert [written(octets, time_ns), written(octets, again)] == [expected(time_ns), expected(again)]
        assert [written(moments, time_ns), written(moments, again)] == [Clock().moment(time_ns), Clock().moment(again)]


@pytest.mark.parametrize(
    ("time_ns", "text"),
    [
        (1454943097_916123000, "2016-02-08T14:51:37.916123000Z"),
        (951782400 * NS, "2000-02-29T00:00:00.000000000Z"),
        (4107542399 * NS + NS - 1, "2100-02-28T23:59:59.999999999Z"),
        (4107542400 * NS, "2100-03-01T00:00:00.000000000Z"),  # 2100 is no leap year
        (2**32 * NS, "2106-02-07T06:28:16.000000000Z"),  # after the last second of a classic pcap
    ],
)
def test_iso_of_known_moments(time_ns: int, text: str) -> None:
    assert Clock().iso(time_ns) == text


@given(st.dates())
def test_civil_is_the_gregorian_calendar(day: date) -> None:
    assert civil(day.toordinal() - date(1970, 1, 1).toordinal()) == (day.year, day.month, day.day)


@given(st.integers(-(10**9), 10**9), st.integers(-1000, 1000))
def test_civil_repeats_every_400_years(day: int, times: int) -> None:
    year, month, of_month = civil(day)
    assert civil(day + times * 146097) == (year + times * 400, month, of_month)


# ---- for people -----------------------------------------------------------------------------------------------------


@pytest.fixture
def zone(request: pytest.FixtureRequest, monkeypatch: pytest.MonkeyPatch) -> Iterator[str]:
    """The time zone of this machine, as long as the test runs."""
    monkeypatch.setenv("TZ", request.param)
    time.tzset()
    yield request.param
    monkeypatch.undo()
    time.tzset()


@given(ANY_TIME)
def test_a_moment_names_utc(time_ns: int) -> None:
    day, _, of_day = expected(time_ns).partition("T")
    assert Clock().moment(time_ns) == written(Moments(Clock()), time_ns) == f"{day} {of_day[:15]} UTC"
    assert Clock().time_of_day(time_ns) == of_day[:15]
    assert Clock().zone(time_ns) == "UTC"


@pytest.mark.parametrize("zone", ["Europe/Berlin", "America/St_Johns", "Asia/Kolkata", "UTC"], indirect=True)
def test_a_local_moment_names_its_offset(zone: str) -> None:
    clock = Clock(local=True)
    moments = Moments(clock)
    for second in (0, 1, 1454943097, 1711846799, 1711846800, 1729990799, 1729990800, 4107542400, -1_000_000_000):
        there = datetime.fromtimestamp(second, ZoneInfo(zone))
        offset = there.strftime("%z")
        shown = f"{there:%Y-%m-%d %H:%M:%S}.000123 {offset[:3]}:{offset[3:5]}"
        assert clock.moment(second * NS + 123456) == written(moments, second * NS + 123456) == shown
        assert (clock.time_of_day(second * NS + 123456), clock.zone(second * NS)) == (shown[11:26], shown[27:])
        assert clock.iso(second * NS) == Clock().iso(second * NS)  # what programs read stays UTC


def test_a_local_moment_never_raises() -> None:
    for time_ns in (-(2**63), 2**63 - 1):
        assert Clock(local=True).moment(time_ns)
