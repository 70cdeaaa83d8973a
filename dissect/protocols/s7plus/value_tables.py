"""Flags and types of S7comm-plus values (docs/s7plus.md)."""

from __future__ import annotations

from typing import Final

from dissect.wire.codes import CodeTable
from dissect.wire.varint import SIGNED, SIGNED64, VLQ, VLQ64

ARRAY: Final = 0x10
ADDRESS_ARRAY: Final = 0x20
SPARSE_ARRAY: Final = 0x40

#: Combinations found in captures. Bit 7 does not change the layout; a CPU 1511 with firmware 1.0 sets it.
VALUE_FLAGS: Final = CodeTable("S7comm-plus value flags", 2, [
    (0x00, "scalar", "One value."),
    (0x10, "array", "A count and as many values."),
    (0x20, "address array", "The same, for lists that address something."),
    (0x40, "sparse array", "Pairs of a key and a value, ended by key 0."),
    (0x80, "scalar", "One value."),
    (0x90, "array", "A count and as many values."),
    (0xA0, "address array", "The same, for lists that address something."),
    (0xC0, "sparse array", "Pairs of a key and a value, ended by key 0."),
])  # fmt: skip

NULL: Final = 0x00
BOOL: Final = 0x01
USINT: Final = 0x02
UINT: Final = 0x03
UDINT: Final = 0x04
ULINT: Final = 0x05
SINT: Final = 0x06
INT: Final = 0x07
DINT: Final = 0x08
LINT: Final = 0x09
BYTE: Final = 0x0A
WORD: Final = 0x0B
DWORD: Final = 0x0C
LWORD: Final = 0x0D
REAL: Final = 0x0E
LREAL: Final = 0x0F
TIMESTAMP: Final = 0x10
TIMESPAN: Final = 0x11
RID: Final = 0x12
AID: Final = 0x13
BLOB: Final = 0x14
WSTRING: Final = 0x15
VARIANT: Final = 0x16
STRUCT: Final = 0x17

VALUE_TYPES: Final = CodeTable("S7comm-plus value type", 2, [
    (NULL, "Null", "No value."),
    (BOOL, "Bool", "One byte, 0 or 1."),
    (USINT, "USInt", "8 bits, unsigned."),
    (UINT, "UInt", "16 bits, unsigned."),
    (UDINT, "UDInt", "32 bits, unsigned, of variable size."),
    (ULINT, "ULInt", "64 bits, unsigned, of variable size."),
    (SINT, "SInt", "8 bits, signed."),
    (INT, "Int", "16 bits, signed."),
    (DINT, "DInt", "32 bits, signed, of variable size."),
    (LINT, "LInt", "64 bits, signed, of variable size."),
    (BYTE, "Byte", "8 bits."),
    (WORD, "Word", "16 bits."),
    (DWORD, "DWord", "32 bits."),
    (LWORD, "LWord", "64 bits."),
    (REAL, "Real", "IEEE 754, 32 bits."),
    (LREAL, "LReal", "IEEE 754, 64 bits."),
    (TIMESTAMP, "Timestamp", "Nanoseconds since 1970, eight bytes."),
    (TIMESPAN, "Timespan", "Nanoseconds, signed, of variable size."),
    (RID, "RID", "Id of an object, four bytes."),
    (AID, "AID", "Id of an attribute, of variable size."),
    (BLOB, "Blob", "Bytes, after the ID of a root."),
    (WSTRING, "WString", "A text in UTF-8."),
    (VARIANT, "Variant", "A value with a type of its own."),
    (STRUCT, "Struct", "An id, then members with ids, or packed bytes."),
])  # fmt: skip

#: The names by type, empty for unknown types: a tuple, because it is used for each value.
TYPE_NAMES: Final = tuple([VALUE_TYPES.name(type_) if type_ in VALUE_TYPES else "" for type_ in range(256)])

#: Octets of types of fixed size.
FIXED_SIZES: Final[dict[int, int]] = {
    BOOL: 1, USINT: 1, SINT: 1, BYTE: 1, UINT: 2, INT: 2, WORD: 2, DWORD: 4, REAL: 4, RID: 4, LWORD: 8, LREAL: 8, TIMESTAMP: 8,
}  # fmt: skip

#: Kinds of the types that are numbers of variable size.
VARIABLE_SIZES: Final[dict[int, int]] = {
    UDINT: VLQ, AID: VLQ, ULINT: VLQ64, DINT: SIGNED, LINT: SIGNED64, TIMESPAN: SIGNED64,
}  # fmt: skip

#: Types of signed numbers (two's complement).
SIGNED_TYPES: Final = frozenset((SINT, INT, DINT, LINT, TIMESPAN))
#: Types that people read as bit patterns.
BIT_TYPES: Final = frozenset((BYTE, WORD, DWORD, LWORD))

#: Flag of a packed structure: its count is sent twice.
PACKED_COUNT_TWICE: Final = 0x400
