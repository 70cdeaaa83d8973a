"""The items of a notification, each form with its places, its faults and what it costs to read."""

from __future__ import annotations

import struct
from typing import Final

import pytest

from dissect.protocols.s7plus.bodies import parse_contents
from dissect.protocols.s7plus.contents import Contents
from dissect.protocols.s7plus.message import parse_plus
from dissect.protocols.s7plus.objects import PlusObject, build_object
from dissect.protocols.s7plus.value_tables import INT
from dissect.protocols.s7plus.values import Value, build_value
from tests.protocols.s7plus.bodies import rid
from tests.protocols.s7plus.pdus import framed

FIVE: Final = Value(0, INT, 5)
INNER: Final = build_object(PlusObject(9, 1001, 0, 0, 0, [PlusObject(8, 7, 0, 0, 0, [])]))
#: Octets of the head of a notification, and behind it the sequence number and the changes.
HEAD: Final = 12


def read(
    items: bytes, subscription: int = 0x70000E51, head: bytes = b"\5\1", shown: bool = True, most: int = 0
) -> Contents:
    data = struct.pack(">BIHHHB", 0x33, subscription, 0x0400, 0, 0, 1) + head + items
    return parse_contents(parse_plus(framed(data, 2)), shown, most)


def parts(found: Contents) -> list[tuple[str, int, int, str]]:
    return [(part.layout.name, part.offset - HEAD, part.end - HEAD, part.note) for part in found.parts]


def test_each_item_is_a_part() -> None:
    items = b"".join([
        b"\x92" + rid(7) + build_value(FIVE),
        b"\x9b\x81\7" + build_value(FIVE),
        b"\x13" + rid(8),
        b"\x03" + rid(9),
        b"\x9c" + rid(10),
        b"\x83" + build_value(FIVE),
        b"\0",
    ])  # fmt: skip
    found = read(items + bytes(4))
    assert (found.malformed, found.whole, found.sequence) == ([], True, 5)
    assert (found.items, found.refusals, found.value) == ([(7, FIVE), (135, FIVE)], [(8, 0x13), (9, 0x03)], FIVE)
    said = parts(found)
    assert [(begin, end, note) for _, begin, end, note in said] == [
        (0, 2, ""),
        (2, 11, "7: Int 5"),
        (11, 18, "135: Int 5"),
        (18, 23, "8: refused"),
        (23, 28, "9: refused"),
        (28, 33, ""),
        (33, 38, "Int 5"),
        (38, 39, ""),
        (39, 43, ""),
    ]
    hidden = read(items + bytes(4), shown=False)
    assert (hidden.items, hidden.refusals, hidden.value, hidden.parts) == (found.items, found.refusals, FIVE, [])


@pytest.mark.parametrize(
    ("subscription", "head", "sequence", "names"),
    [
        (0x70000000, b"\5\1", 5, ["sequence", "changes"]),
        (0x70000000, b"\x81\0\1", 128, ["sequence", "changes"]),
        (0x70000000, b"\5\0" + bytes(7) + b"\1", 5, ["sequence", "time", "changes"]),
        (0x6FFFFFFF, b"\1", 1, ["changes"]),
    ],
)
def test_the_head_of_the_items_depends_on_the_subscription(
    subscription: int, head: bytes, sequence: int, names: list[str]
) -> None:
    found = read(b"\0" + bytes(4), subscription, head)
    assert (found.whole, found.sequence, found.parts[0].end - HEAD) == (True, sequence, len(head))
    assert [value.field.name for value in found.parts[0].values] == names


def test_objects_are_those_beside_each_other() -> None:
    """Each of those that an item holds; those inside them are theirs."""
    found = read(b"\0" + rid(0x70000001) + b"\0\0" + b"\x81" + INNER * 2 + b"\x81" + INNER + b"\0" + bytes(3))
    assert ([one.rid for one in found.objects], found.whole) == ([9, 9, 9], True)
    assert [one.rid for one in found.every] == [9, 8] * 3


@pytest.mark.parametrize("fill", range(7))
def test_three_or_four_zeros_or_none_end_a_notification(fill: int) -> None:
    found = read(b"\0" + bytes(fill))
    assert (found.whole, bool(found.malformed)) == ((True, False) if fill in {0, 3, 4} else (False, True))
    if found.malformed:
        (fact,) = found.malformed
        assert (fact.reason, fact.field, fact.offset, fact.available) == ("trailing_octets", "end", HEAD + 3, fill)
    assert not read(b"\0" + bytes(2) + b"\1").whole


def test_a_second_part_follows_where_there_is_no_zero() -> None:
    second = rid(0x70000001) + b"\0\0"
    found = read(b"\x13" + rid(8) + b"\0" + second + b"\x13" + rid(9) + b"\0" + bytes(3))
    assert (found.refusals, found.whole) == ([(8, 0x13), (9, 0x13)], True)
    assert [(begin, end) for _, begin, end, _ in parts(found)] == [
        (0, 2),
        (2, 7),
        (7, 8),
        (8, 14),
        (14, 19),
        (19, 20),
        (20, 23),
    ]
    cut = read(b"\0" + second[:5])
    assert [(one.reason, one.field, one.offset) for one in cut.malformed] == [("too_short", "second part", HEAD + 3)]


@pytest.mark.parametrize(
    ("items", "fault"),
    [
        (b"", ("too_short", "item", 2)),
        (b"\x44abc", ("unknown_type", "item", 2)),
        (b"\x13" + rid(8) + b"\x45", ("unknown_type", "item", 7)),
        (b"\x92\0\0\0", ("too_short", "reference", 3)),
        (b"\x9b\x80", ("too_short", "reference", 3)),
        (b"\x13\0\0\0", ("too_short", "reference", 3)),
        (b"\x9c\0\0\0", ("too_short", "unknown", 3)),
        (b"\x92" + rid(8), ("too_short", "flags", 7)),
    ],
)
def test_an_item_that_does_not_fit_is_told_with_its_place(items: bytes, fault: tuple[str, str, int]) -> None:
    for shown in (True, False):
        (fact,) = read(items, shown=shown).malformed
        assert (fact.reason, fact.field, fact.offset - HEAD) == fault
        if fact.reason == "unknown_type":
            assert (fact.needed, fact.available) == (0, items[fact.offset - HEAD - 2])


def test_values_and_refusals_cost_as_much() -> None:
    for item in (b"\x92" + rid(7) + build_value(FIVE), b"\x13" + rid(7)):
        assert not read(item * 20 + b"\0" + bytes(4), shown=False, most=100).exhausted
        assert read(item * 20 + b"\0" + bytes(4), shown=False, most=99).exhausted


@pytest.mark.parametrize(
    ("body", "items", "fault"),
    [
        (bytes(4), [], None),
        (bytes(10), [], None),
        (bytes(10) + b"\x92" + rid(1) + build_value(FIVE) + b"\0" + bytes(4), [(1, FIVE)], None),
        (bytes(10) + b"\0", [], None),
        (bytes(3), [], ("too_short", "unknown", 5)),
        (bytes(9), [], ("too_short", "unknown", 9)),
        (bytes(10) + b"\x44", [], ("unknown_type", "item", 15)),
    ],
)
def test_a_notification_of_version_1(
    body: bytes, items: list[tuple[int, Value]], fault: tuple[str, str, int] | None
) -> None:
    found = parse_contents(parse_plus(framed(b"\x33" + rid(0x01020304) + body, 1)))
    assert (found.object_id, found.items, found.whole) == (0x01020304, items, fault is None)
    assert [(one.reason, one.field, one.offset) for one in found.malformed] == ([fault] if fault else [])
    assert [part.end for part in found.parts][-1] == 5 + len(body)
    short = parse_contents(parse_plus(framed(b"\x33\1\2\3", 1)))
    assert [(one.reason, one.field) for one in short.malformed] == [("too_short", "subscription")]
