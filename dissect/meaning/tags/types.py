"""The S7 data types that a tag may have: their sizes and other names, and the parsing of types in files (sheet 6)."""

from __future__ import annotations

import re
from typing import Final, NamedTuple

from dissect.protocols.s7plus.program_tables import DATATYPES
from dissect.wire.config.hints import close_names


class TypeNameError(ValueError):
    """A text is not a type; the message says what to write."""


class DataType(NamedTuple):
    """The type of an element: ``name`` as it is shown ("STRING[20]"), ``kind`` without the length, its size in ``bits``.

    ``even``: in a classic block it begins at an even byte.
    """

    name: str
    kind: str
    bits: int
    even: bool = True

    @property
    def octets(self) -> int:
        """The size in octets; 1 for a bit."""
        return (self.bits + 7) // 8


def _types() -> dict[str, DataType]:
    rows = {
        1: "BYTE CHAR SINT USINT",
        2: "WORD INT UINT DATE S5TIME WCHAR TIMER COUNTER BLOCK_FB BLOCK_FC BLOCK_DB BLOCK_SDB",
        4: "DWORD DINT UDINT REAL TIME TIME_OF_DAY",
        6: "POINTER",
        8: "LWORD LINT ULINT LREAL LTIME LTIME_OF_DAY LDT DATE_AND_TIME",
        10: "ANY",
        12: "DTL",
    }
    found = {name: DataType(name, name, 8 * size, size > 1) for size, names in rows.items() for name in names.split()}
    found["BOOL"] = DataType("BOOL", "BOOL", 1, False)
    return found


#: Types of one size, by name.
TYPES: Final = _types()
#: Other names of types.
ALIASES: Final[dict[str, str]] = {
    "TOD": "TIME_OF_DAY",
    "LTOD": "LTIME_OF_DAY",
    "DT": "DATE_AND_TIME",
    "DATE_AND_LTIME": "LDT",
    "LDATE_AND_TIME": "LDT",
    "BIT": "BOOL",
    "DWORD_BCD": "DWORD",
}
#: System types that are a number or a handle; their octets are shown as a number. A user's type may have such a name, too
#: (``HW_Status``): only names that STEP 7 itself has are system types.
_HANDLES: Final = re.compile(r"(?:HW|OB|DB|PORT|PIP|RTM|CONN)_[A-Z0-9_]+|PORT|PIP|RTM")
_LONG_HANDLES: Final = frozenset(("CONN_R_ID", "AOM_IDENT"))
_EVENTS: Final = re.compile(r"EVENT_[A-Z0-9_]+")
_SYSTEM: Final = frozenset([row.name for row in DATATYPES])
#: System structures and their sizes in octets; their octets are shown unchanged.
STRUCTURES: Final[dict[str, int]] = {
    **dict.fromkeys(("IEC_TIMER", "TON_TIME", "TOF_TIME", "TP_TIME", "TONR_TIME"), 16),
    **dict.fromkeys(("IEC_COUNTER", "IEC_UCOUNTER"), 6),
    **dict.fromkeys(("IEC_SCOUNTER", "IEC_USCOUNTER"), 3),
    **dict.fromkeys(("IEC_DCOUNTER", "IEC_UDCOUNTER"), 12),
    "ERRORSTRUCT": 28,
    "CREF": 8,
    "NREF": 8,
}
#: Greatest lengths of strings, and the length of STRING without a length.
_LONGEST: Final = {"STRING": 254, "WSTRING": 16382, "FSTRING": 65535}
_DEFAULT_LENGTH: Final = 254
_STRING: Final = re.compile(r"(W|F)?STRING\s*(?:[\[(]\s*(\d{1,5})\s*[\])])?")
_ARRAY: Final = re.compile(r"ARRAY\s*\[(.*?)\]\s*OF\s+(.+)", re.IGNORECASE | re.DOTALL)
_COUNTED: Final = re.compile(r"([A-Z0-9_]+(?:\(\d+\))?)\s*\[\s*(\d{1,5})\s*\]")
_BOUND: Final = re.compile(r"\s*(-?\d{1,10})\s*\.\.\s*(-?\d{1,10})\s*")
#: A whole number in a file. No S7 type has more than the 20 digits of a ULINT; Python refuses to parse thousands of digits.
_WHOLE: Final = re.compile(r"[+-]?[0-9]{1,20}")
#: Greatest number of dimensions and of octets of an array.
MAX_DIMENSIONS: Final = 6
MAX_ARRAY: Final = 65536

#: German words and words of other tools, and the corresponding types.
_MEANT: Final = {
    "GANZZAHL": "INT",
    "FLOAT": "REAL",
    "DOUBLE": "LREAL",
    "BOOLEAN": "BOOL",
    "ZEIT": "TIME",
    "DATUM": "DATE",
    "ZEICHEN": "CHAR",
    "WORT": "WORD",
    "DOPPELWORT": "DWORD",
    "GLEITPUNKTZAHL": "REAL",
    "INT16": "INT",
    "UINT16": "UINT",
    "INT32": "DINT",
    "UINT32": "UDINT",
    "INT8": "SINT",
    "UINT8": "USINT",
    "INT64": "LINT",
    "UINT64": "ULINT",
    "SHORT": "INT",
    "LONG": "DINT",
    "INTEGER": "INT",
}


def whole_number(text: str) -> int | None:
    """Parse a whole number in a file; None for anything else: "²", "+-5", thousands of digits."""
    written = text.strip()
    return int(written) if _WHOLE.fullmatch(written) else None


def string_type(kind: str, length: int) -> DataType:
    """Return a STRING, WSTRING or FSTRING (without a length header) of ``length`` characters. Raises `TypeNameError`."""
    if not 0 <= length <= _LONGEST[kind]:
        raise TypeNameError(f"{kind}[{length}]: the length is between 0 and {_LONGEST[kind]}")
    octets = {"STRING": length + 2, "WSTRING": 2 * length + 4, "FSTRING": length}[kind]
    return DataType(f"{kind}[{length}]", kind, 8 * octets)


def elementary(written: str) -> DataType | None:
    """Parse the type of one element, in any case; None if it is not an S7 type.

    Raises `TypeNameError` for a string of an impossible length.
    """
    name = " ".join(written.strip().strip('"').upper().split())
    name = ALIASES.get(name, name)
    found = TYPES.get(name)
    if found is not None:
        return found
    if string := _STRING.fullmatch(name):
        kind = f"{string[1] or ''}STRING"
        return string_type(kind, int(string[2]) if string[2] else _DEFAULT_LENGTH)
    if name in STRUCTURES:
        return DataType(name, "OCTETS", 8 * STRUCTURES[name])
    if name not in _SYSTEM:
        return None
    if name in _LONG_HANDLES or _EVENTS.fullmatch(name):
        return DataType(name, "DWORD", 32)
    return DataType(name, "WORD", 16) if _HANDLES.fullmatch(name) else None


def tag_type(written: str) -> tuple[DataType, list[tuple[int, int]]]:
    """Parse a type: ``Int``, ``INT[5]``, ``Array[1..3] of Int``. Return the type of an element, and the bounds of an array.

    Raises `TypeNameError` for anything else.
    """
    if array := _ARRAY.fullmatch(written.strip()):
        bounds = [parse_bounds(part) for part in array[1].split(",")]
        base, inner = tag_type(array[2])
        return base, [*bounds, *inner]
    found = elementary(written)
    if found is not None:
        return found, []
    if counted := _COUNTED.fullmatch(written.strip().upper()):
        base = require(counted[1])
        return base, [(0, checked_count(int(counted[2]), base) - 1)]
    raise TypeNameError(unknown(written))


def checked_count(count: int, base: DataType) -> int:
    """Return the count of an array. Raises `TypeNameError` if it is below 1, or more than a block can hold."""
    if count < 1 or count * base.octets > MAX_ARRAY:
        raise TypeNameError(f"{count} x {base.name}: an array has 1 element or more, and at most {MAX_ARRAY} bytes")
    return count


def parse_bounds(text: str) -> tuple[int, int]:
    """Parse bounds such as ``1..10``; return the lowest and the highest index. Raises `TypeNameError`."""
    found = _BOUND.fullmatch(text)
    if found is None:
        raise TypeNameError(f"array bounds {text.strip()[:40]!r}: expected LOWEST..HIGHEST, for example 1..10")
    low, high = int(found[1]), int(found[2])
    if high < low:
        raise TypeNameError(f"array bounds {low}..{high}: the upper one is below the lower one")
    return low, high


def require(written: str) -> DataType:
    """Parse the type of one element. Raises `TypeNameError` if it is not an S7 type."""
    found = elementary(written)
    if found is None:
        raise TypeNameError(unknown(written))
    return found


def meant(written: str) -> str:
    """Return the type for a German word or a word of another tool, empty for none."""
    return _MEANT.get(written.upper(), "")


def unknown(written: str) -> str:
    """Return the message for a text that is not a type, with similar types."""
    name = written.strip().strip('"').upper()
    known = meant(name)
    near = [known] if known else close_names(name, [*TYPES, *ALIASES, "STRING[20]", "WSTRING[20]"])
    hint = f"; close to it: {', '.join(near)}" if near else ""
    return f"type {written.strip()[:60]!r} is not a type of S7{hint}"
