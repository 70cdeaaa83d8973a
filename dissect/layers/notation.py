"""Items from addresses as people write them (`dissect.protocols.s7.address.parse_address`)."""

from __future__ import annotations

import re
from typing import Final

from dissect.layers.variables import S7_Any
from dissect.protocols.s7.address import MAX_DB, MAX_OCTET, Address, parse_address
from dissect.protocols.s7.tables import BIT, NUMBERED_AREAS, RECORD_AREA, TRANSPORT_SIZES

#: Transport size of a width letter. No letter is one bit.
_WIDTHS: Final = {"": 0x01, "X": 0x01, "B": 0x02, "W": 0x04, "D": 0x06, "L": 0x0F}
#: The meanings of width letters.
_NOUNS: Final = {"B": "byte", "W": "word", "D": "double word", "L": "long word"}
_MAX_WORD: Final = 65535
#: A count, as summaries write it: ``DB10.DBW4 x3``.
_COUNT: Final = re.compile(r"\s+X([0-9]{1,5})")
#: A pointer of STEP 7: ``P#DB10.DBX4.0 BYTE 10``, ``P#M 10.0 BYTE 4``; its type and number may be missing.
_POINTER: Final = re.compile(r"P#\s*(.*?[0-9]\.[0-7])(?:\s+([A-Z_]+)(?:\s+([0-9]{1,5}))?)?")
#: Peripheral inputs and outputs, which are one area: ``PIW256``, ``PQB0``, in German ``PEW256``, ``PAB0``.
_PERIPHERAL: Final = re.compile(r"P[IQEA]([BWD][0-9]{1,8})")
#: How items of other syntaxes are written, and the classes that make them.
_OTHERS: Final = {
    r"NCK": "as S7_NCKItem(area=…, module=…, column=…, line=…)",
    r"DRIVE": "as S7_DriveItem(…)",
    r"SYM\b": "as S7_SymbolInDB(…) or S7_SymbolInMemory(…)",
    r"D[BI][0-9]+\..*\+D[BI]": "as S7_DBReadItem(areas=[S7_DBArea(…), …])",
    r"0X[0-9A-F]+:|[0-9A-F]{8}\b|.*\"|.*\.LID|.*\bLID\b": "as S7Plus_Address(…) or a value of SCD",
}


def at(address: str, count: int | None = None, transport_size: str | int | None = None) -> S7_Any:
    """Return the item of an address: ``DB10.DBX4.1``, ``DB10.DBW4``, ``MW20``, ``I0.0`` or ``E0.0``, ``T5``, ``C3`` or ``Z3``.

    It takes all addresses that summaries print (``DB10.DBW4 x3``, ``SF200:B0``, ``RECORD1@2``), peripheral ones (``PIW256``),
    and pointers (``P#DB10.DBX4.0 BYTE 10``). ``count`` is in elements, 1 unless the text gives one. The transport size follows
    from the width letter (B BYTE, W WORD, D DWORD, none or X BIT, L DATE_AND_TIME) or the type of the pointer;
    ``transport_size`` sets a different one for the same address, for example ``"REAL"`` for ``DB1.DBD8``. Raises ValueError for
    an invalid address.
    """
    text = address.strip().upper()
    if (pointer := _POINTER.fullmatch(text)) and (
        parsed := parse_address(_written("".join(pointer[1].split())))
    ) is not None:
        kind = transport_size if transport_size is not None else pointer[2] or BIT
        return _placed(address, parsed, int(pointer[3] or 1) if count is None else count, kind, parsed.bit)
    if counted := _COUNT.search(text):
        text = text[: counted.start()] if counted.end() == len(text) else text
        count = int(counted[1]) if count is None else count
    text = _PERIPHERAL.sub(r"P\1", text)
    parsed = parse_address(_written(text))
    if parsed is None:
        raise _no_address(address, _advice(text))
    size = _WIDTHS[parsed.width]
    if parsed.area not in NUMBERED_AREAS and parsed.area != RECORD_AREA and (parsed.bit < 0) == (size == BIT):
        raise _no_address(address, _of_bits(text))
    return _placed(address, parsed, 1 if count is None else count, transport_size, 0)


def _advice(text: str) -> str:
    """Return how to write a text that is not an address: the class of a different kind of item, if it looks like one."""
    for pattern, kinds in _OTHERS.items():
        if re.match(pattern, text):
            return f"items of this kind are made with their fields, {kinds}"
    return "write it as DB10.DBX4.1, DB10.DBW4, MW20, I0.0, PIW256, T5, C3 or P#DB10.DBX4.0 BYTE 10"


def _of_bits(text: str) -> str:
    """Return how to write a bit, and a wider element, for a text that mixes the two."""
    area, width, number, bit = re.fullmatch(r"(.*?)([XBWDL]?)([0-9]+)(?:\.([0-7]))?", text).groups()  # type: ignore[union-attr]
    wide = "" if width == "X" else width
    letter = "X" if area.endswith((".DB", ".DI", ":")) else ""
    return (
        f"a bit has a place after the dot, anything wider has none: {area}{letter}{number}.{bit or 0} for the bit, "
        f"{area}{wide or 'B'}{number} for the {_NOUNS[wide or 'B']}"
    )


def _written(text: str) -> str:
    """Return a text in capitals, except for numbers of areas without a name, which `parse_address` knows in small letters."""
    return re.sub("^AREA0X[0-9A-F]{2}", lambda area: area[0].lower(), text)


def _placed(address: str, parsed: Address, count: int, transport_size: str | int | None, bit: int) -> S7_Any:
    """Return the item of a parsed address; a pointer to anything wider than a bit must end with ``bit`` 0."""
    if parsed.area in NUMBERED_AREAS:
        if parsed.number > _MAX_WORD:
            raise _no_address(address, "a counter or timer is a letter and a number")
        return _item(address, parsed.area, 0, parsed.number, parsed.area, count, transport_size)
    if parsed.number > MAX_OCTET or parsed.db > MAX_DB:
        raise _no_address(address, "its numbers do not fit the fields of an item")
    if parsed.area == RECORD_AREA:
        return _item(address, parsed.area, parsed.db, parsed.field, _WIDTHS["B"], count, transport_size)
    if bit > 0 and transport_size not in {"BIT", "BOOL", BIT}:
        raise _no_address(address, "a pointer to anything wider than a bit ends with .0")
    return _item(address, parsed.area, parsed.db, parsed.field, _WIDTHS[parsed.width], count, transport_size)


def _item(
    address: str, area: int, db: int, place: int, size: int, count: int, transport_size: str | int | None
) -> S7_Any:
    if not 0 < count <= _MAX_WORD:
        message = f"{count} elements of {address!r} cannot be requested: give 1 to {_MAX_WORD}"
        raise ValueError(message)
    if isinstance(transport_size, str):
        names = {name: number for number, name in TRANSPORT_SIZES.names().items()}
        names["BOOL"] = BIT
        if transport_size.upper() not in names:
            message = f"{transport_size!r} is not a transport size: give one of {', '.join(names)}"
            raise ValueError(message)
        transport_size = names[transport_size.upper()]
    if transport_size is not None:
        size = transport_size
    return S7_Any(transport_size=size, count=count, db=db, area=area, address=place)


def _no_address(address: str, advice: str) -> ValueError:
    return ValueError(f"{address!r} is not an address: {advice}")
