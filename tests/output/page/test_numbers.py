"""Numbers in the sentences of a report."""

from __future__ import annotations

from dissect.output.page.numbers import counted, grouped, how_often


def test_thousands_stand_apart() -> None:
    assert counted(1_000_000, "packet") == "1,000,000 packets"
    assert counted(1, "byte is", "bytes are") == "1 byte is"
    assert [how_often(count) for count in (1, 2, 3, 6068)] == ["once", "twice", "3 times", "6,068 times"]


def test_only_whole_numbers_are_grouped() -> None:
    assert grouped("999998 of 1000000 packets used, 12 of them") == "999,998 of 1,000,000 packets used, 12 of them"
    for kept in ("12345.678 s", "0x12345", "192.168.1000.1", "a12345", "12:34567"):
        assert grouped(kept) == kept
