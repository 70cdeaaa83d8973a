"""Finds blocks in an S7comm-plus PDU: objects with a block number, and their attributes (docs/s7plus.md)."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Final

from dissect.protocols.s7plus.bodies import parse_contents
from dissect.protocols.s7plus.ids import block_kind
from dissect.protocols.s7plus.loads import number_of
from dissect.protocols.s7plus.message import parse_plus
from dissect.protocols.s7plus.objects import Attribute, Element, PlusObject, every_object, objects_of, read_into
from dissect.protocols.s7plus.program_tables import LANGUAGES
from dissect.protocols.s7plus.session import CODE_TIME, INTERFACE_TIME, LANGUAGE, NAME
from dissect.protocols.s7plus.value_showing import iso_time
from dissect.protocols.s7plus.values import Blob, Struct, Value
from dissect.protocols.s7plus.walk import FormatError, Walk

_PROTECTION: Final = 2524
# a member of the attribute above: 0 for none; 3 in captures, as in the header of an S7-300/400 block
_PROTECTION_MODE: Final = 3448
#: Attributes of the code: XML source, the code that the CPU runs, the references of both, called blocks, constants.
BODY: Final = 2533
_CODE: Final = frozenset((BODY, 2580, 2583, 2586, 2591, 8190))
#: Attributes of a data block: initial and actual values.
_VALUES: Final = frozenset((2548, 2550))
#: Attributes of the interface: XML source, and types.
INTERFACE: Final = 2544
_INTERFACE: Final = frozenset((INTERFACE, 4578))
#: The names that a body refers to, as XML.
REFERENCES: Final = 2583
#: Blobs that are written as separate files, and what they contain.
TEXTS: Final[dict[int, str]] = {BODY: "body", INTERFACE: "interface", REFERENCES: "references"}
#: Maximum number of blocks taken from one PDU; a CPU has a few thousand.
MAX_BLOCKS: Final = 8192


class PlusBlock:
    """A block of an S7-1200/1500: ``octets`` are its object in the PDU, as far as it is readable.

    ``whole`` is False if the end of the object is missing. ``code`` (the values, for a data block), ``interface`` and ``rest``
    are the octets of its attributes as sent, for comparisons. Times are ISO texts.
    """

    __slots__ = (
        "_object", "author", "code", "code_time", "family", "interface", "interface_time", "kind", "language", "name",
        "number", "octets", "protected", "rest", "version", "whole",
    )  # fmt: skip

    def __init__(self, one: PlusObject, data: bytes) -> None:
        self._object = one
        self.kind = block_kind(one.rid, one.class_id)
        self.number = number_of(one)
        self.whole = one.end > 0
        if not self.whole:
            one.end = _end_of(one)
        self.octets = data[one.offset : one.end]
        self.name = one.text(NAME)
        language = one.number(LANGUAGE)
        self.language = LANGUAGES.name(language) if language > 0 else ""
        self.code_time = _time(one.number(CODE_TIME))
        self.interface_time = _time(one.number(INTERFACE_TIME))
        self.author = self.family = self.version = ""
        self.protected = _is_protected(one.find(_PROTECTION))
        self.code, self.interface, self.rest = self._split(one, data)

    def _split(self, one: PlusObject, data: bytes) -> tuple[bytes, bytes, bytes]:
        """Return the octets of the code attributes, of the interface attributes, and of the rest of the object, as sent."""
        code_ids = _VALUES if self.kind == "DB" else _CODE
        code, interface, rest = bytearray(), bytearray(), bytearray()
        at = one.offset
        for element in one.elements:
            id_ = element.id if isinstance(element, Attribute) else -1
            if isinstance(element, Attribute) and (id_ in code_ids or id_ in _INTERFACE):
                value = element.value
                rest += data[at : value.offset]
                (code if id_ in code_ids else interface).extend(data[value.offset : value.end])
                at = value.end
        rest += data[at : one.end]
        return bytes(code), bytes(interface), bytes(rest)

    def blobs(self) -> Iterator[tuple[int, bytes]]:
        """Yield the compressed texts of body and interface as (attribute id, octets), in wire order."""
        for element in self._object.elements:
            if isinstance(element, Attribute) and element.id in TEXTS:
                for octets in _blobs(element.value):
                    yield element.id, octets


def _is_protected(value: Value | None) -> bool:
    content = value.content if value is not None else None
    mode = content.find(_PROTECTION_MODE) if isinstance(content, Struct) else None
    return mode is not None and isinstance(mode.content, int) and mode.content > 0


def _end_of(one: PlusObject) -> int:
    """Return the end of the last attribute of an object without an end, or its beginning if it has no attribute."""
    ends = [element.value.end for element in one.elements if isinstance(element, Attribute)]
    return ends[-1] if ends else one.offset


def _blobs(value: Value) -> Iterator[bytes]:
    content = value.content
    pieces = [content] if isinstance(content, Blob) else content if isinstance(content, list) else []
    for piece in pieces:
        one = piece[1] if isinstance(piece, tuple) else piece
        inner = one.content if isinstance(one, Value) else one
        if isinstance(inner, Blob):
            yield inner.octets
        elif isinstance(inner, bytes):
            yield inner


def _time(ns: int) -> str:
    return iso_time(ns).replace("T", " ") if ns > 0 else ""


def plus_blocks(octets: bytes) -> list[PlusBlock]:
    """Return the readable blocks in a PDU in wire order. Never raises."""
    pdu = parse_plus(octets)
    found = parse_contents(pdu, False)
    every = every_object(found.objects or found.begun)
    blocks = [one for one in every if block_kind(one.rid, one.class_id)]
    return [PlusBlock(one, pdu.data) for one in blocks[:MAX_BLOCKS]]


def plus_block_of(octets: bytes) -> PlusBlock | None:
    """Return the block in octets that `PlusBlock.octets` returned; None if there is none. Never raises."""
    blocks = [one for one in objects_of(_elements(octets)) if block_kind(one.rid, one.class_id)]
    return PlusBlock(blocks[0], octets) if blocks else None


def _elements(octets: bytes) -> list[Element]:
    """Return the elements in octets; if the octets are too short or faulty, only those before the fault."""
    elements: list[Element] = []
    try:
        read_into(Walk(octets, 0, len(octets), False), elements)
    except FormatError:
        return elements
    return elements
