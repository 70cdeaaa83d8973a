"""The code of blocks: listings, cross-reference, and changes from one version to another (`dissect.protocols.mc7`)."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from typing import Final

from dissect.engine.program.carved import CarvedBlock
from dissect.engine.program.compare import CHANGED, BlockChange, versions
from dissect.engine.transactions.naming import Naming
from dissect.meaning.report.outcome import WIDE_PAGE, Outcome
from dissect.meaning.report.plus_blobs import dictionaries
from dissect.meaning.report.styled import FAILED, HANG, HEADING, PLAIN, Line
from dissect.meaning.report.words import Places
from dissect.meaning.tags.model import place_text
from dissect.output.carve.contents import tag_names
from dissect.output.carve.listing import transfer_line
from dissect.output.carve.networks import NEEDS, compare_networks, compare_sections, interface, networks
from dissect.output.carve.records import digest
from dissect.protocols.mc7.block import Block, parse_block
from dissect.protocols.mc7.changes import Change, compare_blocks
from dissect.protocols.mc7.listing import STL, Lister, block_lines, block_values
from dissect.protocols.mc7.usage import cross_reference_lines, cross_reference_values
from dissect.protocols.mc7.values import DeclaredValue, block_data
from dissect.protocols.s7.tables import DB
from dissect.wire.text import Clock, cell, encodable, printable, shortened

CODE_SCHEMA: Final = "s7dissect.blocks-code/1"
REFERENCES_SCHEMA: Final = "s7dissect.blocks-references/1"
#: CSV columns: for code a row for each instruction, for the cross-reference a row for each use and call.
CODE_COLUMNS: Final = ("plc", "block", "network", "offset", "label", "name", "operand", "tag", "octets")
REFERENCE_COLUMNS: Final = ("plc", "address", "access", "block", "network", "offset")
#: Why the contents of a block are not read.
_NO_HEADER: Final = "  no block header: type and number are those of the request, nothing is read of the contents"
_PLUS: Final = "  the code that the CPU runs (MC7plus) is not shown: its encoding is not public"
#: Characters of the names of a section on a line.
_NAMES: Final = 400
_CALL: Final = "call"
#: Maximum size of the distinct blocks that are decoded in one run; decoded blocks take some fifty times the memory.
MAX_CODE: Final = 4 * 1024 * 1024
_TOO_MUCH: Final = f"  not decoded: the blocks of this run have more than {MAX_CODE // 1024} KiB together"
#: Bits of the types whose address has a width letter.
_WIDTHS: Final[dict[str, int]] = {
    "BOOL": 1,
    **dict.fromkeys(("WORD", "INT", "DATE", "S5TIME"), 16),
    **dict.fromkeys(("DWORD", "DINT", "REAL", "TIME_OF_DAY", "TIME"), 32),
}


class Programs:
    """The blocks of a set by PLC and label, each read once, so that a call finds the interface of the called block."""

    def __init__(self, blocks: Sequence[CarvedBlock]) -> None:
        self._read: dict[str, Block] = {}
        self._fitting: set[str] = set()
        room = MAX_CODE
        for block in blocks:
            key = digest(block)
            if block.classic is not None and key not in self._fitting and len(block.octets) <= room:
                room -= len(block.octets)
                self._fitting.add(key)
        self._latest = {key: row[-1] for key, row in versions(blocks, by_plc=True).items()}

    def read(self, block: CarvedBlock) -> Block:
        """Return a block as far as it can be read; the same object for the same octets."""
        key = digest(block)
        found = self._read.get(key)
        if found is None:
            found = parse_block(block.octets)
            self._read[key] = found
        return found

    def fits(self, block: CarvedBlock) -> bool:
        """Return whether a block is of S7-300/400 and is one of those that are decoded."""
        return block.classic is not None and digest(block) in self._fitting

    def find(self, plc: str, kind: str, number: int) -> Block | None:
        """Return the latest version of a block of a PLC; None if it was not captured."""
        block = self._latest.get((plc, f"{kind}{number}"))
        return self.read(block) if block is not None and self.fits(block) else None

    def lister(self, block: CarvedBlock, language: str, naming: Naming | None) -> Lister:
        """Return a lister for the code of a block, with the tags and the other blocks of its PLC."""
        operation = block.operation
        known = operation.connection.naming if operation is not None else naming
        return Lister(language, tag_names(known), lambda kind, number: self.find(block.plc, kind, number))

    def by_plc(self) -> dict[str, list[Block]]:
        """Return the latest version of each block that has code, by PLC."""
        found: dict[str, list[Block]] = {}
        for (plc, _), block in self._latest.items():
            if self.fits(block) and self.read(block).has_code:
                found.setdefault(plc, []).append(self.read(block))
        return found


def details_of(
    first: Sequence[CarvedBlock], second: Sequence[CarvedBlock], language: str, naming: Naming | None
) -> Callable[[BlockChange], list[Change]]:
    """Return a function that describes the changes of a block between two sets; its result is empty for unreadable blocks."""
    programs = Programs([*first, *second])
    known: dict[int, list[Change]] = {}

    def details(change: BlockChange) -> list[Change]:
        was, now = change.was, change.now
        if was is None or now is None or change.state != CHANGED:
            return []
        if was.plus is not None and now.plus is not None:
            return _plus_changes(was, now)
        if not (programs.fits(was) and programs.fits(now)):
            return []
        if id(change) not in known:
            lister = programs.lister(now, language, naming)
            known[id(change)] = compare_blocks(programs.read(was), programs.read(now), lister)
        return known[id(change)]

    return details


def _plus_changes(was: CarvedBlock, now: CarvedBlock) -> list[Change]:
    known = dictionaries()
    changes = compare_sections(interface(was, known), interface(now, known))
    before, after = networks(was, known), networks(now, known)
    return changes + compare_networks(before, after) if before is not None and after is not None else changes


class CodeListing(Outcome):
    """Blocks with header, interface and code; data blocks with their values by declaration."""

    layout = WIDE_PAGE

    def __init__(
        self,
        blocks: Sequence[CarvedBlock],
        places: Places,
        clock: Clock,
        language: str = STL,
        naming: Naming | None = None,
    ) -> None:
        self._blocks = blocks
        self._places = places
        self._clock = clock
        self._language = language
        self._naming = naming
        self._programs = Programs(blocks)

    def text(self) -> Iterator[Line]:
        """Yield the lines of each block: that of the list, then its contents."""
        for number, block in enumerate(self._blocks):
            if number:
                yield Line("", PLAIN)
            yield Line(transfer_line(block, self._places, self._clock), HEADING, HANG)
            for text in self._held(block):
                yield Line(text, _style(text), HANG)

    def _held(self, block: CarvedBlock) -> Iterator[str]:
        if block.plus is not None:
            yield from _plus_lines(block)
            return
        if block.classic is None:
            yield _NO_HEADER
            return
        if not self._programs.fits(block):
            yield _TOO_MUCH
            return
        program = self._programs.read(block)
        yield from block_lines(program, self._programs.lister(block, self._language, self._naming))
        values = block_data(program) if not program.has_code else []
        if values:
            yield "  values"
        for value in values:
            yield f"    {value_address(block.number, value):<16} {value.name} : {value.type} = {value.text}"

    def as_dict(self) -> dict[str, object]:
        """Return the blocks as values."""
        return {
            "schema": CODE_SCHEMA,
            "language": self._language,
            "blocks": [self._values(block) for block in self._blocks if self._programs.fits(block)],
            "plus_blocks": [_plus_values(block) for block in self._blocks if block.plus is not None],
            "not_read": [
                block.label for block in self._blocks if block.plus is None and not self._programs.fits(block)
            ],
        }

    def _values(self, block: CarvedBlock) -> dict[str, object]:
        program = self._programs.read(block)
        told = block_values(program, self._programs.lister(block, self._language, self._naming))
        told["plc"] = block.plc or None
        told["sha256"] = digest(block)
        told["complete"] = block.complete
        told["values"] = [
            {"name": value.name, "address": value_address(block.number, value), "type": value.type, "value": value.text}
            for value in (block_data(program) if not program.has_code else [])
        ]
        return told

    def rows(self) -> Iterator[Sequence[str]]:
        """Yield the heading and a row for each instruction."""
        yield CODE_COLUMNS
        for block in self._blocks:
            if not self._programs.fits(block):
                continue
            program = self._programs.read(block)
            lister = self._programs.lister(block, self._language, self._naming)
            for network in lister.networks(program):
                for line in network.lines:
                    texts = (
                        block.plc, block.label, str(network.number), str(line.offset), line.label, line.name, line.operand,
                        line.comment, line.octets.hex(),
                    )  # fmt: skip
                    yield [cell(text) for text in texts]


def _plus_lines(block: CarvedBlock) -> Iterator[str]:
    """Yield the interface and the body of an S7comm-plus block; text from the wire is escaped."""
    known = dictionaries()
    for section, names in interface(block, known):
        yield f"  {printable(section)}: {shortened(', '.join(names), _NAMES)}"
    found = networks(block, known)
    if found is None:
        yield f"  {NEEDS}"
    for network in found or ():
        yield ""
        yield f"NETWORK {network.number} ({printable(network.language)})"
        for text in network.lines:
            yield f"       {printable(text)}"
    yield _PLUS


def _plus_values(block: CarvedBlock) -> dict[str, object]:
    known = dictionaries()
    found = networks(block, known)
    return {
        "block": block.label,
        "name": encodable(block.name) or None,
        "plc": block.plc or None,
        "sha256": digest(block),
        "opened": found is not None,
        "interface": [
            {"section": encodable(section), "names": [encodable(name) for name in names]}
            for section, names in interface(block, known)
        ],
        "networks": [
            {
                "network": network.number,
                "language": encodable(network.language),
                "lines": [encodable(line) for line in network.lines],
            }
            for network in found or ()
        ],
    }


def value_address(db: int, value: DeclaredValue) -> str:
    """Return the address of a value in a data block: ``DB2.DBW4``; for a text or structure that of its first byte."""
    return place_text(DB, db, value.bit, _WIDTHS.get(value.type, 8))


def _style(text: str) -> str:
    """Return the style of a line of a listing: faults and the beginnings of networks are highlighted."""
    if text.startswith("!"):
        return FAILED
    return HEADING if text.startswith("NETWORK ") else PLAIN


class References(Outcome):
    """Which blocks read and write which address, and which block calls which, by PLC; the latest version of each block."""

    layout = WIDE_PAGE

    def __init__(self, blocks: Sequence[CarvedBlock]) -> None:
        self._programs = Programs(blocks).by_plc()
        self._left_out = list(dict.fromkeys([block.label for block in blocks if block.plus is not None]))

    def text(self) -> Iterator[Line]:
        """Yield a line for each address, then the calls."""
        for plc, programs in self._programs.items():
            if plc:
                yield Line(plc, HEADING)
            for text in cross_reference_lines(programs):
                yield Line(f"  {text}" if plc and text else text, PLAIN, HANG)
        if self._left_out:
            labels = printable(", ".join(self._left_out))
            yield Line(f"not shown, as the code of an S7-1200/1500 is not public: {labels}", PLAIN, HANG)
        elif not self._programs:
            yield Line("no block with code", PLAIN)

    def as_dict(self) -> dict[str, object]:
        """Return uses and calls as values."""
        found = [{"plc": plc or None, **cross_reference_values(blocks)} for plc, blocks in self._programs.items()]
        return {"schema": REFERENCES_SCHEMA, "plcs": found}

    def rows(self) -> Iterator[Sequence[str]]:
        """Yield the heading and a row for each use and each call."""
        yield REFERENCE_COLUMNS
        for plc, blocks in self._programs.items():
            told = cross_reference_values(blocks)
            uses, calls = told["uses"], told["calls"]
            assert isinstance(uses, list)
            assert isinstance(calls, list)
            for use in uses:
                texts = (plc, use["address"], use["access"], use["block"], str(use["network"]), str(use["offset"]))
                yield [cell(text) for text in texts]
            for call in calls:
                texts = (plc, call["callee"], _CALL, call["block"], str(call["network"]), str(call["offset"]))
                yield [cell(text) for text in texts]
