"""Listings, cross-reference and comparison of the code of carved blocks: joined with tags, callees and PLCs."""

from __future__ import annotations

import pytest

import dissect
from captures.craft.mc7 import DB2, OB1, OB1_CHANGED, Network, code_block
from dissect.engine.program.carved import CarvedBlock, block_of
from dissect.engine.program.compare import compare
from dissect.engine.transactions.naming import Naming
from dissect.meaning.report.words import Places
from dissect.meaning.tags.loading import load_tags
from dissect.output.carve.code import CodeListing, References, details_of
from dissect.output.carve.contents import block_values, tag_names
from dissect.wire.text import Clock
from tests.meaning.report.schemas import ROOT, complaints

VALVE = ROOT / "captures" / "tags" / "valve.csv"
#: An FC with an IN of INT, and a call of it that hands MW 4 on.
CALLED = code_block(0x0C, 9, [Network("FBC2 0002")], "0501")
CALLER = code_block(0x08, 1, [Network("FB70 0009 700B 0004 83000020")], "")


def listing(*blocks: CarvedBlock, language: str = "STL", naming: Naming | None = None) -> CodeListing:
    return CodeListing(blocks, Places([], False), Clock(), language, naming)


def lines(told: CodeListing | References) -> list[str]:
    return [line.text for line in told.text()]


def test_stl_and_awl_with_tags() -> None:
    naming = load_tags([VALVE]).naming()
    told = lines(listing(block_of(OB1), naming=naming))
    assert "       L     S5T#35S" in told
    assert "       T     MW 20                       // Heartbeat" in told
    assert "M2_1:  NOP   0" in told
    german = lines(listing(block_of(OB1), language="AWL"))
    assert "       U     E 0.0" in german
    assert "       SPBN  M2_1" in german


def test_values_of_a_data_block_by_declaration() -> None:
    told = lines(listing(block_of(DB2)))
    assert "    DB2.DBX0.0       STAT0.m0 : BOOL = TRUE" in told
    assert "    DB2.DBW4         STAT0.m3 : INT = 42" in told
    assert "    DB2.DBD16        STAT0.m7 : REAL = 1.250000e+001" in told
    assert "    DB2.DBB20        STAT0.m8 : STRING[6] = 'V-3'" in told


def test_what_cannot_be_read_is_said() -> None:
    raw = block_of(b"\1\2", "DB 7, passive")
    told = listing(raw, block_of(OB1[:50]))
    assert "nothing is read of the contents" in lines(told)[1]
    assert any([line.startswith("! ") and "of 140 bytes" in line for line in lines(told)])
    values = told.as_dict()
    assert values["not_read"] == ["DB7"]
    assert complaints("blocks-code", values, exact=True) == []
    assert len(list(told.rows())) > 5


def test_who_uses_what_and_calls_whom() -> None:
    told = References([block_of(OB1), block_of(OB1_CHANGED), block_of(DB2)])
    assert "MW 20                    write: OB1 network 2" in lines(told)
    assert "SFC46                    called by: OB1 network 3" in lines(told)  # the latest version counts
    assert "DB2.DBW 2                read: OB1 network 2" in lines(told)
    assert complaints("blocks-references", told.as_dict(), exact=True) == []
    assert ["", "SFC46", "call", "OB1", "3", "34"] in [list(row) for row in told.rows()]
    handed = lines(References([block_of(CALLER), block_of(CALLED)]))
    assert any([line.startswith("M 4.0") and "read: OB1 network 1" in line for line in handed])


def test_what_changed_in_words() -> None:
    before, after = [block_of(OB1)], [block_of(OB1_CHANGED)]
    details = details_of(before, after, "STL", None)
    (change,) = compare(before, after)
    texts = [one.text for one in details(change)]
    assert "L S5T#35S → S5T#10S" in [text.strip(": ") for text in texts]
    assert details(change) is details(change)
    (gone,) = compare(before, [])
    assert details(gone) == []


def test_names_of_places() -> None:
    name = tag_names(load_tags([VALVE]).naming())
    assert name(0x83, 0, 160, 16) == "Heartbeat"
    assert name(0x84, 2, 0, 8) == "Valve.open"
    assert name(0x84, 3, 0, 8) == ""
    assert tag_names(None)(0x83, 0, 160, 16) == ""


def test_what_is_too_much_is_not_decoded(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("dissect.output.carve.code.MAX_CODE", len(OB1) + 10)
    told = listing(block_of(OB1), block_of(OB1), block_of(OB1_CHANGED))
    assert len([line for line in lines(told) if line.startswith("NETWORK")]) == 4
    assert lines(told)[-1].startswith("  not decoded: the blocks of this run")
    assert told.as_dict()["not_read"] == ["OB1"]


def test_from_python_with_tags() -> None:
    program = ROOT / "captures" / "crafted" / "program.pcapng"
    found = dissect.blocks(program, tags=VALVE, where="kind == upload")
    assert [block.label for block in found] == ["OB1", "DB2", "OB1", "DB2"]
    values = {value.name: value.value for value in block_values(found[1]) if value.name}
    assert (values["Valve.pressure"], values["Valve.name"]) == (12.5, "V-3")
    assert block_values(found[0]) == []
    assert block_values(dissect.blocks(program)[1]) == []
