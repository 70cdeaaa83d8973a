"""The book of facts: values one after another, what counts as the same, and its bounds."""

from __future__ import annotations

from typing import Final

import pytest
from hypothesis import given
from hypothesis import strategies as st

from dissect.engine.stations import facts
from dissect.engine.stations.facts import Book, Fact


def said(book: Book, key: str, value: str, frame: int = 1, host: str = "10.0.0.2", module: str = "") -> Fact:
    fact = Fact(host, module, key, value, "SZL 0x0011", 1, [frame - 1, frame], frame * 1000)
    book.note(fact)
    return fact


def test_the_same_again_is_one_value() -> None:
    book = Book()
    first, again = said(book, facts.FIRMWARE, "V3.2", 2), said(book, facts.FIRMWARE, "V3.2", 8)
    assert (first.fresh, first.before, again.fresh, again.before) == (True, "", False, "")
    (stretch,) = book.stations["10.0.0.2"].facts["", facts.FIRMWARE]
    assert (stretch.count, stretch.first_frame, stretch.last_frame, stretch.last_ns) == (2, 2, 8, 8000)


def test_a_value_again_without_a_fact_is_kept_like_one_that_is_noted() -> None:
    """Who wants no facts gets a book that says the same: the first of a kind, the latest once more, and any other as a fact."""
    short, whole = Book(), Book()
    changes = 0
    for frame, value in enumerate(("a", "a", "b", "b", "a"), 1):
        if not short.again("10.0.0.2", 0, facts.MAC_KEY, value, "SZL 0x0011", frame, frame * 1000):
            changes += 1
            said(short, facts.MAC, value, frame)
        said(whole, facts.MAC, value, frame)
    assert changes == 2
    assert spans(short) == spans(whole) == [("a", 2, 1, 2), ("b", 2, 3, 4), ("a", 1, 5, 5)]


def spans(book: Book) -> list[tuple[str, int, int, int]]:
    stretches = book.stations["10.0.0.2"].facts[facts.MAC_KEY]
    return [(one.value, one.count, one.first_frame, one.last_frame) for one in stretches]


def test_a_value_without_a_fact_has_the_same_bounds() -> None:
    book = Book()
    for number in range(facts.MAX_KEYS):
        said(book, f"{facts.BLOCKS} {number}", "1")
    assert book.again("10.0.0.2", 0, facts.MAC_KEY, "m", "Ethernet", 1, 1)
    assert (len(book.stations["10.0.0.2"].facts), book.stations["10.0.0.2"].not_kept) == (facts.MAX_KEYS, 1)
    for number in range(facts.MAX_STATIONS):
        assert book.again(f"10.1.{number >> 8}.{number & 0xFF}", 0, facts.MAC_KEY, "m", "Ethernet", 1, 1)
    assert (len(book.stations), book.not_kept) == (facts.MAX_STATIONS, 1)


def test_a_change_begins_a_new_value_and_going_back_another() -> None:
    book = Book()
    for frame, mode in enumerate(("RUN", "STOP", "STOP"), 1):
        said(book, facts.OPERATING_MODE, mode, frame)
    last = said(book, facts.OPERATING_MODE, "RUN", 4)
    values = [stretch.value for stretch in book.stations["10.0.0.2"].facts["", facts.OPERATING_MODE]]
    assert values == ["RUN", "STOP", "RUN"]
    assert (last.fresh, last.before) == (True, "STOP")
    assert book.stations["10.0.0.2"].latest(facts.OPERATING_MODE) == "RUN"
    assert book.stations["10.0.0.2"].latest(facts.FIRMWARE) == ""


@pytest.mark.parametrize(
    ("key", "one", "other", "same"),
    [
        (facts.FIRMWARE, "V4.3", "V4.3.1", True),
        (facts.FIRMWARE, "V4.3.1", "V4.3", True),
        (facts.FIRMWARE, "V4.3", "V4.31", False),
        (facts.SERIAL_NUMBER, "S1", "S1.2", False),
        (facts.ORDER_NUMBER, "6ES7", "6ES7", True),
    ],
)
def test_what_can_be_the_same(key: str, one: str, other: str, same: bool) -> None:
    book = Book()
    said(book, key, one)
    assert said(book, key, other).fresh is not same
    if same:
        assert book.stations["10.0.0.2"].latest(key) == max(one, other, key=len)


def test_modules_of_a_rack_do_not_contradict_each_other() -> None:
    book = Book()
    said(book, facts.SERIAL_NUMBER, "A", module="rack 0 slot 2")
    assert said(book, facts.SERIAL_NUMBER, "B", module="rack 0 slot 3").before == ""


def test_stations_that_state_a_kind() -> None:
    book = Book()
    said(book, facts.MAC, "m", host="10.0.0.3")
    said(book, facts.FIRMWARE, "", host="10.0.0.4")
    said(book, facts.FIRMWARE, "V1", host="10.0.0.5")
    said(book, facts.MAC, "m", host="10.0.0.2")
    said(book, facts.ORDER_NUMBER, "6ES7", host="10.0.0.2")
    told = book.stating(frozenset((facts.ORDER_NUMBER, facts.FIRMWARE)))
    assert [station.host for station in told] == ["10.0.0.5", "10.0.0.2"]


def test_a_clock_runs_on() -> None:
    book = Book()
    said(book, facts.CLOCK, "100")
    assert not said(book, facts.CLOCK, "200", 5).fresh
    (stretch,) = book.stations["10.0.0.2"].facts["", facts.CLOCK]
    assert (stretch.value, stretch.count, stretch.last_frame) == ("200", 2, 5)


def test_bounds() -> None:
    book = Book()
    count = facts.MAX_BLOCKS + 5
    for number in range(count):
        said(book, facts.OPERATING_MODE, str(number), number + 1)
        said(book, f"{facts.BLOCKS} {number}", "1")
        said(book, facts.BLOCK, f"DB {number}")
        said(book, facts.BLOCK, "DB 0")
    for number in range(facts.MAX_STATIONS):
        said(book, facts.MAC, "m", host=f"10.1.{number >> 8}.{number & 0xFF}")
    station = book.stations["10.0.0.2"]
    values = [stretch.value for stretch in station.facts["", facts.OPERATING_MODE]]
    assert values == ["0", *map(str, range(count - facts.MAX_STRETCHES + 1, count))]
    assert len(station.facts) == facts.MAX_KEYS
    assert list(station.blocks) == [f"DB {number}" for number in range(facts.MAX_BLOCKS)]
    assert station.not_kept == count - facts.MAX_STRETCHES + count - (facts.MAX_KEYS - 1) + 5
    assert (len(book.stations), book.not_kept) == (facts.MAX_STATIONS, 1)
    assert len(said(book, facts.PLANT, "x" * 500).value) == facts.MAX_VALUE


# ---- files in any order ----------------------------------------------------------------------------------------------

#: What a station stated, file by file: (file, value, time).
STATED: Final = [
    ("a", "RUN", 1), ("a", "RUN", 5), ("b", "STOP", 20), ("b", "RUN", 30), ("b", "RUN", 31), ("c", "STOP", 40),
    ("d", "STOP", 41), ("d", "STOP", 50), ("e", "RUN", 60),
]  # fmt: skip


def in_order(book: Book, key: str) -> list[tuple[str, int, int, int]]:
    stretches = book.stations["10.0.0.2"].facts["", key]
    return [(one.value, one.count, one.first_ns, one.last_ns) for one in facts.timeline(key, stretches)]


@given(st.permutations("abcde"), st.booleans())
def test_values_are_in_order_of_time_whatever_the_order_of_the_files(files: list[str], apart: bool) -> None:
    book = Book()
    for file in files:
        part = Book() if apart else book
        for own, value, at in STATED:
            if own == file:
                said(part, facts.OPERATING_MODE, value, at)
        if apart:
            book.merge(part)
    said_ = [(value, count, first_ns) for value, count, first_ns, _ in in_order(book, facts.OPERATING_MODE)]
    assert said_ == [("RUN", 2, 1000), ("STOP", 1, 20000), ("RUN", 2, 30000), ("STOP", 3, 40000), ("RUN", 1, 60000)]
    assert book.stations["10.0.0.2"].latest(facts.OPERATING_MODE) == "RUN"


def test_the_same_value_before_and_after_another_one_of_a_third_file() -> None:
    book = Book()
    for value, at in (("S1", 1), ("S1", 100), ("S2", 50)):
        said(book, facts.SERIAL_NUMBER, value, at)
    assert in_order(book, facts.SERIAL_NUMBER) == [
        ("S1", 1, 1000, 1000), ("S2", 1, 50000, 50000), ("S1", 1, 100000, 100000),
    ]  # fmt: skip
    assert book.stations["10.0.0.2"].latest(facts.SERIAL_NUMBER) == "S1"


def test_an_older_value_knows_the_one_after_it() -> None:
    book = Book()
    said(book, facts.SERIAL_NUMBER, "S2", 100)
    older = said(book, facts.SERIAL_NUMBER, "S1", 10)
    assert (older.fresh, older.before, older.after) == (True, "", "S2")
    same = said(book, facts.SERIAL_NUMBER, "S1", 5)
    assert (same.fresh, same.before, same.after) == (False, "", "")


def test_the_latest_clock_is_that_of_the_latest_packet() -> None:
    book = Book()
    for key in (facts.CLOCK, facts.CLOCK_SET):
        said(book, key, "7", 100)
        said(book, key, "3", 10)
        assert in_order(book, key) == [("7", 2, 100000, 100000)]
