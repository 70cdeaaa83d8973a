"""Block names as text: type, number and file system (reference section 3.9); used for files, PI services and block info."""

from __future__ import annotations

from typing import Final

from dissect.protocols.s7.tables import BLOCK_TYPES
from dissect.wire.layout import HOLDS_NUMBER, Field

#: Meaning of the first character of a file name.
_IDENTIFIERS: Final = {"_": "complete module", "$": "module header"}
#: Meaning of the last character: where the block is stored, or will be stored.
FILE_SYSTEMS: Final = {"P": "passive", "A": "active", "B": "active and passive"}
_HEX_DIGITS: Final = b"0123456789ABCDEFabcdef"
#: Octets of a block name without the identifier.
NAME_SIZE: Final = 8


def printable(octets: bytes) -> str:
    """Return octets as text, one character each."""
    return octets.decode("latin-1")


def identifier_text(octets: bytes) -> str | None:
    """Return the identifier of a file name with its meaning."""
    text = printable(octets)
    return f"{text} {_IDENTIFIERS[text]}" if text in _IDENTIFIERS else text


def type_text(octets: bytes) -> str | None:
    """Return a block type, for example ``DB``; an unknown type as its two digits."""
    digits = printable(octets)
    return BLOCK_TYPES.get(digits.upper(), digits)


def number_text(octets: bytes) -> str | None:
    """Return a block number without leading zeros; any other text unchanged."""
    return str(int(octets)) if octets.isdigit() else printable(octets)


def file_system_text(octets: bytes) -> str | None:
    """Return the meaning of the file system character, for example ``passive``."""
    text = printable(octets)
    return FILE_SYSTEMS.get(text, text)


def is_block_name(octets: bytes) -> bool:
    """Return whether eight octets are a block name: two digits of the type, five of the number, the file system."""
    return len(octets) == NAME_SIZE and octets[0] in _HEX_DIGITS and octets[1] in _HEX_DIGITS and octets[2:7].isdigit()


def block_text(octets: bytes) -> str:
    """Return the text for eight octets that name a block, for example ``DB 1, passive``; other octets unchanged."""
    if not is_block_name(octets):
        return printable(octets)
    return f"{type_text(octets[:2])} {number_text(octets[2:7])}, {file_system_text(octets[7:])}"


def name_fields(type_name: str, number_name: str, system_name: str) -> list[Field]:
    """Return the three fields of a block name; the arguments are Wireshark's names, which differ from place to place."""
    return [
        Field(
            "block_type", 2, "Type of the block, two digits as text.", type_name, means=type_text, holds=HOLDS_NUMBER
        ),
        Field(
            "block_number",
            5,
            "Number of the block, five digits as text.",
            number_name,
            means=number_text,
            holds=HOLDS_NUMBER,
        ),
        Field(
            "file_system", 1, "P passive, A active, B both.", system_name, means=file_system_text, holds=HOLDS_NUMBER
        ),
    ]


#: A block name as a file name, or as a part of one.
FILE_NAME_FIELDS: Final = name_fields(
    "s7comm.data.blockcontrol.block_type",
    "s7comm.data.blockcontrol.block_number",
    "s7comm.data.blockcontrol.dest_filesys",
)
