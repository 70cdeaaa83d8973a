"""Places as people write them."""

from __future__ import annotations

import pytest
from hypothesis import given
from hypothesis import strategies as st

from dissect.meaning.bindings.place import AREAS, Place, in_blocks, parse_place
from dissect.protocols.s7.address import MAX_DB, MAX_OCTET


@pytest.mark.parametrize(
    ("written", "place", "told"),
    [
        ("DB10.DBB0", (0x84, 10, 0), "DB10.DBB0"),
        (" db10.dbw4 ", (0x84, 10, 4), "DB10.DBB4"),
        ("DB65535.DBD2097151", (0x84, 65535, 2097151), "DB65535.DBB2097151"),
        ("DI3.DIB1", (0x85, 3, 1), "DI3.DIB1"),
        ("MB20", (0x83, 0, 20), "MB20"),
        ("IW2", (0x81, 0, 2), "IB2"),
        ("EB2", (0x81, 0, 2), "IB2"),
        ("AB1", (0x82, 0, 1), "QB1"),
    ],
)
def test_places(written: str, place: tuple[int, int, int], told: str) -> None:
    found = parse_place(written)
    assert found == Place(*place)
    assert str(found) == told


@pytest.mark.parametrize(
    "written",
    [
        "", "DB10", "DB10.DBX0.1", "DB10.DIB0", "DB10.DBB", "M0.1", "M5", "T5", "CB5", "ZB1", "XB1", "DB65536.DBB0",
        "DB1.DBB2097152", "DB1.DBB-1", "DB1.DBB\u0663", "DB1.DBB0 x", "DB123456.DBB0",
    ],
)  # fmt: skip
def test_what_is_none(written: str) -> None:
    assert parse_place(written) is None


@given(st.sampled_from(sorted(set(AREAS.values()))), st.integers(0, MAX_DB), st.integers(0, MAX_OCTET))
def test_every_place_is_read_as_it_is_shown(area: int, db: int, offset: int) -> None:
    place = Place(area, db if in_blocks(area) else 0, offset)
    assert parse_place(str(place)) == place


@given(st.text(max_size=20))
def test_no_text_raises(written: str) -> None:
    parse_place(written)
