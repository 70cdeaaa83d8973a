"""One file of tags while it is read: its tags, blocks and symbols so far, and what is wrong with it."""

from __future__ import annotations

import math
import re
from collections import Counter
from typing import Final, NamedTuple

from dissect.s7plus.program import Program
from dissect.tags.address import AddressError, TagAddress, block_number, fitted, language, parse_tag_address
from dissect.tags.declarations import Block
from dissect.tags.model import Tag
from dissect.tags.problems import Problems
from dissect.tags.types import DataType, TypeNameError, tag_type

#: Most tags of one file.
MAX_TAGS: Final = 500_000


#: A factor, and a shift with its sign; either may have an exponent, which has a sign as well.
_FACTOR_AND_SHIFT: Final = re.compile(r"([+-]?[0-9.]+(?:e[+-]?[0-9]+)?)([+-][0-9.]+(?:e[+-]?[0-9]+)?)", re.IGNORECASE)


class Symbol(NamedTuple):
    """The name of a block in a symbol table; ``of`` is what it is an instance of ("FB 20", "UDT 3"), empty for none."""

    name: str
    kind: str
    number: int
    of: str
    line: int


class Placed(NamedTuple):
    """A tag of a type that other files declare: it needs their layout."""

    name: str
    address: TagAddress
    type: str
    comment: str
    line: int


class Scale(NamedTuple):
    """How the value on the wire becomes the one in the unit: times ``factor``, plus ``shift``."""

    factor: float = 1.0
    shift: float = 0.0


class Row(NamedTuple):
    """What a row of a table says of a tag. ``type`` is empty where the address tells it; ``scale`` is as it is written."""

    line: int
    name: str
    address: str
    type: str = ""
    comment: str = ""
    unit: str = ""
    scale: Scale = Scale()


class TagFile:
    """What a file holds. ``format`` names what it is, ``encoding`` the code page that was assumed, empty where it is sure.

    ``skipped`` counts rows that name no place in memory, by what they are. ``constants`` are those that array bounds use.
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
        self.programs: dict[str, Program] = {}  # of a capture, by the host of the CPU
        self.skipped: Counter[str] = Counter()
        self._languages: dict[str, tuple[str, int]] = {}

    def add(self, row: Row, *, foreign: bool = False) -> None:
        """Take a row; what is wrong with it is a problem of the file, or with ``foreign`` a warning that it was left out."""
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
        """Return the type that the row declares; one that it does not know may be declared by another file."""
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
        """Note the language of the letters; a file that has both gets one warning."""
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
        """Take a row of a symbol table that names a whole block; False when the address is none of a block."""
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
    """Return how many bits elements of an array are apart: bits are packed, octets as well, all else is even."""
    return base.bits if base.octets == 1 or base.kind == "FSTRING" else (base.octets + 1) // 2 * 16


def parse_scale(text: str) -> Scale:
    """Return what ``0.1``, ``0.1+5``, ``0.1-40`` or ``0..27648 = 0..100`` means. Raises ValueError for anything else."""
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
    """Return a scale that gives every value one of its own. Raises ValueError for 0, "nan" and "inf"."""
    if not factor or not math.isfinite(factor) or not math.isfinite(shift):
        raise ValueError
    return Scale(factor, shift)


def _range(text: str) -> tuple[float, float]:
    low, dots, high = text.partition("..")
    if not dots:
        raise ValueError
    return float(low), float(high)
