"""The definition of the tables, and rows that keep to it."""

from __future__ import annotations

import struct
from pathlib import Path
from typing import Final

import pytest

import dissect
from dissect import analyze
from dissect.engine.pipeline import Options
from dissect.meaning.tags import load_tags
from dissect.output.export.tables import (
    BOOL,
    BYTES,
    INT,
    INTS,
    REAL,
    TABLES,
    TEXT,
    TIME,
    TYPES,
    WORD,
    WORDS,
    UnknownTableError,
    chosen_tables,
)
from tests.meaning.report.support import OWN, ROOT, begun, read, saved
from tests.output.export.support import rows_of
from tests.properties.messages import Item

_HOLDS: Final = {
    INT: int,
    REAL: float,
    BOOL: bool,
    TEXT: str,
    WORD: str,
    BYTES: bytes,
    INTS: list,
    WORDS: list,
}
CAPTURES: Final = ROOT / "captures"
#: Columns that none of our captures has a value of.
RARE: Final = {"name", "vlans", "announced_bytes", "unit", "remark", "host_name", "location", "plant", "vendor"}


def test_columns_are_named_once_and_have_known_types() -> None:
    for table in TABLES.values():
        names = [column.name for column in table.columns]
        assert len(set(names)) == len(names)
        assert {column.type for column in table.columns} <= set(TYPES)
        assert table.time in names
        for column in table.columns:
            assert column.about
            assert column.source
            assert (column.type == TIME) == bool(column.of)
            assert not column.of or column.of in names


def test_rows_of_every_capture_keep_to_their_types() -> None:
    seen: dict[str, set[str]] = {name: set() for name in TABLES}
    for path in OWN:
        for name, rows in rows_of(path).items():
            types = {column.name: _HOLDS[column.type] for column in TABLES[name].stored}
            for row in rows:
                for column, value in row.items():
                    if value is not None:
                        assert type(value) is types[column], (path.name, name, column, value)
                        seen[name].add(column)
    for name, columns in seen.items():  # each column has a value somewhere
        missing = {column.name for column in TABLES[name].stored} - columns
        assert missing <= RARE, (name, missing)


def test_counts_are_those_of_analyze() -> None:
    for path in OWN[::3]:
        rows, analysis = rows_of(path), analyze(path)
        assert len(rows["transactions"]) == analysis.total
        assert len(rows["connections"]) == len(analysis.connections)
        assert len(rows["findings"]) == len(analysis.findings) + len(analysis.explained)
        assert len(rows["operations"]) == sum(sum(counts.values()) for counts in analysis.operations.values())
        assert sum(row["failed"] for row in rows["transactions"]) == analysis.with_errors + analysis.missed
        assert sum(row["item_count"] for row in rows["transactions"]) == len(rows["items"])


def test_what_a_refused_read_says() -> None:
    rows = rows_of(CAPTURES / "item-errors.pcapng")
    (refused,) = [row for row in rows["items"] if row["transaction"] == 2]
    assert refused["address"] == "DB99.DBB0"
    assert (refused["area"], refused["db"], refused["byte"], refused["bit"]) == ("DB", 99, 0, 0)
    assert (refused["type"], refused["count"], refused["operation"]) == ("BYTE", 4, "read")
    assert (refused["return_code"], refused["return_name"]) == (0x0A, "Object does not exist")
    assert (refused["refused"], refused["data"]) == (True, None)
    (transaction,) = [row for row in rows["transactions"] if row["transaction"] == 2]
    assert transaction["errors"] == ["item 1 DB99.DBB0: Object does not exist"]
    assert transaction["latency_ns"] == transaction["response_ns"] - transaction["ts_ns"]
    assert (transaction["failed"], transaction["outcome"], transaction["item_count"]) == (True, "answered", 1)


def test_values_are_numbers_or_text_and_those_of_tags_have_their_unit() -> None:
    path = CAPTURES / "nodes7-write.pcapng"
    tags = Options(naming=load_tags([CAPTURES / "tags" / "valve.csv"]).naming())
    named = [row for row in rows_of(path, options=tags)["items"] if row["name"] == "Valve.pressure"]
    assert {(row["address"], row["number"], row["data"]) for row in named if row["operation"] == "write"} == {
        ("DB2.DBB16", 12.5, b"\x41\x48\x00\x00")
    }
    plain = [row for row in rows_of(path)["items"] if row["address"] == "DB2.DBB16"]
    assert plain
    assert {(row["name"], row["number"]) for row in plain} == {(None, None)}


def test_numbers_that_a_column_cannot_hold_are_there_as_text(tmp_path: Path) -> None:
    tags = tmp_path / "tags.csv"
    tags.write_text(
        "address,type,name\nDB1.DBL0,ULINT,Stamp\nDB1.DBL8,LINT,Small\nDB1.DBD16,Array[0..1] of REAL,Curve\n",
        encoding="utf-8",
    )
    talk = begun()
    read(talk, 2, Item(2, 8, 1, 0x84, 0), struct.pack(">Q", 2**63 + 1))
    read(talk, 3, Item(2, 8, 1, 0x84, 64), struct.pack(">q", -(2**53)))
    read(talk, 4, Item(2, 8, 1, 0x84, 128), struct.pack(">ff", float("inf"), float("nan")))
    capture = saved(tmp_path / "stamp.pcapng", talk.packets())
    for table in ("items", "values"):
        rows = rows_of(capture, options=Options(naming=load_tags([tags]).naming()))[table]
        assert [(row["number"], row["text"]) for row in rows] == [
            (float(2**63), "9223372036854775809"),
            (float(-(2**53)), None),
            (None, '["inf","nan"]'),
        ]


def test_values_are_those_of_the_command_and_follow_each_other() -> None:
    path = CAPTURES / "crafted" / "plus-plant.pcapng"
    rows = rows_of(path)["values"]
    assert len(rows) == len(list(dissect.values(path)))
    levels = [row for row in rows if row["name"] == 'DB1."level"' or row["address"] == 'DB1."level"']
    assert [row["number"] for row in levels][:2] == [levels[1]["previous_number"], levels[1]["number"]]
    tagged = Options(naming=load_tags([CAPTURES / "tags" / "valve.csv"]).naming())
    polled = rows_of(CAPTURES / "nodes7-poll.pcapng", options=tagged)["values"]
    pressures = [row for row in polled if row["name"] == "Valve.pressure"]
    assert {(row["number"], row["unit"], row["type"], row["operation"]) for row in pressures} == {(3.5, "bar", "REAL", "read")}
    assert [row["changed"] for row in pressures] == [None, False, False, False, False]


def test_devices_are_those_of_the_command() -> None:
    path = CAPTURES / "crafted" / "plus-plant.pcapng"
    rows, devices = rows_of(path)["devices"], list(dissect.devices(path))
    assert [(row["address"], row["role"]) for row in rows] == [(device.address, device.role) for device in devices]
    assert [row["firmware"] for row in rows if row["order_number"]] == ["V4.3"]
    assert all(row["ts_ns"] <= row["end_ns"] for row in rows)


def test_several_files_count_packets_of_their_own() -> None:
    pair = (CAPTURES / "transfer.pcapng", CAPTURES / "szl.pcapng")
    both, second = rows_of(*pair), rows_of(pair[1])
    theirs = [row for row in both["transactions"] if row["file"] == str(pair[1])]
    assert [row["request_frame"] for row in theirs] == [row["request_frame"] for row in second["transactions"]]
    assert {row["file"] for row in both["pdus"]} == {str(path) for path in pair}
    assert [row["uid"] for row in second["connections"]] == [row["uid"] for row in both["connections"]][-1:]


def test_wrong_names_are_told_with_the_nearest() -> None:
    assert [table.name for table in chosen_tables(["pdus", "items"])] == ["items", "pdus"]
    assert len(chosen_tables([])) == len(TABLES)
    with pytest.raises(UnknownTableError, match=r"no table 'item'\. Did you mean items"):
        chosen_tables(["item"])


def test_a_folder_without_s7_has_tables_without_rows(tmp_path: Path) -> None:
    empty = tmp_path / "empty.pcap"
    empty.write_bytes(bytes.fromhex("d4c3b2a1020004000000000000000000ffff000001000000"))
    assert not any(rows_of(empty).values())
