"""How a mistake in an expression is shown: the part around it, and a mark below it."""

from __future__ import annotations

from string import ascii_letters
from typing import Final

from dissect.meaning.select.errors import SelectError, range_hint
from tests.cases import each

#: Characters that differ from those around them, so that a wrong place shows.
TEXT: Final = "".join([ascii_letters[(at * 7 + at // 52) % 52] for at in range(400)])


@each(
    ("size", "start", "end", "first", "last"),
    [
        (20, 5, 9, 0, 20), (20, 0, 1, 0, 20), (20, 19, 20, 0, 20), (20, 20, 21, 0, 20), (20, 25, 26, 0, 20), (20, 5, 5, 0, 20),
        (140, 70, 71, 0, 140), (141, 70, 71, 0, 140), (141, 71, 72, 1, 141), (400, 69, 70, 0, 140), (400, 71, 80, 1, 141),
        (400, 200, 210, 130, 270), (400, 200, 400, 130, 270), (400, 399, 400, 329, 400), (400, 330, 331, 260, 400),
        (400, 329, 330, 259, 399), (400, 400, 401, 330, 400),
    ],
)  # fmt: skip
def test_seventy_characters_before_the_wrong_part_are_shown_and_as_many_from_there_on(
    size: int, start: int, end: int, first: int, last: int
) -> None:
    text = TEXT[:size]
    reason, line, mark = SelectError("wrong", text, start, end).lines()
    before, after = "\u2026 " if first else "", " \u2026" if last < size else ""
    assert (reason, line) == ("wrong", f"  {before}{text[first:last]}{after}")
    if start <= size:
        assert mark.index("^") == 2 + len(before) + start - first
    assert mark.strip(" ") == "^" * max(1, min(end, last) - start)


def test_an_error_keeps_the_place_that_it_has() -> None:
    error = SelectError("wrong")
    assert (error.text, error.start, error.end) == ("", 0, 0)
    assert (error.lines(), str(error)) == (["wrong"], "wrong")
    placed = error.within("abc", 1, 2)
    assert (placed.reason, placed.text, placed.start, placed.end) == ("wrong", "abc", 1, 2)
    assert placed.within("xyz", 0, 1) is placed
    assert str(placed) == "wrong\n  abc\n   ^"
    assert isinstance(error, ValueError)


def test_what_cannot_be_printed_is_one_character_and_wide_ones_are_two_columns() -> None:
    _, line, mark = SelectError("wrong", "a\x1b\t\n\u202e\u6f22b", 6, 7).lines()
    assert line == "  a?  ?\u6f22b"
    assert mark == "  " + " " * 7 + "^"
    reason, *_ = SelectError("wr\x1bong", "a").lines()
    assert reason == "wr\\x1bong"


@each(
    ("text", "hint"),
    [
        ("1-5", ", or with `in` the range 1..5"), ("1..5", ", or with `in` the range 1..5"),
        ("10...20", ", or with `in` the range 10..20"),
        ("1....5", ""), ("1.5", ""), ("a-5", ""), ("1-", ""), ("-5", ""), ("1-5-7", ""),
    ],
)  # fmt: skip
def test_a_range_in_another_notation_is_explained(text: str, hint: str) -> None:
    assert range_hint(text) == hint
