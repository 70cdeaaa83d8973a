from __future__ import annotations

import struct

import pytest
from hypothesis import given
from hypothesis import strategies as st

from dissect.protocols.ibh.layouts import IBH, MPI_LONG, MPI_SHORT
from dissect.wire.layout import Layout

#: Each header as `struct` sees it; the structs of the library whose names they have are all octets but for the two flags.
SHAPES = [
    (IBH, "<BBBBHH", "channel1 channel2 length number s_flags r_flags"),
    (MPI_SHORT, "<7B", "src_conn dst_conn mpi local_mpi length function number"),
    (MPI_LONG, "<9B", "src_conn dst_conn mpi unknown1 unknown2 unknown3 length function number"),
]


@pytest.mark.parametrize(("layout", "shape", "names"), SHAPES)
@given(octets=st.binary(min_size=12, max_size=12), start=st.integers(0, 3))
def test_layout_reads_what_struct_reads(layout: Layout, shape: str, names: str, octets: bytes, start: int) -> None:
    assert layout.size == struct.calcsize(shape)
    expected = list(zip(names.split(), struct.unpack_from(shape, octets, start), strict=True))
    assert [(value.field.name, value.value) for value in layout.read(octets, start)] == expected


def test_wireshark_has_no_names_for_them() -> None:
    assert {field.wireshark for layout, _, _ in SHAPES for field in layout.fields} == {""}
