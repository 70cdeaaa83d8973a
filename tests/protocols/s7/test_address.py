from __future__ import annotations

import pytest
from hypothesis import given
from hypothesis import strategies as st

from dissect.protocols.s7.address import address_text, parse_address
from dissect.protocols.s7.tables import AREA_LETTERS, AREAS, ELEMENT_OCTETS, NUMBERED_AREAS, TRANSPORT_SIZES
from tests.cases import each

BIT, BYTE, CHAR, WORD, INT, DWORD, DINT, REAL = range(1, 9)
COUNTER, TIMER, LREAL = 0x1C, 0x1D, 0x30


@each(
    ("area", "db", "address", "transport_size", "text"),
    [
        # Data blocks.
        (0x84, 10, 4 * 8 + 1, BIT, "DB10.DBX4.1"),
        (0x84, 10, 4 * 8, BIT, "DB10.DBX4.0"),
        (0x84, 10, 4 * 8, BYTE, "DB10.DBB4"),
        (0x84, 10, 4 * 8, CHAR, "DB10.DBB4"),
        (0x84, 10, 4 * 8, WORD, "DB10.DBW4"),
        (0x84, 10, 4 * 8, INT, "DB10.DBW4"),
        (0x84, 10, 4 * 8, DWORD, "DB10.DBD4"),
        (0x84, 10, 4 * 8, DINT, "DB10.DBD4"),
        (0x84, 10, 4 * 8, REAL, "DB10.DBD4"),
        (0x84, 10, 4 * 8, LREAL, "DB10.DBL4"),
        (0x84, 65535, 65535 * 8 + 7, BIT, "DB65535.DBX65535.7"),
        (0x84, 0, 0, BYTE, "DB0.DBB0"),
        (0x85, 7, 2 * 8 + 5, BIT, "DI7.DIX2.5"),
        (0x85, 7, 2 * 8, WORD, "DI7.DIW2"),
        # Flags, inputs, outputs, peripherals, local data.
        (0x83, 0, 20 * 8, WORD, "MW20"),
        (0x83, 0, 10 * 8 + 3, BIT, "M10.3"),
        (0x83, 0, 10 * 8, BYTE, "MB10"),
        (0x83, 0, 10 * 8, REAL, "MD10"),
        (0x81, 0, 0, BIT, "I0.0"),
        (0x81, 0, 3 * 8, BYTE, "IB3"),
        (0x81, 0, 4 * 8, WORD, "IW4"),
        (0x82, 0, 2 * 8, BYTE, "QB2"),
        (0x82, 0, 124 * 8 + 7, BIT, "Q124.7"),
        (0x80, 0, 256 * 8, WORD, "PW256"),
        (0x80, 0, 256 * 8, DWORD, "PD256"),
        (0x86, 0, 8, BYTE, "LB1"),
        (0x86, 0, 9, BIT, "L1.1"),
        (0x87, 0, 16, WORD, "VW2"),
        (0x87, 0, 17, BIT, "V2.1"),
        # Timers and counters: a plain number, never divided by eight.
        (0x1D, 0, 5, TIMER, "T5"),
        (0x1C, 0, 3, COUNTER, "C3"),
        (0x1D, 0, 2048, TIMER, "T2048"),
        (0x1C, 0, 3, WORD, "C3"),
        # The 200 family.
        (0x03, 0, 0, BYTE, "SI200:B0"),
        (0x05, 0, 8 * 4 + 2, BIT, "SF200:X4.2"),
        (0x06, 0, 8 * 4, WORD, "AI200:W4"),
        (0x07, 0, 8 * 4, WORD, "AO200:W4"),
        (0x1E, 0, 9, 0x1E, "C200:9"),
        (0x1F, 0, 9, 0x1F, "T200:9"),
        # What nobody knows is shown by its number.
        (0x00, 0, 16, BYTE, "RAW:B2"),
        (0x99, 0, 16, WORD, "area0x99:W2"),
        (0x01, 5, 512, BYTE, "RECORD5@512"),
        # An odd bit address of something that is no bit.
        (0x84, 1, 4 * 8 + 3, WORD, "DB1.DBW4.3"),
        (0x83, 0, 4 * 8 + 3, BYTE, "MB4.3"),
    ],
)
def test_as_people_write_it(area: int, db: int, address: int, transport_size: int, text: str) -> None:
    assert address_text(area, db, address, transport_size) == text


WIDTHS = {1: "B", 2: "W", 4: "D", 8: "L"}


def expected(area: int, width: str) -> str:
    """The address at octet 5, bit 1, or number 41, with DB number 3 where there is one."""
    letters = AREA_LETTERS.get(area, f"area0x{area:02x}")
    if area in NUMBERED_AREAS:
        return f"{letters}41" if len(letters) == 1 else f"{letters}:41"
    if area == 1:
        return "RECORD3@41"
    if area in {0x84, 0x85}:
        return f"{letters}3.{letters}{width}5.1"
    if 0x80 <= area <= 0x87:
        return f"{letters}{'' if width == 'X' else width}5.1"
    return f"{letters}:{width}5.1"


@each("transport_size", [row.number for row in TRANSPORT_SIZES] + [0x00, 0xFF])
def test_every_area_with_every_transport_size(transport_size: int) -> None:
    width = "X" if transport_size == BIT else WIDTHS[ELEMENT_OCTETS.get(transport_size, 1)]
    texts = [address_text(area, 3, 41, transport_size) for area in range(256)]
    assert texts == [expected(area, width) for area in range(256)]
    assert len(set(texts)) == 256


def test_every_area_has_letters() -> None:
    assert set(AREA_LETTERS) == {row.number for row in AREAS}


@given(
    st.integers(0, 255), st.integers(0, 0xFFFF), st.integers(0, 0xFFFFFF), st.integers(0, 0xFFFFFF), st.integers(0, 255)
)
def test_two_places_never_share_an_address(area: int, db: int, one: int, other: int, transport_size: int) -> None:
    texts = {address_text(area, db, address, transport_size) for address in (one, other)}
    assert (len(texts) == 1) is (one == other)
    assert all(text.isascii() and text.isprintable() for text in texts)


@given(st.integers(0, 255), st.integers(0, 0xFFFF), st.integers(0, 0xFFFFFF), st.integers(0, 255))
def test_an_address_is_read_as_it_is_written(area: int, db: int, address: int, transport_size: int) -> None:
    found = parse_address(address_text(area, db, address, transport_size))
    assert found is not None
    assert (found.area, found.field) == (area, address)
    assert found.db == (db if area in {0x01, 0x84, 0x85} else 0)


@pytest.mark.parametrize(
    ("text", "area", "db", "number", "width", "bit"),
    [
        ("DB10.DBX4.1", 0x84, 10, 4, "X", 1),
        ("DI3.DIL8", 0x85, 3, 8, "L", -1),
        ("MW20", 0x83, 0, 20, "W", -1),
        ("M2.0", 0x83, 0, 2, "", 0),
        ("E0.7", 0x81, 0, 0, "", 7),
        ("AB4", 0x82, 0, 4, "B", -1),
        ("Z3", 0x1C, 0, 3, "", -1),
        ("T5", 0x1D, 0, 5, "", -1),
        ("C200:5", 0x1E, 0, 5, "", -1),
        ("RECORD5@3", 0x01, 5, 3, "", -1),
    ],
)
def test_what_an_address_names(text: str, area: int, db: int, number: int, width: str, bit: int) -> None:
    found = parse_address(text)
    assert found is not None
    assert (found.area, found.db, found.number, found.width, found.bit) == (area, db, number, width, bit)


@pytest.mark.parametrize(
    "text",
    [
        "",
        "DB10",
        "DB10.DBW",
        "X5",
        "M2.8",
        "MX2",
        "TW5",
        "T5.1",
        "db1.dbb0",
        "area0x84:B5",
        "DB:W5",
        "C:W5",
        "MW20 ",
        "M\u0662",
    ],
)
def test_what_is_no_address(text: str) -> None:
    assert parse_address(text) is None


@given(st.text(max_size=20))
def test_no_text_is_too_odd_to_be_read(text: str) -> None:
    parse_address(text)
