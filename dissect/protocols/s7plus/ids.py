"""Names of objects, classes, attributes and areas as text, by their ids (docs/s7plus.md)."""

from __future__ import annotations

from typing import Final

from dissect.protocols.s7plus.id_tables import IDS, MEMBERS

# Kinds of blocks: the upper 16 bits of the id of their object.
DATA_BLOCK: Final = 0x8A0E
#: Upper 16 bits of the ids of blocks, and the engineers' names for such blocks.
BLOCK_KINDS: Final[dict[int, str]] = {
    DATA_BLOCK: "DB",
    0x8A12: "FB",
    0x8A13: "FC",
    0x8A20: "FB",  # from the library of the engineering tool, such as MB_CLIENT
    0x8A24: "UDT",  # of the same library
    0x8A32: "OB",
    0x89FD: "UDT",
}
#: Classes of organization blocks, one for each kind of event that starts one: the base class, 22 of the first CPUs, motion.
_OB_CLASSES: Final = (2610, *range(2637, 2659), 4637, 4639)
#: The engineers' names for the blocks of a class. The class determines this wherever the object is, and for any id.
BLOCK_CLASSES: Final[dict[int, str]] = {
    2574: "DB",
    2578: "FB",
    2579: "FC",
    3932: "UDT",
    3933: "FBT",
    3934: "SDT",
    3935: "FCT",
    **dict.fromkeys(_OB_CLASSES, "OB"),
}
#: Upper 8 bits of the ids of type information; the lower 16 bits are the number of the block.
TYPE_KINDS: Final[dict[int, str]] = {0x91: "UDT", 0x92: "DB", 0x93: "FB", 0x94: "FC", 0x95: "OB"}
#: Areas: process image, memory, counters and timers.
AREAS: Final[dict[int, str]] = {80: "I", 81: "Q", 82: "M", 83: "C", 84: "T"}


#: Attributes and members whose values are not shown: the answer to a challenge (old and new form), a password of know-how
#: protection, an encrypted key for a MAC, the passwords of a CPU, the data of its users.
SECRETS: Final = frozenset((304, 1846, 3449, 1822, 7918, 7919, 7920, 7921, 8081))
#: The secrets with which a client logs in.
PASSWORDS: Final = frozenset((304, 1846))
#: Attributes that protect a CPU: the level, and its passwords.
PROTECTIONS: Final = frozenset((3451, 7918, 7919, 7920, 7921))
_IS_SECRET: Final = bytes([id_ in SECRETS for id_ in range(max(SECRETS) + 1)])
#: All ids of blocks and all classes of blocks are at least this.
_FIRST_BLOCK: Final = min(BLOCK_KINDS) << 16
_FIRST_CLASS: Final = min(BLOCK_CLASSES)
#: Common beginnings and ends of the names of objects and classes.
_OBJECTS: Final = ("NativeObjects.", "EventRid.", "Class", "GetNewRID")
_CLASS: Final = ".Class_Rid"
#: A request contains it instead of an id that the server is to choose.
NEW_OBJECT: Final = 211
#: Replaces a hidden value.
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
    """Return the name of an id without its number and without prefixes and suffixes: ``CPUexecUnit``, ``DB3``, ``DAI``."""
    row = IDS.get(number)
    if row is None:
        return id_name(number)
    name = row.name.removeprefix("NativeObjects.the").removesuffix(".Class_Rid")
    return name.removesuffix("_Rid").removesuffix("_Aid")


def member_name(number: int) -> str:
    """Return the name of an attribute or member without its class: ``OperatingState``, ``1845``.

    If only an object or a class has this id, the number is returned: in an address it is the index of an array element.
    """
    row = IDS.get(number)
    if row is not None and (row.name.startswith(_OBJECTS) or row.name.endswith(_CLASS)):
        return str(number)
    return short_name(number).rpartition(".")[2]


def block_name(number: int) -> str:
    """Return the name of a block by the id of its object, for example ``DB3``; empty if it is not a block."""
    if number < _FIRST_BLOCK:
        return ""
    kind = BLOCK_KINDS.get(number >> 16)
    return f"{kind}{number & 0xFFFF}" if kind is not None else ""


def block_kind(rid: int, class_id: int) -> str:
    """Return the engineers' name for the block with this id and class; empty if it is not a block."""
    if class_id == 0:
        return ""
    kind = BLOCK_KINDS.get(rid >> 16, "") if rid >= _FIRST_BLOCK else ""
    return kind or (BLOCK_CLASSES.get(class_id, "") if class_id >= _FIRST_CLASS else "")


def is_secret(id_: int) -> bool:
    """Return whether an id is one of `SECRETS`. This is called for every value."""
    return 0 <= id_ < len(_IS_SECRET) and _IS_SECRET[id_] != 0


def is_packed(struct_id: int) -> bool:
    """Return whether a structure is sent as raw octets, as those of types declared by the program are."""
    return 0x90000000 < struct_id < 0x9FFFFFFF or 0x02000000 < struct_id < 0x02FFFFFF
