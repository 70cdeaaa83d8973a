"""Blocks of real projects: every self-check holds, and each is assembled to the octets it came from."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Final, NamedTuple

import pytest

from dissect.protocols.mc7.block import Block, parse_block
from dissect.protocols.mc7.checks import all_facts, calls
from dissect.protocols.mc7.code import jumps, unknown_octets
from dissect.protocols.mc7.instruction_tables import confidence
from dissect.protocols.mc7.source import assemble_block, block_source
from dissect.protocols.s7.blocks import FOOTER, HEADER


class Real(NamedTuple):
    """A block of a project, and which one that is."""

    project: str
    block: Block
    octets: bytes


def wrapped(row: dict[str, object]) -> bytes:
    """Return a stored block as it is transferred: with header and footer."""
    code, interface, additional = (bytes.fromhex(str(row[part])) for part in ("code", "ssb", "add"))
    size = HEADER.size + len(code) + len(interface) + len(additional) + FOOTER.size
    octets = (
        b"pp\x01\x01" + bytes((int(str(row["lang"])), int(str(row["t"])))) + int(str(row["num"])).to_bytes(2, "big")
    )
    octets += size.to_bytes(4, "big") + int(str(row["pw"])).to_bytes(4, "big") + bytes(12)
    # The local data are not stored with them: as many as any block may have.
    for length in (len(interface), len(additional), 0xFFFF, len(code)):
        octets += length.to_bytes(2, "big")
    checksum = int(str(row["ck"])) & 0xFFFF
    footer = bytes(16) + bytes.fromhex(str(row["name"])) + b"\x10\0" + checksum.to_bytes(2, "big") + bytes(8)
    return octets + code + interface + additional + footer


@pytest.fixture(scope="module")
def real(corpus: Path) -> list[Real]:
    path = corpus / "blocks" / "step7_project_blocks.jsonl"
    if not path.is_file():
        pytest.skip("no shared captures of blocks")
    rows = [json.loads(line) for line in path.read_text(encoding="utf-8").splitlines()]
    found = [(f"{row['repo']} {row['path']}", wrapped(row)) for row in rows]
    return [Real(project, parse_block(octets), octets) for project, octets in found]


def test_every_block_passes_every_check(real: list[Real]) -> None:
    assert len(real) == 167
    assert [(each.block.label, all_facts(each.block)) for each in real if all_facts(each.block)] == []
    assert sum(len(each.block.code) for each in real) == 129_150
    assert sum(len(each.block.instructions) for each in real) == 36_148
    assert sum(unknown_octets(each.block.instructions) for each in real) == 0
    assert sum(len(each.block.tables.networks) for each in real) == 1447
    assert sum(len(jumps(each.block.instructions)) for each in real) == 907
    assert sum(each.block.protected for each in real) == 10


#: Two blocks of one project that do not fit each other, because the project was stored between two edits: the caller, whom it
#: calls and where, parameters that are given and declared.
UNFIT: Final = [("UnitTest.zip", "FC1", "FC21", 252, 1, 3)]


def test_calls_fit_what_they_call(real: list[Real]) -> None:
    blocks = {(each.project, each.block.kind, each.block.number): each.block for each in real}
    unfit, seen = [], 0
    for each in real:
        for instruction, kind, number in calls(each.block):
            called = blocks.get((each.project, kind, number))
            if instruction.list is None or called is None:
                continue
            seen += 1
            given, declared = len(instruction.list) // 4, len(called.interface.parameters)
            if called.interface_octets and given != declared:
                where = (each.project.split()[0], each.block.label, called.label, instruction.offset)
                unfit.append((*where, given, declared))
    assert unfit == UNFIT
    assert seen > 300


def test_every_block_is_assembled_to_its_own_octets(real: list[Real]) -> None:
    for each in real:
        text = block_source(each.block)
        assert assemble_block(text) == each.octets, each.block.label


def test_only_words_that_were_met_are_there(real: list[Real]) -> None:
    words = {instruction.word for each in real for instruction in each.block.instructions}
    assert [hex(word) for word in sorted(words) if confidence(word >> 8, word & 0xFF) != "C"] == []
