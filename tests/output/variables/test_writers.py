"""Rows as lines of text, JSON and CSV: each line of a made conversation, byte for byte, and values of every form."""

from __future__ import annotations

import csv
import io
import json
import math
from pathlib import Path
from typing import Any, Final

import pytest

from dissect.engine.transactions.results import GAPS
from dissect.meaning.report.words import Places
from dissect.meaning.tags.loading import load_tags
from dissect.output.variables import writers
from dissect.output.variables.choosing import Known, choose
from dissect.output.variables.collector import ValueCollector
from dissect.output.variables.model import ValueRow, Variable
from dissect.output.variables.summary import Summary, csv_rows, json_lines, text_lines
from dissect.output.variables.writers import (
    RowWriter,
    ValueCsv,
    ValueJsonl,
    ValueText,
    any_text,
    line_end,
    line_remarks,
    names_json,
    place_text,
    shown,
    typed_text,
    value_cell,
    value_line,
)
from dissect.packets.source.packet import SourceFile
from dissect.packets.tcp.stream import Endpoint
from dissect.wire.build import COMPILED
from dissect.wire.text import Clock
from tests.cases import each
from tests.meaning.report.support import ROOT, begun
from tests.output.variables.support import BIT, BYTE, INT, REAL, WORD, collected, db, reads, real, rows_of, writes
from tests.output.variables.test_collector import doubtful
from tests.output.variables.test_shortcuts import busy, rows_of_file

_PLC: Final = Endpoint(bytes((10, 0, 0, 2)), 102)
_DAY: Final = "2024-03-04"


def variable(type_: str = "", tag: str = "", unit: str = "", bytes_only: bool = False) -> Variable:
    made = Variable(_PLC, 0, "DB1.DBB0", type_, tag, unit)
    made.bytes_only = bytes_only
    return made


def tank(folder: Path) -> list[ValueRow]:
    """Rows of a tag with a unit that changes and stays, of octets between tags, and of a word that is written."""
    tags = folder / "tags.csv"
    tags.write_text('address,type,name,unit,scale\nDB1.DBW0,INT,"Temp, oil",°C,0.1\n', encoding="utf-8")
    talk = begun()
    reads(talk, 1, (db(INT, 0), b"\0\xd7"))
    reads(talk, 2, (db(INT, 0), b"\0\xd8"))
    reads(talk, 3, (db(INT, 0), b"\0\xd8"))
    reads(talk, 4, (db(BYTE, 0, 10), bytes(range(10))), (db(REAL, 40), real(0.5)))
    writes(talk, 5, (db(WORD, 20), b"\0\1", 0xFF))
    return rows_of(talk, naming=load_tags([tags]).naming())


def objects(writer: ValueJsonl) -> list[dict[str, Any]]:
    return [json.loads(str(line, "utf-8")) for line in writer.take() if isinstance(line, bytes)]


def test_lines_for_a_person(tmp_path: Path) -> None:
    writer = ValueText()
    writer.values(tank(tmp_path))
    times = ("08", "10", "12", "14", "14", "14", "15")
    frames = (9, 11, 13, 15, 15, 15, 16)
    what = (
        "read   Temp, oil (DB1.DBW0) INT = 21.5 °C",
        "read   Temp, oil (DB1.DBW0) INT = 21.6 °C  was 21.5 °C",
        "read   Temp, oil (DB1.DBW0) INT = 21.6 °C",
        "read   Temp, oil (DB1.DBW0) INT = 0.1 °C  was 21.6 °C",
        "read   DB1.DBB2 8 x BYTE = 02 03 04 05 06 07 08 09",
        "read   DB1.DBD40 REAL = 0.5",
        "write  DB1.DBW20 WORD = 1",
    )
    assert [getattr(line, "text", line) for line in writer.take()] == [
        f"{_DAY} 05:06:07.0{time}000 UTC  {frame:>6}  10.0.0.1 → 10.0.0.2:102  {said}"
        for time, frame, said in zip(times, frames, what, strict=True)
    ]


def test_lines_that_no_terminal_styles_are_bytes(tmp_path: Path) -> None:
    rows = tank(tmp_path)
    styled, plain = ValueText(), ValueText()
    plain.plain = True
    for writer in (styled, plain):
        writer.values(rows[:2])
        writer.values(rows[2:])
    assert plain.take() == [str(getattr(line, "text", line)).encode() for line in styled.take()]


def test_lines_of_json(tmp_path: Path) -> None:
    writer = ValueJsonl()
    writer.values(tank(tmp_path)[1:5])
    lines = objects(writer)
    second = {
        "schema": "s7dissect.value/1", "time": f"{_DAY}T05:06:07.010000000Z", "frame": 11, "connection": 1,
        "client": "10.0.0.1", "plc": "10.0.0.2:102", "how": "read", "address": "DB1.DBW0", "tag": "Temp, oil", "type": "INT",
        "unit": "°C", "value": 21.6, "previous": 21.5, "changed": True, "octets": "00d8", "remark": None,
    }  # fmt: skip
    assert list(lines[0].items()) == list(second.items())
    later = {"time": f"{_DAY}T05:06:07.012000000Z", "frame": 13}
    assert lines[1] == {**second, **later, "previous": 21.6, "changed": False}
    assert [line["octets"] for line in lines[2:]] == ["0001", "0203040506070809"]
    assert (lines[3]["value"], lines[3]["tag"], lines[3]["unit"]) == ([2, 3, 4, 5, 6, 7, 8, 9], None, None)
    assert (lines[3]["previous"], lines[3]["changed"]) == (None, None)


def test_rows_of_csv(tmp_path: Path) -> None:
    writer = ValueCsv()
    rows = tank(tmp_path)
    writer.values([])
    writer.values(rows[:3])
    writer.values(rows[3:])
    lines = [line.decode() for line in writer.take()]  # type: ignore[union-attr]
    start, ends = f"{_DAY}T05:06:07.0", "10.0.0.1,10.0.0.2:102"
    assert lines == [
        "time,frame,connection,client,plc,how,address,tag,type,value,value_text,unit,previous,changed,octets,remark,certainty,doubt",
        f'{start}08000000Z,9,1,{ends},read,DB1.DBW0,"Temp, oil",INT,21.5,,°C,,,00d7,,sure,',
        f'{start}10000000Z,11,1,{ends},read,DB1.DBW0,"Temp, oil",INT,21.6,,°C,21.5,true,00d8,,sure,',
        f'{start}12000000Z,13,1,{ends},read,DB1.DBW0,"Temp, oil",INT,21.6,,°C,21.6,false,00d8,,sure,',
        f'{start}14000000Z,15,1,{ends},read,DB1.DBW0,"Temp, oil",INT,0.1,,°C,21.6,true,0001,,sure,',
        f"{start}14000000Z,15,1,{ends},read,DB1.DBB2,,8 x BYTE,02 03 04 05 06 07 08 09,,,,,0203040506070809,,sure,",
        f"{start}14000000Z,15,1,{ends},read,DB1.DBD40,,REAL,0.5,,,,,3f000000,,sure,",
        f"{start}15000000Z,16,1,{ends},write,DB1.DBW20,,WORD,1,,,,,0001,,sure,",
    ]


def as_dicts(writer: RowWriter, rows: list[ValueRow]) -> list[dict[str, str]]:
    writer.values(rows)
    text = "\n".join([line.decode() if isinstance(line, bytes) else str(line) for line in writer.take()])
    return list(csv.DictReader(io.StringIO(text)))


def odd_rows() -> list[ValueRow]:
    """A place of which a part passed, and one of a transaction that is only likely."""
    talk = begun()
    reads(talk, 1, (db(BYTE, 0, 2), b"\x01\x02"))
    reads(talk, 2, (db(BYTE, 1, 2), b"\x09\x09"))
    reads(talk, 3, (db(BYTE, 0), b"\x05"))
    return doubtful(ValueCollector(choose(["DB1.DBW0"], Known(None)), likely=True), talk, 3)


def test_what_is_odd_about_a_value_is_said_in_every_form() -> None:
    whole, likely, pieced = odd_rows()
    part = "only a part of its bytes passed"
    assert [line_remarks(row) for row in (whole, likely, pieced)] == [
        "", f"  [{part}]  (likely: gaps in both directions)", f"  [{part}]",
    ]  # fmt: skip
    text = ValueText()
    text.values([whole, likely, pieced])
    assert [str(getattr(line, "text", line)).partition("DB1.DB")[2] for line in text.take()] == [
        "B0 2 x BYTE = 01 02", f"B0 2 x BYTE = 01 09  was 01 02  [{part}]  (likely: gaps in both directions)",
        f"B0 2 x BYTE = 05 02  was 01 02  [{part}]",
    ]  # fmt: skip
    lines = ValueJsonl()
    lines.values([whole, likely, pieced])
    said = objects(lines)
    assert [line["remark"] for line in said] == [None, part, part]
    assert [(line.get("certainty"), line.get("doubt")) for line in said] == [
        (None, None), ("likely", "gaps"), (None, None),
    ]  # fmt: skip
    cells = as_dicts(ValueCsv(), [whole, likely, pieced])
    assert [(row["remark"], row["certainty"], row["doubt"]) for row in cells] == [
        ("", "sure", ""), (part, "likely", "gaps"), (part, "sure", ""),
    ]  # fmt: skip


def test_a_remark_on_a_part_of_a_tag(tmp_path: Path) -> None:
    tags = tmp_path / "tags.csv"
    tags.write_text("address,type,name\nDB1.DBD0,REAL,Level\n", encoding="utf-8")
    talk = begun()
    reads(talk, 1, (db(BYTE, 0, 2), b"\x40\x60"))
    (row,) = rows_of(talk, naming=load_tags([tags]).naming())
    assert line_end(row, "Level") == "Level = 40 60  [bytes 0 to 1 of 4]"
    (cells,) = as_dicts(ValueCsv(), [row])
    assert (cells["value"], cells["octets"], cells["remark"]) == ("", "4060", "bytes 0 to 1 of 4")
    lines = ValueJsonl()
    lines.values([row])
    (said,) = objects(lines)
    assert (said["value"], said["octets"], said["remark"]) == (None, "4060", "bytes 0 to 1 of 4")


def test_a_remark_on_a_value_without_octets_is_only_said_where_there_is_no_value() -> None:
    """As of SCD: there the text of the value says it already."""
    (row,) = odd_rows()[:1]
    for value, data, expected in (
        (1, None, ""), (None, None, "  [late]"), (1, b"\1", "  [late]"), (None, b"\1", "  [late]"),
    ):  # fmt: skip
        row._told = type(row._told)(data, -1, value)
        row.remark = "late"
        assert line_remarks(row) == expected, (value, data)


def test_a_line_made_alone_is_that_of_a_writer() -> None:
    """Other faces ask for the line of one row: it is made in another way, and says the same."""
    seen = 0
    for rows in (busy(5).packets(), None):
        made = (
            collected(ValueCollector(), rows).take()
            if rows is not None
            else rows_of_file(ROOT / "captures" / "crafted" / "plus-plant.pcapng")
        )
        writer = ValueText()
        writer.values(made)
        lines = [str(getattr(line, "text", line)) for line in writer.take()]
        assert lines == [value_line(row, Clock(), Places([], False)) for row in made]
        seen += len(lines)
    assert seen > 400


def test_rows_of_several_files_name_theirs(tmp_path: Path) -> None:
    rows = tank(tmp_path)[:3]
    files = [SourceFile("one, two.pcap", 1), SourceFile("b.pcap", 11)]
    places = Places(files, True)
    writer = ValueText()
    writer.places = places
    writer.values(rows)
    marks = [str(getattr(line, "text", line)).partition("UTC")[2].partition("10.0.0.1")[0] for line in writer.take()]
    assert marks == [f"  {places.mark(frame):>6}  " for frame in (9, 11, 13)]
    assert len(set(marks)) == 3
    table = ValueCsv()
    table.places = places
    cells = as_dicts(table, rows)
    assert list(cells[0])[:4] == ["time", "frame", "file", "connection"]
    assert [(row["frame"], row["file"]) for row in cells] == [("9", "one, two.pcap"), ("1", "b.pcap"), ("3", "b.pcap")]
    lines = ValueJsonl()
    lines.places = places
    lines.values(rows)
    said = objects(lines)
    assert [(line["frame"], line["file"]) for line in said] == [(9, "one, two.pcap"), (1, "b.pcap"), (3, "b.pcap")]
    assert list(said[0])[2:4] == ["frame", "file"]


def test_a_summary_in_each_form_is_what_its_module_makes() -> None:
    talk = begun()
    reads(talk, 1, (db(BIT, 0), b"\1"), (db(BYTE, 4, 2), b"\1\2"))
    whole = Summary(collected(ValueCollector(sums=True), talk.packets()))
    text, lines, table = ValueText(), ValueJsonl(), ValueCsv()
    for writer in (text, lines, table):
        writer.summary(whole)
    assert [row.text for row in text.take()] == [row.text for row in text_lines(whole, Clock(), Places([], False))]  # type: ignore[union-attr]
    assert lines.take() == json_lines(whole)
    assert list(csv.reader(io.StringIO("\n".join(map(str, table.take()))))) == list(csv_rows(whole))


def test_hosts_have_the_names_that_are_known() -> None:
    talk = begun()
    reads(talk, 1, (db(BIT, 0), b"\1"))
    rows = rows_of(talk)
    for hosts, expected in (
        ({"10.0.0.1": "panel"}, "panel → 10.0.0.2:102"), ({"10.0.0.2": "press"}, "10.0.0.1 → press:102"),
    ):  # fmt: skip
        writer = ValueText()
        writer.places = Places([], False, hosts)
        writer.values(rows)
        (line,) = writer.take()
        assert f"  {expected}  read   DB1.DBX0.0 BOOL = true" in str(getattr(line, "text", line))


@pytest.mark.skipif(COMPILED, reason="compiled constants cannot be changed")
@pytest.mark.parametrize("writer", [ValueText, ValueJsonl, ValueCsv])
def test_what_a_writer_forgets_changes_no_line(writer: type[RowWriter], monkeypatch: pytest.MonkeyPatch) -> None:
    rows = collected(ValueCollector(), busy(7).packets()).take()[:200]
    whole = writer()
    whole.values(rows)
    expected = whole.take()
    monkeypatch.setattr(writers, "_MAX_CACHED", 3)
    small = writer()
    small.values(rows)
    assert small.take() == expected
    assert len(small._written) <= 3


@each(
    ("made", "value", "data", "text", "expected"),
    [
        (variable("INT"), 7, b"\0\7", "", "7"),
        (variable("INT", unit="°C"), 7, b"\0\7", "", "7 °C"),
        (variable("INT", unit="u" * 30), 7, b"\0\7", "", f"7 {'u' * 20}… (30 characters)"),
        (variable("INT"), 7, None, "on", "7 (on)"),
        (variable("INT", unit="V"), 7, None, "on", "7 V (on)"),
        (variable("INT"), None, None, "", "-"),
        (variable("INT"), None, b"\0\7\x80", "", "00 07 80"),
        (variable("4 x BYTE", bytes_only=True), [1, 2, 3, 4], bytes((1, 2, 3, 4)), "", "01 02 03 04"),
        (variable("Struct"), {"members": {"level": 1.5}}, None, "", "{level: 1.5}"),
        (variable("Struct"), {"kind": "Ö", "members": 5}, None, "", '{"kind": "Ö", "members": 5}'),
        (variable("Blob"), "0a14", None, "", "0a 14"),
        (variable("WString"), "0a14", None, "", "'0a14'"),
        (variable("BOOL"), True, b"\1", "", "true"),
        (variable(), 1 + 2j, None, "", "(1+2j)"),
        (variable("Array"), [1, 2], None, "", "[1, 2]"),
    ],
)
def test_a_value_for_a_person(made: Variable, value: object, data: bytes | None, text: str, expected: str) -> None:
    assert shown(made, value, data, text) == expected


def test_a_long_value_is_shortened() -> None:
    said = shown(variable("Struct"), {"members": {f"member{at}": at for at in range(100)}}, None)
    assert said.startswith("{member0: 0, member1: 1, ")
    assert len(said.partition("…")[0]) == 200
    assert len(said) < 230


@each("writer", (ValueText, ValueJsonl, ValueCsv))
def test_rows_that_are_written_are_a_choice_of_all(writer: type[RowWriter]) -> None:
    """A row without a change need not follow the one that has the same value: it may be left out, as a filter does."""
    rows = collected(ValueCollector(), busy(9).packets()).take()
    steady = [row for row in rows if not row.changed]
    assert len({(row.variable, row.data) for row in steady}) > 20
    for chosen in (steady, steady[::2], rows[::3], rows[::-1]):
        together = writer()
        together.values(chosen)
        lines = together.take()[-len(chosen) :]
        alone = []
        for row in chosen:
            one = writer()
            one.values([row])
            alone += one.take()[-1:]
        assert lines == alone


@each(
    ("value", "expected"),
    [
        (None, "null"), (True, "true"), (7, "7"), (1.5, "1.5"), ("a\x7fb", '"a\\u007fb"'), ([], "[]"),
        ([0, 255, 256, -1], "[0,255,256,-1]"), ([True, False], "[true,false]"), ([1.5, None, "x"], '[1.5,null,"x"]'),
        (math.nan, '"nan"'), ([math.inf, -math.inf], '["inf","-inf"]'),
        ([[1, 2], [3]], "[[1,2],[3]]"), ({"a": [1, {"b": "\x7f"}]}, '{"a":[1,{"b":"\\u007f"}]}'),
    ],
)  # fmt: skip
def test_any_value_as_json(value: object, expected: str) -> None:
    assert any_text(value) == expected


def test_a_variable_in_words_and_cells() -> None:
    assert place_text(variable()) == "DB1.DBB0"
    assert place_text(variable(tag="Level")) == "Level (DB1.DBB0)"
    assert place_text(variable(tag="t" * 100)) == f"{'t' * 100} (DB1.DBB0)"
    assert place_text(variable(tag="t" * 101)) == f"{'t' * 100}… (101 characters) (DB1.DBB0)"
    assert shown(variable("INT"), 7, None, "t" * 101) == f"7 ({'t' * 100}… (101 characters))"
    assert (typed_text(variable("BYTE")), typed_text(variable())) == ("DB1.DBB0 BYTE", "DB1.DBB0")
    assert names_json(variable()) == ',"address":"DB1.DBB0","tag":null,"type":null,"unit":null'
    assert names_json(variable("REAL", "L", "m")) == ',"address":"DB1.DBB0","tag":"L","type":"REAL","unit":"m"'
    octets = variable("2 x BYTE", bytes_only=True)
    assert value_cell(octets, [1, 2], b"\1\2") == "01 02"
    assert value_cell(octets, [1, 2], None) == value_cell(variable(), [1, 2], b"\1\2") == "[1, 2]"
    assert value_cell(octets, None, b"\1\2") == ""
    assert value_cell(octets, 5, b"\5") == "5"


def test_a_mark_of_doubt_follows_a_value_that_did_not_change() -> None:
    talk = begun()
    for ref in (1, 2, 3):
        reads(talk, ref, (db(WORD, 0), b"\0\7"))
    rows = doubtful(ValueCollector(likely=True), talk, 3, flag=GAPS)
    text = ValueText()
    text.values(rows)
    assert [str(getattr(line, "text", line)).partition("WORD = ")[2] for line in text.take()] == [
        "7", "7  (likely: gaps in both directions)", "7",
    ]  # fmt: skip
    lines = ValueJsonl()
    lines.values(rows)
    assert [(line.get("certainty"), line.get("doubt"), line["remark"]) for line in objects(lines)] == [
        (None, None, None), ("likely", "gaps", None), (None, None, None),
    ]  # fmt: skip
    assert [(row["certainty"], row["doubt"], row["remark"]) for row in as_dicts(ValueCsv(), rows)] == [
        ("sure", "", ""), ("likely", "gaps", ""), ("sure", "", ""),
    ]  # fmt: skip
