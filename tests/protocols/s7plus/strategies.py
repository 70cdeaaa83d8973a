"""Values, objects and addresses for Hypothesis: everything that the format can represent."""

from __future__ import annotations

import struct
from typing import Final

from hypothesis import strategies as st

from dissect.protocols.s7plus.objects import Attribute, Element, PlusObject, Relation
from dissect.protocols.s7plus.tables import VARIABLE_NUMBERS
from dissect.protocols.s7plus.value_tables import (
    ADDRESS_ARRAY,
    ARRAY,
    BLOB,
    BOOL,
    FIXED_SIZES,
    LREAL,
    NULL,
    REAL,
    SIGNED_TYPES,
    SPARSE_ARRAY,
    STRUCT,
    VALUE_TYPES,
    VARIABLE_SIZES,
    VARIANT,
    WSTRING,
)
from dissect.protocols.s7plus.values import Blob, Packed, Rows, Struct, Value
from dissect.protocols.s7plus.variables import NameList, Variable, VariableList
from dissect.wire.varint import SIGNED, SIGNED64, VLQ, VLQ64

U32: Final = st.integers(0, 2**32 - 1)
IDS: Final = st.integers(1, 2**32 - 1)
#: Ids of structures whose members are sent one by one.
PLAIN_IDS: Final = U32.filter(lambda id_: not (0x90000000 < id_ < 0x9FFFFFFF or 0x02000000 < id_ < 0x02FFFFFF))
PACKED_IDS: Final = st.integers(0x90000001, 0x9FFFFFFE) | st.integers(0x02000001, 0x02FFFFFE)
_RANGES: Final = {
    VLQ: (0, 2**32 - 1),
    VLQ64: (0, 2**64 - 1),
    SIGNED: (-(2**31), 2**31 - 1),
    SIGNED64: (-(2**63), 2**63 - 1),
}


def elements(type_: int, members: st.SearchStrategy[list[tuple[int, Value]]]) -> st.SearchStrategy[object]:
    """One content of a type that is not a structure."""
    if type_ == BOOL:
        return st.booleans()
    if type_ == REAL:
        return st.floats(width=32, allow_nan=False) | st.just(struct.unpack(">f", b"\x7f\xc0\0\0")[0])
    if type_ == LREAL:
        return st.floats()
    if type_ in FIXED_SIZES:
        bits = 8 * FIXED_SIZES[type_]
        return (
            st.integers(-(2 ** (bits - 1)), 2 ** (bits - 1) - 1)
            if type_ in SIGNED_TYPES
            else st.integers(0, 2**bits - 1)
        )
    if type_ in VARIABLE_SIZES:
        return st.integers(*_RANGES[VARIABLE_SIZES[type_]])
    if type_ == WSTRING:
        return st.text(max_size=20) | st.just(b"caf\xe9")
    if type_ == NULL:
        return st.none()
    assert type_ == BLOB
    plain = st.builds(Blob, st.integers(0, 1), st.binary(max_size=20))
    long = st.builds(
        Blob,
        st.integers(2, 2**32 - 1),
        st.binary(max_size=20),
        st.binary(min_size=8, max_size=8),
        st.sampled_from([2, 3]),
    )
    listed = st.builds(
        Blob, st.integers(2, 2**32 - 1), st.just(b""), st.binary(min_size=8, max_size=8), st.just(0), members
    )
    return plain | long | listed


def _nested(inner: st.SearchStrategy[Value]) -> st.SearchStrategy[Value]:
    members = st.lists(st.tuples(IDS, inner), max_size=3)
    structs = st.builds(Struct, PLAIN_IDS, members)
    bit_7 = st.sampled_from([0, 0x80])
    packed = st.builds(Packed, PACKED_IDS, st.integers(0, 2**64 - 1), U32, st.binary(max_size=30))
    scalar = st.builds(Value, bit_7, st.just(STRUCT), structs | packed)
    rows = st.builds(Rows, PLAIN_IDS, st.lists(members, max_size=3))
    arrays = st.builds(Value, st.sampled_from([ARRAY, ADDRESS_ARRAY]), st.just(STRUCT), rows)
    sparse = st.builds(Value, st.just(SPARSE_ARRAY), st.just(STRUCT), st.lists(st.tuples(IDS, structs), max_size=3))
    variant = st.builds(Value, bit_7, st.just(VARIANT), inner)
    return scalar | arrays | sparse | variant


@st.composite
def _flat(draw: st.DrawFn) -> Value:
    type_ = draw(st.sampled_from([type_.number for type_ in VALUE_TYPES if type_.number not in {STRUCT, VARIANT}]))
    one = elements(type_, st.just([(7, Value(0, BOOL, True))]))
    flags = draw(st.sampled_from([0, 0x80, ARRAY, ADDRESS_ARRAY, SPARSE_ARRAY, 0x90]))
    if flags & SPARSE_ARRAY:
        return Value(flags, type_, draw(st.lists(st.tuples(IDS, one), max_size=4)))
    if flags & (ARRAY | ADDRESS_ARRAY):
        return Value(flags, type_, draw(st.lists(one, max_size=2 if type_ == NULL else 5)))
    return Value(flags, type_, draw(one))


#: Numbers and texts, each by itself.
PLAIN: Final[st.SearchStrategy[Value]] = st.sampled_from(
    [type_.number for type_ in VALUE_TYPES if type_.number not in {BLOB, NULL, STRUCT, VARIANT}]
).flatmap(lambda type_: st.builds(Value, st.just(0), st.just(type_), elements(type_, st.just([]))))
SPARSE_VARIANTS: Final = st.builds(
    Value, st.just(SPARSE_ARRAY), st.just(VARIANT), st.lists(st.tuples(IDS, U32), max_size=4)
)
VALUES: Final[st.SearchStrategy[Value]] = st.recursive(_flat() | SPARSE_VARIANTS, _nested, max_leaves=8)


@st.composite
def variables(draw: st.DrawFn) -> Variable:
    attributes = draw(st.integers(0, 0xFFFF))
    count = VARIABLE_NUMBERS[attributes >> 12]
    numbers = draw(st.lists(U32, min_size=count, max_size=count))
    octets = [draw(st.integers(0, 255)) for _ in range(2)]
    words = [draw(st.integers(0, 0xFFFF)) for _ in range(2)]
    return Variable(draw(U32), draw(U32), octets[0], attributes, octets[1], words[0], words[1], numbers)


NAMES: Final = st.text(max_size=10).map(lambda name: name.encode().replace(b"\0", b""))
VARIABLE_LISTS: Final = st.builds(
    VariableList, st.just(0x02000080), st.lists(st.lists(variables(), min_size=1, max_size=3), min_size=1, max_size=2)
)
NAME_LISTS: Final = st.builds(NameList, st.lists(st.lists(NAMES, min_size=1, max_size=4), max_size=2))


_FLAT_ELEMENTS: Final[st.SearchStrategy[Element]] = (
    st.builds(Attribute, IDS, VALUES) | st.builds(Relation, IDS, U32) | VARIABLE_LISTS | NAME_LISTS
)


@st.composite
def objects(draw: st.DrawFn, depth: int = 2) -> PlusObject:
    """An object with up to ``depth`` levels of others inside."""
    inner = _FLAT_ELEMENTS | objects(depth - 1) if depth else _FLAT_ELEMENTS
    held = draw(st.sampled_from([0, 0, 7]))
    found: list[Element] = [draw(inner) for _ in range(draw(st.integers(0, 3)))]
    return PlusObject(draw(U32), draw(U32), draw(U32), held, draw(U32) if held else 0, found)


OBJECTS: Final = objects()
