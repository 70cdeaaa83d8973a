"""Finds what a request loads into a CPU: blocks, types, texts and the hardware configuration, anywhere in its objects.

A CPU is loaded by creating objects. Engineering tools create each block in the program of the CPU, or the whole program, with
its blocks inside, in the root of the CPU; in captures both occur. So every object of a request is examined, and its class shows
its kind.
"""

from __future__ import annotations

from typing import Final

from dissect.protocols.s7plus.contents import VariableAddress
from dissect.protocols.s7plus.ids import (
    AREAS,
    BLOCK_KINDS,
    PROTECTIONS,
    block_kind,
    block_name,
    member_name,
    short_name,
)
from dissect.protocols.s7plus.objects import PlusObject
from dissect.protocols.s7plus.program import CODE, TYPE_INFO
from dissect.protocols.s7plus.program_tables import LANGUAGES
from dissect.protocols.s7plus.session import LANGUAGE, NAME, NUMBER
from dissect.wire.text import count

# Kinds of events (`dissect.protocols.s7plus.events`).
LOADED: Final = "load"
PROTECTED: Final = "protection"
FIRMWARE: Final = "firmware"

#: The object that contains the firmware of a CPU (by its name in one source; there is no capture).
FIRMWARE_PACKAGE: Final = 16
#: The object of the program, and its class; class of the hardware configuration, and of texts with their languages.
PROGRAM: Final = 3
_PROGRAM_CLASS: Final = 2520
HARDWARE: Final = 2
_HARDWARE_CLASS: Final = 2496
_TEXTS_CLASS: Final = 4672
#: Objects that contain the program and the hardware configuration.
CONTAINERS: Final = {PROGRAM: "the program", HARDWARE: "the hardware configuration"}
#: The attribute by which an engineering tool states that the loaded objects are complete.
CONSISTENT: Final = 2458
#: Attributes of a block that are its code and its interface, not its values; writing one of them changes the program.
LOADS: Final = CODE | {2544, 4578}
#: Maximum number of objects that a text names.
_NAMED: Final = 5
#: Kinds of blocks in the order in which a text names them; from `_TYPES_FROM` on they are types.
_ORDER: Final = "OB FB FC DB UDT FBT SDT FCT"
_TYPES_FROM: Final = _ORDER.index("UDT")


def number_of(one: PlusObject) -> int:
    """Return the number of a block: the attribute, or else its id, which ends with it; -1 if it has neither."""
    number = one.number(NUMBER)
    if number >= 0:
        return number
    return one.rid & 0xFFFF if one.rid >> 16 in BLOCK_KINDS else -1


def load_text(parent: int, tops: list[PlusObject], every: list[PlusObject], unread: bool) -> str:
    """Return what is loaded by creating ``tops`` in the object ``parent``; empty for objects that belong to no program.

    ``every`` are these objects and all inside them. ``unread``: there are more, which could not be read.
    """
    blocks = [one for one in every if block_kind(one.rid, one.class_id)]
    parts = _parts(every, len(blocks) > 0)
    if not blocks and not parts and parent != PROGRAM:
        return ""
    outer = {one.offset for one in tops}
    if parent == PROGRAM and all(one.offset in outer for one in blocks):
        text = said(tops) or "objects that were not read"
    else:
        text = ", ".join([*parts, *([_counted(blocks)] if blocks else [])]) or said(tops)
    return text + (" and more that was not read" if unread else "")


def written_as(address: VariableAddress) -> tuple[str, str]:
    """Return the kind of event for writing an attribute, and a text of it; both are empty for most attributes."""
    attribute = address.lids[-1] if address.lids else address.sub_area
    if address.sub_area in LOADS and address.area >> 16 in BLOCK_KINDS:
        return LOADED, f"{block_name(address.area)} ({member_name(address.sub_area)})"
    if attribute in PROTECTIONS and address.area >> 16 not in BLOCK_KINDS and address.area not in AREAS:
        return PROTECTED, f"{short_name(address.area)}.{member_name(attribute)}"
    if address.area == FIRMWARE_PACKAGE:
        return FIRMWARE, f"{short_name(address.area)}.{member_name(attribute)}"
    return "", ""


def _is_container(class_id: int) -> bool:
    return class_id == _PROGRAM_CLASS or class_id == _HARDWARE_CLASS or class_id == _TEXTS_CLASS


def _parts(every: list[PlusObject], blocks: bool) -> list[str]:
    """Return the loaded objects other than blocks."""
    if not blocks and not any(_is_container(one.class_id) for one in every):
        return []
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
    """Return a text about blocks: their number if there are several, and some names, blocks with code first."""
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
