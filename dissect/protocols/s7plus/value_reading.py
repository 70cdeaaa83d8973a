"""Reads values and splits them into parts (docs/s7plus.md). Everything here raises `FormatError` for octets that do not fit."""

from __future__ import annotations

from typing import Final

from librt.strings import read_f32_be, read_f64_be
from mypy_extensions import i64

from dissect.protocols.s7plus.blobs import COMPRESSED, PLAIN_KEYS, check_blob, is_compressed, may_swell
from dissect.protocols.s7plus.ids import id_name, is_packed, member_id
from dissect.protocols.s7plus.layouts import LIST_END, MEMBER, PACKED, PACKED_TWICE, ROW
from dissect.protocols.s7plus.value_showing import value_said
from dissect.protocols.s7plus.value_tables import (
    ADDRESS_ARRAY,
    ARRAY,
    BLOB,
    BOOL,
    FIXED_SIZES,
    LREAL,
    NULL,
    PACKED_COUNT_TWICE,
    REAL,
    SIGNED_TYPES,
    SPARSE_ARRAY,
    STRUCT,
    TYPE_NAMES,
    VARIABLE_SIZES,
    VARIANT,
    WSTRING,
)
from dissect.protocols.s7plus.values import FLOAT, Blob, Member, Packed, Rows, Struct, Value
from dissect.protocols.s7plus.walk import STEP, FormatError, Walk, big_endian
from dissect.wire.layout import Layout
from dissect.wire.varint import VLQ

#: By type: size if it is fixed; the kind of a number of variable size (0 for none); whether it is signed. They are copied here
#: because access to another module's table takes longer, and is needed for each value.
_SIZES: Final = bytes([FIXED_SIZES.get(type_, 0) for type_ in range(256)])
_KINDS: Final = [VARIABLE_SIZES.get(type_, 0) for type_ in range(256)]
_SIGNED: Final = bytes([type_ in SIGNED_TYPES for type_ in range(256)])
_NAMES: Final[list[str]] = list(TYPE_NAMES)
#: The bits of the exponent of a single in its first and in its second octet.
_EXPONENT: Final = 0x7F
_LAST_OF_EXPONENT: Final = 0x80


def read_value(walk: Walk, layout: Layout, start: int, label: str = "", id_: int = 0) -> Value:
    """Read a value, and make a part of ``layout`` that begins at ``start``, with the id or number before the value.

    ``label`` is the beginning of the part's note. ``id_`` is the attribute or member that the value belongs to, 0 for others.
    Members of a structure become parts of their own. Raises `FormatError`.
    """
    offset = walk.at
    walk.spend(STEP, "value")
    if offset + 2 <= walk.end:
        flags = walk.octets[offset]
        type_ = walk.octets[offset + 1]
        walk.at = offset + 2
    else:
        flags = walk.u8("flags")
        type_ = walk.u8("type")
    if type_ == STRUCT:
        value = Value(flags, type_, _read_struct(walk, flags, layout, start, label), offset, walk.at)
    else:
        value = Value(flags, type_, _read_content(walk, flags, type_), offset, walk.at)
        walk.part(layout, start, f"{label}{value_said(value, id_)}" if walk.shown else "")
        if type_ == BLOB and id_ in COMPRESSED:
            _look_into_blobs(walk, value)
    return value


def _read_content(walk: Walk, flags: int, type_: int) -> object:
    if not _NAMES[type_]:
        raise FormatError("unknown_type", "type", walk.at - 1, 0, type_)
    if flags & SPARSE_ARRAY:
        pairs: list[tuple[int, object]] = []
        while True:
            key = walk.number(VLQ, "key")
            if key == 0:
                return pairs
            walk.spend(1, "key")
            pairs.append((key, walk.number(VLQ, "variant") if type_ == VARIANT else _read_one(walk, type_)))
    if flags & (ARRAY | ADDRESS_ARRAY):
        # Elements of Null have no octets: only the budget limits their number.
        count = walk.number(VLQ, "count") if type_ == NULL else walk.counted(VLQ, "count")
        walk.spend(count, "count")
        kind = _KINDS[type_]
        if kind:  # like reference lists
            name = _NAMES[type_]
            return [walk.number(kind, name) for _ in range(count)]
        return [_read_one(walk, type_) for _ in range(count)]
    return _read_one(walk, type_)


def _read_one(walk: Walk, type_: int) -> object:
    """Read one element, which has no flags and type."""
    size: i64 = _SIZES[type_]
    if size:
        at: i64 = walk.at
        walk.need(size, _NAMES[type_])
        walk.at = at + size
        if type_ == REAL:
            return _read_single(walk.octets, at)
        if type_ == LREAL:
            return read_f64_be(walk.octets, at)
        number = big_endian(walk.octets, at, size)
        if _SIGNED[type_] and number >> 8 * size - 1:
            number -= 1 << 8 * size
        if type_ == BOOL and number < 2:
            return number != 0  # not a conditional expression, which becomes a number in compiled code
        return number
    kind = _KINDS[type_]
    if kind:
        return walk.number(kind, _NAMES[type_])
    if type_ == WSTRING:
        octets = walk.take(walk.counted(VLQ, "length"), "text")
        try:
            return octets.decode("utf-8")
        except UnicodeDecodeError:
            return octets
    if type_ == BLOB:
        return _read_blob(walk)
    if type_ == NULL:
        return None
    return _read_variant(walk)


def _read_single(octets: bytes, at: i64) -> float | bytes:
    if octets[at] & _EXPONENT != _EXPONENT or octets[at + 1] < _LAST_OF_EXPONENT:
        return read_f32_be(octets, at)
    # This may be a NaN or an infinity. A signalling NaN would not survive the conversion to double: its octets are kept.
    kept = octets[at : at + 4]
    single: float = FLOAT.unpack(kept)[0]
    return single if FLOAT.pack(single) == kept else kept


def _read_variant(walk: Walk) -> Value:
    """Read a value inside a value; it stays within the part of the outer value."""
    offset = walk.at
    flags = walk.u8("flags")
    type_ = walk.u8("type")
    shown, walk.shown = walk.shown, False
    content: object = None
    try:
        walk.enter("variant")
        struct: bool = type_ == STRUCT
        content = _read_struct(walk, flags, MEMBER, offset, "") if struct else _read_content(walk, flags, type_)
    finally:
        walk.shown = shown  # also for the octets after a fault
    walk.depth -= 1
    return Value(flags, type_, content, offset, walk.at)


def _read_blob(walk: Walk) -> Blob:
    root = walk.number(VLQ, "root")
    if root <= 1:
        octets = walk.take(walk.counted(VLQ, "length"), "blob")
        return Blob(root, octets, end=walk.at)
    head = walk.take(8, "blob head")
    kind = walk.u8("kind")
    if kind == 0:
        shown, walk.shown = walk.shown, False
        try:
            members = read_members(walk)
        finally:
            walk.shown = shown
        return Blob(root, b"", head, kind, members)
    if kind not in {2, 3}:
        raise FormatError("unknown_type", "blob kind", walk.at - 1, 0, kind)
    return Blob(root, walk.take(walk.counted(VLQ, "length"), "blob"), head, kind)


def parse_content(flags: int, type_: int, octets: bytes) -> Value | None:
    """Return the value whose content is ``octets``; None if they are not exactly one content.

    Not for structures, whose content ends here before their members.
    """
    walk = Walk(octets, 0, len(octets), False)
    try:
        content = _read_content(walk, flags, type_)
    except FormatError:
        return None
    return Value(flags, type_, content) if walk.left == 0 else None


def _look_into_blobs(walk: Walk, value: Value) -> None:
    """Note the compressed blobs in a value, and the faults of those that are not sound."""
    content = value.content
    found = content if isinstance(content, list) else [(0, content)]
    for key, one in [pair for pair in found if isinstance(pair, tuple)]:
        if key >= PLAIN_KEYS or not isinstance(one, Blob) or not is_compressed(one.octets):
            continue
        begin = one.end - len(one.octets)
        walk.blobs.append((begin, one.end))
        if walk.hurried and (walk.faults or not may_swell(one.octets)):
            continue
        opened = check_blob(one.octets, walk.inflating)
        walk.inflating = max(0, walk.inflating - opened.size)
        if opened.fault:
            walk.faults.append(FormatError(opened.fault, "blob", begin, opened.size, len(one.octets)))


def _read_struct(walk: Walk, flags: int, layout: Layout, start: int, label: str) -> object:
    """Read a structure after its flags and type; its part ends where its members begin."""
    if flags & SPARSE_ARRAY:
        walk.part(layout, start, f"{label}sparse array of structures")
        return _read_sparse_structs(walk)
    id_ = walk.fixed(4, "structure")
    note = f"{label}Struct {id_name(id_)}" if walk.shown else ""
    if is_packed(id_):
        walk.part(layout, start, note)
        return _read_packed(walk, id_)
    if not flags & (ARRAY | ADDRESS_ARRAY):
        walk.part(layout, start, note)
        return Struct(id_, read_members(walk))
    count = walk.counted(VLQ, "count")
    walk.spend(count, "count")
    walk.part(layout, start, f"{note}, {count} elements")
    return Rows(id_, [read_members(walk) for _ in range(count)])


def _read_sparse_structs(walk: Walk) -> list[tuple[int, Struct]]:
    pairs: list[tuple[int, Struct]] = []
    while True:
        at = walk.at
        key = walk.number(VLQ, "key")
        if key == 0:
            walk.part(LIST_END, at)
            return pairs
        id_ = walk.fixed(4, "structure")
        walk.part(ROW, at)
        walk.spend(STEP, "structure")
        pairs.append((key, Struct(id_, read_members(walk))))


def _read_packed(walk: Walk, id_: int) -> Packed:
    at = walk.at
    time = walk.fixed(8, "interface time")
    flags = walk.number(VLQ, "transport flags")
    count = walk.number(VLQ, "count")
    twice = bool(flags & PACKED_COUNT_TWICE)
    if twice:
        count = walk.number(VLQ, "count")
    octets = walk.take(count, "packed structure")
    walk.part(PACKED_TWICE if twice else PACKED, at, f"{len(octets)} bytes")
    return Packed(id_, time, flags, octets)


def read_members(walk: Walk) -> list[Member]:
    """Read a list of ids and values up to the id 0 that ends it. Raises `FormatError`."""
    members: list[Member] = []
    walk.enter("members")
    while True:
        at = walk.at
        id_ = walk.number(VLQ, "member")
        if id_ == 0:
            walk.part(LIST_END, at)
            walk.depth -= 1
            return members
        members.append((id_, read_value(walk, MEMBER, at, f"{member_id(id_)} = " if walk.shown else "", id_)))
