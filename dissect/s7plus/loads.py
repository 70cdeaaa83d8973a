"""Finds what a request loads into a CPU: blocks, types, texts and the hardware configuration, wherever they are in its objects.

A CPU is loaded by objects that are created. Engineering tools create each block in the program of the CPU, or the whole
program, with its blocks inside, in the root of the CPU; in captures both occur. So every object of a request is looked at, and
its class says what it is.
"""

from __future__ import annotations

from typing import Final

from dissect.s7plus.contents import Address
from dissect.s7plus.ids import BLOCK_KINDS, block_kind, block_name, member_name, short_name
from dissect.s7plus.objects import PlusObject
from dissect.s7plus.program import CODE, TYPE_INFO
from dissect.s7plus.program_tables import LANGUAGES
from dissect.s7plus.session import CODE_TIME, INTERFACE_TIME, LANGUAGE, NAME, NUMBER
from dissect.wire.text import count

#: The object of the program, and its class; class of the hardware configuration, and of texts with their languages.
PROGRAM: Final = 3
_PROGRAM_CLASS: Final = 2520
HARDWARE: Final = 2
_HARDWARE_CLASS: Final = 2496
_TEXTS_CLASS: Final = 4672
#: Objects that hold the program and the hardware configuration.
CONTAINERS: Final = {PROGRAM: "the program", HARDWARE: "the hardware configuration"}
#: The attribute by which an engineering tool says that what it loaded is complete.
CONSISTENT: Final = 2458
#: Attributes of a block that are its code and its interface, not its values; writing one of them changes the program.
LOADS: Final = CODE | {2544, 4578}
#: How many objects a text names, and how many blocks of one request are remembered.
_NAMED: Final = 5
#: Kinds of blocks in the order in which a text names them; from `_TYPES_FROM` on they are types.
_ORDER: Final = "OB FB FC DB UDT FBT SDT FCT"
_TYPES_FROM: Final = _ORDER.index("UDT")
MAX_BLOCKS: Final = 1024


class LoadedBlock:
    """A block that a request carries: what its object says about it, and its size there.

    ``number`` is -1 if the object states none. Times are nanoseconds since 1970, -1 if it has none. ``name`` is from the wire
    and not escaped.
    """

    __slots__ = ("code_ns", "interface_ns", "kind", "language", "name", "number", "size")

    def __init__(self, one: PlusObject, kind: str) -> None:
        self.kind = kind
        self.number = number_of(one)
        self.name = one.text(NAME)
        language = one.number(LANGUAGE)
        self.language = LANGUAGES.name(language) if language > 0 else ""
        self.size = max(0, one.end - one.offset)
        self.code_ns = one.number(CODE_TIME)
        self.interface_ns = one.number(INTERFACE_TIME)

    @property
    def label(self) -> str:
        """Type and number: ``FB1084``."""
        return f"{self.kind}{self.number}" if self.number >= 0 else self.kind


class Loading:
    """What one request loads: its blocks, those that were not remembered (``more``), other parts, and a text of all of it."""

    __slots__ = ("blocks", "more", "parts", "text")

    def __init__(self, text: str) -> None:
        self.text = text
        self.blocks: list[LoadedBlock] = []
        self.more = 0
        self.parts: list[str] = []


def number_of(one: PlusObject) -> int:
    """Return the number of a block: the attribute, or else its id, which ends in it; -1 if it has neither."""
    number = one.number(NUMBER)
    if number >= 0:
        return number
    return one.rid & 0xFFFF if one.rid >> 16 in BLOCK_KINDS else -1


def loading_of(parent: int, tops: list[PlusObject], every: list[PlusObject], unread: bool) -> Loading | None:
    """Return what creating ``tops`` in the object ``parent`` loads; None for objects that belong to no program.

    ``every`` are these objects and all inside them. ``unread``: there are more, which could not be read.
    """
    blocks = [one for one in every if block_kind(one.rid, one.class_id)]
    parts = _parts(every, len(blocks) > 0)
    if not blocks and not parts and parent != PROGRAM:
        return None
    outer = {one.offset for one in tops}
    if parent == PROGRAM and all([one.offset in outer for one in blocks]):
        text = said(tops) or "objects that were not read"
    else:
        text = ", ".join([*parts, *([_counted(blocks)] if blocks else [])]) or said(tops)
    found = Loading(text + (" and more that was not read" if unread else ""))
    found.blocks = [LoadedBlock(one, block_kind(one.rid, one.class_id)) for one in blocks[:MAX_BLOCKS]]
    found.more = len(blocks) - len(found.blocks)
    found.parts = parts
    return found


def written_code(address: Address) -> Loading | None:
    """Return what writing an attribute loads: code or interface of a block; None for all others."""
    if address.sub_area not in LOADS or address.area >> 16 not in BLOCK_KINDS:
        return None
    return Loading(f"{block_name(address.area)} ({member_name(address.sub_area)})")


def _parts(every: list[PlusObject], blocks: bool) -> list[str]:
    """Return what else is loaded, without blocks."""
    classes = [one.class_id for one in every]
    parts = ["the hardware configuration"] if _HARDWARE_CLASS in classes else []
    whole = _PROGRAM_CLASS in classes
    if whole:
        parts.append("the program")
    types = classes.count(TYPE_INFO) if whole or blocks else 0
    if types:
        parts.append(count(types, "description of a type", "descriptions of types"))
    texts = classes.count(_TEXTS_CLASS)
    if texts:
        parts.append(count(texts, "text container"))
    return parts


def _counted(blocks: list[PlusObject]) -> str:
    """Return a text of blocks: of several how many there are, and the names of some, those with code first."""
    if len(blocks) == 1:
        return said(blocks)
    rank = [_ORDER.find(block_kind(one.rid, one.class_id)) for one in blocks]
    order = sorted(range(len(blocks)), key=lambda at: rank[at])
    types = len([place for place in rank if place >= _TYPES_FROM])
    counts = [count(len(blocks) - types, "block")] if len(blocks) > types else []
    counts += [count(types, "type")] if types else []
    return f"{' and '.join(counts)}: {said([blocks[at] for at in order])}"


def said(objects: list[PlusObject]) -> str:
    """Return a text with the names and languages of objects."""
    more = f" and {len(objects) - _NAMED} more" if len(objects) > _NAMED else ""
    return ", ".join([_said(one) for one in objects[:_NAMED]]) + more


def _said(one: PlusObject) -> str:
    kind = block_kind(one.rid, one.class_id)
    number = number_of(one)
    text = f"{kind}{number}" if kind and number >= 0 else kind or short_name(one.class_id)
    if not kind and number >= 0:
        text += f" {number}"
    name = one.text(NAME)
    title = f" {name!r}" if name and name != text else ""
    language = one.number(LANGUAGE)
    return f"{text}{title}{f' ({LANGUAGES.name(language)})' if language > 0 else ''}"
