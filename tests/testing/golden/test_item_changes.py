"""What is said of a read or write that asks for other items."""

from __future__ import annotations

import pytest

from dissect.testing.golden.content import item_changes
from dissect.testing.golden.exchange import S7, Exchange
from tests.engine.transactions.talk import dbw, item, read, write, written

A, B, C, D = (dbw(10, octet) for octet in (0, 2, 4, 6))
CHARS = item(0x84, 10, 0, 3)
SEVEN = "DB1.DBW0 WORD, DB1.DBW2 WORD, DB1.DBW4 WORD, DB1.DBW6 WORD, DB1.DBW8 WORD and 2 more"


@pytest.mark.parametrize(
    ("before", "after", "text", "was", "is_"),
    [
        ([A, B], [A, B, C], "requests DB10.DBW4 WORD as well", "", "DB10.DBW4 WORD"),
        ([A, B, C], [C, A], "no longer requests DB10.DBW2 WORD", "DB10.DBW2 WORD", ""),
        ([A, B], [A, C], "requests DB10.DBW4 WORD instead of DB10.DBW2 WORD", "DB10.DBW2 WORD", "DB10.DBW4 WORD"),
        ([A, B], [B, A], "requests the same items in a different order", "DB10.DBW0 WORD, DB10.DBW2 WORD",
         "DB10.DBW2 WORD, DB10.DBW0 WORD"),
        ([A, A, B], [A, B], "no longer requests DB10.DBW0 WORD", "DB10.DBW0 WORD", ""),
        ([A], [B], "requests DB10.DBW2 instead of DB10.DBW0", "READ DB10.DBW0",
         "READ DB10.DBW2"),
        ([item(0x84, 10, 0, 2)], [CHARS], "requests DB10.DBB0 CHAR instead of DB10.DBB0 BYTE",
         "DB10.DBB0 BYTE", "DB10.DBB0 CHAR"),
        ([], [A], "requests DB10.DBW0 WORD as well", "", "DB10.DBW0 WORD"),
        ([A], [dbw(1, 2 * number) for number in range(7)],
         f"requests {SEVEN} instead of DB10.DBW0 WORD", "DB10.DBW0 WORD", SEVEN),
    ],
)  # fmt: skip
def test_reads(before: list[bytes], after: list[bytes], text: str, was: str, is_: str) -> None:
    change = item_changes(Exchange(S7, read(1, *before), b""), Exchange(S7, read(2, *after), b""))
    assert (change.kind, change.text, change.was, change.is_) == ("requests", text, was, is_)
    assert change.targets == ("Read Var",)


def test_writes() -> None:
    one = Exchange(S7, write(1, [A], written(4, b"\0\1")), b"")
    two = Exchange(S7, write(1, [A, D], written(4, b"\0\1") * 2), b"")
    assert item_changes(one, two).text == "writes DB10.DBW6 WORD as well"
    assert item_changes(two, one).text == "no longer writes DB10.DBW6 WORD"
