from __future__ import annotations

from collections.abc import Callable

import pytest
from hypothesis import given
from hypothesis import strategies as st

from dissect.wire.octets import Tally, same, u16, u24, u32

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


@given(st.integers(0, 90), st.binary(max_size=9), st.binary(max_size=9), st.data())
def test_what_stands_somewhere(size: int, before: bytes, behind: bytes, data: st.DataObject) -> None:
    octets = bytes(range(100, 100 + size))
    whole = before + octets + behind
    assert same(octets, whole, len(before), len(before) + size)
    assert not same(octets + b"x", whole, len(before), len(before) + size)
    if size:
        at = data.draw(st.integers(0, size - 1))
        other = octets[:at] + b"\0" + octets[at + 1 :]
        assert not same(other, whole, len(before), len(before) + size)


@given(
    st.lists(st.integers(0, 6)),
    st.integers(0, 6),
    st.integers(0, 6),
    st.lists(st.integers(0, 9), min_size=7, max_size=7),
)
def test_it_counts_what_came(numbers: list[int], often: int, also: int, more: list[int]) -> None:
    tally = Tally(7, often, also)
    for number in numbers:
        tally.add(number)
    assert tally.counts() == [numbers.count(number) for number in range(7)]
    tally.add_counts(more)
    assert tally.counts() == [numbers.count(number) + more[number] for number in range(7)]


def test_what_is_returned_is_a_copy() -> None:
    tally = Tally(2, 0, 1)
    tally.counts()[0] = 5
    assert tally.counts() == [0, 0]
    with pytest.raises(IndexError):
        tally.add(2)
