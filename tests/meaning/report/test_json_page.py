"""JSON over several lines: what the standard library writes with an indent."""

from __future__ import annotations

import enum
import json

from hypothesis import given
from hypothesis import strategies as st

from dissect.meaning.report.json_page import JsonPage


class Code(enum.IntEnum):
    """A number that is more than one."""

    ONE = 1


class Name(str):
    """A text that is more than one."""

    __slots__ = ()


LEAVES = (
    st.none()
    | st.booleans()
    | st.integers()
    | st.floats()
    | st.text()
    | st.sampled_from([Code.ONE, Name("\x7f"), {}, [], (), {1: 2, None: 3, False: 4, 1.5: [], Code.ONE: "é"}])
)
VALUES = st.recursive(
    LEAVES, lambda inner: st.lists(inner) | st.dictionaries(st.text(), inner) | st.tuples(inner, inner), max_leaves=20
)


@given(VALUES, st.integers(0, 4), st.sampled_from(["", "   "]))
def test_it_is_what_the_standard_library_writes(value: object, indent: int, before: str) -> None:
    told = json.dumps(value, indent=indent).replace("\x7f", "\\u007f")
    assert JsonPage(indent).text(value, before) == told.replace("\n", f"\n{before}")


@given(st.lists(VALUES, max_size=5))
def test_what_came_before_leaves_no_trace(values: list[object]) -> None:
    page = JsonPage(1)
    sentence = "A sentence that is long enough to be kept, é."
    for value in [sentence, *values, [sentence], {sentence: sentence}, *values]:
        assert page.text(value, "  ") == JsonPage(1).text(value, "  ")
