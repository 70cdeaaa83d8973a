"""`TagFile`: one file of tags while it is read, with its tags, blocks, symbols and problems so far."""

from __future__ import annotations

import math
import re
from collections import Counter
from typing import Final, NamedTuple

from dissect.meaning.tags.address import AddressError, TagAddress, block_number, fitted, language, parse_tag_address
from dissect.meaning.tags.declarations import Block
from dissect.meaning.tags.model import Tag
from dissect.meaning.tags.problems import Problems
from dissect.meaning.tags.types import DataType, TypeNameError, tag_type
from dissect.protocols.s7plus.program import Program

#: Maximum number of tags of one file.
MAX_TAGS: Final = 500_000


#: A factor, and a shift with its sign; either may have an exponent with a sign.
_FACTOR_AND_SHIFT: Final = re.compile(r"([+-]?[0-9.]+(?:e[+-]?[0-9]+)?)([+-][0-9.]+(?:e[+-]?[0-9]+)?)", re.IGNORECASE)


class Symbol(NamedTuple):
    """The name of a block in a symbol table; ``of`` is the type or FB of an instance ("FB 20", "UDT 3"), else empty."""

    name: str
    kind: str
    number: int
    of: str
    line: int


class Placed(NamedTuple):
    """A tag whose type another file declares; it is laid out when all files were read."""

    name: str
    address: TagAddress
    type: str
    comment: str
    line: int


class Scale(NamedTuple):
    """The scale of a tag: the value on the wire times ``factor`` plus ``shift`` is the value in its unit."""

    factor: float = 1.0
    shift: float = 0.0


class Row(NamedTuple):
    """A row of a table. ``type`` is empty if the address has it; ``scale`` is a text as it is written."""

    line: int
    name: str
    address: str
    type: str = ""
    comment: str = ""
    unit: str = ""
    scale: Scale = Scale()


class TagFile:
    """The contents of a file. ``format`` is its name for users; ``encoding`` the code page if it was only assumed, else empty.

    ``skipped`` counts rows that are not tags, by their kind. ``constants`` are those that bounds of arrays may use.
    """

    def __init__(self, path: str) -> None:
        self.path = path
        self.format = ""
        self.encoding = ""
        self.problems = Problems(path)
        self.tags: list[Tag] = []
        self.blocks: list[Block] = []
        self.symbols: list[Symbol] = []
        self.placed: list[Placed] = []
        self.constants: dict[str, int] = {}
        self.programs: dict[str, Program] = {}  # from a capture, by the host of the CPU
        self.skipped: Counter[str] = Counter()
        self._languages: dict[str, tuple[str, int]] = {}

    def add(self, row: Row, *, foreign: bool = False) -> None:
        """Add the tag of a row. A mistake is an error; with ``foreign``, a warning that the row was left out."""
        complain = self.problems.warning if foreign else self.problems.error
        if not row.name.strip():
            complain(row.line, f"the tag at {row.address.strip()[:60]!r} has no name")
            return
        if not row.address.strip():
            complain(row.line, f"{row.name.strip()[:60]!r} has no address")
            return
        if len(self.tags) >= MAX_TAGS:
            if len(self.tags) == MAX_TAGS:
                self.problems.error(row.line, f"more than {MAX_TAGS} tags in one file: split it")
            return
        try:
            address = parse_tag_address(row.address)
            self._speak(address, row)
            declared = self._declared(row, address)
            if declared is None and row.type.strip():
                return
            base, dims, remark = fitted(row.address, address, declared)
        except (AddressError, TypeNameError) as error:
            complain(row.line, f"{row.name.strip()[:60]}: {error}")
            return
        tag = Tag(row.name.strip(), address.area, address.db, address.start, base.kind, base.name, base.bits)
        tag.dims = dims
        for low, high in dims:
            tag.count *= high - low + 1
        tag.step = element_step(base) if dims else base.bits
        tag.comment = row.comment.strip()
        tag.unit = row.unit.strip()
        tag.factor, tag.shift = row.scale
        tag.file, tag.line = self.path, row.line
        if remark.startswith("begins"):
            self.problems.warning(row.line, f"{tag.name} ({row.address.strip()}) {remark}")
        else:
            tag.remark = remark
        self.tags.append(tag)

    def _declared(self, row: Row, address: TagAddress) -> tuple[DataType, list[tuple[int, int]]] | None:
        """Return the type of a row; None if it has none, or if another file may declare it (then the row is kept)."""
        if not row.type.strip():
            return None
        try:
            return tag_type(row.type)
        except TypeNameError:
            if "[" in row.type:
                raise
            self.placed.append(Placed(row.name.strip(), address, row.type.strip().strip('"'), row.comment, row.line))
            return None

    def _speak(self, address: TagAddress, row: Row) -> None:
        """Note the language of an address's letters; a file with both languages gets one warning."""
        spoken = language(address.letters)
        if not spoken or spoken in self._languages:
            return
        self._languages[spoken] = (row.address.strip(), row.line)
        if len(self._languages) == 2:
            (one, first), (other, second) = self._languages.values()
            self.problems.warning(
                second, f"{one} (line {first}) and {other} (line {second}): German and international names in one file"
            )

    def name_block(self, symbol: str, address: str, of: str, line: int) -> bool:
        """Take a row of a symbol table that names a whole block; return False if the address is not a block."""
        block = block_number(address)
        if block is None:
            return False
        kind, number = block
        instance = block_number(of)
        of_text = f"{instance[0]} {instance[1]}" if instance is not None and instance != block else ""
        if kind in {"DB", "UDT", "FB", "SFB"}:
            self.symbols.append(Symbol(symbol.strip(), kind, number, of_text, line))
        self.skipped["blocks" if kind != "VAT" else "variable tables"] += 1
        return True


def element_step(base: DataType) -> int:
    """Return the distance of array elements in bits: bits and octets are packed, all other types begin at even bytes."""
    return base.bits if base.octets == 1 or base.kind == "FSTRING" else (base.octets + 1) // 2 * 16


def parse_scale(text: str) -> Scale:
    """Parse a scale: ``0.1``, ``0.1+5``, ``0.1-40`` or ``0..27648 = 0..100``. Raises ValueError for anything else."""
    written = "".join(text.split())
    if not written:
        return Scale()
    raw, equals, scaled = written.partition("=")
    try:
        if equals:
            low, high = _range(raw)
            bottom, top = _range(scaled)
            factor = (top - bottom) / (high - low)
            return _checked(factor, bottom - low * factor)
        if parts := _FACTOR_AND_SHIFT.fullmatch(written):
            return _checked(float(parts[1]), float(parts[2]))
        return _checked(float(written))
    except (ValueError, ZeroDivisionError):
        pass
    raise ValueError(
        f"scale {text.strip()[:40]!r}: expected a factor (0.1), factor and shift (0.1-40), or 0..27648 = 0..100"
    )


def _checked(factor: float, shift: float = 0.0) -> Scale:
    """Return a scale. Raises ValueError for a factor 0 (all values would be equal), NaN and infinities."""
    if not factor or not math.isfinite(factor) or not math.isfinite(shift):
        raise ValueError
    return Scale(factor, shift)


def _range(text: str) -> tuple[float, float]:
    low, dots, high = text.partition("..")
    if not dots:
        raise ValueError
    return float(low), float(high)
