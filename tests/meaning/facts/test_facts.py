"""The tables of facts: each face of a moved record is made of its table, and of nothing beside it."""

from __future__ import annotations

import ast
import json
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Any, Final

import pytest

from dissect.meaning.facts.connection import CONNECTION
from dissect.meaning.facts.counted import COUNTED
from dissect.meaning.facts.device import AREA, MAC, MODULE, REASON
from dissect.meaning.facts.fact import CODE, KINDS, Fact
from dissect.meaning.facts.finding import FINDING
from dissect.meaning.facts.operation import ACT
from dissect.meaning.facts.pdu import ASKED
from dissect.meaning.facts.schema import MADE as MADE_OF
from dissect.meaning.facts.schema import TABLES, filled
from dissect.meaning.facts.transaction import ITEM
from dissect.meaning.facts.value import CLIENT
from dissect.meaning.facts.written import files_of
from dissect.output.export.tables import (
    ACTS,
    CONNECTIONS,
    DEVICES,
    FINDING_COUNTS,
    FINDINGS,
    ITEMS,
    OPERATIONS,
    PDUS,
    TRANSACTIONS,
    VALUES,
    Table,
)
from dissect.output.export.tables import TABLES as ALL
from tests.cases import each
from tests.meaning.report.schemas import NAMES, load
from tests.meaning.report.support import OWN, ROOT, of_files

RECORDS: Final[Mapping[str, Mapping[str, Fact[Any]]]] = {
    **TABLES,
    "act": ACT,
    "counted": COUNTED,
    "item": ITEM,
    "asked": ASKED,
    "client": CLIENT,
    "area": AREA,
    "mac": MAC,
    "module": MODULE,
    "reason": REASON,
}
#: The tables that are made of facts, and the functions that make JSON of them, with all texts that stand in these.
MADE: Final[tuple[tuple[Table, str], ...]] = (
    (CONNECTIONS, "connection"),
    (FINDINGS, "finding"),
    (OPERATIONS, "operation"),
    (ACTS, "act"),
    (FINDING_COUNTS, "counted"),
    (DEVICES, "device"),
    (TRANSACTIONS, "transaction"),
    (ITEMS, "item"),
    (VALUES, "value"),
    (PDUS, "pdu"),
)
WRITERS: Final = {
    ("dissect/meaning/report/contract.py", "connection_as_dict"): {"tls", "ending"},
    ("dissect/meaning/report/contract.py", "finding_as_dict"): set[str](),
    ("dissect/meaning/report/operations.py", "operation_json"): {
        "schema",
        "blocks",
        "oddities",
        "name",
        "detail",
        "frame",
    },
    ("dissect/output/export/rows.py", "connection"): set[str](),
    ("dissect/output/export/rows.py", "operation"): set[str](),
    ("dissect/output/export/rows.py", "act"): set[str](),
    ("dissect/output/export/rows.py", "finding_counts"): set[str](),
    ("dissect/meaning/inventory/contract.py", "device_as_dict"): {"blocks"},
    ("dissect/meaning/inventory/contract.py", "talk_as_dict"): set[str](),
    ("dissect/output/variables/summary.py", "variable_json"): {"schema", "first", "last"},
    ("dissect/output/export/rows.py", "device"): set[str](),
    ("dissect/output/export/rows.py", "finding"): {"client_host", "server_host"},
}


def texts_in(path: Path, name: str) -> set[str]:
    """Return the words that could be keys or columns in a function."""
    functions = [node for node in ast.walk(ast.parse(path.read_bytes())) if isinstance(node, ast.FunctionDef)]
    (found,) = [node for node in functions if node.name == name]
    constants = [node.value for part in found.body[1:] for node in ast.walk(part) if isinstance(node, ast.Constant)]
    return {text for text in constants if isinstance(text, str) and text.isidentifier()}


def test_facts_are_named_once_and_of_known_kinds() -> None:
    for record, facts in RECORDS.items():
        keys = [fact.key for fact in facts.values() if fact.key]
        assert len(set(keys)) == len(keys), record
        assert record not in TABLES or not set(keys) & set(files_of(facts)), record
        for name, fact in facts.items():
            assert fact.name == name
            assert fact.kind in KINDS, (record, name)
            assert bool(fact.codes) == (fact.kind == CODE), (record, name)
            assert fact.about.endswith((".", "…")), (record, name)


def test_every_table_is_made_of_facts() -> None:
    assert {table.name for table, _ in MADE} == set(ALL)


@pytest.mark.parametrize(("table", "record"), MADE, ids=[record for _, record in MADE])
def test_columns_are_those_of_facts(table: Table, record: str) -> None:
    facts = RECORDS[record]
    assert table.facts
    for fact in table.facts:
        assert facts[fact.name] is fact
    assert {column.source for column in table.columns} == {fact.name for fact in table.facts}


@pytest.mark.parametrize("place", WRITERS, ids=[name for _, name in WRITERS])
def test_nothing_stands_beside_the_table(place: tuple[str, str]) -> None:
    path, name = place
    assert texts_in(ROOT / path, name) == WRITERS[place]


def _made(written: Any, made: Any) -> Iterator[tuple[str, dict[str, Any], dict[str, Any]]]:
    """Yield the objects of a published schema that are made of a table: its name, the object as written, and as made."""
    if isinstance(written, dict):
        if MADE_OF in written:
            yield written[MADE_OF], written, made
            return
        for key, part in written.items():
            yield from _made(part, made[key])
    elif isinstance(written, list):
        for part, other in zip(written, made, strict=True):
            yield from _made(part, other)


def test_published_schemas_repeat_no_key_of_a_record() -> None:
    found = set()
    for home in NAMES:
        written = json.loads(
            (ROOT / "dissect" / "meaning" / "schema" / f"{home}.schema.json").read_text(encoding="utf-8")
        )
        for record, given, made in _made(written, load(home)):
            found.add(record)
            facts = TABLES[record]
            own = given.get("properties", {})
            assert set(own) <= {"schema"}
            keys = [*own, *[fact.key for fact in facts.values() if fact.key]]
            assert [key for key in made["properties"] if key not in files_of(facts)] == keys
            assert set(made["required"]) | {fact.key for fact in facts.values() if fact.rare} == set(keys)
    assert found == set(TABLES) - {"stretch"}  # which other tables name


def test_a_schema_keeps_what_is_written_beside_the_table() -> None:
    given = {"a": [{"title": "T", "required": ["schema"], "properties": {"schema": {"const": 1}}, "$made": "finding"}]}
    (made,) = filled(given)["a"]
    assert (made["title"], made["required"][:2]) == ("T", ["schema", "number"])
    assert list(made["properties"])[:2] == ["schema", "number"]
    assert made["properties"]["time"]["oneOf"][1] == {"type": "null"}
    assert "$made" not in made


@each("paths", [(path,) for path in OWN[::4]] + [(OWN[0], OWN[4])])
def test_json_has_the_keys_of_the_table_in_its_order(paths: tuple[Path, ...]) -> None:
    told = of_files(*paths).as_dict()
    tables: list[tuple[Any, str]] = [(CONNECTION, "connections"), (FINDING, "finding_details")]
    for facts, name in tables:
        records: Any = told[name]
        for record in records:
            files = files_of(facts)
            assert [key for key in record if key not in files] == [
                fact.key for fact in facts.values() if fact.key in record
            ]
            assert set(files) & set(record) == (set(files) if len(paths) > 1 else set())
            for fact in [fact for fact in facts.values() if fact.key]:
                assert fact.rare or fact.key in record
                assert not fact.codes or record[fact.key] in {*fact.codes, None}


#: The functions that make columns and tables, all of facts.
MAKERS: Final = {("Column", "_time"), ("Column", "_columns"), ("Table", "_of_facts")}


def test_no_column_is_made_but_of_a_fact() -> None:
    found = set()
    for path in sorted((ROOT / "dissect").rglob("*.py")):
        text = path.read_text(encoding="utf-8")
        if path.name != "tables.py" and "dissect.output.export.tables import" not in text:
            continue
        for function in [node for node in ast.walk(ast.parse(text)) if isinstance(node, ast.FunctionDef | ast.Module)]:
            name = function.name if isinstance(function, ast.FunctionDef) else ""
            inner = (
                function.body
                if name
                else [one for one in function.body if not isinstance(one, ast.FunctionDef | ast.ClassDef)]
            )
            calls = [node for part in inner for node in ast.walk(part) if isinstance(node, ast.Call)]
            made = {node.func.id for node in calls if isinstance(node.func, ast.Name)} & {"Column", "Table"}
            found |= {(one, name) for one in made}
    assert found == MAKERS
