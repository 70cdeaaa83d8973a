"""Values: flags, a type, and a content that depends on both (docs/s7plus.md). This module builds their octets as well.

`dissect.protocols.s7plus.value_reading` reads values, `dissect.protocols.s7plus.value_showing` shows them.
"""

from __future__ import annotations

import struct
from typing import Final

from mypy_extensions import mypyc_attr

from dissect.protocols.s7plus.value_tables import (
    ADDRESS_ARRAY,
    ARRAY,
    FIXED_SIZES,
    NULL,
    PACKED_COUNT_TWICE,
    REAL,
    SIGNED_TYPES,
    SPARSE_ARRAY,
    STRUCT,
    VALUE_TYPES,
    VARIABLE_SIZES,
    VARIANT,
    WSTRING,
)
from dissect.wire.copies import leaves
from dissect.wire.varint import VLQ, build_varint

FLOAT: Final = struct.Struct(">f")
DOUBLE: Final = struct.Struct(">d")
_TYPE_NAMES: Final[list[str]] = [VALUE_TYPES.name(type_) for type_ in range(256)]


@mypyc_attr(acyclic=True, free_list_len=1)
class Value:
    """A value. ``flags`` and ``type`` determine the kind of ``content``.

    It is a number, a bool or a float; a text, or octets if they are not UTF-8 (WString); a `Blob`; a `Struct` or `Packed`, or
    `Rows` with an array flag; None for Null; a `Value` for a Variant. Arrays are lists of these, sparse arrays lists of (key,
    content).
    """

    __slots__ = ("content", "end", "flags", "offset", "type")

    def __init__(self, flags: int, type_: int, content: object, offset: int = 0, end: int = 0) -> None:
        self.flags = flags
        self.type = type_
        self.content = content
        self.offset = offset  # offset of the flags; ``end`` is the offset after the last octet
        self.end = end

    def __eq__(self, other: object) -> bool:
        return isinstance(other, Value) and build_value(self) == build_value(other)

    def __hash__(self) -> int:
        return hash(build_value(self))

    def __repr__(self) -> str:
        return f"Value({self.flags:#x}, {self.type:#x}, {self.content!r})"

    @property
    def sparse(self) -> bool:
        """True for a sparse array."""
        return self.flags & SPARSE_ARRAY != 0

    @property
    def array(self) -> bool:
        """True for an array with a count of elements."""
        return self.flags & (ARRAY | ADDRESS_ARRAY) != 0 and not self.sparse

    @property
    def type_name(self) -> str:
        """Name of the type."""
        type_ = self.type
        return _TYPE_NAMES[type_] if 0 <= type_ < len(_TYPE_NAMES) else VALUE_TYPES.name(type_)


#: A member of a structure or of a list: its id, and its value.
Member = tuple[int, Value]


class Struct:
    """A structure with separate members."""

    __slots__ = ("id", "members")

    def __init__(self, id_: int, members: list[Member]) -> None:
        self.id = id_
        self.members = members

    def find(self, id_: int) -> Value | None:
        """Return the first member with this id; None if there is none."""
        return find_member(self.members, id_)


class Rows:
    """An array of structures: one id for all, and the members of each."""

    __slots__ = ("id", "rows")

    def __init__(self, id_: int, rows: list[list[Member]]) -> None:
        self.id = id_
        self.rows = rows


class Packed:
    """A structure of the program, as octets. ``time`` is the time of its interface, ``octets`` its content."""

    __slots__ = ("flags", "id", "octets", "time")

    def __init__(self, id_: int, time: int, flags: int, octets: bytes) -> None:
        self.id = id_
        self.time = time
        self.flags = flags
        self.octets = octets


class Blob:
    """Octets after the id of a root. A ``root`` above 1 has a ``head`` (8 octets), ``kind``, and for kind 0 ``members``.

    ``end`` is where the octets end within the buffer that they were read from.
    """

    __slots__ = ("end", "head", "kind", "members", "octets", "root")

    def __init__(
        self,
        root: int,
        octets: bytes,
        head: bytes = b"",
        kind: int = -1,
        members: list[Member] | None = None,
        end: int = 0,
    ) -> None:
        self.root = root
        self.octets = octets
        self.head = head
        self.kind = kind
        self.members: list[Member] = members if members is not None else []
        self.end = end


def find_member(members: list[Member], id_: int) -> Value | None:
    """Return the first member of a list with this id; None if there is none."""
    for known, value in members:
        if known == id_:
            return value
    return None


# ---- writing --------------------------------------------------------------------------------------------------------


def build_value(value: Value) -> bytes:
    """Return the octets of a value. Raises ValueError or TypeError if the content does not fit flags and type."""
    return bytes((value.flags, value.type)) + _build_content(value)


def _build_content(value: Value) -> bytes:
    content = value.content
    type_ = value.type
    if value.sparse:
        if not isinstance(content, list):
            raise TypeError("a sparse array takes a list of (key, content)")
        if type_ == VARIANT:
            pairs = [build_varint(key, VLQ) + build_varint(number, VLQ) for key, number in content]
        else:
            pairs = [build_varint(key, VLQ) + _build_one(type_, element) for key, element in content]
        return b"".join(pairs) + b"\0"
    if isinstance(content, Rows):
        lists = [build_members(row) for row in content.rows]
        return content.id.to_bytes(4, "big") + build_varint(len(lists), VLQ) + b"".join(lists)
    if value.array and type_ != STRUCT:
        if not isinstance(content, list):
            raise TypeError("an array takes a list")
        return build_varint(len(content), VLQ) + b"".join([_build_one(type_, element) for element in content])
    return _build_one(type_, content)


def _build_one(type_: int, content: object) -> bytes:
    size = FIXED_SIZES.get(type_, 0)
    if isinstance(content, float):
        return (FLOAT if type_ == REAL else DOUBLE).pack(content)
    if isinstance(content, bytes):
        return content if size else build_varint(len(content), VLQ) + content
    if isinstance(content, int):
        if size:
            try:
                return content.to_bytes(size, "big", signed=type_ in SIGNED_TYPES)
            except OverflowError:
                raise ValueError(f"{content} does not fit into {VALUE_TYPES.name(type_)}") from None
        kind = VARIABLE_SIZES.get(type_, 0)
        if kind:
            return build_varint(content, kind)
    if isinstance(content, str) and type_ == WSTRING:
        return _build_one(type_, content.encode("utf-8"))
    if isinstance(content, Value):
        return build_value(content)
    if isinstance(content, Struct):
        return content.id.to_bytes(4, "big") + build_members(content.members)
    if isinstance(content, Packed):
        count = build_varint(len(content.octets), VLQ)
        counts = count + count if content.flags & PACKED_COUNT_TWICE else count
        head = content.id.to_bytes(4, "big") + content.time.to_bytes(8, "big")
        return head + build_varint(content.flags, VLQ) + counts + content.octets
    if isinstance(content, Blob):
        return _build_blob(content)
    if content is None and type_ == NULL:
        return b""
    raise TypeError(f"{VALUE_TYPES.name(type_)} does not take {type(content).__name__}")


def _build_blob(blob: Blob) -> bytes:
    root = build_varint(blob.root, VLQ)
    counted = build_varint(len(blob.octets), VLQ) + blob.octets
    if blob.root <= 1:
        return root + counted
    return root + blob.head + bytes((blob.kind,)) + (build_members(blob.members) if blob.kind == 0 else counted)


def build_members(members: list[Member]) -> bytes:
    """Return the octets of a list of ids and values, with its end."""
    return b"".join([build_varint(id_, VLQ) + build_value(value) for id_, value in members]) + b"\0"


leaves(Blob, Struct, Value)
