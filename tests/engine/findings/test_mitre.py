"""The table of MITRE techniques: two lists of ids, nine of them different."""

from __future__ import annotations

import re

from dissect.engine.findings.mitre import TECHNIQUES, Technique
from tests.cases import each

#: v18 id → v19 id, from MITRE's crosswalk of 2026-04-28.
RENUMBERED = {
    "T0803": "T1691.001",
    "T0804": "T1691.002",
    "T0805": "T1695.001",
    "T0812": "T1694.001",
    "T0839": "T1693.002",
    "T0855": "T1692.001",
    "T0856": "T1692.002",
    "T0857": "T1693.001",
    "T0891": "T1694.002",
}


def test_the_renumbered_ones() -> None:
    assert {one.v18: one.v19 for one in TECHNIQUES.values() if one.v18 != one.v19} == RENUMBERED


def test_no_technique_stands_twice() -> None:
    for column in ("name", "v18", "v19"):
        values = [getattr(one, column) for one in TECHNIQUES.values()]
        assert len(values) == len(set(values)), column


@each("technique", TECHNIQUES.values())
def test_a_row(technique: Technique) -> None:
    assert TECHNIQUES[technique.key] is technique
    assert re.fullmatch(r"[a-z_]+", technique.key)
    assert re.fullmatch(r"T0[0-9]{3}", technique.v18)
    assert re.fullmatch(r"T0[0-9]{3}|T169[0-9]\.[0-9]{3}", technique.v19)
    assert ("crosswalk" in technique.source) == (technique.v18 != technique.v19)


def test_how_a_technique_is_told() -> None:
    moved, kept = TECHNIQUES["command_message"], TECHNIQUES["program_upload"]
    assert (moved.ids, kept.ids) == ("T0855 (v19: T1692.001)", "T0845")
    assert str(moved) == "Unauthorized Command Message T0855 (v19: T1692.001)"
    assert moved.as_dict() == {"name": "Unauthorized Command Message", "v18": "T0855", "v19": "T1692.001"}
