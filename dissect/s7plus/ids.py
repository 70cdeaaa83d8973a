"""What the number of an object, a class, an attribute or an area says to a person (docs/s7plus.md)."""

from __future__ import annotations

from typing import Final

from dissect.s7plus.id_tables import IDS, MEMBERS

# Kinds of blocks: the upper 16 bits of the id of their object.
DATA_BLOCK: Final = 0x8A0E
#: Upper 16 bits of the ids of blocks, and what engineers call the block.
BLOCK_KINDS: Final[dict[int, str]] = {
    DATA_BLOCK: "DB",
    0x8A12: "FB",
    0x8A13: "FC",
    0x8A32: "OB",
    0x89FD: "UDT",
}
#: Upper 8 bits of the ids of type information; the lower 16 bits are the number of the block.
TYPE_KINDS: Final[dict[int, str]] = {0x91: "UDT", 0x92: "DB", 0x93: "FB", 0x94: "FC", 0x95: "OB"}
#: Areas of the process image, of memory, of counters and timers.
AREAS: Final[dict[int, str]] = {80: "I", 81: "Q", 82: "M", 83: "C", 84: "T"}


#: Attributes and members whose value is not shown: the answer to a challenge (old and new form), a password of know-how
#: protection, an encrypted key for a MAC, the passwords of a CPU, the data of its users.
SECRETS: Final = frozenset((304, 1846, 3449, 1822, 7918, 7919, 7920, 7921, 8081))
#: Those of them by which a client logs in.
PASSWORDS: Final = frozenset((304, 1846))
_IS_SECRET: Final = bytes([id_ in SECRETS for id_ in range(max(SECRETS) + 1)])
#: How the names of objects and of classes begin or end.
_OBJECTS: Final = ("NativeObjects.", "EventRid.", "Class", "GetNewRID")
_CLASS: Final = ".Class_Rid"
#: Stands in a request for the id that the server shall choose.
NEW_OBJECT: Final = 211
#: Stands in the place of a value that is hidden.
HIDDEN: Final = "not shown"


def id_name(number: int) -> str:
    """Return the name of an id with its number: ``233 ObjectVariableTypeName``, ``DB3``, ``0x70000e51``."""
    block = block_name(number)
    if block:
        return block
    row = IDS.get(number)
    if row is not None:
        return f"{number} {row.name}"
    kind = TYPE_KINDS.get(number >> 24)
    if kind is not None:
        return f"type of {kind}{number & 0xFFFF} 0x{number:08x}"
    if number >> 16 == 0x020A:
        return f"String[{number & 0xFFFF}]"
    return plain_id(number)


def member_id(number: int) -> str:
    """Return the name of a member of a structure with its number: ``3486 AS_DIS.OperatingState``."""
    row = MEMBERS.get(number)
    return f"{number} {row.name}" if row is not None else id_name(number)


def plain_id(number: int) -> str:
    """Return an id without a name: ``960``, ``0x70000e51``."""
    return str(number) if number < 0x10000 else f"0x{number:08x}"


def short_name(number: int) -> str:
    """Return what an id is called, without its number and what tables put around a name: ``CPUexecUnit``, ``DB3``, ``DAI``."""
    row = IDS.get(number)
    if row is None:
        return id_name(number)
    name = row.name.removeprefix("NativeObjects.the").removesuffix(".Class_Rid")
    return name.removesuffix("_Rid").removesuffix("_Aid")


def member_name(number: int) -> str:
    """Return what an attribute or a member is called, without its class: ``OperatingState``, ``1845``.

    An element of an array stands there by its index, which is no member even where an object or a class has the same number.
    """
    row = IDS.get(number)
    if row is not None and (row.name.startswith(_OBJECTS) or row.name.endswith(_CLASS)):
        return str(number)
    return short_name(number).rpartition(".")[2]


def block_name(number: int) -> str:
    """Return the name of a block by the id of its object, for example ``DB3``; empty when it is none."""
    kind = BLOCK_KINDS.get(number >> 16)
    return f"{kind}{number & 0xFFFF}" if kind is not None else ""


def is_secret(id_: int) -> bool:
    """Tell whether an id is one of `SECRETS`; this is asked of every value."""
    return 0 <= id_ < len(_IS_SECRET) and _IS_SECRET[id_] != 0


def is_packed(struct_id: int) -> bool:
    """Tell whether a structure's octets come as the program holds them: those of types that the program declares."""
    return 0x90000000 < struct_id < 0x9FFFFFFF or 0x02000000 < struct_id < 0x02FFFFFF
