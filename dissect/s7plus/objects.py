"""Objects: a class, attributes, relations to other objects, lists of variables, and objects inside (docs/s7plus.md)."""

from __future__ import annotations

from typing import Final

from dissect.s7plus.blobs import COMPRESSED
from dissect.s7plus.ids import id_name
from dissect.s7plus.layouts import ATTRIBUTE, OBJECT, OBJECT_END, OBJECT_HELD, RELATION
from dissect.s7plus.skipping import Skipper, member_at, passed
from dissect.s7plus.tables import (
    ATTRIBUTE_TAG,
    NAMES_TAG,
    OBJECT_END_TAG,
    OBJECT_TAG,
    RELATION_TAG,
    TAG_DESCRIPTION_TAG,
    VARIABLES_TAG,
)
from dissect.s7plus.value_reading import read_value
from dissect.s7plus.value_tables import STRUCT, UDINT, WSTRING
from dissect.s7plus.values import Struct, Value, build_value
from dissect.s7plus.variables import (
    NameList,
    TagDescription,
    Variable,
    VariableList,
    build_names,
    build_tag_description,
    build_variables,
    read_names,
    read_tag_description,
    read_variables,
)
from dissect.s7plus.walk import STEP, FormatError, Walk
from dissect.wire.varint import VLQ, build_varint, read_varint


class Attribute:
    """An attribute of an object: its id and its value, which may be read only when somebody asks for it."""

    __slots__ = ("_end", "_octets", "_start", "_value", "id")

    def __init__(self, id_: int, value: Value | None, octets: bytes = b"", start: int = 0, end: int = 0) -> None:
        self.id = id_
        self._value = value
        self._octets = octets  # where the value is, from ``start`` to ``end``, when it is not read yet
        self._start = start
        self._end = end

    @property
    def value(self) -> Value:
        """The value."""
        if self._value is None:
            walk = Walk(self._octets, self._start, self._end, False)
            self._value = read_value(walk, ATTRIBUTE, self._start, "", self.id)
            self._octets = b""
        return self._value

    def text(self) -> str:
        """Return its value as a text, empty when it is none."""
        if self._value is None and _is_plain(self._octets, self._start, WSTRING):
            return _text_at(self._octets, self._start + _HEAD, self._end).decode("utf-8", "replace")
        content = self.value.content
        if isinstance(content, bytes):
            return content.decode("utf-8", "replace")
        return content if isinstance(content, str) else ""

    def number(self) -> int:
        """Return its value as a number, -1 when it is none."""
        if self._value is None and _is_plain(self._octets, self._start, UDINT):
            return read_varint(self._octets, self._start + _HEAD, self._end, VLQ)[0]
        content = self.value.content
        return int(content) if isinstance(content, int) else -1

    def member(self, id_: int) -> str:
        """Return the first member with this id of the structure that it is; empty where it is no text in UTF-8."""
        if self._value is None and _is_plain(self._octets, self._start, STRUCT):
            at = member_at(self._octets, self._start, self._end, id_)
            if at >= 0:
                if not _is_plain(self._octets, at, WSTRING):
                    return ""
                try:
                    return _text_at(self._octets, at + _HEAD, self._end).decode("utf-8")
                except UnicodeDecodeError:
                    return ""
        content = self.value.content
        value = content.find(id_) if isinstance(content, Struct) else None
        return value.content if value is not None and isinstance(value.content, str) else ""


#: Octets of flags and type.
_HEAD: Final = 2


def _is_plain(octets: bytes, at: int, type_: int) -> bool:
    """Tell whether one value of a type begins here, which is sound."""
    return octets[at] == 0 and octets[at + 1] == type_


def _text_at(octets: bytes, at: int, end: int) -> bytes:
    """Return the octets of a text that is sound and whose length is at ``at``."""
    size, begin = read_varint(octets, at, end, VLQ)
    return octets[begin : begin + size]


class Relation:
    """A relation of an object: its id, and the id of the other object."""

    __slots__ = ("id", "rid")

    def __init__(self, id_: int, rid: int) -> None:
        self.id = id_
        self.rid = rid


class PlusObject:
    """An object. ``elements`` are what it holds, in wire order; ``attribute`` is 0 in captures, else ``more`` is there."""

    __slots__ = ("attribute", "class_flags", "class_id", "elements", "end", "more", "offset", "rid")

    def __init__(
        self, rid: int, class_id: int, class_flags: int, attribute: int, more: int, elements: list[Element]
    ) -> None:
        self.rid = rid
        self.class_id = class_id
        self.class_flags = class_flags
        self.attribute = attribute
        self.more = more
        self.elements = elements
        self.offset = 0  # of its tag, and behind the tag that ends it
        self.end = 0

    def find(self, id_: int) -> Value | None:
        """Return the value of an attribute, None when the object has none of this id."""
        found = self._attribute(id_)
        return found.value if found is not None else None

    def _attribute(self, id_: int) -> Attribute | None:
        for element in self.elements:
            if isinstance(element, Attribute) and element.id == id_:
                return element
        return None

    def holds(self, id_: int) -> bool:
        """Tell whether there is an attribute, without reading it."""
        return self._attribute(id_) is not None

    def relation(self, id_: int) -> int:
        """Return the id of the object that a relation leads to, 0 when there is no such relation."""
        for element in self.elements:
            if isinstance(element, Relation) and element.id == id_:
                return element.rid
        return 0

    def text(self, id_: int) -> str:
        """Return an attribute that is a text, empty when it is none."""
        found = self._attribute(id_)
        return found.text() if found is not None else ""

    def number(self, id_: int) -> int:
        """Return an attribute that is a number, -1 when it is none."""
        found = self._attribute(id_)
        return found.number() if found is not None else -1

    def member(self, id_: int, member: int) -> str:
        """Return a text in an attribute that is a structure, empty when there is none."""
        found = self._attribute(id_)
        return found.member(member) if found is not None else ""

    @property
    def objects(self) -> list[PlusObject]:
        """The objects inside it."""
        return [element for element in self.elements if isinstance(element, PlusObject)]

    @property
    def lists(self) -> tuple[list[NameList], list[VariableList]]:
        """Its lists of names and of variables."""
        names = [element for element in self.elements if isinstance(element, NameList)]
        return names, [element for element in self.elements if isinstance(element, VariableList)]

    @property
    def names(self) -> list[str]:
        """Names of the variables it lists."""
        return [name for element in self.elements if isinstance(element, NameList) for name in element.names]

    @property
    def variables(self) -> list[Variable]:
        """Variables it lists, in the order of their names."""
        return [
            variable for element in self.elements if isinstance(element, VariableList) for variable in element.variables
        ]


#: What stands in an object.
Element = Attribute | Relation | PlusObject | VariableList | NameList | TagDescription


def read_elements(walk: Walk) -> list[Element]:
    """Read elements one behind the other, up to an octet that is no tag of one. Raises `FormatError`.

    Of a walk that wants some attributes only, relations and the other attributes are left out, as far as they are sound.
    """
    elements: list[Element] = []
    read_into(walk, elements)
    return elements


def read_into(walk: Walk, elements: list[Element]) -> None:
    """Read elements as `read_elements` does, to the end of ``elements``: where it raises, they hold what came before.

    An object at which it ends is among them, with what was read of it.
    """
    while True:
        wanted = walk.wanted
        if wanted is not None:
            skipper = Skipper(walk.octets, walk.at, walk.end)
            skipper.attributes(wanted.attributes, walk.depth)
            walk.at = skipper.at
            walk.spend(skipper.spent, "value")
        tag = walk.peek()
        start = walk.at
        if tag == ATTRIBUTE_TAG:
            walk.at += 1
            id_ = walk.number(VLQ, "attribute")
            elements.append(_read_attribute(walk, start, id_))
        elif tag == RELATION_TAG:
            walk.at += 1
            id_ = walk.number(VLQ, "relation")
            rid = walk.fixed(4, "relation")
            walk.part(RELATION, start, f"{id_name(id_)} → {id_name(rid)}" if walk.shown else "")
            elements.append(Relation(id_, rid))
        elif tag == OBJECT_TAG:
            _read_object(walk, elements)
        elif tag == VARIABLES_TAG:
            walk.at += 1
            elements.append(read_variables(walk))
        elif tag == NAMES_TAG:
            walk.at += 1
            elements.append(read_names(walk))
        elif tag == TAG_DESCRIPTION_TAG:
            walk.at += 1
            elements.append(read_tag_description(walk))
        else:
            return


def _read_attribute(walk: Walk, start: int, id_: int) -> Attribute:
    if walk.shown:
        return Attribute(id_, read_value(walk, ATTRIBUTE, start, f"{id_name(id_)} = ", id_))
    at = walk.at
    if id_ not in COMPRESSED and passed(walk):
        return Attribute(id_, None, walk.octets, at, walk.at)
    return Attribute(id_, read_value(walk, ATTRIBUTE, start, "", id_))


def _read_object(walk: Walk, elements: list[Element]) -> None:
    start = walk.at
    found = _read_head(walk)
    attribute = found.attribute
    what = f"{id_name(found.class_id)}, {id_name(found.rid)}" if walk.shown else ""
    walk.part(OBJECT_HELD if attribute else OBJECT, start, what)
    walk.enter("object")
    elements.append(found)
    read_into(walk, found.elements)
    walk.depth -= 1
    at = walk.at
    tag = walk.u8("end of object")
    if tag != OBJECT_END_TAG:
        raise FormatError("unknown_type", "element", at, OBJECT_END_TAG, tag)
    walk.part(OBJECT_END, at)
    found.end = walk.at


def _read_head(walk: Walk) -> PlusObject:
    """Read what an object begins with, its tag included."""
    start = walk.at
    walk.spend(STEP, "object")
    walk.at += 1
    rid = walk.fixed(4, "RID")
    class_id = walk.number(VLQ, "class")
    class_flags = walk.number(VLQ, "class flags")
    attribute = walk.number(VLQ, "attribute")
    more = walk.number(VLQ, "attribute") if attribute else 0
    found = PlusObject(rid, class_id, class_flags, attribute, more, [])
    found.offset = start
    return found


def objects_at(octets: bytes, places: list[int], end: int) -> list[PlusObject]:
    """Return objects that are sound, before ``end``, of what `dissect.s7plus.skipping.Skipper` noted of them."""
    found: list[PlusObject] = []
    within: list[PlusObject] = []
    walk = Walk(octets, 0, end, False)
    for at in places:
        tag = octets[at]
        walk.at = at
        if tag == OBJECT_TAG:
            one = _read_head(walk)
            if within:
                within[-1].elements.append(one)
            else:
                found.append(one)
            within.append(one)
        elif tag == OBJECT_END_TAG:
            within.pop().end = at + 1
        elif within:  # nobody asks for what stands in no object
            walk.at = at + 1
            if tag == ATTRIBUTE_TAG:
                id_ = walk.number(VLQ, "attribute")
                within[-1].elements.append(Attribute(id_, None, octets, walk.at, end))
            else:
                within[-1].elements.append(read_variables(walk) if tag == VARIABLES_TAG else read_names(walk))
    return found


def objects_of(elements: list[Element]) -> list[PlusObject]:
    """Return the objects among elements that stand in no object."""
    return [element for element in elements if isinstance(element, PlusObject)]


def every_object(objects: list[PlusObject]) -> list[PlusObject]:
    """Return objects and all those inside them, each before those it holds."""
    found: list[PlusObject] = []
    for one in objects:
        found.append(one)
        found.extend(every_object(one.objects))
    return found


# ---- writing --------------------------------------------------------------------------------------------------------


def build_elements(elements: list[Element]) -> bytes:
    """Return elements one behind the other. Raises as `build_value` does."""
    return b"".join([_build_element(element) for element in elements])


def _build_element(element: Element) -> bytes:
    if isinstance(element, Attribute):
        return bytes((ATTRIBUTE_TAG,)) + build_varint(element.id, VLQ) + build_value(element.value)
    if isinstance(element, Relation):
        return bytes((RELATION_TAG,)) + build_varint(element.id, VLQ) + element.rid.to_bytes(4, "big")
    if isinstance(element, VariableList):
        return build_variables(element)
    if isinstance(element, NameList):
        return build_names(element)
    if isinstance(element, TagDescription):
        return build_tag_description(element)
    return build_object(element)


def build_object(found: PlusObject) -> bytes:
    """Return an object with its tags. Raises as `build_value` does."""
    head = bytes((OBJECT_TAG,)) + found.rid.to_bytes(4, "big")
    numbers = [found.class_id, found.class_flags, found.attribute, *([found.more] if found.attribute else [])]
    body = b"".join([build_varint(number, VLQ) for number in numbers]) + build_elements(found.elements)
    return head + body + bytes((OBJECT_END_TAG,))
