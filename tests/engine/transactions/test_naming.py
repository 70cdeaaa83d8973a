"""What a request is about, in words: its items with their values, by tags or addresses, as many as fit a line."""

from __future__ import annotations

import struct
from pathlib import Path
from typing import Any

import pytest

from dissect.engine.pipeline import Options, Pipeline
from dissect.engine.transactions.naming import (
    NamedValue,
    Naming,
    item_subject,
    items_said,
    named_items,
    named_values,
    plain,
    subject,
)
from dissect.engine.transactions.naming import written as written_tag
from dissect.engine.transactions.probes import Probes
from dissect.engine.transactions.transaction import Transaction
from dissect.meaning.tags.loading import load_tags
from dissect.protocols.s7.values import Value
from tests.cases import each
from tests.engine.transactions.talk import Talk, ack_data, dbw, good, item, read, words, write, written

TAGS = "address,type,name,unit,scale\nDB1.DBW0,INT,Temp,°C,0.1\nDB1.DBW2,WORD,Mode,,\nDB1.DBB4,String[6],Name,,\n"


def one(asked: bytes, told: bytes, folder: Path | None = None) -> Transaction:
    """Return the transaction of a request and its answer; with a folder where tags are known."""
    talk = Talk()
    if folder is not None:
        (folder / "tags.csv").write_text(TAGS, encoding="utf-8")
        talk.pipeline = Pipeline(talk, Options(strict=True, naming=load_tags([folder / "tags.csv"]).naming()))
    talk.open()
    talk.ask(asked)
    talk.tell(told)
    return talk.transactions[0]


def wrote(*items: tuple[bytes, bytes], folder: Path | None = None) -> Transaction:
    """Return the transaction of a write of items, each with its transport header and octets."""
    data = b"".join([content + bytes(len(content) % 2) for _, content in items])
    return one(
        write(1, [place for place, _ in items], data), ack_data(1, bytes((5, len(items))), b"\xff" * len(items)), folder
    )


def word(value: int) -> bytes:
    return written(4, value.to_bytes(2, "big"))


def test_a_read_is_said_by_its_items() -> None:
    assert subject(one(read(1, dbw(1, 0), dbw(2, 4, 3)), words(1, 1))) == "Read Var DB1.DBW0, DB2.DBW4 x3"


def test_a_write_is_said_with_its_values() -> None:
    assert subject(wrote((dbw(1, 0), word(7)))) == "Write Var DB1.DBW0 = 7"
    three = [(dbw(1, 2 * at), word(at)) for at in range(3)]
    assert subject(wrote(*three)) == "Write Var DB1.DBW0 = 0, DB1.DBW2 = 1, DB1.DBW4 = 2"
    said = subject(wrote(*three, (dbw(1, 6), word(3)), (dbw(1, 8), word(4))))
    assert said == "Write Var DB1.DBW0 = 0, DB1.DBW2 = 1, DB1.DBW4 = 2 and 2 more"


@each(
    ("place", "content", "said"),
    [
        (item(0x84, 1, 0, 2, 8), written(4, bytes(range(8))), "DB1.DBB0 x8 = 00 01 02 03 04 05 06 07"),
        (item(0x84, 1, 0, 2, 9), written(4, bytes(range(9))), "DB1.DBB0 x9 = 00 01 02 03 04 05 06 07 …"),
        (item(0x84, 1, 0, 2, 1), written(4, b"\x05"), "DB1.DBB0 = 5"),
        (item(0x84, 1, 0, 1, 1), written(3, b"\x01"), "DB1.DBX0.0 = true"),
        (item(0x84, 1, 0, 1, 1), written(3, b"\x00"), "DB1.DBX0.0 = false"),
        (item(0x84, 1, 0, 8, 1), written(7, struct.pack(">f", 2.5)), "DB1.DBD0 = 2.5"),
        (dbw(1, 0, 8), written(4, bytes(16)), f"DB1.DBW0 x8 = [{', '.join(['0'] * 8)}]"),
        (dbw(1, 0, 9), written(4, bytes(18)), f"DB1.DBW0 x9 = [{', '.join(['0'] * 8)}, …]"),
        (item(0x84, 1, 0, 3, 32), written(9, b"a" * 32), f"DB1.DBB0 x32 = '{'a' * 32}'"),
        (item(0x84, 1, 0, 3, 33), written(9, b"a" * 33), f"DB1.DBB0 x33 = '{'a' * 32}…'"),
    ],
)
def test_a_value_is_said_shortly(place: bytes, content: bytes, said: str) -> None:
    assert subject(wrote((place, content))) == f"Write Var {said}"


def test_tags_stand_for_addresses(tmp_path: Path) -> None:
    read_all = read(1, item(0x84, 1, 0, 2, 4))
    told = ack_data(1, b"\x04\x01", good(4, b"\0\xd7\0\3"))
    asked = one(read_all, told, tmp_path)
    assert subject(asked) == "Read Var Temp (DB1.DBW0), Mode (DB1.DBW2)"
    assert [(number, named.name, named.value) for number, named in named_values(asked)] == [
        (1, "Temp", 21.5),
        (1, "Mode", 3),
    ]
    assert [[named.name for named in some] for some in named_items(asked)] == [["Temp", "Mode"]]
    given = wrote((dbw(1, 0), word(215)), (dbw(1, 2), word(3)), (dbw(9, 0), word(1)), folder=tmp_path)
    assert subject(given) == "Write Var Temp = 21.5 °C (DB1.DBW0), Mode = 3 (DB1.DBW2), DB9.DBW0 = 1"
    assert [number for number, _ in named_values(given)] == [1, 2]
    assert named_items(one(read_all, told)) == []


@pytest.mark.parametrize("folder", [False, True])
def test_an_item_is_said_by_its_number(folder: bool, tmp_path: Path) -> None:
    given = wrote((dbw(1, 0), word(215)), (dbw(9, 0), word(1)), folder=tmp_path if folder else None)
    first = "Temp = 21.5 °C (DB1.DBW0)" if folder else "DB1.DBW0 = 215"
    assert [item_subject(given, number, "?") for number in range(4)] == ["?", first, "DB9.DBW0 = 1", "?"]
    assert item_subject(given, -1, "?") == "?"


@each(
    ("value", "expected"),
    [(None, None), (True, True), (5, 5), (2.5, 2.5), ("x", "x"), (b"\1\xff", "01 ff"), ((1, 2), "(1, 2)")],
)
def test_any_value_becomes_one_of_s7(value: Any, expected: object) -> None:
    assert plain(value) == expected


def test_probes_are_counted_with_the_first_and_the_last() -> None:
    one_side, other = Probes(), Probes()
    assert (bool(one_side), one_side.join(None), one_side.join(other)) == (False, one_side, one_side)
    one_side.add(5, 500, True)
    assert (one_side.frames, one_side.count, one_side.filled, bool(one_side)) == ([5], 1, 1, True)
    one_side.add(9, 900, False)
    assert (one_side.frames, one_side.count, one_side.filled, one_side.last_ns) == ([5, 9], 2, 1, 900)
    for frames, joined, last_ns in (
        ((2, 3), [2, 9], 900),
        ((6, 7), [5, 9], 900),
        ((6, 12), [5, 12], 1200),
        ((1, 20), [1, 20], 2000),
    ):
        first, second = Probes(), Probes()
        for frame in (5, 9):
            first.add(frame, frame * 100, False)
        for frame in frames:
            second.add(frame, frame * 100, True)
        assert first.join(second) is first
        assert (first.frames, first.count, first.filled, first.last_ns) == (joined, 4, 2, last_ns)
    empty = Probes().join(one_side)
    assert (empty.frames, empty.count, empty.last_ns) == ([5, 9], 2, 900)


def test_a_naming_of_nothing_names_nothing() -> None:
    """What a naming need not define."""
    naming = Naming()
    given = wrote((dbw(1, 0), word(215)))
    assert naming.of(given.connection) is naming
    assert (naming.program("10.0.0.2"), naming.named(given.s7_results[0])) == (None, [])
    assert items_said(naming, given.s7_results, True) == "DB1.DBW0 = 215"
    assert items_said(naming, given.s7_results, False) == "DB1.DBW0"


def test_a_named_value_shows_name_value_and_unit() -> None:
    one_value = NamedValue("Temp", "DB1.DBW0", "INT")
    assert (one_value.origin, one_value.whole, one_value.value, one_value.offset) == ("tag", True, None, 0)
    one_value.value, one_value.unit = 21.5, "°C"
    assert repr(one_value) == "NamedValue('Temp', 21.5, '°C')"


@each(
    ("value", "data", "unit", "said"),
    [
        (80.0, b"", "°C", "T = 80.0 °C (DB1.DBD4)"),
        (80.0, b"", "", "T = 80.0 (DB1.DBD4)"),
        (None, b"", "°C", "T (DB1.DBD4)"),
        (None, b"\x01\xff", "°C", "T = 01 ff (DB1.DBD4)"),
        ([1, 2], b"\0\1\0\2", "°C", "T = 00 01 00 02 °C (DB1.DBD4)"),
        (False, b"", "", "T = false (DB1.DBD4)"),
        ("", b"", "", "T = '' (DB1.DBD4)"),
    ],
)
def test_a_written_tag_is_said_with_its_value(value: Value, data: bytes, unit: str, said: str) -> None:
    tag = NamedValue("T", "DB1.DBD4", "REAL")
    tag.value, tag.data, tag.unit = value, data, unit
    assert written_tag(tag) == said


def test_an_item_without_address_is_said_by_nothing() -> None:
    talk = Talk()
    talk.open()
    talk.tell(words(5, 1))
    talk.finish()
    assert items_said(None, talk.transactions[0].s7_results, False) == ""
    assert item_subject(talk.transactions[0], 1, "here") == "here"


def test_as_many_items_are_said_as_asked_for() -> None:
    results = wrote(*[(dbw(1, 2 * at), word(at)) for at in range(4)]).s7_results
    assert items_said(None, results, False, 1) == "DB1.DBW0 and 3 more"
    assert items_said(None, results, False, 4) == "DB1.DBW0, DB1.DBW2, DB1.DBW4, DB1.DBW6"
