from __future__ import annotations

from collections.abc import Callable

import pytest
from hypothesis import given
from hypothesis import strategies as st

from dissect.wire.octets import u16, u24, u32

READERS: list[tuple[Callable[[bytes, int], int], int]] = [(u16, 2), (u24, 3), (u32, 4)]


@pytest.mark.parametrize(("read", "size"), READERS)
@given(octets=st.binary(max_size=12), at=st.integers(0, 12))
def test_big_endian_or_not_there(read: Callable[[bytes, int], int], size: int, octets: bytes, at: int) -> None:
    if at + size <= len(octets):
        assert read(octets, at) == int.from_bytes(octets[at : at + size], "big")
    else:
        with pytest.raises(IndexError):
            read(octets, at)


@pytest.mark.parametrize(("read", "size"), READERS)
def test_the_largest_number(read: Callable[[bytes, int], int], size: int) -> None:
    assert read(b"\xff" * size, 0) == 256**size - 1
