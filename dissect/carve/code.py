"""The code of blocks that were carved or read from files: as STL or AWL, and as a cross-reference."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from typing import Final

from dissect.carve.differences import MAX_CODE
from dissect.carve.listing import title
from dissect.mc7.block import DATA_BLOCKS, Block, parse_block
from dissect.mc7.listing import STL, Lister, block_lines, block_values
from dissect.mc7.listing import Naming as AddressNaming
from dissect.mc7.usage import cross_reference_lines, cross_reference_values
from dissect.mc7.values import block_data
from dissect.program.carved import CarvedBlock
from dissect.report.outcome import PAGE, Outcome
from dissect.report.styled import DIM, FAILED, HANG, HEADING, PLAIN, Line
from dissect.s7.tables import DB
from dissect.tags.naming import TagNaming, part_name
from dissect.transactions.naming import Naming
from dissect.wire.text import printable

CODE_SCHEMA: Final = "s7dissect.block-code/1"
USAGE_SCHEMA: Final = "s7dissect.block-usage/1"


class Program:
    """The blocks of a run by PLC, decoded when somebody asks; of each the latest whole version is what others call."""

    def __init__(self, blocks: Sequence[CarvedBlock], naming: Naming | None) -> None:
        self._naming = naming
        self._decoded: dict[int, Block] = {}
        self._latest: dict[tuple[str, str, int], CarvedBlock] = {}
        self.shown: list[CarvedBlock] = []
        self.left_out = 0
        room = MAX_CODE
        for block in blocks:
            if block.classic is not None and len(block.octets) > room:
                self.left_out += 1
                continue
            self.shown.append(block)
            if block.classic is not None:
                room -= len(block.octets)
                key = (block.plc, block.kind, block.number)
                if block.complete or key not in self._latest:
                    self._latest[key] = block

    def decode(self, block: CarvedBlock) -> Block:
        """Return a block with its instructions."""
        found = self._decoded.get(id(block))
        if found is None:
            found = self._decoded[id(block)] = parse_block(block.octets)
        return found

    def lister(self, block: CarvedBlock, language: str = STL) -> Lister:
        """Return what writes the code of a block, with the tags and the other blocks of its PLC."""

        def callee(kind: str, number: int) -> Block | None:
            called = self._latest.get((block.plc, kind, number))
            return self.decode(called) if called is not None else None

        return Lister(language, address_names(block, self._naming), callee)


def address_names(block: CarvedBlock, naming: Naming | None) -> AddressNaming:
    """Return what names addresses in the code of a block: the tags of its PLC."""
    if block.operation is not None:
        naming = block.operation.connection.naming
    index = naming.index if isinstance(naming, TagNaming) else None

    def name(area: int, db: int, bit: int, bits: int) -> str:
        cover = index.cover(area, db, bit, bits) if index is not None else None
        if cover is None or len(cover.parts) != 1 or cover.more:
            return ""
        return part_name(cover.parts[0])

    return name


class BlockCode(Outcome):
    """The code of blocks, the values of data blocks, in ``language`` (STL or AWL)."""

    layout = PAGE

    def __init__(self, blocks: Sequence[CarvedBlock], naming: Naming | None, language: str) -> None:
        self._program = Program(blocks, naming)
        self._language = language

    def text(self) -> Iterator[Line]:
        """Yield the blocks one below the other."""
        for number, block in enumerate(self._program.shown):
            if number:
                yield Line("", PLAIN)
            yield from self._block(block)
        if self._program.left_out:
            yield Line(f"and {self._program.left_out} further blocks: more than {MAX_CODE // 1024} KiB of code", FAILED)

    def _block(self, block: CarvedBlock) -> Iterator[Line]:
        if block.classic is None:
            yield Line(f"{title(block)}: {_no_code(block)}", HEADING)
            return
        decoded = self._program.decode(block)
        lister = self._program.lister(block, self._language)
        for number, text in enumerate(block_lines(decoded, lister)):
            yield Line(text, _style(number, text), HANG)
        if decoded.kind in DATA_BLOCKS:
            names = address_names(block, None)
            for value in block_data(decoded):
                tag = names(DB, decoded.number, value.bit, 1)
                at = f"{value.bit // 8}.{value.bit % 8}"
                comment = f"  // {printable(tag)}" if tag else ""
                yield Line(f"    {at:<8} {value.name:<16} : {value.type:<16} = {value.text}{comment}", PLAIN, HANG)

    def as_dict(self) -> dict[str, object]:
        """Return them as values (schema block-code)."""
        blocks: list[dict[str, object]] = []
        for block in self._program.shown:
            if block.classic is None:
                blocks.append({"block": block.label, "decoded": False, "reason": _no_code(block)})
                continue
            decoded = self._program.decode(block)
            values = {"decoded": True} | block_values(decoded, self._program.lister(block, self._language))
            if decoded.kind in DATA_BLOCKS:
                values["values"] = [value._asdict() for value in block_data(decoded)]
            blocks.append(values)
        return {
            "schema": CODE_SCHEMA,
            "mnemonics": self._language,
            "left_out": self._program.left_out,
            "blocks": blocks,
        }


def _style(number: int, text: str) -> str:
    if text.startswith("!"):
        return FAILED
    if number == 0 or text.startswith("NETWORK"):
        return HEADING
    return DIM if text.startswith("  ") and not text.startswith("      ") else PLAIN


def _no_code(block: CarvedBlock) -> str:
    if block.plus is not None:
        return "the code of an S7-1200 or 1500 (MC7plus) cannot be decoded; -o DIR writes its networks as XML"
    return "contents without a block header: not decoded"


class BlockUsage(Outcome):
    """Which block reads and writes which address, and which calls which; of each block the latest version."""

    layout = PAGE

    def __init__(self, blocks: Sequence[CarvedBlock]) -> None:
        program = Program(blocks, None)
        self._left_out = program.left_out
        self._plcs: dict[str, list[Block]] = {}
        latest = {(block.plc, block.label): block for block in program.shown if block.classic is not None}
        for (plc, _), block in latest.items():
            self._plcs.setdefault(plc, []).append(program.decode(block))

    def text(self) -> Iterator[Line]:
        """Yield an address a line, with who reads and writes it, then who calls whom."""
        for plc, blocks in self._plcs.items():
            if len(self._plcs) > 1:
                yield Line(plc, HEADING)
            for text in cross_reference_lines(blocks):
                yield Line(text, PLAIN, HANG)
        if self._left_out:
            yield Line(f"without {self._left_out} further blocks: more than {MAX_CODE // 1024} KiB of code", FAILED)

    def as_dict(self) -> dict[str, object]:
        """Return it as values (schema block-usage)."""
        plcs = [{"plc": plc or None} | cross_reference_values(blocks) for plc, blocks in self._plcs.items()]
        return {"schema": USAGE_SCHEMA, "left_out": self._left_out, "plcs": plcs}
