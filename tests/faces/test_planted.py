"""A planted difference is found: in every cell of the table of facts, and in the words of every face."""

from __future__ import annotations

import copy
import json
import re
from collections.abc import Callable, Hashable, Iterator
from decimal import Decimal
from functools import cache
from itertools import islice
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any, Final

import pytest

from tests.faces.cells import Fact
from tests.faces.comparing import Cut, Difference, at, compare, value
from tests.faces.coverage import Watched
from tests.faces.facts import FACTS
from tests.faces.kinds import UNTOLD
from tests.faces.made import made
from tests.faces.reading import CAPTURES, Told, read
from tests.faces.records import FACES, Face, Record, cut

#: Captures that together fill nearly every cell.
NAMES: Final = (
    "item-errors.pcapng", "szl.pcapng", "transfer.pcapng", "plc-control.pcapng", "nodes7-poll.pcapng", "crafted/causes.pcapng",
    "crafted/certainty.pcapng", "crafted/endings.pcapng", "crafted/plus-plant.pcapng", "crafted/coverage-items.pcapng",
    "crafted/vlan.pcapng", "crafted/holes.pcapng", "crafted/refusals.pcapng", "crafted/cotp-refused.pcapng",
    "crafted/snaplen.pcapng", "scd/plant.pcapng", "program-python.pcapng", "blocks.pcapng", "crafted/negotiation.pcapng",
    "crafted/plc-asks.pcapng", "clock.pcapng",
    "crafted/plus-answers.pcapng", "multi-items.pcapng",
)  # fmt: skip

#: The capture that `tests.faces.made` makes.
MADE: Final = "made"


@cache
def told(name: str) -> Told:
    with TemporaryDirectory() as folder, TemporaryDirectory() as other:
        return read(CAPTURES / name if name != MADE else made(Path(other)), Path(folder))


@cache
def records(name: str) -> Cut:
    return cut(told(name))


# ---- in every cell --------------------------------------------------------------------------------------------------


def changed(value: Any) -> Iterator[Any]:
    """Yield other values of the same type: of a list and an object, one for each part of it."""
    if isinstance(value, bool):
        yield not value
    elif isinstance(value, (int, float)):
        yield value + 1_000_003
    elif isinstance(value, bytes):
        yield value + b"\x5a"
    elif isinstance(value, Decimal):
        yield value * 2 + 1
    elif isinstance(value, str) and value:
        yield from _changed_text(value)
    elif isinstance(value, list):
        for at_, one in enumerate(value):
            for other in changed(one):
                yield [*value[:at_], other, *value[at_ + 1 :]]
        yield [*value, value[0]] if value else ["planted"]
    elif isinstance(value, dict):
        for name, one in value.items():
            for other in changed(one):
                yield {**value, name: other}


def _changed_text(text: str) -> Iterator[str]:
    """Change a digit, so that a time stays a time and a number one, then add something in front and behind."""
    for found in re.finditer(r"\d", text):
        yield f"{text[: found.start()]}{'1' if found[0] != '1' else '2'}{text[found.end() :]}"
    yield f"planted {text}"
    yield f"{text},planted"


def planted(fact: Fact, face: Face, record: Record) -> Iterator[Record]:
    """Yield records with another value at one of the places that the cell reads."""
    seen: set[str] = set()
    value(fact, face, Watched(record, seen))
    for name in {
        place if place in record else place.partition(".")[0] for place in (fact.cells[face.name].path, *seen)
    }:
        for other in changed(record.get(name)):
            yield {**record, name: other}


#: Records that are tried for a cell, and of a capture: not each shows a difference, where a face tells only a part of the fact.
_TRIES: Final = 8
_OF_EACH: Final = 2


def filled(fact: Fact, face: Face) -> Iterator[tuple[Hashable, dict[str, Record]]]:
    """Yield records in which a face tells the fact, with those of the other faces that have it, from several captures."""
    faces = [one for one in FACES[fact.record] if one.name in fact.cells]
    for name in (MADE, *NAMES):
        both = records(name)
        left = _OF_EACH
        for key in reversed(both[fact.record, face.name]):
            theirs = {one.name: both[fact.record, one.name][key] for one in faces if key in both[fact.record, one.name]}
            told_ = [one for one in faces if one.name in theirs and value(fact, one, theirs[one.name]) is not UNTOLD]
            if not left:
                break
            if faces[0] in told_ and face in told_ and len(told_) > 1 and _has(fact, face, theirs[face.name]):
                left -= 1
                yield key, theirs


def _has(fact: Fact, face: Face, record: Record) -> bool:
    """Return whether a face has something where the cell says."""
    return at(record, fact.cells[face.name].path) is not None and value(fact, face, record) not in (None, [])


def shows(fact: Fact, face: Face) -> bool | None:
    """Return whether a difference planted in a cell is reported as one of its fact; None if no capture fills the cell."""
    faces = [one.name for one in FACES[fact.record] if one.name in fact.cells]
    tried = None
    for key, theirs in islice(filled(fact, face), _TRIES):
        tried = False
        for other in islice(planted(fact, face, theirs[face.name]), 4000):
            if _shown(fact, faces, key, theirs, face.name, other):
                return True
    return tried


def _shown(fact: Fact, faces: list[str], key: Hashable, theirs: dict[str, Any], face: str, other: Record) -> bool:
    said = {(fact.record, one): {key: found} for one, found in {**theirs, face: other}.items() if found is not None}
    try:
        before = _of(fact, {(fact.record, one): {key: found} for one, found in theirs.items() if found is not None})
        after = _of(fact, said)
    except (AssertionError, AttributeError, KeyError, OverflowError, TypeError, ValueError):
        return True  # what cannot be read at all is no agreement either
    return any([face in {one.face, faces[0]} for one in after if one not in before])


def _of(fact: Fact, both: Cut) -> list[Difference]:
    everything: Cut = {(kind, face.name): {} for kind, faces in FACES.items() for face in faces}
    return [one for one in compare({**everything, **both}, facts=[fact]) if one.fact == fact.name]


@pytest.mark.parametrize("record", FACES)
def test_a_difference_in_any_cell_is_found(record: str) -> None:
    """Every cell of every fact; the first face of a fact is planted in as well as the others."""
    shown = {
        (fact.record, fact.name, face.name): shows(fact, face)
        for fact in FACTS
        if fact.record == record
        for face in FACES[record]
        if face.name in fact.cells
    }
    assert sorted([cell for cell, found in shown.items() if found is False]) == []
    assert sorted([cell[1:] for cell, found in shown.items() if found is None]) == sorted(UNFILLED.get(record, ()))
    assert shown


#: Cells that no capture fills, by kind of record: fact and face (see `tests.faces.test_faces.UNSEEN`).
UNFILLED: Final[dict[str, tuple[tuple[str, str], ...]]] = {
    "operation": (("likely", "jsonl"),),
    "value": (("certainty", "jsonl"), ("doubt", "csv"), ("doubt", "jsonl"), ("doubt", "text")),
    "device": (("host_name", "csv"), ("host_name", "tables")),
}


# ---- in what a face writes ------------------------------------------------------------------------------------------


def in_lines(kind: str, form: str, old: str, new: str) -> Callable[[Told], None]:
    """Return what changes the first line of an output in which ``old`` stands."""

    def plant(one: Told) -> None:
        lines = one.lines[kind, form]
        number = next(number for number, line in enumerate(lines) if re.search(old, line))
        lines[number] = re.sub(old, new, lines[number], count=1)

    return plant


def in_rows(table: str, column: str, value: Any) -> Callable[[Told], None]:
    def plant(one: Told) -> None:
        one.rows[table][0][column] = value

    return plant


def in_document(
    name: str, change: Callable[[Record], None], wanted: Callable[[Record], bool] = bool
) -> Callable[[Told], None]:
    def plant(one: Told) -> None:
        change(next(found for found in one.documents[name] if wanted(found)))

    return plant


def in_fields(kind: str, field: str, value: str) -> Callable[[Told], None]:
    def plant(one: Told) -> None:
        one.things[kind][0][field] = value

    return plant


def _set(*path: str, to: Any) -> Callable[[Record], None]:
    def change(record: Record) -> None:
        inner = record
        for name in path[:-1]:
            inner = inner[name]
        inner[path[-1]] = to

    return change


#: What a face would write if it were wrong, by kind of record, fact and face; all in one capture, acts in another.
WRITTEN: Final[dict[tuple[str, str, str], Callable[[Told], None]]] = {
    ("capture", "packets", "text"): in_lines("analysis", "text", r"26 of 26 packets", "26 of 27 packets"),
    ("capture", "with_errors", "text"): in_lines("analysis", "text", r"^(Transactions.*)7 with errors", r"\g<1>8 with errors"),
    ("capture", "total", "json"): in_lines("analysis", "json", r'"total": 8', '"total": 9'),
    ("function", "most", "text"): in_lines("analysis", "text", r"(Read Var .*)80 µs", r"\g<1>81 µs"),
    ("slug", "count", "text"): in_lines("analysis", "text", r"item_error \(13 times\)", "item_error (14 times)"),
    ("slug", "count", "tables"): in_rows("finding_counts", "events", 99),
    ("slug", "reports", "ecs"): in_document("ecs.finding_counts", _set("s7dissect", "reports", to=99)),
    ("slug", "count", "zeek"): in_document("zeek-json.s7comm_finding_count", _set("events", to=99)),
    ("act", "bytes", "tables"): in_rows("acts", "bytes", 99),
    ("act", "outcome", "zeek"): in_document("zeek-json.s7comm_act", _set("outcome", to="refused_")),
    ("detailed", "count", "tables"): in_rows("findings", "slug", "transaction.slow"),
    ("kind", "results", "tables"): in_rows("operations", "result", "failed"),
    ("connection", "ended", "text"): in_lines("analysis", "text", r"closed by the client", "reset by the client"),
    ("connection", "ended_by", "text"): in_lines("analysis", "text", r"closed by the client", "closed by the server"),
    ("connection", "pdu_length", "text"): in_lines("analysis", "text", r"PDU length 480,", "PDU length 240,"),
    ("connection", "answered", "tables"): in_rows("connections", "answered", 9),
    ("connection", "pdus", "ecs"): in_document("ecs.connections", _set("s7dissect", "pdus", to=99)),
    ("connection", "ended", "pytest"): lambda one: one.goldens[0].update(ended="reset"),
    ("connection", "answered", "screens"): lambda one: one.screens[0].update(answered="99"),
    ("connection", "called_tsap", "-Y"): in_fields("connection", "called_tsap", "02.00"),
    ("transaction", "outcome", "text"): in_lines("transactions", "text", r"Read Var  ", "Read Var  push  "),
    ("transaction", "latency", "text"): in_lines("transactions", "text", r"52 µs", "54 µs"),
    ("transaction", "time", "jsonl"): in_lines("transactions", "jsonl", r"05\.694416498Z", "05.694416499Z"),
    ("transaction", "latency", "csv"): in_lines("transactions", "csv", r",52263,", ",52264,"),
    ("transaction", "latency", "fields"): in_lines("transactions", "fields", r"\t52263\t(\d+)", "\t\\g<1>\t52264"),
    ("transaction", "failed", "zeek"): in_document("zeek-json.s7comm_transaction", _set("failed", to=True)),
    ("transaction", "reason", "ecs"): in_document("ecs.transactions", _set("s7dissect", "reason", to="hole")),
    ("transaction", "certainty", "tables"): in_rows("transactions", "certainty", "likely"),
    ("item", "return_code", "jsonl"): in_lines("transactions", "jsonl", r'"return_code":10', '"return_code":11'),
    ("item", "value", "csv"): in_lines("transactions", "csv", r",Success,3\.5,", ",Success,3.25,"),
    ("item", "value", "text"): in_lines("transactions", "text", r"DB2\.DBD16 = 3\.5", "DB2.DBD16 = 3.25"),
    ("item", "return_name", "text"): in_lines("transactions", "text", r"x4: Object does not exist", "x4: Invalid address"),
    ("item", "label", "tables"): in_rows("items", "address", "DB98.DBB0"),
    ("operation", "parts", "text"): in_lines("operations", "text", r"AmQ 1/1  done", "AmQ 1/1  3 transactions  done"),
    ("operation", "result", "jsonl"): in_lines("operations", "jsonl", r'"result":"done"', '"result":"refused"'),
    ("operation", "kind", "fields"): in_lines("operations", "fields", r"\tconnect\t", "\tupload\t"),
    ("operation", "octets", "tables"): in_rows("operations", "bytes", 7),
    ("finding", "detail", "text"): in_lines("analysis", "text", r"(item_error.*|Read Var) DB99", r"\g<1> DB98"),
    ("finding", "severity", "json"): in_lines(
        "analysis", "json", r'("slug": "transaction.item_error", "severity": )"warning"', r'\g<1>"note"'),
    ("finding", "frames", "tables"): in_rows("findings", "frames", [1]),
    ("finding", "time", "ecs"): in_document("ecs.findings", _set("@timestamp", to="2026-01-01T00:00:00.000000000Z")),
    ("finding", "sentence", "stix"): in_document("stix", _set("abstract", to="Nothing."), lambda one: one["type"] == "note"),
    ("finding", "slug", "-Y"): in_fields("finding", "slug", "transaction.slow"),
    ("value", "value", "text"): in_lines("values", "text", r"REAL = 3\.5", "REAL = 3.25"),
    ("value", "how", "csv"): in_lines("values", "csv", r",read,", ",write,"),
    ("value", "address", "jsonl"): in_lines("values", "jsonl", r'"address":"DB1\.', '"address":"DB3.'),
    ("value", "octets", "tables"): in_rows("values", "data", b"\x00"),
    ("device", "role", "text"): in_lines("devices", "text", r"127\.0\.0\.1  S7 server", "127.0.0.1  panel"),
    ("device", "answered", "text"): in_lines("devices", "text", r"8 answered", "9 answered"),
    ("device", "answered", "csv"): in_lines("devices", "csv", r",8,8,0,7,", ",8,9,0,7,"),
    ("device", "with_errors", "json"): in_lines("devices", "json", r'"with_errors": 7', '"with_errors": 6'),
    ("device", "median", "tables"): in_rows("devices", "median_ns", 1),
    ("pdu", "pdu_ref", "text"): in_lines("PDUs", "text", r"ref 0x0100", "ref 0x0101"),
    ("pdu", "function", "jsonl"): in_lines("PDUs", "jsonl", r'"code":240', '"code":241'),
    ("pdu", "time", "fields"): in_lines("PDUs", "fields", r"05\.694416498Z", "05.694416499Z"),
    ("pdu", "kind", "tables"): in_rows("pdus", "kind", "Userdata"),
    ("pdu", "rosctr_code", "zeek"): in_document("zeek-json.s7comm", _set("rosctr_code", to=9)),
}  # fmt: skip


@pytest.mark.parametrize("case", WRITTEN, ids=" ".join)
def test_a_difference_in_what_a_face_writes_is_found(case: tuple[str, str, str]) -> None:
    record, fact, _ = case
    one = copy.deepcopy(told("item-errors.pcapng" if record != "act" else "crafted/plus-plant.pcapng"))
    before = set(compare_all(one))
    WRITTEN[case](one)
    found = set(compare_all(one)) - before
    assert any([(told_[0], told_[1]) == (record, fact) for told_ in found]), sorted(map(str, found))


def compare_all(one: Told) -> Iterator[tuple[str, str, str, str]]:
    for found in compare(cut(one)):
        yield found.record, found.fact, found.face, json.dumps([repr(found.key), repr(found.first), repr(found.told)])


def test_something_is_planted_in_every_face() -> None:
    planted_in = {(record, face) for record, _, face in WRITTEN}
    faces = {(kind, face.name) for kind, some in FACES.items() for face in some}
    views = {(kind, face) for kind, face in faces if face in {"link", "listed", "report", "ending", "analysis"}}
    sums = {
        ("capture", "tables"),
        ("function", "json"),
        ("function", "tables"),
        ("slug", "json"),
        ("connection", "json"),
    }
    sums |= {(kind, face) for kind, face in faces if kind in {"detailed", "kind"}}
    assert faces - views - sums - planted_in == set()


def test_a_record_that_a_face_lacks_or_has_alone_is_found() -> None:
    for name in ("transactions", "connections", "findings", "operations", "items", "values", "devices", "pdus"):
        for change in (lambda rows: rows.pop(), lambda rows: rows.append({**rows[-1], **_other(rows[-1])})):
            one = copy.deepcopy(told("item-errors.pcapng"))
            change(one.rows[name])
            assert [found for found in compare(cut(one)) if not found.fact], name


def _other(row: Record) -> Record:
    """Return the key of a row as nobody has it."""
    names = ("transaction", "connection", "finding", "operation", "item", "frame", "address")
    return {name: next(changed(row[name])) for name in names if name in row}
