"""A walk over the contents of a PDU: what it reads, where it stops, and what it says of that."""

from __future__ import annotations

from typing import Final

import pytest

from dissect.protocols.s7plus.layouts import VALUE
from dissect.protocols.s7plus.walk import EXHAUSTED, MAX_DEPTH, FormatError, Walk
from dissect.wire.malformed import Malformed
from dissect.wire.varint import SIGNED, SIGNED64, VLQ, VLQ64, build_varint, read_varint

#: The first and the last number of each length.
NUMBERS: Final = [0, *[(1 << 7 * size) + add for size in range(1, 9) for add in (-1, 0)], 2**32 - 1, 2**64 - 1]


def told(fault: FormatError) -> tuple[str, str, int, int, int]:
    return fault.reason, fault.field, fault.at, fault.needed, fault.available


@pytest.mark.parametrize("kind", [VLQ, VLQ64, SIGNED, SIGNED64])
@pytest.mark.parametrize("begin", [0, 3])
def test_a_number_is_the_one_of_its_kind(kind: int, begin: int) -> None:
    """Whole, with others behind it, and cut off behind each of its octets."""
    bits = 64 if kind in {VLQ64, SIGNED64} else 32
    for number in NUMBERS:
        for one in (number, -number):
            low, high = (-(2 ** (bits - 1)), 2 ** (bits - 1)) if kind in {SIGNED, SIGNED64} else (0, 2**bits)
            if not low <= one < high:
                continue
            wire = bytes(begin) + build_varint(one, kind)
            for behind in (b"", b"\0", b"\x7f\x7f", b"\xff\xff\xff"):
                walk = Walk(wire + behind, begin, len(wire + behind), False)
                assert (walk.number(kind, "it"), walk.at) == (one, len(wire)) == read_varint(wire, begin, 99, kind)
            for end in range(begin, len(wire)):
                walk = Walk(wire, begin, end, False)
                with pytest.raises(FormatError) as caught:
                    walk.number(kind, "it")
                assert told(caught.value) == ("too_short", "it", begin, end - begin + 1, end - begin)


def test_octets_are_read_up_to_the_end() -> None:
    octets = bytes(range(1, 9))
    for size in (1, 2, 3, 4, 8):
        number = int.from_bytes(octets[:size], "big")
        for read in (Walk.fixed, Walk.step, Walk.take):
            walk = Walk(octets, 0, size, False)
            assert read(walk, size, "it") in (number, octets[:size], 0)
            assert (walk.at, walk.left, walk.peek()) == (size, 0, -1)
            short = Walk(octets, 0, size - 1, False)
            with pytest.raises(FormatError) as caught:
                read(short, size, "it")
            assert told(caught.value) == ("too_short", "it", 0, size, size - 1)
    walk = Walk(octets, 2, 5, False)
    assert (walk.left, walk.peek(), walk.u8("it"), walk.fixed(2, "it"), walk.left) == (3, 3, 3, 0x0405, 0)
    assert Walk(octets, 2, 99, False).left == 6  # there is no more
    assert Walk(octets, 4, 99, False).step(2, "it") == 4


def test_a_count_is_of_what_there_is() -> None:
    walk = Walk(b"\2ab", 0, 3, False)
    assert (walk.counted(VLQ, "count"), walk.at) == (2, 1)
    walk = Walk(b"\0\3ab", 1, 4, False)
    with pytest.raises(FormatError) as caught:
        walk.counted(VLQ, "count")
    assert told(caught.value) == ("length_beyond", "count", 1, 3, 2)


@pytest.mark.parametrize("size", [0, 10])
def test_work_is_bounded_by_the_octets_or_by_less(size: int) -> None:
    """Three for each octet and 1024; a smaller bound is no fault of the sender."""
    most = 3 * size + 1024
    for bound, left, reason in (
        (0, most, "count_mismatch"),
        (most + 5, most, "count_mismatch"),
        (most, most, "count_mismatch"),
        (7, 7, EXHAUSTED),
        (most - 1, most - 1, EXHAUSTED),
    ):
        walk = Walk(bytes(size), 0, size, False, bound)
        assert (walk.budget, walk.hurried, walk.bounded) == (left, bound > 0, reason == EXHAUSTED)
        walk.spend(left, "it")
        walk.spend(0, "it")
        with pytest.raises(FormatError) as caught:
            walk.spend(1, "it")
        assert told(caught.value) == (reason, "it", 0, 1, 0)


def test_depth_is_bounded() -> None:
    walk = Walk(b"abc", 2, 3, False)
    for _ in range(MAX_DEPTH):
        walk.enter("it")
    with pytest.raises(FormatError) as caught:
        walk.enter("it")
    assert told(caught.value) == ("bad_value", "depth of it", 2, MAX_DEPTH, MAX_DEPTH + 1)


def test_what_is_left_is_a_part() -> None:
    """Octets that nobody asked for are surplus; a walk that ended early leaves octets; faults are told in order."""
    first, surplus = FormatError("bad_value", "a", 1, 2, 3), FormatError("trailing_octets", "b", 2, 0, 2)
    for fault, layout, reasons in (
        (None, "octets", ["bad_value"]),
        (surplus, "surplus bytes", ["bad_value", "trailing_octets"]),
        (FormatError(EXHAUSTED, "c", 2, 5, 0), "octets", ["bad_value"]),
    ):
        malformed: list[Malformed] = []
        walk = Walk(b"\0\0ab", 0, 4, True)
        walk.take(2, "it")
        walk.enter("it")
        walk.part(VALUE, 0, "note", 1)
        walk.faults.append(first)
        walk.rest(malformed, fault, "snaplen")
        assert [(part.layout.name, part.offset, part.end, part.depth, part.note) for part in walk.parts] == [
            ("value", 0, 2, 2, "note"),
            (layout, 2, 4, 0, ""),
        ]
        assert (walk.at, walk.depth) == (4, 0)
        assert [(fact.layer, fact.reason, fact.limit) for fact in malformed] == [
            ("s7plus", reason, "snaplen") for reason in reasons
        ]
        assert (malformed[0].field, malformed[0].offset, malformed[0].needed, malformed[0].available) == ("a", 1, 2, 3)


def test_no_part_is_made_of_nothing_or_of_what_is_not_shown() -> None:
    walk = Walk(b"ab", 0, 2, True)
    walk.take(2, "it")
    walk.part(VALUE, 0)
    walk.rest([])
    assert [(part.offset, part.end) for part in walk.parts] == [(0, 2)]
    hidden = Walk(b"ab", 0, 2, False)
    hidden.part(VALUE, 0)
    hidden.rest([])
    assert (hidden.parts, hidden.at, hidden.uncut, hidden.full) == ([], 2, 0, False)
