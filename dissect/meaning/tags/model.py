"""`Tag`: a name for a place in a CPU, and the type of the value there."""

from __future__ import annotations

from typing import Final

from mypy_extensions import i64

from dissect.protocols.s7.address import address_text
from dissect.protocols.s7.tables import BIT, BYTE, NUMBERED_AREAS
from dissect.wire.copies import leaves

#: Size in bits of a timer or counter, whose address is a number: their values are words.
NUMBERED_BITS: Final = 16
#: Transport sizes by octets, for the width letter in an address.
_LETTERED: Final[dict[int, int]] = {1: BYTE, 2: 0x04, 4: 0x06, 8: 0x30}

#: Kinds whose addresses have no width letter for their size.
UNLETTERED: Final = frozenset(("STRING", "WSTRING", "FSTRING", "OCTETS"))


class Tag:
    """A variable, or an array of them.

    ``start`` is the first bit: byte times 8 plus bit; for a timer or counter, its number times 16. An element has ``size``
    bits, and the next one begins ``step`` bits later. ``dims`` has the lowest and highest index of each dimension, and
    ``count`` is the number of all elements; 1 for a single variable, whose ``dims`` are empty. ``prefix`` precedes an index
    ("2," for a row of an array of bits). ``type`` is the name of the type of an element ("REAL", "STRING[20]"), ``kind`` the
    same without a length. The value on the wire times ``factor`` plus ``shift`` is the value in ``unit``. ``remark`` says what
    is uncertain about the address. ``file`` and ``line`` are where the tag is declared.
    """

    __slots__ = (
        "area",
        "comment",
        "count",
        "db",
        "dims",
        "factor",
        "file",
        "kind",
        "line",
        "name",
        "prefix",
        "remark",
        "shift",
        "size",
        "start",
        "step",
        "type",
        "unit",
    )

    def __init__(self, name: str, area: i64, db: i64, start: i64, kind: str, type_: str, size: i64) -> None:
        self.name: str = name
        self.area: i64 = area
        self.db: i64 = db
        self.start: i64 = start
        self.kind: str = kind
        self.type: str = type_
        self.size: i64 = size
        self.step: i64 = size
        self.count: i64 = 1
        self.dims: list[tuple[int, int]] = []
        self.prefix: str = ""
        self.unit: str = ""
        self.factor: float = 1.0
        self.shift: float = 0.0
        self.comment: str = ""
        self.remark: str = ""
        self.file: str = ""
        self.line: i64 = 0

    @property
    def end(self) -> i64:
        """The first bit after the tag."""
        return self.start + self.step * (self.count - 1) + self.size

    @property
    def scaled(self) -> bool:
        """Whether the value on the wire is different from that in ``unit``."""
        return self.factor != 1.0 or self.shift != 0.0

    @property
    def address(self) -> str:
        """The address in STEP 7's form: ``DB10.DBD4``, ``M0.1``, ``T5``."""
        return place_text(self.area, self.db, self.start, self.size if self.kind not in UNLETTERED else 8)

    @property
    def declared(self) -> str:
        """The type with the bounds of an array: ``REAL``, ``Array[1..3] of INT``."""
        if not self.dims:
            return self.type
        bounds = ",".join([f"{low}..{high}" for low, high in self.dims])
        return f"Array[{bounds}] of {self.type}"

    def element(self, number: i64) -> str:
        """Return the name of an element, counted from 0."""
        return f"{self.name}[{self.prefix}{self.index(number)}]" if self.dims else self.name

    def index(self, number: i64) -> str:
        """Return the indexes of an element, counted from 0: ``3``, ``1,0,6``."""
        left: i64 = number
        texts: list[str] = []
        for low, high in reversed(self.dims):
            length: i64 = high - low + 1
            texts.append(str(low + left % length))
            left //= length
        texts.reverse()
        return ",".join(texts)

    def __repr__(self) -> str:
        return f"Tag({self.name!r}, {self.address!r}, {self.declared!r})"


def place_text(area: i64, db: i64, start: i64, bits: i64) -> str:
    """Return the address of ``bits`` bits from bit ``start`` on."""
    if area in NUMBERED_AREAS:
        return address_text(area, db, start // NUMBERED_BITS, BYTE)
    size = BIT if bits == 1 else _LETTERED.get(bits // 8, BYTE)
    return address_text(area, db, start, size)


def _taken(tag: Tag) -> tuple[str, int, int, int, str, str, int]:
    return tag.name, 0, 0, 0, tag.kind, tag.type, 0


leaves(Tag, taken=_taken)
