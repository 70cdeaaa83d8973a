from __future__ import annotations

import json
import tomllib
from collections.abc import Iterator
from typing import Any

import pytest
from hypothesis import given
from hypothesis import strategies as st

from dissect.wire.config.hints import close_names, close_to
from dissect.wire.config.lines import Lines, Path, Place

TEXT = '''# a comment with [brackets] and = signs
title = "x [[object]] = # no comment"

[[object]]
index = 0x6000
"a b".c = 1
fields = [
  {name = "run", type = "bool"},  # first
  {reserved = 6},

  {name = "speed",
   type = "int16"},
]

[[object]]
  index = 1.5
text = """
[[object]]
name = 1
"""
when = 2015-10-18 00:00:00
[object.inner]
key = [[1, 2],
  [3]]

[ dictionary ]
'name' = 'it"s'
'''


@pytest.mark.parametrize(
    ("path", "line"),
    [
        (("title",), 2),
        (("object", 0), 4),
        (("object", 0, "index"), 5),
        (("object", 0, "a b", "c"), 6),
        (("object", 0, "fields"), 7),
        (("object", 0, "fields", 0, "type"), 8),
        (("object", 0, "fields", 1), 9),
        (("object", 0, "fields", 2, "name"), 11),
        (("object", 1), 15),
        (("object", 1, "index"), 16),
        (("object", 1, "text"), 17),
        (("object", 1, "when"), 21),
        (("object", 1, "inner"), 22),
        (("object", 1, "inner", "key", 1), 24),
        (("dictionary",), 26),
        (("dictionary", "name"), 27),
        (("object", 0, "missing"), 4),
        (("nothing",), 0),
    ],
)
def test_every_key_has_its_line(path: Path, line: int) -> None:
    assert Lines(TEXT).at(*path) == line


def test_a_place_goes_down() -> None:
    place = Place(Lines(TEXT), ("object",)).inside(0)
    assert (place.line(), place.line("index"), place.inside("fields", 2).line("type")) == (4, 5, 12)
    assert Place(Lines(""), ("object", 3)).line("name") == 0


_KEYS = st.text(st.characters(codec="utf-8", exclude_categories=("Cs", "Cc")), max_size=6)
_LEAVES = st.integers(-9, 9) | st.booleans() | st.text(st.sampled_from("ab[]{}=#,.\n\"'\\"), max_size=8)
_TREES = st.recursive(
    _LEAVES, lambda inner: st.lists(inner, max_size=3) | st.dictionaries(_KEYS, inner, max_size=3), max_leaves=12
)


def _toml(value: Any) -> str:
    if isinstance(value, dict):
        return (
            "{"
            + ", ".join(f"{json.dumps(key, ensure_ascii=False)} = {_toml(item)}" for key, item in value.items())
            + "}"
        )
    if isinstance(value, list):
        return "[\n" + ",\n".join(_toml(item) for item in value) + "]"
    return json.dumps(value, ensure_ascii=False)


def _paths(value: Any, path: Path = ()) -> Iterator[Path]:
    if path:
        yield path
    if isinstance(value, dict):
        for key, item in value.items():
            yield from _paths(item, (*path, key))
    elif isinstance(value, list):
        for at, item in enumerate(value):
            yield from _paths(item, (*path, at))


@given(st.lists(st.dictionaries(_KEYS, _TREES, max_size=4), max_size=4))
def test_any_text_that_is_toml_has_the_lines_of_its_keys(rows: list[dict[str, Any]]) -> None:
    """Each key is found where its own text was written, whatever stands in the values around it."""
    lines = ["# begin"]
    wanted: dict[Path, int] = {}
    for number, row in enumerate(rows):
        lines.append("[[row]]")
        wanted["row", number] = len(lines)
        for key, value in row.items():
            wanted["row", number, key] = len(lines) + 1
            lines += f"{json.dumps(key, ensure_ascii=False)} = {_toml(value)}".split("\n")
    text = "\n".join(lines)
    content = tomllib.loads(text)
    found = Lines(text)
    assert {path: found.at(*path) for path in wanted} == wanted
    assert set(found._known) == set(_paths(content))


def test_close_names_are_few_and_the_closest_first() -> None:
    names = ["name", "names", "mane", "index", "NAME"]
    assert close_names("nmae", names)[0] in {"name", "mane"}
    assert close_to("nam", ["name"]) == "; close to it: 'name'"
    assert close_to("INDEX", names) == "; close to it: 'index'"
    assert close_to("zzz", names) == ""
