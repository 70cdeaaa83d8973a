"""The tables of system status lists against the reference, and against each other."""

from __future__ import annotations

import csv
from pathlib import Path

from dissect.protocols.s7 import diagnostic_tables, szl_communication, szl_modules, szl_records, szl_tables
from dissect.protocols.s7.diagnostic_tables import EVENTS
from dissect.protocols.s7.diagnostics import event_name
from dissect.protocols.s7.szl import record_layout, record_size
from dissect.protocols.s7.szl_communication import CAPABILITY_RECORDS, STATUS_RECORDS, flags
from dissect.protocols.s7.szl_records import COMPONENT_RECORDS, RECORDS
from dissect.protocols.s7.szl_tables import CAPABILITIES, COMPONENTS, INDEXES, PARTIAL_LISTS, STATUS_SECTIONS, SZL_IDS
from dissect.wire.codes import CodeTable
from dissect.wire.layout import Layout
from tests.cases import each

MODULES = (szl_tables, diagnostic_tables)
TABLES = [table for module in MODULES for table in vars(module).values() if isinstance(table, CodeTable)]
LAYOUTS = [
    *{
        layout.name: layout
        for module in (szl_records, szl_communication, szl_modules)
        for layout in vars(module).values()
        if isinstance(layout, Layout)
    }.values(),
    *COMPONENT_RECORDS.values(),
    *CAPABILITY_RECORDS.values(),
    *STATUS_RECORDS.values(),
]


@each("table", TABLES)
def test_rows(table: CodeTable) -> None:
    assert len(table)
    for row in table:
        assert 0 <= row.number < 16**table.digits
        assert row.name == row.name.strip() != ""
        assert table.name(row.number) == row.name
        assert table.text(row.number) == row.text == row.text.strip()
        assert not row.text or row.text.endswith(".")


def test_ids_are_those_of_the_reference(reference: Path) -> None:
    with (reference / "tables" / "szl_ids.tsv").open(encoding="utf-8", newline="") as file:
        rows = {int(row["szl_id"], 16): row for row in csv.DictReader(file, delimiter="\t")}
    assert len(rows) == len(SZL_IDS) == 153
    for number, row in rows.items():
        assert number in SZL_IDS
        assert SZL_IDS.name(number) == PARTIAL_LISTS.name(number & 0xFF) == row["partial_list_name"]
        assert SZL_IDS.text(number)


def test_an_unknown_extract_has_the_name_of_its_list() -> None:
    assert 0x0774 not in SZL_IDS
    assert SZL_IDS.name(0x0774) == "status of module LEDs"
    assert SZL_IDS.text(0x0774) == ""
    assert SZL_IDS.text(0x0F96).startswith("List header only")
    assert SZL_IDS.get(0x7777) is None
    assert SZL_IDS.name(0x7777) == "0x7777"
    assert SZL_IDS.text(0x7777) == ""


def test_what_an_index_picks() -> None:
    assert set(INDEXES) <= set(PARTIAL_LISTS.names())
    assert set(COMPONENT_RECORDS) == set(COMPONENTS.names())
    assert set(CAPABILITY_RECORDS) <= set(CAPABILITIES.names())
    assert set(STATUS_RECORDS) <= set(STATUS_SECTIONS.names())
    for records, names in ((CAPABILITY_RECORDS, CAPABILITIES), (STATUS_RECORDS, STATUS_SECTIONS)):
        assert {number: layout.name for number, layout in records.items()} == {
            number: f"{names.title}: {names.name(number)}" for number in records
        }


@each("layout", LAYOUTS)
def test_fields(layout: Layout) -> None:
    names = [field.name for field in layout.fields]
    assert len(set(names)) == len(names)
    assert all(field.text.endswith(".") for field in layout.fields)


def test_communication_functions_stand_in_the_octet_they_are_numbered_by() -> None:
    """Their eight octets are numbered 0 to 7; Wireshark has the number in the name of each."""
    for layout in (CAPABILITY_RECORDS[0x06], STATUS_RECORDS[0x06]):
        values = [(value.offset - 2, value.field.wireshark) for value in layout.read(bytes(40))]
        functions = [(octet, name) for octet, name in values if 0 <= octet < 8]
        assert {octet for octet, _ in functions} == set(range(8))
        assert [name for octet, name in functions if f"_{octet}" not in name[-16:]] == []


def test_sizes_of_records() -> None:
    """Sizes of the reference, and of the Siemens manual for the lists that the reference does not lay out."""
    sizes = {number: record_size(number) for number in (*RECORDS, 0x1C, 0x31, 0x32)}
    assert sizes == {
        0x00: 2, 0x11: 28, 0x12: 2, 0x13: 36, 0x14: 8, 0x15: 10, 0x19: 4, 0x22: 28, 0x24: 20, 0x25: 4, 0x37: 48, 0x71: 16,
        0x74: 4, 0x75: 16, 0x90: 14, 0x91: 16, 0x92: 16, 0x94: 0, 0x95: 40, 0x96: 48, 0xA0: 20, 0x1C: 34, 0x31: 40, 0x32: 40,
        0xB1: 4, 0xB2: 0, 0xB3: 0,
    }  # fmt: skip
    assert {layout.size for layout in COMPONENT_RECORDS.values()} == {34}
    assert {layout.size for layout in (*CAPABILITY_RECORDS.values(), *STATUS_RECORDS.values())} == {40}
    assert record_size(0x0118) == 0


def test_the_index_of_a_record_decides() -> None:
    for szl_id, index, layout in (
        (0x011C, 0x0005, COMPONENT_RECORDS[5]),
        (0x021C, 0xF805, COMPONENT_RECORDS[5]),
        (0x001C, 0x0006, szl_records.COMPONENT),
        (0x0131, 0x0010, CAPABILITY_RECORDS[0x10]),
        (0x0132, 0x0004, STATUS_RECORDS[4]),
        (0x0232, 0x0004, STATUS_RECORDS[4]),
        (0x0132, 0x0007, szl_records.RECORD),
        (0x0018, 0x0001, szl_records.RECORD),
    ):
        record = index.to_bytes(2, "big") + bytes(38)
        assert record_layout(szl_id, record, 0, 40) is layout
    assert record_layout(0x0131, b"\0", 0, 1) is szl_records.RECORD


def test_flags_are_told_highest_first() -> None:
    fields = flags("s7comm.x", "- seven=six - - - - - one")
    assert [(field.name, field.wireshark, field.bits, field.shares) for field in fields] == [
        ("seven", "s7comm.x.six", (0x40, 6), False),
        ("one", "s7comm.x.one", (0x01, 0), True),
    ]
    assert {field.size for field in flags("", "a b", 2, True)} == {2}
    assert all(field.shares and not field.wireshark for field in flags("", "a b", 2, True))


def test_events() -> None:
    assert len(EVENTS) == 545
    assert event_name(0x4302) == "STARTUP to RUN"
    assert event_name(0x39C4) == "distributed I/O: station failed"
    assert EVENTS.get(0x4402) is None
    assert event_name(0x4402) == "mode transition"
    assert EVENTS.name(0x4402) == "0x4402"
    assert EVENTS.text(0x4402) == ""


def test_module_and_user_events_go_by_their_number() -> None:
    """Classes 8 and 9: bits 11-8 tell how the event came, not what it is."""
    assert event_name(0x8054) == event_name(0x8954) == "analog input: wire break"
    assert event_name(0x9B60) == "GRAPH step"
    assert EVENTS.text(0x9B60) == "Coming: entered; going: left."
    assert event_name(0xA301) == event_name(0xB301) == "user event"
    assert event_name(0x0001) == "0x0"
