"""Values from Python: what is asked for, what is wrong with it, and tables of columns."""

from __future__ import annotations

import sys
from datetime import timedelta
from pathlib import Path

import pytest

import dissect
from dissect.engine.pipeline import Options
from dissect.meaning.tags.loading import load_tags
from dissect.meaning.tags.naming import HostNaming
from dissect.output.variables.choosing import Known, WantedError, choose
from dissect.output.variables.collector import Collector
from tests.cases import each
from tests.meaning.report.support import begun, saved
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
    rows = collected(Collector(choose(["T5"], Known(None))), talk.packets()).take()
    assert [(row.address, row.type, row.value) for row in rows] == [("T5", "TIMER", "S5T#25s")]


def test_tags_of_one_plc_are_not_looked_for_on_others(tmp_path: Path) -> None:
    mine, other = tmp_path / "mine.csv", tmp_path / "other.csv"
    mine.write_text("address,type,name\nDB1.DBD0,REAL,Level\n", encoding="utf-8")
    other.write_text("address,type,name\nDB1.DBW0,WORD,Level\n", encoding="utf-8")
    talk = begun()
    reads(talk, 1, (db(REAL, 0), real(1.5)))
    for host, expected in (("10.0.0.2", [("REAL", 1.5)]), ("10.0.0.9", [("WORD", 0x3FC0)])):
        naming = HostNaming({host: load_tags([mine]).naming()}, load_tags([other]).naming())
        collector = Collector(choose(["Level"], Known(naming)))
        rows = collected(collector, talk.packets(), Options(strict=True, naming=naming)).take()
        assert [(row.type, row.value) for row in rows] == expected, host
