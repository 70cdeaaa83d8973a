from __future__ import annotations

import re
from collections.abc import Iterator
from pathlib import Path
from typing import Final

import pytest
from hypothesis import given
from hypothesis import strategies as st
from scapy.sendrecv import sniff

import dissect
from dissect.layers import S7, S7_Any, S7Session, at

CAPTURES: Final = Path(__file__).parents[2] / "captures"


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
        ("P#M 2.0 BYTE 4", 0x83, 0, 16, 2),
        ("P#E 0.7", 0x81, 0, 7, 1),
        ("p#db10.dbx 4.1", 0x84, 10, 33, 1),
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


@pytest.mark.parametrize(
    ("address", "advice"),
    [
        ("MW2.1", "M2.1 for the bit, MW2 for the word"),
        ("M2", "M2.0 for the bit, MB2 for the byte"),
        ("DB10.DBB4.1", "DB10.DBX4.1 for the bit, DB10.DBB4 for the byte"),
        ("DB10.DBX4", "DB10.DBX4.0 for the bit, DB10.DBB4 for the byte"),
        ("QD8.7", "Q8.7 for the bit, QD8 for the double word"),
        ("NCK C1 module S column 1 line 1", "S7_NCKItem"),
        ("DRIVEESANY p17[7]", "S7_DriveItem"),
        ("SYM DB1 LID 9", "S7_SymbolInDB"),
        ("DB68.DBB352 x2+DB72.DBB48", "S7_DBReadItem"),
        ('DB1."level"', "S7Plus_Address"),
        ("0x6041:0", "S7Plus_Address"),
        ("level", "write it as DB10.DBX4.1"),
    ],
)
def test_a_refusal_says_the_right_form(address: str, advice: str) -> None:
    with pytest.raises(ValueError, match="is not an address: ") as refused:
        at(address)
    assert advice in str(refused.value)
    for written in re.findall(r"(\S+) for the", str(refused.value)):
        assert at(written).describe() == written


def addresses_of(path: Path) -> Iterator[str]:
    """Give every address that a transaction or a layer of a capture prints."""
    for event in dissect.open(path, pdus=False):
        if isinstance(event, dissect.Transaction) and not event.is_plus and not event.is_scd:
            yield from [item.address for item in event.items]
            yield from [error.address for error in event.errors]
    for packet in sniff(offline=str(path), session=S7Session):
        for item in (getattr(packet[S7].payload, "items", None) or []) if S7 in packet else []:
            yield item.summary()


def test_every_address_that_is_printed_is_taken_or_refused_with_the_class_to_use() -> None:
    taken, refused = set(), {}
    for path in sorted(CAPTURES.glob("*.pcapng")) + sorted((CAPTURES / "crafted").glob("coverage-*.pcapng")):
        for address in addresses_of(path):
            try:
                taken.add(at(address).describe())
            except ValueError as error:
                refused[address.partition(" ")[0]] = str(error)
    assert len(taken) > 100
    assert all("items of this kind" in said for kind, said in refused.items() if kind)
    assert set(refused) == {"", "DB68.DBB352", "DRIVEESANY", "NCK", "NCK_I", "NCK_M", "SYM"}


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
