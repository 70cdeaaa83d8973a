"""The code tables hold what the protocol reference holds: every number, under the same name."""

from __future__ import annotations

import csv
from pathlib import Path
from typing import Final

import pytest

from dissect.protocols.iso import tables as iso_tables
from dissect.protocols.s7 import errors, tables
from dissect.wire.codes import CodeTable


def tsv(path: Path) -> list[dict[str, str]]:
    with path.open(encoding="utf-8", newline="") as file:
        return list(csv.DictReader(file, delimiter="\t", quoting=csv.QUOTE_NONE))


#: Rows that we name otherwise than the reference, and why.
RENAMED: Final = {
    ("s7_functions", 0x00): "CPU services",  # that it heads userdata is said by the row's sentence
    ("s7_transport_sizes", 0x1E): "IEC TIMER/COUNTER",  # in capitals, as the other types are written
    ("s7_transport_sizes", 0x1F): "IEC COUNTER/TIMER",
}


def expected_names(rows: list[dict[str, str]], stem: str, number: str, name: str) -> dict[int, str]:
    return {int(row[number], 16): RENAMED.get((stem, int(row[number], 16)), row[name]) for row in rows}


@pytest.mark.parametrize(
    ("stem", "number", "name", "table"),
    [
        ("cotp_tpdu_types", "code", "abbr", iso_tables.TPDU_TYPES),
        ("cotp_parameters", "code", "name", iso_tables.PARAMETERS),
        ("cotp_dr_reasons", "hex", "name", iso_tables.DR_REASONS),
        ("s7_functions", "code", "name", tables.FUNCTIONS),
        ("s7_areas", "code", "name", tables.AREAS),
        ("s7_return_codes", "code", "name", tables.RETURN_CODES),
        ("s7_syntax_ids", "code", "name", tables.SYNTAX_IDS),
        ("s7_error_codes", "code", "short_name", errors.ERROR_CODES),
    ],
)
def test_table_is_the_reference(reference: Path, stem: str, number: str, name: str, table: CodeTable) -> None:
    assert table.names() == expected_names(tsv(reference / "tables" / f"{stem}.tsv"), stem, number, name)


@pytest.mark.parametrize(
    ("where", "table"), [("request", tables.TRANSPORT_SIZES), ("data", tables.DATA_TRANSPORT_SIZES)]
)
def test_transport_sizes_are_the_reference(reference: Path, where: str, table: CodeTable) -> None:
    rows = [row for row in tsv(reference / "tables" / "s7_transport_sizes.tsv") if row["where"] == where]
    assert table.names() == expected_names(rows, "s7_transport_sizes", "code", "name")


def test_element_sizes_are_the_reference(reference: Path) -> None:
    rows = [row for row in tsv(reference / "tables" / "s7_transport_sizes.tsv") if row["where"] == "request"]
    assert {
        int(row["code"], 16): int(row["element_octets"]) for row in rows if row["element_octets"].isdigit()
    } == tables.ELEMENT_OCTETS


def test_area_letters_and_block_types_are_the_reference(reference: Path) -> None:
    areas = tsv(reference / "tables" / "s7_areas.tsv")
    assert {int(row["code"], 16): row["short"] for row in areas} == tables.AREA_LETTERS
    blocks = tsv(reference / "tables" / "s7_block_types.tsv")
    assert {row["ascii"]: row["name"] for row in blocks} == tables.BLOCK_TYPES


def test_userdata_groups_are_the_reference(reference: Path) -> None:
    rows = tsv(reference / "tables" / "s7_userdata_subfunctions.tsv")
    assert {int(row["group"]): row["group_name"] for row in rows} == tables.USERDATA_GROUPS.names()
    expected: dict[int, dict[int, str]] = {}
    for row in rows:
        expected.setdefault(int(row["group"]), {})[int(row["subfunction"], 16)] = row["name"]
    assert {group: table.names() for group, table in tables.USERDATA_SUBFUNCTIONS.items()} == expected


#: What requests do, where our tables are finer than the classes of the reference.
FINER = {
    tables.ALARM_CHANGE: {"write"}, tables.CLOCK: {"write"}, tables.CONTROL: {"control", "read"},
    tables.DEBUG: {"debug", "control"},
    tables.FLASH: {"control"}, tables.FORCE: {"write", "debug"}, tables.MEMORY: {"destructive"},
    tables.ROUTING: {"session", "read/write"}, tables.TEST: {"debug", "read"},
    tables.TRANSFER: {"program change", "program read"},
}  # fmt: skip


def test_what_userdata_does_is_the_reference(reference: Path) -> None:
    for row in tsv(reference / "tables" / "s7_userdata_subfunctions.tsv"):
        code = tables.USERDATA_SUBFUNCTIONS[int(row["group"])].get(int(row["subfunction"], 16))
        assert code is not None
        assert row["security_class"] in FINER.get(code.effect, {code.effect}), row["name"]
        assert code.text.casefold() == f"{row['direction']}."
