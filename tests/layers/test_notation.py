from __future__ import annotations

import pytest
from hypothesis import given
from hypothesis import strategies as st

from dissect.layers import S7_Any, at


@pytest.mark.parametrize(
    ("address", "area", "db", "place", "size"),
    [
        ("DB10.DBX4.1", 0x84, 10, 33, 1),
        ("DB10.DBB4", 0x84, 10, 32, 2),
        ("DB10.DBW4", 0x84, 10, 32, 4),
        ("db10.dbd4", 0x84, 10, 32, 6),
        ("DI3.DIW6", 0x85, 3, 48, 4),
        ("MW20", 0x83, 0, 160, 4),
        ("M2.0", 0x83, 0, 16, 1),
        ("I0.0", 0x81, 0, 0, 1),
        ("E0.7", 0x81, 0, 7, 1),
        ("QB1", 0x82, 0, 8, 2),
        ("AW2", 0x82, 0, 16, 4),
        ("PW256", 0x80, 0, 2048, 4),
        ("T5", 0x1D, 0, 5, 0x1D),
        ("C3", 0x1C, 0, 3, 0x1C),
        ("Z3", 0x1C, 0, 3, 0x1C),
        ("C200:5", 0x1E, 0, 5, 0x1E),
        ("SF200:B7", 0x05, 0, 56, 2),
        ("area0x99:W2", 0x99, 0, 16, 4),
        ("RECORD1@2", 0x01, 1, 2, 2),
        ("PIW256", 0x80, 0, 2048, 4),
        ("PQB3", 0x80, 0, 24, 2),
        ("PED4", 0x80, 0, 32, 6),
        ("P#DB10.DBX4.1", 0x84, 10, 33, 1),
        ("P#M2.0", 0x83, 0, 16, 1),
    ],
)
def test_addresses(address: str, area: int, db: int, place: int, size: int) -> None:
    item = at(address, 2)
    assert (item.area, item.db, item.address, item.transport_size, item.count) == (area, db, place, size, 2)


def test_another_transport_size() -> None:
    assert at("DB7.DBD8", transport_size="real").transport_size == 8
    assert at("DB7.DBB0", transport_size=3).transport_size == 3
    with pytest.raises(ValueError, match="'FLOAT' is not a transport size: give one of BIT, BYTE"):
        at("DB7.DBD8", transport_size="FLOAT")


@pytest.mark.parametrize(
    "address",
    ["", "DB10", "DB10.DBW", "X5", "M2", "MW2.1", "MX2", "DB10.DBX4", "DB10.DBB4.1", "M2.8", "T5.1", "TW5", "T70000",
     "DB70000.DBB0", "MB2097152", "PIX0.0", "P#DB10.DBX4", "P#M2.1 WORD", "DB10.DBW4 x3 y", "NONE:B0"],
)  # fmt: skip
def test_what_is_no_address_is_refused(address: str) -> None:
    with pytest.raises(ValueError, match="is not an address"):
        at(address)


@pytest.mark.parametrize("count", [0, -1, 65536])
def test_counts_out_of_range_are_refused(count: int) -> None:
    with pytest.raises(ValueError, match="elements of 'MB0' cannot be requested"):
        at("MB0", count)


@given(
    area=st.sampled_from((0x1C, 0x1D, 0x80, 0x81, 0x82, 0x83, 0x84, 0x85, 0x86, 0x87)),
    size=st.sampled_from((1, 2, 4, 6)),
    db=st.integers(0, 65535),
    place=st.integers(0, 65535),
    count=st.integers(1, 65535),
)
def test_an_item_is_found_again_by_how_it_is_written(area: int, size: int, db: int, place: int, count: int) -> None:
    if area in {0x1C, 0x1D}:
        size = area
    elif size != 1:
        place &= ~7
    item = S7_Any(transport_size=size, count=count, db=db if area in {0x84, 0x85} else 0, area=area, address=place)
    text = S7_Any(transport_size=size, db=item.db, area=area, address=place).describe()
    assert bytes(at(text, count)) == bytes(item)


@pytest.mark.parametrize(
    ("text", "count", "size"),
    [
        ("DB10.DBW4 x3", 3, 4),
        ("P#DB10.DBX4.0 BYTE 10", 10, 2),
        ("P#DB10.DBX4.0 word 2", 2, 4),
        ("p#DB10.DBX4.0 REAL", 1, 8),
        ("P#DB10.DBX4.0 BOOL 1", 1, 1),
    ],
)
def test_counts_and_types_in_the_text(text: str, count: int, size: int) -> None:
    item = at(text)
    assert (item.area, item.db, item.address, item.count, item.transport_size) == (0x84, 10, 32, count, size)
    assert at(text, 7).count == 7


def test_all_addresses_of_items_are_taken_again() -> None:
    for area in (0x01, 0x03, 0x05, 0x06, 0x07, 0x1E, 0x1F, 0x80, 0x99):
        item = S7_Any(
            transport_size=2 if area not in {0x1E, 0x1F} else area,
            count=5,
            db=1 if area == 1 else 0,
            area=area,
            address=64,
        )
        assert bytes(at(item.describe())) == bytes(item)
