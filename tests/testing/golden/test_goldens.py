"""The goldens in captures/golden: they are what the captures give, and what they say is what tshark's fields say."""

from __future__ import annotations

import os
import re
from collections import Counter
from collections.abc import Iterator
from concurrent.futures import Future, ThreadPoolExecutor
from typing import Final

import pytest

from captures.golden.sources import GOLDENS, SOURCES
from dissect.testing.golden import golden_text, parse_golden
from tests.cases import each
from tests.testing.golden.golden_said import read_said
from tests.testing.golden.support import ROOT
from tests.testing.golden.tshark_known import CAUSES, ROWS, excused
from tests.testing.golden.tshark_match import Difference, differences
from tests.testing.golden.tshark_view import Shown, read_shown

#: The same conversation in other containers.
PLAIN: Final = sorted(name for name in SOURCES if name.startswith("crafted/plain"))
CUT: Final = sorted(name for name in SOURCES if name.startswith("crafted/cut-"))
#: Goldens that have every form, for the test that a golden which says something else is found out.
CHANGED: Final = [
    "blocks",
    "bsend",
    "clock",
    "crafted/coverage-items",
    "crafted/pushes",
    "crafted/refusals",
    "plc-control",
]

Views = dict[str, Future[list[Shown]]]


@pytest.fixture(scope="module")
def views(request: pytest.FixtureRequest) -> Iterator[Views]:
    """What tshark shows of each capture a test here is about, asked for once, some at a time."""
    wanted: set[str] = set()
    for item in request.session.items:
        if isinstance(item, pytest.Function) and "views" in item.fixturenames and item.module is request.module:
            wanted.add(str(item.callspec.params["name"]))
    with ThreadPoolExecutor(os.cpu_count()) as pool:
        yield {name: pool.submit(read_shown, SOURCES[name].capture) for name in sorted(wanted)}


@each("name", SOURCES)
def test_goldens_are_what_their_captures_give(name: str) -> None:
    written = SOURCES[name].golden.read_bytes()
    assert SOURCES[name].text().encode() == written, "python -m captures.golden writes it anew"


@each("name", SOURCES)
def test_goldens_read_back_to_themselves(name: str) -> None:
    written = SOURCES[name].golden.read_text(encoding="utf-8")
    assert golden_text(parse_golden(written)) == written


def test_there_is_a_golden_for_each_capture_and_none_besides() -> None:
    there = sorted(path.relative_to(GOLDENS).as_posix() for path in GOLDENS.rglob("*.s7.txt"))
    assert there == sorted(f"{name}.s7.txt" for name in SOURCES)
    captures = {path for path in (ROOT / "captures").rglob("*.pcap*") if ".env" not in path.parts}
    assert {source.capture for source in SOURCES.values()} == captures


@pytest.mark.parametrize("names", [PLAIN, CUT], ids=["plain", "cut"])
def test_the_container_does_not_show(names: list[str]) -> None:
    assert len(names) == {"plain": 8, "cut": 3}[names[0].removeprefix("crafted/").partition("-")[0].partition(".")[0]]
    assert len({SOURCES[name].golden.read_bytes() for name in names}) == 1


@pytest.mark.parametrize("name", SOURCES)
def test_what_it_says_is_what_tshark_says(name: str, views: Views) -> None:
    found = differences(read_said(SOURCES[name].golden.read_text(encoding="utf-8")), views[name].result())
    places, shows = excused(name)
    assert [difference for difference in found if difference.place and difference.place not in places] == []
    assert _summed(found) == (places, shows), "a row excuses what is no difference, or another one"


def test_every_row_is_of_a_capture_and_every_cause_stands_on_its_page() -> None:
    assert {row.capture for row in ROWS} <= SOURCES.keys()
    assert {row.cause for row in ROWS} == CAUSES.keys()
    for page, said, _ in CAUSES.values():
        assert said in (ROOT / page).read_text(encoding="utf-8"), f"{page} does not say {said!r}"


@pytest.mark.parametrize("name", CHANGED)
def test_every_line_of_a_golden_matters(name: str, views: Views) -> None:
    """With another digit or letter in any line that is not a remark, tshark says something else."""
    lines = SOURCES[name].golden.read_text(encoding="utf-8").split("\n")
    changed = 0
    for at, line in enumerate(lines):
        said, mark, remark = line.partition("  # ")
        last = re.search(r"[0-9a-z](?=[^0-9a-z]*$)", said)
        if at == 0 or last is None or said.startswith("connection ") or said.lstrip().startswith("#"):
            continue
        other = f"{said[: last.start()]}{'1' if last[0] == '0' else '0'}{said[last.end() :]}"
        text = "\n".join([*lines[:at], f"{other}{mark}{remark}", *lines[at + 1 :]])
        assert _odd(name, text, views[name].result()), f"nobody notices {other!r}"
        changed += 1
    assert changed > 20


def _odd(name: str, text: str, shown: list[Shown]) -> bool:
    """Tell whether there are other differences than those excused, or it cannot be read at all."""
    try:
        found = differences(read_said(text), shown)
    except ValueError:
        return True
    return _summed(found) != excused(name)


def _summed(found: list[Difference]) -> tuple[set[str], Counter[str]]:
    shown = Counter(difference.shown for difference in found if difference.shown != "nothing")
    return {difference.place for difference in found if difference.place}, shown
