from __future__ import annotations

import pytest
from hypothesis import given
from hypothesis import strategies as st

from dissect.protocols.s7.items import parse_item
from dissect.protocols.s7.layouts import ITEM_HEAD
from dissect.protocols.s7.syntaxes import (
    DB_AREA,
    DB_READ_ITEM,
    DRIVE_ITEM,
    NCK_ITEM,
    PBC_ID,
    SYMBOL_ELSEWHERE,
    SYMBOL_IN_DB,
    SYMBOL_IN_MEMORY,
    SYMBOL_STEP,
    item_text,
    layout_of,
)
from dissect.protocols.s7.tables import S7ANY, SYNTAX_IDS
from dissect.wire.part import OCTETS
from tests.protocols.s7.job_pdus import Rows, job, said, stands_cuts
from tests.protocols.s7.userdata_pdus import body

#: (item without its head's first two octets, layouts, address); reference sections 3.5 and 8.3, appendix A.
EXAMPLES = [
    ("b0 02 02 0044 0160 01 0048 0030", [DB_READ_ITEM, DB_AREA, DB_AREA], "DB68.DBB352 x2+DB72.DBB48"),
    ("b0 00", [DB_READ_ITEM], "DBREAD"),
    ("82 41 0001 0001 7f 01", [NCK_ITEM], "NCK C1 module S column 1 line 1"),
    ("83 02 0003 0004 10 05", [NCK_ITEM], "NCK_M N2 module Y column 3 line 4 x5"),
    ("84 ff 0003 0004 10 00", [NCK_ITEM], "NCK_I M31 module Y column 3 line 4 x0"),
    ("a2 01 0002 0003 0011 0007", [DRIVE_ITEM], "DRIVEESANY p17[7]"),
    ("b2 ff 8a0e 0001 11223344 40000009", [SYMBOL_IN_DB, SYMBOL_STEP], "SYM DB1 LID 9"),
    (
        "b2 ff 0000 0052 11223344 4000000a 50000002 60000000",
        [SYMBOL_IN_MEMORY, SYMBOL_STEP, SYMBOL_STEP, SYMBOL_STEP],
        "SYM M LID 10 index 2 part start 0",
    ),
    ("b2 ff 1234 0052 11223344", [SYMBOL_ELSEWHERE], "SYM 0x1234:0x0052"),
    ("13 cc 00000001", [PBC_ID], "R_ID 0x00000001"),
    ("82 41 0001 0001 80 01", [NCK_ITEM], "NCK C1 module 0x80 column 1 line 1"),
]
ALARMS = [
    ("15 00 60000001", "ALARM_LOCKFREE event 0x60000001"),
    ("16 00 60000001 01 00 ff fe", "ALARM_IND event 0x60000001"),
    ("19 00 60000001 ff fe", "ALARM_ACK event 0x60000001"),
    ("1a 00 01 34 00000002", "ALARM_QUERYREQ 1:0x00000002"),
    ("1a 00 03 34 60000001", "ALARM_QUERYREQ 3:0x60000001"),
    ("1a 00 07 34 00000009", "ALARM_QUERYREQ 7:0x00000009"),
    ("1c 00 60000001 01 00 ff fe 01 02 03 00", "NOTIFY_IND event 0x60000001"),
]


def item(text: str) -> str:
    octets = bytes.fromhex(text)
    return f"12{len(octets):02x}{octets.hex()}"


@pytest.mark.parametrize(("text", "layouts", "address"), EXAMPLES)
def test_examples(text: str, layouts: list[object], address: str) -> None:
    octets = bytes.fromhex(item(text))
    read = parse_item(octets, 2)
    assert (read.address, read.size, read.count) == (address, -1, -1)
    found = body(job("0401" + item(text)))
    assert found.malformed == []
    assert [part.layout for part in found.parameters[1:]] == layouts
    assert address in {found.notes[0], "+".join(found.notes)}  # a DBREAD item says its areas one by one
    stands_cuts("0401" + item(text))


@pytest.mark.parametrize(("text", "address"), ALARMS)
def test_alarms(text: str, address: str) -> None:
    found = body(job("0401" + item(text)))
    assert ([part.layout for part in found.parameters[1:]], found.notes) == (
        [layout_of(bytes.fromhex(item(text)))],
        [address],
    )


def test_fields() -> None:
    rows: Rows = [
        ("area_count", 2), ("area_size", 2), ("db", 68), ("start", 352), ("area_size", 1), ("db", 72), ("start", 48),
    ]  # fmt: skip
    assert said(job("0401" + item(EXAMPLES[0][0])))[5:] == rows
    assert said(job("0401" + item(EXAMPLES[2][0])))[5:] == [
        ("nck_area", "C"), ("nck_unit", 1), ("column", 1), ("line", 1), ("module", "S"), ("line_count", 1),
    ]  # fmt: skip
    assert said(job("0401" + item(EXAMPLES[5][0])))[5:] == [
        ("unknown_1", 1), ("unknown_2", 2), ("unknown_3", 3), ("parameter", 17), ("parameter_index", 7),
    ]  # fmt: skip
    assert said(job("0401" + item(EXAMPLES[6][0])))[5:] == [
        ("reserved", 0xFF), ("root", "data block"), ("db", 1), ("crc", 0x11223344), ("flags", "LID"), ("value", 9),
    ]  # fmt: skip


def test_an_odd_item_is_followed_by_a_fill_octet() -> None:
    drive, symbol = item("b0 01 04 000a 0000") + "00", item("b2 ff 8a0e 0001 11223344")
    found = body(job("0402" + drive + symbol))
    assert [part.layout.name for part in found.parameters[1:]] == [
        DB_READ_ITEM.name,
        DB_AREA.name,
        "fill",
        SYMBOL_IN_DB.name,
    ]
    assert found.parameters[-1].note == "SYM DB1"


@pytest.mark.parametrize("text", [row[0] for row in EXAMPLES] + [row[0] for row in ALARMS])
def test_an_item_of_another_size_stays_octets(text: str) -> None:
    for other in (item(text + "00"), item(text)[:2] + f"{len(bytes.fromhex(text)) - 1:02x}" + item(text)[4:-2]):
        octets = bytes.fromhex(other)
        assert layout_of(octets) is None
        assert item_text(octets) == f"{SYNTAX_IDS.name(octets[2])}:{octets[3:].hex()}"
        assert body(job("0401" + other)).parameters[-1].layout is (OCTETS if len(octets) > 3 else ITEM_HEAD)


def test_a_syntax_nobody_knows_stays_octets() -> None:
    found = body(job("0401" + item("77 0102")))
    assert [part.layout.name for part in found.parameters[1:]] == ["item", OCTETS.name]
    assert found.notes == ["0x77:0102"]


SYNTAXES = st.one_of(st.sampled_from([row.number for row in SYNTAX_IDS]), st.integers(0, 255))


@given(SYNTAXES, st.binary(max_size=40))
def test_never_raises(syntax_id: int, address: bytes) -> None:
    octets = bytes([0x12, 1 + len(address), syntax_id]) + address
    assert parse_item(octets, 0).address
    found = body(job("0401" + octets.hex()))
    if syntax_id != S7ANY:
        assert sum(part.end - part.offset for part in found.parameters[1:]) == len(octets)
