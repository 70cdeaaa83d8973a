"""A dictionary as plain records: the content of a compiled file, and the result of reading a TOML source.

The order of the fields is the order in the file; a later minor version may only add fields at the end of a record.
"""

from __future__ import annotations

from typing import Literal

import msgspec

#: A default value in the form of records: times are [seconds, nanoseconds], texts and addresses are octets.
Plain = bool | int | float | bytes | list[int] | None

Access = Literal["", "rw", "wo", "ro", "const"]
Counts = Literal["", "data", "data+crc", "rest", "total"]
ObjectClass = Literal[0, 2, 7, 8, 9]


class Traits(msgspec.Struct, array_like=True, frozen=True):
    """How a value is shown and checked: physical value = raw · scale + shift in unit, limits of the raw value, its texts."""

    unit: str = ""
    scale: float = 1.0
    shift: float = 0.0
    low: float | int | None = None
    high: float | int | None = None
    texts: list[tuple[int, str]] = []


class FieldRecord(msgspec.Struct, array_like=True, frozen=True):
    """A field of a DEFSTRUCT, or of a RECORD without one. Type 0: reserved bits; ``fixed``: their value, None for "any" (R32).

    With ``access`` "" and ``mappable`` None the field takes those of the object.
    """

    name: str
    type: int
    bits: int
    fixed: int | None = None
    access: Access = ""
    mappable: bool | None = None
    default: Plain = None
    traits: Traits | None = None


class TypeRecord(msgspec.Struct, array_like=True, frozen=True):
    """A DEFTYPE: a simple type with ``kind`` (`types.Kind`) and width."""

    index: int
    name: str
    kind: int
    bits: int


class StructRecord(msgspec.Struct, array_like=True, frozen=True):
    """A DEFSTRUCT."""

    index: int
    name: str
    fields: list[FieldRecord]


class ObjectRecord(msgspec.Struct, array_like=True, frozen=True):
    """An object (R58). ``type`` 0: it is NULL, or a RECORD with its own fields.

    ``bits`` is the width if the type leaves it open, ``count`` the number of elements of an ARRAY, ``used`` its sub-index 0.
    ``values`` are the defaults of the variable, the elements or the fields (empty, or one for each; None: no default).
    """

    index: int
    object_class: ObjectClass
    name: str
    type: int
    bits: int
    access: Access
    mandatory: bool
    mappable: bool
    count: int = 0
    used: int = 0
    values: list[Plain] = []
    fields: list[FieldRecord] = []
    traits: Traits | None = None


class CrcRecord(msgspec.Struct, array_like=True, frozen=True):
    """A CRC of 16 bits, over everything "before" it, or only over the "data"."""

    poly: int = 0x1021
    init: int = 0
    refin: bool = False
    refout: bool = False
    xorout: int = 0
    covers: Literal["before", "data"] = "before"


Role = Literal[
    "protocol", "kind", "response", "abort", "tid", "seq", "err", "index", "sub", "pdo", "port", "src", "dst", "size", "data",
    "crc", "reserved", "const",
]  # fmt: skip


class EnvelopeField(msgspec.Struct, array_like=True, frozen=True):
    """A field of an envelope. ``signed`` and ``bits`` are its type, ``big`` its byte order; ``value`` is that of a constant."""

    role: Role
    bits: int = 0
    signed: bool = False
    big: bool = False
    value: int | None = None
    counts: Counts = ""


class EnvelopeRecord(msgspec.Struct, array_like=True, frozen=True):
    """How messages are wrapped: fields in their order, kinds as (number, service)."""

    fields: list[EnvelopeField]
    kinds: list[tuple[int, Literal["read", "write", "pdo"]]]
    crc: CrcRecord | None = None


class Body(msgspec.Struct, array_like=True, frozen=True):
    """A whole dictionary: types, structs and objects are sorted by index. ``encoding`` is that of its strings on the wire."""

    name: str
    version: str
    time_scale: Literal["utc", "tai"]
    types: list[TypeRecord]
    structs: list[StructRecord]
    objects: list[ObjectRecord]
    envelope: EnvelopeRecord | None = None
    errors: list[tuple[int, str]] = []
    encoding: str = "utf-8"
