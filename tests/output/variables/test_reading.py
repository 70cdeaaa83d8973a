"""Values from Python: what is asked for, what is wrong with it, and tables of columns."""

from __future__ import annotations

import sys
from datetime import timedelta
from pathlib import Path
from typing import Any

import pytest

import dissect
from dissect.engine.pipeline import Options, Pipeline
from dissect.meaning.tags.loading import load_tags
from dissect.meaning.tags.naming import HostNaming
from dissect.output.variables.choosing import Known, WantedError, choose
from dissect.output.variables.collector import ValueCollector
from dissect.output.variables.model import SharedValue, ValueRow
from tests.cases import each
from tests.engine.transactions import talk as line
from tests.meaning.report.support import ROOT, begun, saved
from tests.output.variables.support import BIT, BYTE, INT, REAL, WORD, collected, db, reads, real, writes
from tests.properties.messages import Item


def capture(folder: Path) -> Path:
    """Write a capture with values of several types, the same address read as two of them."""
    talk = begun()
    reads(
        talk,
        1,
        (db(REAL, 0), real(1.5)),
        (db(BIT, 8), b"\1"),
        (db(INT, 10, 2), b"\0\1\xff\xff"),
        (db(WORD, 0), b"\1\2"),
    )
    reads(
        talk, 2, (db(REAL, 0), real(2.5)), (db(BIT, 8), b"\0"), (db(INT, 10, 2), b"\0\2\xff\xfe"), (db(BYTE, 20), b"\7")
    )
    writes(talk, 3, (db(REAL, 0), real(3.5), 0xFF))
    return saved(folder / "values.pcapng", talk.packets())


def test_tables_have_the_types_of_their_values(tmp_path: Path) -> None:
    tables = dissect.value_tables(dissect.values(capture(tmp_path)))
    kinds = {name: str(table.schema.field("value").type) for name, table in tables.items()}
    assert kinds == {
        "DB1.DBD0": "double",
        "DB1.DBX8.0": "bool",
        "DB1.DBW10": "list<item: int64>",
        "DB1.DBW0": "int64",
        "DB1.DBB20": "int64",
    }
    level = tables["DB1.DBD0"]
    assert level.column("value").to_pylist() == [1.5, 2.5, 3.5]
    assert level.column("how").to_pylist() == ["read", "read", "write"]
    assert str(level.schema.field("time").type) == "timestamp[ns, tz=UTC]"
    assert level.column("frame").to_pylist() == [9, 11, 12]
    assert level.schema.metadata[b"type"] == b"REAL"
    assert level.column("time").cast("int64").to_pylist() == sorted(level.column("time").cast("int64").to_pylist())


def test_two_types_at_one_address_are_two_tables(tmp_path: Path) -> None:
    talk = begun()
    reads(talk, 1, (db(WORD, 0), b"\1\2"), (db(INT, 0), b"\1\2"))
    path = saved(tmp_path / "two.pcapng", talk.packets())
    assert set(dissect.value_tables(dissect.values(path))) == {"DB1.DBW0 WORD", "DB1.DBW0 INT"}


def kinds_of(rows: list[ValueRow]) -> dict[str, tuple[str, list[object]]]:
    """The type and the values of the tables of rows."""
    return {
        name: (str(table.schema.field("value").type), table.column("value").to_pylist())
        for name, table in dissect.value_tables(rows).items()
    }


_LEAST, _MOST, _UNSIGNED = -(2**63), 2**63 - 1, 2**64 - 1


@each(
    ("values", "kind"),
    [
        ([_LEAST], "int64"), ([_MOST, _LEAST], "int64"), ([0, 1], "int64"), ([_MOST + 1], "uint64"), ([0, _UNSIGNED], "uint64"),
        ([[_LEAST, 5], [_MOST]], "list<item: int64>"), ([[_UNSIGNED]], "list<item: uint64>"),
        ([1, 2.5, None], "double"), ([_UNSIGNED, 0.5], "double"), ([2**53 + 1, 0.5], "double"),
        ([[1], [0.5]], "list<item: double>"), ([[2**53 + 1, 0.5], None], "list<item: double>"),
        ([True, None, False], "bool"), (["a", None], "string"), ([["a", "b"], None, []], "list<item: string>"),
        ([None], "string"), ([[]], "list<item: string>"),
    ],
)  # fmt: skip
def test_the_type_of_a_table_holds_each_of_its_values(values: list[Any], kind: str) -> None:
    """As double a whole number may lose digits; nothing raises."""
    ((said, found),) = kinds_of(rows_with(values)).values()
    assert said == kind
    if "double" in kind:
        values = [
            None if one is None else [*map(float, one)] if isinstance(one, list) else float(one) for one in values
        ]
    assert found == values


@each(
    "values",
    [[True, 1], [1, "x"], [[1], 2], [[1], ["x"]], [_LEAST, _UNSIGNED], [2**64], [[True, 5]],
     [[[1], [2]], ["x"]], [1.5, "x", None]],
)  # fmt: skip
def test_values_without_a_type_in_common_are_texts(values: list[object]) -> None:
    ((said, found),) = kinds_of(rows_with(values)).values()
    assert said == "string"
    assert found == [None if value is None else str(value) for value in values]


def rows_with(values: list[object]) -> list[ValueRow]:
    """Rows of one variable that have these values, whatever they are."""
    talk = begun()
    for ref in range(1, len(values) + 1):
        reads(talk, ref, (db(WORD, 0), bytes((0, ref))))
    rows = collected(ValueCollector(), talk.packets()).take()
    for row, value in zip(rows, values, strict=True):
        row._told = SharedValue(row.data, -1, value)
    return rows


def test_the_smallest_of_eight_bytes_is_a_number() -> None:
    for text, octets, expected in (
        ("DB1:0:LINT", b"\x80" + bytes(7), _LEAST), ("DB1:0:LINT", b"\xff" * 8, -1), ("DB1:0:ULINT", b"\xff" * 8, _UNSIGNED),
    ):  # fmt: skip
        talk = begun()
        reads(talk, 1, (db(BYTE, 0, 8), octets))
        rows = collected(ValueCollector(choose([text], Known(None))), talk.packets()).take()
        assert kinds_of(rows)["DB1.DBL0"][1] == [expected]


def test_each_table_has_a_name_of_its_own() -> None:
    """The address or tag; with the type where that is not enough, with the PLC where that is not either."""
    collector = ValueCollector()
    first = line.Talk()
    first.pipeline = Pipeline(collector, Options(strict=True))
    word = line.dbw(1, 0)
    for number, (host, vlan, items) in enumerate(
        ((2, 0, [word, line.item(0x84, 1, 0, INT), line.dbw(1, 8)]), (3, 0, [word]), (3, 7, [word]))
    ):
        talk = first if not number else line.Talk(50000 + number, beside=first)
        talk.hosts, talk.vlan = [1, host], vlan
        talk.open()
        talk.ask(line.read(1, *items))
        answers = b"".join([line.good(4, bytes((number, at))) for at in range(len(items))])
        talk.tell(line.ack_data(1, bytes((4, len(items))), answers))
    found = kinds_of(collector.take())
    assert {name: values for name, (_, values) in found.items()} == {
        "DB1.DBW0 INT": [1], "DB1.DBW8": [2], "DB1.DBW0 WORD 10.0.0.2:102": [0], "DB1.DBW0 WORD 10.0.0.3:102": [256],
        "DB1.DBW0 WORD 10.0.0.3:102 in VLAN 7": [512],
    }  # fmt: skip


def test_what_is_known_of_a_variable_is_beside_its_table(tmp_path: Path) -> None:
    tags = tmp_path / "tags.csv"
    tags.write_text("address,type,name,unit,scale\nDB1.DBW0,INT,Temp,°C,0.1\n", encoding="utf-8")
    talk = begun()
    reads(talk, 1, (db(INT, 0), b"\0\xd7"))
    naming = load_tags([tags]).naming()
    rows = collected(ValueCollector(), talk.packets(), Options(strict=True, naming=naming)).take()
    (table,) = dissect.value_tables(rows).values()
    assert {key.decode(): value.decode() for key, value in table.schema.metadata.items()} == {
        "plc": "10.0.0.2:102", "address": "DB1.DBW0", "tag": "Temp", "type": "INT", "unit": "°C",
    }  # fmt: skip
    assert table.column_names == ["time", "value", "how", "client", "connection", "frame", "certainty"]
    assert table.to_pylist()[0]["client"] == "10.0.0.1"
    assert (table.to_pylist()[0]["connection"], table.to_pylist()[0]["certainty"]) == (1, "sure")


def test_a_table_is_in_order_of_time() -> None:
    rows = rows_with([1, 2, 3])
    assert kinds_of([rows[2], rows[0], rows[1]])["DB1.DBW0"][1] == [1, 2, 3]


def test_what_to_install_is_said_without_pyarrow(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(sys.modules, "pyarrow", None)
    with pytest.raises(ImportError, match=r"^value_tables needs pyarrow: pip install 's7dissect\[data\]'$"):
        dissect.value_tables([])


def test_what_is_asked_for(tmp_path: Path) -> None:
    path = capture(tmp_path)
    assert [row.value for row in dissect.values(path, of="DB1.DBX8.0", changes=True)] == [True, False]
    assert [row.value for row in dissect.values(path, of="DB1.DBD0", where="function == write")] == [3.5]
    assert len(list(dissect.values(path, of=["DB1.DBD0", "DB1.DBB20"], every=timedelta(hours=1)))) == 2
    with pytest.raises(ValueError, match="expected a time above 0"):
        dissect.values(path, every=timedelta(0))
    with pytest.raises(
        WantedError, match=r"^Nonsense: not an address such as .*, and without tags= there are no names"
    ):
        dissect.values(path, of="Nonsense")
    with pytest.raises(dissect.SelectError):
        dissect.values(path, where="functoin == write")


@each(
    ("text", "address", "bits"),
    [
        ("DB10.DBD4", "DB10.DBD4", 32),
        ("db10.dbx4.1", "DB10.DBX4.1", 1),
        ("%MW20:INT", "MW20", 16),
        ("E 0.1", "I0.1", 1),
        ("DB10,REAL4", "DB10.DBD4", 32),
        ("DB1,INT0.3", "DB1.DBB0", 48),
        ("DB10,S20.30", "DB10.DBB20", 256),
        ("DB10.DBB0 x10", "DB10.DBB0", 80),
        ("T5", "T5", 16),
        ("C3", "C3", 16),
        ("DB4:140:STRING(10)", "DB4.DBB140", 96),
        ("M10.3", "M10.3", 1),
    ],
)
def test_addresses_of_all_dialects(text: str, address: str, bits: int) -> None:
    (wanted,) = choose([text], Known(None)).all
    assert (wanted.address, wanted.bits) == (address, bits)


def test_a_timer_is_found_by_its_number() -> None:
    talk = begun()
    reads(talk, 1, (Item(0x1D, 3, 0, 0x1D, 4), b"\0\x05\x12\x50\0\x07"))
    rows = collected(ValueCollector(choose(["T5"], Known(None))), talk.packets()).take()
    assert [(row.address, row.type, row.value) for row in rows] == [("T5", "TIMER", "S5T#25s")]


def test_tags_of_one_plc_are_not_looked_for_on_others(tmp_path: Path) -> None:
    mine, other = tmp_path / "mine.csv", tmp_path / "other.csv"
    mine.write_text("address,type,name\nDB1.DBD0,REAL,Level\n", encoding="utf-8")
    other.write_text("address,type,name\nDB1.DBW0,WORD,Level\n", encoding="utf-8")
    talk = begun()
    reads(talk, 1, (db(REAL, 0), real(1.5)))
    for host, expected in (("10.0.0.2", [("REAL", 1.5)]), ("10.0.0.9", [("WORD", 0x3FC0)])):
        naming = HostNaming({host: load_tags([mine]).naming()}, load_tags([other]).naming())
        collector = ValueCollector(choose(["Level"], Known(naming)))
        rows = collected(collector, talk.packets(), Options(strict=True, naming=naming)).take()
        assert [(row.type, row.value) for row in rows] == expected, host


def test_tables_of_one_name_are_numbered(tmp_path: Path) -> None:
    """Pieces of a tag have its name, type and PLC."""
    tags = tmp_path / "tags.csv"
    tags.write_text("address,type,name\nDB1.DBD0,REAL,Level\n", encoding="utf-8")
    talk = begun()
    reads(talk, 1, (db(BYTE, 0, 2), b"\1\2"), (db(BYTE, 2, 2), b"\3\4"), (db(REAL, 0), real(1.5)))
    options = Options(strict=True, naming=load_tags([tags]).naming())
    rows = collected(ValueCollector(), talk.packets(), options).take()
    assert {name: values for name, (_, values) in kinds_of(rows).items()} == {
        "Level REAL 10.0.0.2:102 1": [None], "Level REAL 10.0.0.2:102 2": [None], "Level REAL 10.0.0.2:102 3": [1.5],
    }  # fmt: skip


def test_likely_values_are_left_out_unless_they_are_asked_for() -> None:
    path = ROOT / "captures" / "crafted" / "certainty.pcapng"
    sure, all_of_them = list(dissect.values(path)), list(dissect.values(path, likely=True))
    assert {row.certainty for row in sure} == {"sure"}
    assert [row.value for row in all_of_them if not row.doubt] == [row.value for row in sure]
    assert {row.certainty for row in all_of_them} == {"sure", "likely"}


def test_values_at_one_time_are_all_there(tmp_path: Path) -> None:
    """A variable that a request names twice has two values, which only ``every`` makes one."""
    talk = begun()
    reads(talk, 1, (db(WORD, 0), b"\0\1"), (db(WORD, 0), b"\0\2"))
    path = saved(tmp_path / "twice.pcapng", talk.packets())
    assert [row.value for row in dissect.values(path)] == [1, 2]
    assert [row.value for row in dissect.values(path, every=timedelta(microseconds=1))] == [1]


@each("every_us", (1, 2, 1000, 1001, 999, 3_600_000_000))
def test_an_interval_ends_at_a_multiple_of_it(tmp_path: Path, every_us: int) -> None:
    """The last nanosecond before belongs to it, the first one behind to the next."""
    size = every_us * 1000
    talk = begun()
    for ref in range(1, 4):
        reads(talk, ref, (db(WORD, 0), bytes((0, ref))))
    *before, last = talk.packets()
    begin = (last.time_ns // size + 1) * size
    times = [begin, begin + size - 1, begin + size]
    exchanges = [*before, last][-6:]
    moved = [packet._replace(time_ns=times[at // 2]) for at, packet in enumerate(exchanges)]
    path = saved(tmp_path / "every.pcapng", [*before[:-5], *moved])
    assert [row.time_ns for row in dissect.values(path)] == times
    every = timedelta(microseconds=every_us)
    assert [row.time_ns for row in dissect.values(path, every=every)] == [begin, begin + size]
