"""The table of fields: complete, documented, and of the names that the JSON contract uses."""

from __future__ import annotations

import re
import runpy
from typing import Final

from dissect.meaning.select import Where
from dissect.meaning.select.fields import FIELDS, NAMES, WIRESHARK
from dissect.meaning.select.things import KINDS
from tests.meaning.report.schemas import ROOT, load

#: Keys of a transaction that are no fields: what is joined, what names files, and headers that a field of their own has.
NOT_FIELDS: Final = frozenset(
    ("schema", "request_file", "response_file", "setup", "asks", "tells", "s7plus", "scd", "userdata")
)


def test_every_field_has_an_example_that_names_it() -> None:
    for field in FIELDS.values():
        assert field.name in field.example
        assert Where(field.example).texts == (field.example,)
        assert field.about.endswith(".")
        assert field.things, field.name
        assert set(field.getters) <= set(KINDS)


def test_names_are_those_of_the_json_contract() -> None:
    keys = set(load("transaction")["properties"]) - NOT_FIELDS
    assert {key for key in keys if key not in NAMES and f"{key}.name" not in NAMES} <= {"errors"}
    for key in ("address", "area", "db", "transport_size", "count", "return_code", "data", "value"):
        assert f"items.{key}" in NAMES
    operation = set(load("operation")["properties"]) & {"kind", "result", "subject", "duration_ns", "pushes", "octets"}
    assert operation <= NAMES.keys()
    assert {"slug", "severity", "kind", "connection", "frames", "time", "detail"} <= NAMES.keys()


def test_names_are_lower_case_and_given_once() -> None:
    names = [name for field in FIELDS.values() for name in (field.name, *field.also)]
    assert len(names) == len(set(names))
    assert all(name == name.lower() for name in names)
    assert set(WIRESHARK.values()) <= FIELDS.keys()
    assert not WIRESHARK.keys() & NAMES.keys()


def test_the_page_has_the_table() -> None:
    made = runpy.run_path(str(ROOT / "scripts" / "select_doc.py"))
    page = (ROOT / "docs" / "select.md").read_text(encoding="utf-8")
    assert made["document"](page) == page, "PYTHONPATH=. python scripts/select_doc.py"
    assert page.count("\n| `") > len(FIELDS)


def test_what_stands_for_tshark_and_zeek_can_be_asked_for() -> None:
    page = (ROOT / "docs" / "select.md").read_text(encoding="utf-8")
    rows = re.findall(r"^\|.*\|$", page.split("| an expression here |\n")[1], re.MULTILINE)
    told = [expression for row in rows for expression in re.findall(r"`(.*?)`", row.rstrip("|").rsplit("|", 1)[1])]
    assert len(told) > 15
    for expression in told:
        assert Where(expression).predicate("transaction") is not None, expression
    named = {row.split("`")[1].split(" ")[0] for row in rows if row.startswith("| `s7comm.")}
    assert named & WIRESHARK.keys(), "the names that -Y takes for Wireshark's"
