from __future__ import annotations

from itertools import pairwise

from hypothesis import given
from hypothesis import strategies as st

from dissect.wire.layout import Field, Layout, latin


@st.composite
def layouts(draw: st.DrawFn) -> tuple[Layout, list[tuple[int, int, int, int]]]:
    """A layout of fields whole or cut into bits, and what each field is: (offset, size, lowest bit, bits)."""
    fields: list[Field] = []
    places: list[tuple[int, int, int, int]] = []
    offset = 0
    for number in range(draw(st.integers(1, 6))):
        size = draw(st.integers(1, 4))
        cuts = draw(st.lists(st.integers(1, size * 8 - 1), max_size=3, unique=True))
        edges = [size * 8, *sorted(cuts, reverse=True), 0]
        for part, (high, low) in enumerate(pairwise(edges)):
            mask = (1 << high) - (1 << low)
            bits = (mask, low) if cuts else None
            fields.append(Field(f"field{number}_{part}", size, "", "", None, bits, part > 0))
            places.append((offset, size, low, high - low))
        offset += size
    return Layout("drawn", "a test", fields), places


@given(layouts(), st.binary(max_size=40), st.integers(0, 20))
def test_fields_are_read_where_they_stand(
    drawn: tuple[Layout, list[tuple[int, int, int, int]]], octets: bytes, start: int
) -> None:
    layout, places = drawn
    values = layout.read(octets, start)
    whole = [place for place in places if start + place[0] + place[1] <= len(octets)]
    assert len(values) == len(whole)  # a header cut short gives its first fields
    for value, field, (offset, size, low, bits) in zip(values, layout.fields, whole, strict=False):
        assert value.field is field
        assert (value.offset, value.end) == (start + offset, start + offset + size)
        number = sum(octet << 8 * power for power, octet in enumerate(reversed(octets[value.offset : value.end])))
        assert value.value == (number >> low) % (1 << bits)
        assert field.read(octets, value.offset) == value.value


@given(layouts(), st.binary(max_size=40), st.integers(0, 20), st.integers(0, 45))
def test_one_field_is_found_as_it_is_read(
    drawn: tuple[Layout, list[tuple[int, int, int, int]]], octets: bytes, start: int, end: int
) -> None:
    layout, _ = drawn
    layout.fields.append(Field("octets", 2, "", means=latin))
    layout = Layout(layout.name, layout.source, layout.fields)
    read = {value.field.name: value for value in layout.read(octets, start, end)}
    for name in layout.numbers:
        value, there = layout.find(name, octets, start, end), read.get(name)
        assert (value is None) == (there is None)
        if value is not None and there is not None:
            assert (value.field, value.offset, value.end) == (there.field, there.offset, there.end)
            assert (value.value, value.octets, value.meaning) == (there.value, there.octets, there.meaning)
        number, text = layout.number(name, octets, start, end), layout.text(name, octets, start, end)
        assert (number, text) == ((-1, "") if there is None else (there.value, there.meaning))


@given(layouts())
def test_the_size_counts_shared_octets_once(drawn: tuple[Layout, list[tuple[int, int, int, int]]]) -> None:
    layout, places = drawn
    assert layout.size == max(offset + size for offset, size, _, _ in places)


def test_fields_sharing_octets() -> None:
    layout = Layout(
        "DT",
        "X.224",
        [Field("li", 1, ""), Field("eot", 1, "", "", None, (0x80, 7)), Field("nr", 1, "", "", None, (0x7F, 0), True)],
    )
    assert layout.size == 2
    read = [(value.field.name, value.offset, value.end, value.value) for value in layout.read(b"\x02\xf5")]
    assert read == [("li", 0, 1, 2), ("eot", 1, 2, 1), ("nr", 1, 2, 0x75)]
    assert [value.field.name for value in layout.read(b"\x02")] == ["li"]
    assert layout.read(b"", 0) == []
    assert layout.read(b"\x02\xf5", 2) == []
