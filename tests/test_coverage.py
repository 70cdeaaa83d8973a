"""docs/coverage.md is what the tables and the captures say, and no cell of it is empty without a reason."""

from __future__ import annotations

import re
from pathlib import Path
from typing import Final

import pytest

from dissect.testing.oracle.known import KNOWN
from scripts.coverage_doc import DIFFERENCES, PAGE, Key, Row, cells, census, document, expected, faults, reasons

#: What was seen in the public captures, which are not part of this repository.
SHARED: Final = re.compile(r"\| \d+( / \d+ / \d+ \|)")


@pytest.fixture(scope="module")
def own() -> dict[Key, Row]:
    """The rows in the captures of this repository."""
    return census(None)


def masked(page: str) -> str:
    return SHARED.sub(r"| ?\1", page)


def test_the_page_is_what_the_captures_of_this_repository_say(own: dict[Key, Row]) -> None:
    told = PAGE.read_text(encoding="utf-8")
    assert masked(document(own)) == masked(told), (
        "run `python scripts/coverage_doc.py FOLDER > docs/coverage.md` with the folder of the public captures"
    )


def test_the_page_is_what_all_captures_say(corpus: Path) -> None:
    assert document(census(corpus)) == PAGE.read_text(encoding="utf-8")


def test_no_cell_is_empty_without_a_reason_and_no_reason_is_left_over(own: dict[Key, Row]) -> None:
    assert faults(own) == []


def test_faults_are_found(own: dict[Key, Row]) -> None:
    """A row that nothing shows, and one that needs its reason no more."""
    lost = {key: row for key, row in own.items() if key != ("Areas", "0x83 flags (bit memory)")}
    assert [fault for fault in faults(lost) if "0x83 flags" not in fault] == []
    assert len(faults(lost)) == 4
    section, name, column = next(key for key in reasons() if key[2] == "decoded" and key[0] == "Userdata")
    row = Row()
    row.layouts = {"something"}
    row.classes, row.fields, row.seen = own[section, name].classes, {"s7comm.x"}, [0, 0, 1]
    assert f"not needed: {(section, name, column)}" in faults({**own, (section, name): row})


def test_octets_without_a_meaning_are_not_taken_for_decoded() -> None:
    row = Row()
    row.layouts = {"programmer command"}
    row.octets = True
    assert cells("Userdata", "x", row)["decoded"] == ""


def test_every_reason_and_difference_is_about_a_row() -> None:
    rows = {(section, name) for section, names in expected().items() for name in names}
    assert {(section, name) for section, name, _ in reasons()} <= rows
    assert set(DIFFERENCES.values()) <= {entry.id for entry in KNOWN}
    for place, start in DIFFERENCES:
        assert any(section == place and name.startswith(start) for section, name in rows), start
