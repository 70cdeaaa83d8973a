"""Parts: a block of octets is cut without gaps, and what does not fit is told once."""

from __future__ import annotations

from typing import Final

from dissect.wire.layout import COUNTS_REST, REST, Field, Layout, latin
from dissect.wire.malformed import Malformed
from dissect.wire.part import FILL, OCTETS, SURPLUS, Cursor, Part

FIXED: Final = Layout("fixed", "", [Field("number", 2, ""), Field("word", 2, "", means=latin)])
NAMED: Final = Layout("named", "", [Field("size", 1, "", counts=COUNTS_REST), Field("name", REST, "", means=latin)])


def cursor(octets: bytes) -> Cursor:
    """Return a cursor over all octets."""
    return Cursor(octets, 0, len(octets), "data", [])


def spans(parts: list[Part]) -> list[tuple[str, int, int]]:
    """Return what was cut where."""
    return [(part.layout.name, part.offset, part.end) for part in parts]


def test_a_part_has_its_fields() -> None:
    """Numbers, octets and what they mean."""
    part = cursor(b"\x01\x02AB").take(FIXED)
    assert part is not None
    assert (part.number("number"), part.octets("word"), part.text("word")) == (0x0102, b"AB", "AB")
    assert (part.number("nothing"), part.octets("nothing"), part.text("nothing")) == (-1, b"", "")
    assert part.number("word") == 0  # it holds octets, no number


def test_an_open_part_takes_what_it_is_given() -> None:
    """The size of an open part comes from its parser, all that is left by default."""
    at = cursor(b"\x03abcXY")
    named = at.take(NAMED, 4)
    assert named is not None
    assert named.text("name") == "abc"
    assert at.take(OCTETS) is not None
    assert spans(at.parts) == [("named", 0, 4), (OCTETS.name, 4, 6)]
    assert at.malformed == []


def test_what_is_too_short_is_kept_and_told_once() -> None:
    """Whatever part is cut short, its octets are in a part, and later parts are not told again."""
    for size in range(FIXED.size):
        at = cursor(b"\x01\x02AB"[:size])
        assert at.take(FIXED) is None
        assert at.take(NAMED) is None
        at.finish()
        assert [(fact.reason, fact.needed, fact.available) for fact in at.malformed] == [("too_short", 4, size)]
        assert spans(at.parts) == ([("fixed", 0, size)] if size else [])
        if size >= 2:
            assert at.parts[0].number("number") == 0x0102
        assert at.parts == [] or at.parts[0].octets("word") == b""


def test_an_open_part_that_states_too_much_or_too_little() -> None:
    """A stated size is held to what is there and to the fixed fields."""
    for stated in (0, 9):
        at = cursor(b"\x03abc")
        assert at.take(NAMED, stated) is None
        assert at.malformed[0].reason == "too_short"
        assert spans(at.parts) == [("named", 0, 4)]


def test_surplus_is_told_and_kept() -> None:
    """Octets that are left over are cut as such."""
    at = cursor(b"\x01\x02AB\xff")
    at.take(FIXED)
    at.finish()
    assert spans(at.parts) == [("fixed", 0, 4), (SURPLUS.name, 4, 5)]
    assert [(fact.reason, fact.offset) for fact in at.malformed] == [("trailing_octets", 4)]


def test_rest_is_no_fault() -> None:
    """Octets of unknown meaning are cut without complaint, and nothing is cut when there are none."""
    at = cursor(b"\x01")
    at.rest("said")
    at.rest()
    assert [(part.layout, part.note) for part in at.parts] == [(OCTETS, "said")]
    assert at.malformed == []


def test_fill_only_after_odd_sizes_and_before_more() -> None:
    """The fill octet follows an odd item when there is anything left."""
    at = cursor(b"\0\0")
    at.take_fill(2)
    at.take_fill(1)
    assert spans(at.parts) == [(FILL.name, 0, 1)]
    at.take_fill(3)
    at.take_fill(3)
    assert at.left == 0


def test_limit_and_field_are_told() -> None:
    """The fact names whose length set the limit."""
    told: list[Malformed] = []
    at = Cursor(b"\0" * 8, 2, 5, "param", told)
    assert at.take(FIXED) is None
    assert str(told[0]) == "s7: fixed at byte 2 needs 4 bytes, the parameter part has 3"
