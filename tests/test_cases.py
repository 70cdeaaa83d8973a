"""The loop that stands for many tests fails where one of them would."""

from __future__ import annotations

from pathlib import Path

import pytest

from tests.cases import each

SEEN: list[int] = []


@each("number", range(3))
def test_every_case_is_run_with_the_fixtures(number: int, tmp_path: Path) -> None:
    assert tmp_path.is_dir()
    SEEN.append(number)


def test_all_were_run() -> None:
    SEEN.clear()
    test_every_case_is_run_with_the_fixtures(tmp_path=Path())
    assert SEEN == [0, 1, 2]


def test_a_failure_names_its_case() -> None:
    @each("number", range(9))
    def fails(number: int) -> None:
        assert number != 5

    with pytest.raises(AssertionError) as caught:
        fails()
    assert caught.value.__notes__ == ["the case: number=5"]


def test_a_failure_names_all_that_is_its_case() -> None:
    @each("left", (1, 2))
    @each(("right", "total"), ((3, 4), (4, 6)))
    def fails(left: int, right: int, total: int) -> None:
        assert left + right == total

    with pytest.raises(ExceptionGroup, match="2 of 2 cases failed") as caught:
        fails()
    assert [error.__notes__ for error in caught.value.exceptions] == [
        ["the case: right=4, total=6", "the case: left=1"],
        ["the case: right=3, total=4", "the case: left=2"],
    ]


def test_a_case_has_as_many_values_as_names() -> None:
    with pytest.raises(ValueError, match="longer"):
        each(("left", "right"), [(1, 2, 3)])


def test_several_failures_are_all_told() -> None:
    @each("number", range(9))
    def fails(number: int) -> None:
        SEEN.append(number)
        assert number % 2

    SEEN.clear()
    with pytest.raises(ExceptionGroup, match="5 of 9 cases failed") as caught:
        fails()
    assert list(range(9)) == SEEN
    assert [error.__notes__ for error in caught.value.exceptions] == [
        [f"the case: number={even}"] for even in range(0, 9, 2)
    ]


def test_no_case_is_no_test() -> None:
    with pytest.raises(AssertionError, match="no case"):
        each("number", ())
