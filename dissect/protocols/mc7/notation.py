"""Operands as text in STL (English) and AWL (German), and back (reference sheet mc7.md, section 7)."""

from __future__ import annotations

import re
from typing import Final

from dissect.protocols.mc7.constants import constant_text, parse_constants
from dissect.protocols.mc7.instruction_tables import ENGLISH, GERMAN
from dissect.protocols.mc7.operands import (
    CONSTANT,
    COUNT,
    FIXED,
    JUMP,
    JUMP_LIST,
    MEMORY,
    NO_OPERAND,
    NUMBERED,
    PARAMETER,
    POINTER,
    POINTER_BYTES,
    Operand,
)

_WIDTHS: Final = ("", "B", "W", "", "D")
_SIZES: Final = {"B": 1, "W": 2, "D": 4}
#: Areas, counters and status bits with different names in German.
_GERMAN_AREAS: Final[dict[str, str]] = {"I": "E", "Q": "A", "PI": "PE", "PQ": "PA", "C": "Z"}
_ENGLISH_AREAS: Final = {german: english for english, german in _GERMAN_AREAS.items()}
_GERMAN_FIXED: Final[dict[str, str]] = {"BR": "BIE"}
_FIXED: Final = frozenset(
    (
        "AR2",
        "DBLG",
        "DILG",
        "DBNO",
        "DINO",
        "STW",
        "OS",
        "OV",
        ">0",
        "<0",
        "UO",
        "<>0",
        "==0",
        ">=0",
        "<=0",
        "BR",
        "0",
        "1",
    )
)

_BIT: Final = re.compile(r"(DBX|DIX|[A-Z]) (\d{1,8})\.([0-7])")
_PLACE: Final = re.compile(r"(P[IQEA]|DB|DI|[A-Z])([BWD]) (\d{1,8})")
_NUMBERED: Final = re.compile(r"(SFC|SFB|DB|DI|FC|FB|T|C|Z) (\d{1,8})")
_VIA: Final = re.compile(r"([A-Z]*) ?\[(?:(AR[12]),P#(\d{1,8})\.([0-7])|((?:M|DB|DI|L)[WD]) (\d{1,8}))\]")
_POINTER: Final = re.compile(r"P#(?:(DBX|DIX|[A-Z]|0x[0-9A-F]{2}) )?(\d{1,8})\.([0-7])")
_PARAMETER: Final = re.compile(r"(P##|#)([A-Z_]+\d*)")
_DATA: Final = re.compile(r"([BW])#16#([0-9A-F]{1,4})")
_DISTANCE: Final = re.compile(r"[+-]\d{1,5}")
_UNNAMED: Final = "PAR"


class Names:
    """Names of a block's formal parameters, and how instructions use each."""

    def __init__(self, names: list[str] | None = None, used: list[str] | None = None) -> None:
        self._names = names or []
        self._used = used or []
        self._positions = {name: position for position, name in enumerate(self._names, 1)}

    def name(self, number: int) -> str:
        """Return the name of a parameter; ``number`` is twice its position."""
        position = number // 2
        if number & 1 or not 1 <= position <= len(self._names):
            return f"{_UNNAMED}{number}"
        return self._names[position - 1]

    def find(self, name: str) -> tuple[int, str]:
        """Return twice the position of a parameter, and how it is used; -1 if it is unknown."""
        position = self._positions.get(name)
        if position is not None:
            return 2 * position, self._used[position - 1] if position <= len(self._used) else ""
        number = name.removeprefix(_UNNAMED)
        return (int(number), "") if number.isdecimal() and len(number) < 6 else (-1, "")


NO_NAMES: Final = Names()


def mnemonic(name: str, german: bool) -> str:
    """Return the name of an instruction in English or German."""
    return GERMAN.get(name, name) if german else name


def english(name: str) -> str:
    """Return the English name of a German instruction."""
    return ENGLISH.get(name, name)


def area_text(area: str, german: bool) -> str:
    """Return the letters of an area."""
    return _GERMAN_AREAS.get(area, area) if german else area


def operand_text(operand: Operand, german: bool = False, names: Names = NO_NAMES) -> str:
    """Return an operand as text; a jump is a distance in words, because labels are not known here."""
    kind = operand.kind
    if kind == MEMORY:
        return _memory_text(operand, german)
    if kind == CONSTANT:
        return constant_text(operand)
    if kind == NUMBERED:
        letters = area_text(operand.area, german)
        return f"{letters} [{operand.via} {operand.number}]" if operand.via else f"{letters} {operand.number}"
    if kind == COUNT:
        return str(operand.number)
    if kind == FIXED:
        return _GERMAN_FIXED.get(operand.area, operand.area) if german else operand.area
    if kind == POINTER:
        return pointer_text(operand, german)
    if kind == PARAMETER:
        return ("P##" if operand.area == "P##" else "#") + names.name(operand.number)
    if kind in {JUMP, JUMP_LIST}:
        return f"{operand.number:+d}"
    if kind == "data":
        return f"{'W' if operand.width == 2 else 'B'}#16#{operand.number:0{2 * operand.width}X}"
    return ""


def _memory_text(operand: Operand, german: bool) -> str:
    letters = area_text(operand.area, german)
    if operand.width:
        letters += _WIDTHS[operand.width]
    elif operand.area in {"DB", "DI"}:
        letters += "X"
    at, bit = divmod(operand.number, 8)
    if operand.via.startswith("AR"):
        return f"{letters} [{operand.via},P#{at}.{bit}]".lstrip()
    if operand.via:
        return f"{letters} [{operand.via} {operand.number}]"
    return f"{letters} {at}" if operand.width and not bit else f"{letters} {at}.{bit}"


def pointer_text(operand: Operand, german: bool = False) -> str:
    """Return a pointer as text: ``P#M 0.0``; an unknown area byte is written as a number."""
    at, bit = divmod(operand.number, 8)
    area = operand.area
    if area and area not in POINTER_BYTES:
        area = f"0x{area}"
    letters = f"{area_text(area, german)} " if area else ""
    return f"P#{letters}{at}.{bit}"


def parse_operand(text: str, german: bool = False, names: Names = NO_NAMES) -> list[Operand]:
    """Return the possible meanings of an operand, the usual one first; empty if it is not an operand."""
    if not text:
        return [NO_OPERAND]
    found: list[Operand] = []
    if text.isdecimal() and text.isascii() and len(text) <= 5:
        found.append(Operand(COUNT, "", 0, int(text)))
    fixed = "BR" if german and text == "BIE" else text
    if fixed in _FIXED:
        found.append(Operand(FIXED, fixed))
    for reader in (_read_bit, _read_place, _read_numbered, _read_via, _read_pointer):
        operand = reader(text, german)
        if operand is not None:
            found.append(operand)
            if operand.kind == POINTER and not operand.area:
                found.append(operand._replace(width=2))
    found += _read_parameter(text, names)
    if _DISTANCE.fullmatch(text):
        found += [Operand(JUMP, "", 0, int(text)), Operand(JUMP_LIST, "", 0, int(text))]
    match = _DATA.fullmatch(text)
    if match is not None:
        found.append(Operand("data", "", 2 if match[1] == "W" else 1, int(match[2], 16)))
    return found + parse_constants(text)


def _english(letters: str, german: bool) -> str:
    return _ENGLISH_AREAS.get(letters, letters) if german else letters


def _read_bit(text: str, german: bool) -> Operand | None:
    match = _BIT.fullmatch(text)
    if match is None:
        return None
    area = _english(match[1], german).removesuffix("X")
    return Operand(MEMORY, area, 0, int(match[2]) * 8 + int(match[3]))


def _read_place(text: str, german: bool) -> Operand | None:
    match = _PLACE.fullmatch(text)
    if match is None:
        return None
    return Operand(MEMORY, _english(match[1], german), _SIZES[match[2]], int(match[3]) * 8)


def _read_numbered(text: str, german: bool) -> Operand | None:
    match = _NUMBERED.fullmatch(text)
    return Operand(NUMBERED, _english(match[1], german), 0, int(match[2])) if match is not None else None


def _read_via(text: str, german: bool) -> Operand | None:
    match = _VIA.fullmatch(text)
    if match is None:
        return None
    letters = match[1]
    via = match[2] or match[5]
    number = int(match[6]) if match[5] else int(match[3]) * 8 + int(match[4])
    area, width = letters, 0
    if via.endswith("W"):
        return Operand(NUMBERED, _english(letters, german), 0, number, via)
    if letters in {"DBX", "DIX"}:
        area = letters[:2]
    elif letters[-1:] in _SIZES and _is_area(letters[:-1], german):
        area, width = letters[:-1], _SIZES[letters[-1]]
    return Operand(MEMORY, _english(area, german), width, number, via)


def _is_area(letters: str, german: bool) -> bool:
    return _english(letters, german) in {"", "I", "Q", "M", "DB", "DI", "L", "PI", "PQ"}


def _read_pointer(text: str, german: bool) -> Operand | None:
    match = _POINTER.fullmatch(text)
    if match is None:
        return None
    area = match[1] or ""
    area = area[2:] if area.startswith("0x") else _english(area, german)
    return Operand(POINTER, area, 4, int(match[2]) * 8 + int(match[3]))


def _read_parameter(text: str, names: Names) -> list[Operand]:
    match = _PARAMETER.fullmatch(text)
    if match is None:
        return []
    number, used = names.find(match[2])
    if number < 0:
        return []
    if match[1] == "P##":
        return [Operand(PARAMETER, "P##", 0, number)]
    kinds = [used] if used else []
    kinds += [kind for kind in ("WORD", "BOOL", "BYTE", "DWORD", "T", "C", "FC", "FB", "DB", "DI") if kind not in kinds]
    return [Operand(PARAMETER, kind, 0, number) for kind in kinds]
