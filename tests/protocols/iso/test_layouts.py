from __future__ import annotations

import struct
from typing import Final

import pytest
from hypothesis import given
from hypothesis import strategies as st

from dissect.protocols.iso import layouts
from dissect.protocols.iso.cotp import parse_tpdu
from dissect.wire.layout import Layout
from tests.protocols.iso.tpdus import TPDUS

#: Each header as `struct` sees it (X.224 section 13, RFC 1006 section 6), and its names; ``a/b`` share their octets, as many
#: bits of the lower as the number says.
SHAPES: Final[list[tuple[Layout, str, str]]] = [
    (layouts.TPKT, ">BBH", "version reserved length"),
    (layouts.CR, ">BBHHB", "li type/credit:4 dst_ref src_ref class_/options:4"),
    (layouts.CC, ">BBHHB", "li type/credit:4 dst_ref src_ref class_/options:4"),
    (layouts.DR, ">BBHHB", "li type/credit:4 dst_ref src_ref reason"),
    (layouts.DC, ">BBHH", "li type/credit:4 dst_ref src_ref"),
    (layouts.DT, ">BBB", "li type/credit:4 eot/tpdu_nr:7"),
    (layouts.DT_NORMAL, ">BBHB", "li type/credit:4 dst_ref eot/tpdu_nr:7"),
    (layouts.DT_EXTENDED, ">BBHI", "li type/credit:4 dst_ref eot/tpdu_nr:31"),
    (layouts.ED, ">BBB", "li type/credit:4 eot/tpdu_nr:7"),
    (layouts.ED_NORMAL, ">BBHB", "li type/credit:4 dst_ref eot/tpdu_nr:7"),
    (layouts.ED_EXTENDED, ">BBHI", "li type/credit:4 dst_ref eot/tpdu_nr:31"),
    (layouts.AK, ">BBHB", "li type/credit:4 dst_ref next_nr"),
    (layouts.AK_EXTENDED, ">BBHIH", "li type/credit:4 dst_ref next_nr credit_extended"),
    (layouts.EA, ">BBHB", "li type/credit:4 dst_ref next_nr"),
    (layouts.EA_EXTENDED, ">BBHI", "li type/credit:4 dst_ref next_nr"),
    (layouts.RJ, ">BBHB", "li type/credit:4 dst_ref next_nr"),
    (layouts.RJ_EXTENDED, ">BBHIH", "li type/credit:4 dst_ref next_nr credit_extended"),
    (layouts.ER, ">BBHB", "li type/credit:4 dst_ref cause"),
    (layouts.UNKNOWN, ">BB", "li type/credit:4"),
    (layouts.PARAMETER, ">BB", "code length"),
]
IDS: Final = [f"{layout.name} {layout.size}" for layout, _, _ in SHAPES]


def unpacked(shape: str, names: str, octets: bytes) -> list[tuple[str, int]]:
    values: list[tuple[str, int]] = []
    for name, number in zip(names.split(), struct.unpack_from(shape, octets), strict=True):
        high, _, low = name.partition("/")
        low, _, bits = low.partition(":")
        values.append((high, number >> int(bits or 0)))
        if low:
            values.append((low, number % (1 << int(bits))))
    return values


@pytest.mark.parametrize(("layout", "shape", "names"), SHAPES, ids=IDS)
@given(octets=st.binary(min_size=16, max_size=16), start=st.integers(0, 3))
def test_layout_reads_what_struct_reads(layout: Layout, shape: str, names: str, octets: bytes, start: int) -> None:
    assert layout.size == struct.calcsize(shape)
    read = [(value.field.name, value.value) for value in layout.read(octets, start)]
    assert read == unpacked(shape, names, octets[start:])


def test_every_layout_is_listed() -> None:
    assert {id(value) for value in vars(layouts).values() if isinstance(value, Layout)} == {
        id(layout) for layout, _, _ in SHAPES
    }


@pytest.mark.parametrize(
    ("layout", "shape", "names"), [entry for entry in SHAPES if entry[0] not in {layouts.TPKT, layouts.PARAMETER}]
)
@given(octets=st.binary(min_size=16, max_size=16))
def test_the_parser_reads_by_the_layout(layout: Layout, shape: str, names: str, octets: bytes) -> None:
    """A TPDU that ends with its fixed part is read as its layout says, at the offsets the layout says."""
    type_ = {fields["type"] for name, _, fields, _, _ in TPDUS if name == layout.name} or {0x3}
    li = layout.size - 1
    header = bytes((li, type_.pop() << 4 | octets[1] & 0x0F)) + octets[2:]
    tpdu = parse_tpdu(header)
    assert tpdu.layout is layout
    read = [(value.field.name, value.offset, value.value) for value in tpdu.fields]
    assert read == [(value.field.name, value.offset, value.value) for value in layout.read(header)]
    assert [(name, value) for name, _, value in read] == unpacked(shape, names, header)
    assert tpdu.data == header[li + 1 :]
