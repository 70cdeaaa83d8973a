"""Objects: a class, attributes, relations to other objects, lists of variables, and objects inside (docs/s7plus.md)."""

from __future__ import annotations

from typing import Final

from mypy_extensions import i64, mypyc_attr

from dissect.protocols.s7plus.blobs import COMPRESSED
from dissect.protocols.s7plus.cursor import Cursor, member_at, passed
from dissect.protocols.s7plus.ids import id_name
from dissect.protocols.s7plus.layouts import ATTRIBUTE, OBJECT, OBJECT_END, OBJECT_HELD, RELATION
from dissect.protocols.s7plus.tables import (
    ATTRIBUTE_TAG,
    NAMES_TAG,
    OBJECT_END_TAG,
    OBJECT_TAG,
    RELATION_TAG,
    TAG_DESCRIPTION_TAG,
    VARIABLES_TAG,
)
from dissect.protocols.s7plus.value_reading import read_value
from dissect.protocols.s7plus.value_tables import ADDRESS_ARRAY, ARRAY, STRUCT, UDINT, WSTRING
from dissect.protocols.s7plus.values import Struct, Value, build_value
from dissect.protocols.s7plus.variables import (
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
from dissect.protocols.s7plus.walk import STEP, FormatError, Walk
from dissect.wire.copies import leaves
from dissect.wire.octets import u16, u32
from dissect.wire.varint import VLQ, build_varint, read_varint


@mypyc_attr(acyclic=True)  # many are made, without the header of the garbage collector
class Attribute:
    """An attribute of an object: its id, and its value, which is read only when needed."""

    __slots__ = ("_end", "_octets", "_start", "_value", "id")

    def __init__(self, id_: int, value: Value | None, octets: bytes = b"", start: int = 0, end: int = 0) -> None:
        self.id = id_
        self._value = value
        self._octets = octets  # contains the value from ``start`` to ``end``, until it is read
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
        """Return the value if it is a text, else an empty text."""
        if self._value is None and _is_plain(self._octets, self._start, WSTRING):
            return _text_at(self._octets, self._start + _HEAD, self._end).decode("utf-8", "replace")
        content = self.value.content
        if isinstance(content, bytes):
            return content.decode("utf-8", "replace")
        return content if isinstance(content, str) else ""

    def number(self) -> int:
        """Return the value if it is a number, else -1."""
        if self._value is None and _is_plain(self._octets, self._start, UDINT):
            return read_varint(self._octets, self._start + _HEAD, self._end, VLQ)[0]
        content = self.value.content
        return int(content) if isinstance(content, int) else -1

    def numbers(self) -> list[int]:
        """Return the whole numbers among the elements of the value; empty if it has no elements."""
        if self._value is None and u16(self._octets, self._start) in _ARRAYS:
            return numbers_at(self._octets, self._start + _HEAD, self._end)
        return whole_numbers(self.value)

    def member(self, id_: int) -> str:
        """Return the text of the first member with this id, if the value is a structure; empty if it is not UTF-8 text."""
        if self._value is None and _is_plain(self._octets, self._start, STRUCT):
            at = member_at(self._octets, self._start, self._end, id_)
            if at >= 0 and _is_plain(self._octets, at, WSTRING):
                try:
                    return _text_at(self._octets, at + _HEAD, self._end).decode("utf-8")
                except UnicodeDecodeError:
                    return ""
        content = self.value.content
        value = content.find(id_) if isinstance(content, Struct) else None
        return value.content if value is not None and isinstance(value.content, str) else ""


#: Octets of flags and type, and of the id of an object.
_HEAD: Final = 2
_RID: Final = 4
#: Flags and type of reference lists.
_ARRAYS: Final = frozenset((ARRAY << 8 | UDINT, ADDRESS_ARRAY << 8 | UDINT))


def numbers_at(octets: bytes, at: i64, end: i64) -> list[int]:
    """Return unsigned numbers of at most 32 bits; their count is at ``at``, and they are known to be sound."""
    cursor = Cursor(octets, at, end)
    found: list[int] = []
    left = cursor.number()
    while left > 0:
        found.append(int(cursor.number()))
        left -= 1
    return found


def whole_numbers(value: Value) -> list[int]:
    """Return the whole numbers among the elements of a value."""
    content = value.content
    return [one for one in content if isinstance(one, int)] if isinstance(content, list) else []


def _is_plain(octets: bytes, at: int, type_: int) -> bool:
    """Return whether a single value of a type begins here; it is known to be sound."""
    return octets[at] == 0 and octets[at + 1] == type_


def _text_at(octets: bytes, at: int, end: int) -> bytes:
    """Return the octets of a text whose length is at ``at``; it is known to be sound."""
    size, begin = read_varint(octets, at, end, VLQ)
    return octets[begin : begin + size]


@mypyc_attr(acyclic=True)
class Relation:
    """A relation of an object: its id, and the id of the other object."""

    __slots__ = ("id", "rid")

    def __init__(self, id_: int, rid: int) -> None:
        self.id = id_
        self.rid = rid


@mypyc_attr(acyclic=True)
class PlusObject:
    """An object. ``elements`` are its content in wire order; ``more`` is present unless ``attribute`` is 0, as in captures."""

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
        self.offset = 0  # offset of its tag; ``end`` is the offset after its end tag
        self.end = 0

    def find(self, id_: int) -> Value | None:
        """Return the value of an attribute; None if the object does not have it."""
        found = self._attribute(id_)
        return found.value if found is not None else None

    def _attribute(self, id_: int) -> Attribute | None:
        for element in self.elements:
            if isinstance(element, Attribute) and element.id == id_:
                return element
        return None

    def holds(self, id_: int) -> bool:
        """Return whether there is an attribute with this id, without reading its value."""
        return self._attribute(id_) is not None

    def holds_any(self, ids: frozenset[int]) -> bool:
        """Return whether there is an attribute with one of these ids."""
        for element in self.elements:
            if isinstance(element, Attribute):
                id_ = element.id
                if id_ in ids:
                    return True
        return False

    def relation(self, id_: int) -> int:
        """Return the id of the object that a relation refers to, 0 if there is no such relation."""
        for element in self.elements:
            if isinstance(element, Relation) and element.id == id_:
                return element.rid
        return 0

    def text(self, id_: int) -> str:
        """Return the text of an attribute, empty if it is not a text."""
        found = self._attribute(id_)
        return found.text() if found is not None else ""

    def number(self, id_: int) -> int:
        """Return the number of an attribute, -1 if it is not a number."""
        found = self._attribute(id_)
        return found.number() if found is not None else -1

    def numbers(self, id_: int) -> list[int]:
        """Return the whole numbers among the elements of an attribute; empty if there are none."""
        found = self._attribute(id_)
        return found.numbers() if found is not None else []

    def member(self, id_: int, member: int) -> str:
        """Return the text of a member of an attribute that is a structure; empty if there is none."""
        found = self._attribute(id_)
        return found.member(member) if found is not None else ""

    @property
    def objects(self) -> list[PlusObject]:
        """The objects inside this one."""
        return [element for element in self.elements if isinstance(element, PlusObject)]

    @property
    def lists(self) -> tuple[list[NameList], list[VariableList]]:
        """The lists of names and the lists of variables."""
        names = [element for element in self.elements if isinstance(element, NameList)]
        return names, [element for element in self.elements if isinstance(element, VariableList)]

    @property
    def names(self) -> list[str]:
        """Names of the listed variables."""
        return [name for element in self.elements if isinstance(element, NameList) for name in element.names]

    @property
    def variables(self) -> list[Variable]:
        """The listed variables, in the order of their names."""
        return [
            variable for element in self.elements if isinstance(element, VariableList) for variable in element.variables
        ]


#: What an object may contain.
Element = Attribute | Relation | PlusObject | VariableList | NameList | TagDescription


def read_elements(walk: Walk) -> list[Element]:
    """Read elements up to an octet that is not the tag of an element. Raises `FormatError`.

    If the walk wants only some attributes, relations and other attributes are skipped if they are sound.
    """
    elements: list[Element] = []
    read_into(walk, elements)
    return elements


def read_into(walk: Walk, elements: list[Element]) -> None:
    """Like `read_elements`, but append to ``elements``: if this raises, they contain what was read before.

    An object in which reading stopped is among them, with the part that was read.
    """
    while True:
        wanted = walk.wanted
        if wanted is not None:
            cursor = Cursor(walk.octets, walk.at, walk.end)
            cursor.attributes(wanted.attributes, walk.depth)
            if cursor.spent <= walk.budget:  # otherwise read them, to find the place where the budget is exceeded
                walk.at = cursor.at
                walk.spend(cursor.spent, "value")
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
    """Read the beginning of an object, with its tag."""
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


def objects_at(octets: bytes, places: list[int], end: i64) -> tuple[list[PlusObject], list[PlusObject]]:
    """Return the objects at ``places``, which come from `Cursor.noted` of sound octets that end at ``end``.

    The second list has all objects, including those inside others, as `every_object` returns them.
    """
    found: list[PlusObject] = []
    every: list[PlusObject] = []
    within: list[PlusObject] = []  # the objects that have begun, innermost last
    inner: PlusObject | None = None
    cursor = Cursor(octets, 0, end)
    for place in places:
        at: i64 = place
        tag: i64 = octets[at]
        if tag == ATTRIBUTE_TAG:
            if inner is not None:  # attributes outside of objects are not needed
                cursor.at = at + 1
                id_ = cursor.number()
                inner.elements.append(Attribute(int(id_), None, octets, int(cursor.at), int(end)))
        elif tag == OBJECT_TAG:
            cursor.at = at + 1
            one = _head_at(octets, cursor)
            if inner is not None:
                inner.elements.append(one)
            else:
                found.append(one)
            every.append(one)
            within.append(one)
            inner = one
        elif tag == OBJECT_END_TAG:
            within.pop().end = place + 1
            inner = within[-1] if within else None
        elif inner is not None:
            walk = Walk(octets, place + 1, int(end), False)
            inner.elements.append(read_variables(walk) if tag == VARIABLES_TAG else read_names(walk))
    return found, every


def _head_at(octets: bytes, cursor: Cursor) -> PlusObject:
    """Read the beginning of a sound object, after its tag, from ``cursor``."""
    at: i64 = cursor.at
    cursor.at = at + _RID
    class_id = cursor.number()
    class_flags = cursor.number()
    attribute = cursor.number()
    more: i64 = 0
    if attribute > 0:
        more = cursor.number()
    found = PlusObject(int(u32(octets, at)), int(class_id), int(class_flags), int(attribute), int(more), [])
    found.offset = int(at - 1)
    return found


def objects_of(elements: list[Element]) -> list[PlusObject]:
    """Return the objects among ``elements``, not those inside other objects."""
    return [element for element in elements if isinstance(element, PlusObject)]


def every_object(objects: list[PlusObject]) -> list[PlusObject]:
    """Return objects and all objects inside them, each before those inside it."""
    found: list[PlusObject] = []
    for one in objects:
        found.append(one)
        found.extend(every_object(one.objects))
    return found


# ---- writing --------------------------------------------------------------------------------------------------------


def build_elements(elements: list[Element]) -> bytes:
    """Return the octets of elements. Raises as `build_value` does."""
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
    """Return the octets of an object with its tags. Raises as `build_value` does."""
    head = bytes((OBJECT_TAG,)) + found.rid.to_bytes(4, "big")
    numbers = [found.class_id, found.class_flags, found.attribute, *([found.more] if found.attribute else [])]
    body = b"".join([build_varint(number, VLQ) for number in numbers]) + build_elements(found.elements)
    return head + body + bytes((OBJECT_END_TAG,))


leaves(Attribute, PlusObject, Relation)
