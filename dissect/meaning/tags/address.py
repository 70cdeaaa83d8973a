"""Addresses in the notations of all S7 tools: ``%DB1.DBD4:REAL``, ``DB1,REAL4``, ``MW 10``, ``%E0.1`` (sheet 2.6, 5).

Marks show the dialect: ``%`` with ``:TYPE`` is PLC4X, ``%`` alone TIA, a comma after the block nodes7 (a second comma OPC),
``DBn.DB`` STEP 7, ``DBn.X`` telegraf, ``DBn:byte.bit`` ENLYZE. Blanks come from symbol tables of STEP 7 V5.
"""

from __future__ import annotations

import re
from typing import Final, NamedTuple

from dissect.meaning.tags.model import NUMBERED_BITS, place_text
from dissect.meaning.tags.types import TYPES, DataType, TypeNameError, checked_count, require, string_type
from dissect.protocols.s7.address import MAX_DB, MAX_OCTET
from dissect.protocols.s7.tables import DB, LETTER_AREAS, NUMBERED_AREAS

_PERIPHERAL: Final = 0x80
#: Areas by the letters of all dialects; O and F are used by drivers that are not from Siemens.
AREAS: Final[dict[str, int]] = {
    **{letter: area for letter, area in LETTER_AREAS.items() if letter in {"I", "E", "Q", "A", "M", "C", "Z", "T"}},
    "O": LETTER_AREAS["Q"],
    "F": LETTER_AREAS["M"],
    **dict.fromkeys(("PI", "PE", "PQ", "PA", "P"), _PERIPHERAL),
}
#: Letters that only one of the two languages uses.
GERMAN: Final = frozenset(("E", "A", "Z", "PE", "PA"))
INTERNATIONAL: Final = frozenset(("I", "Q", "C", "PI", "PQ"))

#: Type codes of the nodes7 family, telegraf, Kepware, OPC and AVEVA.
_CODES: Final[dict[str, str]] = {
    "X": "BOOL",
    "B": "BYTE",
    "C": "CHAR",
    "W": "WORD",
    "I": "INT",
    "D": "DWORD",
    "DW": "DWORD",
    "DI": "DINT",
    "R": "REAL",
    "LR": "LREAL",
    "LI": "LINT",
    "LW": "LWORD",
    "ULI": "ULINT",
    "S": "STRING",
    "WS": "WSTRING",
    "DTZ": "DATE_AND_TIME",
    "DTLZ": "DTL",
    "DT": "DATE_AND_TIME",
    "TOD": "TIME_OF_DAY",
    "STRING": "STRING",
    "WSTRING": "WSTRING",
    **{name: name for name in TYPES},
}
#: Types of nodes7 with the low byte first, which are not supported.
_SWAPPED: Final = frozenset(("RI", "RW", "RDI", "RD", "RR", "WDT", "DWT"))
#: The bits of each width letter, and its type if none is declared.
WIDTHS: Final[dict[str, int]] = {"X": 1, "B": 8, "W": 16, "D": 32, "L": 64}
_BY_WIDTH: Final[dict[str, str]] = {"X": "BOOL", "B": "BYTE", "W": "WORD", "D": "DWORD", "L": "LWORD"}
_LETTERED: Final = frozenset((8, 16, 32))

_N = r"(\d{1,8})"
_TYPE = r"(?::([A-Z_0-9]+(?:[\[(]\d{1,5}[\])])?(?:\[\d{1,5}\])?))?"
_BLOCK: Final = re.compile(rf"%?DB{_N}\.DB([XBWDL])?{_N}(?:\.{_N})?{_TYPE}")
_BLOCK_BYTE: Final = re.compile(rf"%?DB{_N}:{_N}(?:\.{_N})?{_TYPE}")
_BLOCK_COMMA: Final = re.compile(rf"DB{_N},([A-Z]+){_N}(?:\.{_N})?(?:\.{_N})?(?:,{_N})?")
_BLOCK_DOT: Final = re.compile(rf"DB{_N}\.([A-Z]{{1,3}}){_N}(?:\.{_N})?(?:\.{_N})?")
_AREA: Final = re.compile(rf"(%?)(P[IEQA]|[IEQAMFO]|P)([A-Z_]*?){_N}(?:\.{_N})?(?:\.{_N})?(?:,{_N})?{_TYPE}")
_NUMBERED: Final = re.compile(rf"%?([TCZ]){_N}(?:,{_N})?{_TYPE}")
#: Whole blocks and tables in a symbol table; they are not addresses of values.
_BLOCKS: Final = re.compile(rf"%?(DB|FB|FC|SFB|SFC|OB|UDT|SDB|VAT) ?{_N}")


class AddressError(ValueError):
    """A text is not an address; the message says what was expected."""


class TagAddress(NamedTuple):
    """A parsed address. ``byte`` is the number of a timer or counter; ``bit`` is -1 if none is written.

    ``width`` is X, B, W, D, L or empty. ``type`` is the type, if the address has one, ``elements`` their count or 0.
    ``letters`` are those of the area. ``loose``: the dialect writes a bit in every address, for all types.
    """

    area: int
    db: int
    byte: int
    bit: int
    width: str
    type: DataType | None
    elements: int
    letters: str
    loose: bool = False

    @property
    def start(self) -> int:
        """The first bit, counted as in `dissect.meaning.tags.model.Tag.start`."""
        return self.byte * (NUMBERED_BITS if self.area in NUMBERED_AREAS else 8) + max(self.bit, 0)


def block_number(text: str) -> tuple[str, int] | None:
    """Return the kind and number of a whole block that a symbol table names (``DB 20``, ``FB1``, ``VAT 1``), else None."""
    found = _BLOCKS.fullmatch(" ".join(text.split()).upper())
    return (found[1], int(found[2])) if found else None


def parse_tag_address(text: str) -> TagAddress:
    """Parse an address of any dialect. Raises `AddressError`, `TypeNameError`."""
    written = "".join(text.split()).upper()
    plain = written.removesuffix(":P") if written.startswith("%") else written
    if found := _NUMBERED.fullmatch(plain):
        return _checked(text, _numbered(found))
    if found := _BLOCK.fullmatch(plain):
        number, width, byte, bit, type_ = found.groups()
        return _checked(text, _declared(text, DB, int(number), int(byte), bit, width or "", type_, "DB"))
    if found := _BLOCK_BYTE.fullmatch(plain):
        number, byte, bit, type_ = found.groups()
        address = _declared(text, DB, int(number), int(byte), bit, "", type_, "DB")
        return _checked(text, address._replace(loose=not type_))
    if found := _BLOCK_COMMA.fullmatch(plain) or _BLOCK_DOT.fullmatch(plain):
        number, code, byte, first, second, *third = found.groups()
        behind = third[0] if third else None  # in OPC: the count after a second comma
        return _checked(text, _coded(text, DB, int(number), code, int(byte), first, second, behind))
    if found := _AREA.fullmatch(plain):
        percent, letters, code, byte, first, second, count, type_ = found.groups()
        area = AREAS[letters]
        if percent or type_:
            if code not in {"", "X", "B", "W", "D", "L"} or second or count:
                raise AddressError(_none(text))
            return _checked(text, _declared(text, area, 0, int(byte), first, code, type_, letters))
        if not code:
            code = "X"
        return _checked(text, _coded(text, area, 0, code, int(byte), first, second, count)._replace(letters=letters))
    raise AddressError(_none(text))


def _none(text: str) -> str:
    return f"{text.strip()[:60]!r} is not an address: expected for example DB10.DBD4, %MW10, I0.1, DB10,REAL4"


def _checked(text: str, address: TagAddress) -> TagAddress:
    shown = text.strip()[:60]
    if address.bit > 7:
        raise AddressError(f"{shown}: bits are 0-7")
    if address.db > MAX_DB or address.byte > MAX_OCTET:
        raise AddressError(f"{shown}: the highest block is DB{MAX_DB}, the highest byte {MAX_OCTET}")
    return address


def _numbered(found: re.Match[str]) -> TagAddress:
    letter, number, count, type_ = found.groups()
    kind = require(type_) if type_ else TYPES["TIMER" if letter == "T" else "COUNTER"]
    return TagAddress(AREAS[letter], 0, int(number), -1, "", kind, int(count or 0), letter)


def _declared(
    text: str, area: int, db: int, byte: int, bit: str | None, width: str, type_: str | None, letters: str
) -> TagAddress:
    """Return an address with a width letter, perhaps a bit, perhaps a type after a colon."""
    if bit is not None and width and width != "X":
        words = {"B": "byte", "W": "word", "D": "double word", "L": "long word"}
        raise AddressError(f"{text.strip()[:60]}: a {words[width]} has no bit")
    if width == "X" and bit is None:
        raise AddressError(f"{text.strip()[:60]}: the bit is missing, for example {text.strip()[:60]}.0")
    base, count = _typed(type_) if type_ else (None, 0)
    return TagAddress(area, db, byte, int(bit) if bit is not None else -1, width, base, count, letters)


def _typed(text: str) -> tuple[DataType, int]:
    """Return the type and count in the text after a colon: ``REAL``, ``STRING(20)``, ``BOOL[8]``."""
    found = re.fullmatch(r"([A-Z_0-9]+)(?:\((\d+)\))?(?:\[(\d+)\])?", text)
    if found is None:
        return require(text), 0
    name, length, count = found.groups()
    if name in {"STRING", "WSTRING"}:
        size = length or count
        return (string_type(name, int(size)) if size else require(name)), int(count) if length and count else 0
    return require(name), int(count or 0)


def _coded(
    text: str, area: int, db: int, code: str, byte: int, first: str | None, second: str | None, third: str | None
) -> TagAddress:
    """Return an address whose letters are a type, as in nodes7; a number after a dot is a bit, a length or a count."""
    if code in _SWAPPED:
        raise AddressError(f"{text.strip()[:60]}: {code} is a little-endian type of nodes7, which has no S7 type")
    name = _CODES.get(code)
    if name is None:
        raise AddressError(_none(text))
    letters = "DB" if area == DB else ""
    shown = text.strip()[:60]
    if name == "BOOL":
        if first is None:
            raise AddressError(f"{shown}: the bit is missing, for example {shown}.0")
        return TagAddress(area, db, byte, int(first), "X", TYPES["BOOL"], int(second or third or 0), letters)
    if name in {"STRING", "WSTRING"}:
        # OPC: DB1,STRING10,20 has the length after the second comma.
        length = first or third
        if length is None:
            raise AddressError(f"{shown}: the length of the string is missing: {shown}.20 for 20 characters")
        return TagAddress(area, db, byte, -1, "", string_type(name, int(length)), int(second or 0), letters)
    if second is not None:
        raise AddressError(f"{shown}: two numbers after the byte are for bits and strings only")
    count = int(first or third or 0)
    width = code if code in {"B", "W", "D", "L"} else ""
    return TagAddress(area, db, byte, -1, width, TYPES[name], count, letters)


def fitted(
    text: str, address: TagAddress, declared: tuple[DataType, list[tuple[int, int]]] | None
) -> tuple[DataType, list[tuple[int, int]], str]:
    """Return type and dimensions of a tag, from its address and the declared type, and a remark on what is uncertain.

    Raises `AddressError` if address and declared type contradict each other.
    """
    shown = text.strip()[:60]
    if declared is None:
        base = address.type
        dims: list[tuple[int, int]] = []
        remark = ""
        if base is None:
            width = address.width or ("X" if address.bit >= 0 and not address.loose else "")
            if not width:
                raise AddressError(f"{shown}: neither the address nor the row has a type")
            base = TYPES[_BY_WIDTH[width]]
        if not address.type or (address.width in {"W", "D"} and address.letters):
            remark = (
                "type by width only: the file does not tell INT, REAL and WORD apart" if base.kind != "BOOL" else ""
            )
        if address.elements > 1:
            dims = [(0, checked_count(address.elements, base) - 1)]
        return base, dims, remark
    base, dims = declared
    if address.elements > 1 and not dims:
        dims = [(0, checked_count(address.elements, base) - 1)]
    if address.type is not None and address.type.bits != base.bits:
        raise AddressError(f"{shown} is {address.type.name}, but the row has {base.name}: they differ in size")
    if address.area in NUMBERED_AREAS:
        if base.bits != NUMBERED_BITS:
            raise AddressError(f"{shown}: a timer or counter has 16 bits, {base.name} does not")
        return base, dims, ""
    _check_width(shown, address, base, bool(dims))
    odd = "begins at an odd byte, which classic blocks do not have" if base.even and address.byte % 2 else ""
    return base, dims, odd if address.area == DB else ""


def _check_width(shown: str, address: TagAddress, base: DataType, several: bool) -> None:
    """Raise `AddressError` when the width letter or bit of an address does not fit a declared type."""
    if base.kind == "BOOL":
        if address.bit < 0:
            raise AddressError(f"{shown}: the bit is missing for BOOL, for example {_right(address, base)}")
        return
    lettered = base.bits in _LETTERED and not several and base.kind not in {"STRING", "FSTRING", "OCTETS"}
    if address.bit >= 0 and not address.loose and (lettered or address.bit):
        raise AddressError(f"{shown}: {base.name} has no bit: expected {_right(address, base)}")
    bits = WIDTHS.get(address.width, 0)
    if bits and bits != base.bits and (lettered or bits > 8) and address.width != "X":
        raise AddressError(f"{shown} with {base.name}: {base.name} needs {_right(address, base)}")


def _right(address: TagAddress, base: DataType) -> str:
    """Return the address with the width letter that fits the type."""
    return place_text(address.area, address.db, address.byte * 8, base.bits)


def language(letters: str) -> str:
    """Return the language of the letters of an area: "German", "international", or empty for letters of both."""
    if letters in GERMAN:
        return "German"
    return "international" if letters in INTERNATIONAL else ""


__all__ = ["AddressError", "TagAddress", "TypeNameError", "block_number", "fitted", "language", "parse_tag_address"]
