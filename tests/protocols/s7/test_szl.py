"""System status lists: the examples of the reference, whole, cut at every octet, with more behind, and several parts."""

from __future__ import annotations

import struct
from typing import Final

import pytest
from hypothesis import given
from hypothesis import strategies as st

from dissect.protocols.s7.bodies import parse_body, parse_joined
from dissect.protocols.s7.message import parse_pdu
from dissect.protocols.s7.parameters import PUSH, REQUEST, RESPONSE
from dissect.protocols.s7.szl import SZL_HEAD, SZL_REQUEST
from dissect.protocols.s7.szl_communication import PROTECTION
from dissect.protocols.s7.szl_modules import MODULE_DIAGNOSTICS, MODULE_STATUS
from dissect.protocols.s7.szl_notes import list_note
from dissect.protocols.s7.szl_records import (
    COMPONENT_RECORDS,
    IDENTIFICATION,
    LED,
    MEMORY_AREA,
    OPERATING_MODE,
    RECORD,
    RECORD_REST,
    SZL_ID,
)
from dissect.protocols.s7.tables import READ_SZL
from dissect.wire.malformed import Malformed
from dissect.wire.part import OCTETS, SURPLUS, Part
from tests.cases import each

#: Reference section 8.8: the current mode, and the two parts of a list of ids.
MODE: Final = bytes.fromhex("0424 0000 0014 0001 5144ff0800000000000000002311142215306213")
IDS_1: Final = bytes.fromhex("0000 0000 0002 0006 0000 0f00 0011")
IDS_2: Final = bytes.fromhex("0f11 001c 0131")


def cut(octets: bytes, type_: int = RESPONSE) -> tuple[list[Part], list[str]]:
    told: list[Malformed] = []
    return parse_joined(4, READ_SZL, type_, octets, told), [fact.reason for fact in told]


def szl(szl_id: int, *records: bytes, index: int = 0) -> bytes:
    length = len(records[0]) if records else 0
    return struct.pack(">HHHH", szl_id, index, length, len(records)) + b"".join(records)


def notes(octets: bytes) -> list[str]:
    parts, told = cut(octets)
    assert told == []
    return [part.note for part in parts[1:]]


def body(payload: bytes, data_unit_ref: int, last: int) -> list[Part]:
    """The data of an answer with this place in a chain of parts, without its data head."""
    head = bytes((0, 1, 0x12, 8, 0x12, 0x84, 1, 3, data_unit_ref, last, 0, 0))
    data = b"\xff\x09" + len(payload).to_bytes(2, "big") + payload
    pdu = parse_pdu(struct.pack(">BBHHHH", 0x32, 7, 0, 1, len(head), len(data)) + head + data)
    parsed = parse_body(pdu)
    assert parsed.malformed == []
    return parsed.data[1:]


def test_a_request() -> None:
    (request,), told = cut(bytes.fromhex("0131 0001"), REQUEST)
    assert told == []
    assert request.layout is SZL_REQUEST
    assert request.number("szl_id") == 0x0131
    assert request.text("szl_id") == "communication capability"
    assert request.note == "SZL 0x0131 communication capability, general"


@pytest.mark.parametrize(
    ("szl_id", "index", "note"),
    [
        (0x0011, 0, "SZL 0x0011 module identification"),
        (0x0011, 1, "SZL 0x0011 module identification, index 0x0001"),
        (0x0232, 4, "SZL 0x0232 communication status, protection"),
        (0x0222, 0x50, "SZL 0x0222 interrupt status, OB 80"),
        (0x0022, 0x50, "SZL 0x0022 interrupt status, index 0x0050"),
        (0x0092, 0, "SZL 0x0092 rack and station status, central racks"),
        (0x0692, 2, "SZL 0x0692 rack and station status, DP master system 2"),
        (0x0694, 101, "SZL 0x0694 rack and station status (PROFIBUS DP and PROFINET), PROFINET IO system 101"),
        (0x4292, 0, "SZL 0x4292 rack and station status (IM)"),
        (0x0D91, 0, "SZL 0x0d91 module status, rack 0"),
        (0x0D91, 0x0103, "SZL 0x0d91 module status, DP master system 1 station 3"),
        (0x0D91, 0x8803, "SZL 0x0d91 module status, PROFINET IO system 101 station 3"),
        (0x0C91, 0x8100, "SZL 0x0c91 module status, output address 256"),
        (0x0991, 0x0200, "SZL 0x0991 module status, DP master system 2"),
        (0x0190, 1, "SZL 0x0190 DP master system information, DP master system 1"),
        (0x01A0, 10, "SZL 0x01a0 diagnostic buffer of the CPU, newest 10"),
        (0x00B1, 256, "SZL 0x00b1 module diagnostics, data record 0, input address 256"),
        (0x00B2, 0x0104, "SZL 0x00b2 module diagnostics, data record 1, by rack and slot, rack 1 slot 4"),
        (0x0F1C, 0, "SZL 0x0f1c component identification, head only"),
        (0x4C91, 5, "SZL 0x4c91 module status (IM), input address 5"),
        (0x7777, 0, "SZL 0x7777 (0x7)"),
    ],
)
def test_what_a_list_is(szl_id: int, index: int, note: str) -> None:
    assert list_note(szl_id, index) == note


def test_the_mode() -> None:
    (head, mode), told = cut(MODE)
    assert told == []
    assert head.layout is SZL_HEAD
    assert head.note == "SZL 0x0424 operating modes"
    assert mode.layout is OPERATING_MODE
    assert mode.text("mode") == "RUN"
    assert mode.text("time") == "DT#2023-11-14-22:15:30.621"
    assert mode.note == "RUN, event 0x5144 run-time event"


def test_the_joined_list_of_ids() -> None:
    (head, *ids), told = cut(IDS_1 + IDS_2)
    assert told == []
    assert head.number("record_length") * head.number("record_count") == 12
    assert [part.number("listed_id") for part in ids] == [0x0000, 0x0F00, 0x0011, 0x0F11, 0x001C, 0x0131]
    assert all(part.layout is SZL_ID and not part.note for part in ids)
    assert ids[2].text("listed_id") == "module identification"


def test_identification() -> None:
    module = struct.pack(">H20sHHH", 1, b"6ES7 315-2EH14-0AB0 ", 0xC0, 4, 1)
    firmware = struct.pack(">H20sHHH", 7, b" " * 20, 0xC0, 0x5603, 0x0206)
    odd = struct.pack(">H20sHHH", 1, b"6ES7 315-2EH14-0AB0 ", 0xC0, 0x0300, 0x2020)
    assert notes(szl(0x0011, odd)) == ["6ES7 315-2EH14-0AB0, module"]
    nothing = struct.pack(">H20sHHH", 0x81, b"Boot Loader", 0xC0, 0x2020, 0x2020)
    assert notes(szl(0x0011, module, firmware, nothing)) == [
        "6ES7 315-2EH14-0AB0, module version 4",
        "basic firmware V3.2.6",
        "Boot Loader, firmware extension",
    ]


def test_notes_of_records() -> None:
    assert notes(
        szl(0x0074, bytes((0, 4, 1, 0)), bytes((0, 5, 0, 0)), bytes((0, 0xB, 1, 1)), bytes((0, 0x7F, 9, 0)))
    ) == [
        "RUN on",
        "STOP off",
        "BUS1F on, flashing at 2 Hz",
        "0x007f 0x0009",
    ]
    component = struct.pack(">H24s8x", 5, b"S C-C2UR28922012")
    assert notes(szl(0x011C, component, index=5)) == ["serial number S C-C2UR28922012"]
    protection = struct.pack(">6H", 4, 1, 0, 3, 2, 0) + bytes(28)
    assert notes(szl(0x0232, protection, index=4)) == ["protection 3 (read and write protection), switch RUN-P"]
    mode = bytes.fromhex("4302ff68") + bytes(8) + bytes.fromhex("2311142215306213")
    assert notes(szl(0x0124, mode)) == ["RUN, before: STARTUP (warm restart), event 0x4302 STARTUP to RUN"]
    event = bytes.fromhex("4302ff68") + bytes(8) + bytes.fromhex("2311142215306213")
    assert notes(szl(0x00A0, event)) == ["0x4302 STARTUP to RUN, DT#2023-11-14-22:15:30.621"]
    assert notes(szl(0x0013, struct.pack(">HHI", 1, 1, 196608) + bytes(28))) == ["work memory 196608 bytes"]
    assert notes(szl(0x0014, struct.pack(">4H", 4, 1, 256, 0))) == ["timers 256"]
    assert notes(szl(0x0015, struct.pack(">3HI", 0x0A00, 16001, 64, 65536))) == ["DB: at most 16001"]
    assert notes(szl(0x0090, bytes((1,)) + bytes(13))) == ["DP master system 1"]
    capability = struct.pack(">HHH", 1, 240, 16) + bytes(34)
    assert notes(szl(0x0131, capability, index=1)) == ["PDU length 240, at most 16 connections"]
    status = struct.pack(">10H", 1, 1, 1, 2, 3, 8, 4, 6, 5, 20) + bytes(20)
    assert notes(szl(0x0132, status, index=1)) == [
        "open connections: 2 of programming devices, 3 of operator stations, 4 configured, 5 others"
    ]
    clock = struct.pack(">H", 8) + bytes(20) + bytes.fromhex("2311142215306213") + bytes(10)
    assert notes(szl(0x0132, clock, index=8)) == ["time of day DT#2023-11-14-22:15:30.621"]
    assert notes(szl(0x0132, struct.pack(">H", 8) + bytes(38), index=8)) == ["time system"]
    assert notes(szl(0x0090, bytes((100,)) + bytes(13))) == ["PROFINET IO system 100"]
    ethernet = bytes.fromhex("07ff c0a80001 ffffff00 c0a80001 001b1b000001 01 00") + bytes(26)
    assert notes(szl(0x0037, ethernet)) == ["192.168.0.1, 00:1b:1b:00:00:01"]
    assert notes(szl(0x0012, b"\x01\x04")) == [""]
    assert notes(szl(0x0018, b"\x01\x04")) == [""]


def test_racks_and_stations() -> None:
    """Bit 0 is the central rack or station 1; list 0x94 has a bit of the whole system in front of them."""
    octets = b"\x05" + bytes(14) + b"\x80"
    assert notes(szl(0x0092, octets)) == ["configured: racks 0, 2, 127"]
    assert notes(szl(0x0292, octets, index=1)) == ["available: stations 1, 3, 128"]
    assert notes(szl(0x0692, b"\x04" + bytes(15), index=1)) == ["faulty or deactivated: station 3"]
    assert notes(szl(0x0392, b"\x01" + bytes(15))) == ["rack 0"]
    assert notes(szl(0x0294, b"\0\0\0\0")) == ["available: none"]
    assert notes(szl(0x0294, b"\0\0\x03\0")) == ["available: rack 0"]
    assert notes(szl(0x0694, b"\0\x64\x09\x01", index=0x64)) == ["faulty or deactivated: stations 3, 8"]


def test_modules() -> None:
    def module(place: int, slot: int, address: int, state: int) -> list[str]:
        return notes(szl(0x0D91, struct.pack(">8H", place, slot, address, 0, 0, 0, state, 0x11)))

    assert module(0, 0x0200, 2047, 0xFF82) == ["rack 0 slot 2 (address 2047): ok"]
    assert module(3, 0x0401, 0x7FFF, 0xB400) == ["rack 3 slot 4 interface module 1: no module"]
    assert module(0x0107, 0x0400, 256, 0xB403) == ["DP master system 1 station 7 slot 4 (input address 256): faulty"]
    assert module(0x8807, 3, 8, 0xB514) == [
        "PROFINET IO system 101 station 7 slot 3 (output address 8): not available, station faulty"
    ]
    submodule = struct.pack(">HHIHHHH", 256, 100, 0, 7, 3, 1, 0) + bytes(18)
    assert notes(szl(0x0C96, submodule + struct.pack(">HH", 0x0102, 0x21) + bytes(10))) == [
        "PROFINET IO system 100 station 7 slot 3 subslot 1: maintenance required"
    ]
    central = struct.pack(">HHIHHHH", 256, 0, 0, 1, 4, 0, 0) + bytes(18)
    assert notes(szl(0x0C96, central + struct.pack(">HH", 2, 0x21) + bytes(10))) == ["rack 1 slot 4: ok"]


def test_diagnostic_data_of_a_module() -> None:
    (_, record), told = cut(szl(0x00B1, bytes.fromhex("0d150020"), index=256))
    assert told == []
    assert record.layout is MODULE_DIAGNOSTICS
    assert record.text("module_class") == "analog module"
    assert record.note == "analog module: channel fault, external fault, fuse blown"
    assert notes(szl(0x00B1, bytes.fromhex("00858010"))) == ["analog module: converter fault, maintenance required"]
    (_, record, rest), told = cut(szl(0x00B2, bytes.fromhex("001f0000 7008"), index=4))
    assert told == []
    assert record.note == "digital module: no fault"
    assert rest.layout is RECORD_REST


def test_fields_of_flags() -> None:
    (_, module), _ = cut(szl(0x0D91, struct.pack(">8H", 0, 0x0200, 0x7FFF, 0xC0, 0xC0, 0, 0xB483, 0x0011)))
    assert module.layout is MODULE_STATUS
    assert module.text("address_kind") == "input"
    assert [module.number(name) for name in ("local_segment", "not_available", "exists", "error")] == [1, 0, 1, 1]
    assert module.text("area") == "S7-300"
    assert module.number("width") == 1
    (_, memory), _ = cut(szl(0x0013, struct.pack(">HHIH", 1, 1, 0, 0x11) + bytes(26)))
    assert memory.layout is MEMORY_AREA
    assert [memory.number(name) for name in ("together", "separate", "volatile")] == [1, 0, 1]


def test_head_only() -> None:
    parts, told = cut(bytes.fromhex("0f11 0000 001c 0004"))
    assert told == []
    assert [part.layout for part in parts] == [SZL_HEAD]


def test_no_records() -> None:
    assert cut(bytes.fromhex("003a 0000 0094 0000"))[1] == []
    assert cut(bytes.fromhex("0112 0200 0000 0000"))[1] == []


def test_a_longer_record_is_told_to_its_end() -> None:
    (_, led, rest, second, rest_2), told = cut(szl(0x0074, bytes((0, 4, 1, 0, 9)), bytes((0, 5, 0, 0, 9))))
    assert told == []
    assert led.layout is second.layout is LED
    assert rest.layout is rest_2.layout is RECORD_REST
    assert second.note == "STOP off"


def test_a_shorter_record_has_the_fields_that_fit() -> None:
    (_, first, second), told = cut(szl(0x0111, b"\0\x016ES7 315-2EH14-0AB0 ", b"\0\x06" + b"x" * 20))
    assert told == []
    assert first.layout is IDENTIFICATION
    assert first.note == "6ES7 315-2EH14-0AB0, module"
    assert first.find("version") is None
    assert second.number("index") == 6


def test_unknown_lists_have_records_of_octets() -> None:
    (head, first, second), told = cut(szl(0x001A, b"abc", b"def"))
    assert told == []
    assert head.note == "SZL 0x001a"
    assert first.layout is second.layout is RECORD
    assert (first.octets("octets"), second.octets("octets")) == (b"abc", b"def")


@each("size", range(1, len(MODE)))
def test_cut(size: int) -> None:
    parts, told = cut(MODE[:size])
    assert told == (["count_mismatch"] if size == SZL_HEAD.size else ["too_short"])
    assert parts[-1].end == size


def test_fewer_records_than_told() -> None:
    parts, told = cut(IDS_1)
    assert told == ["count_mismatch"]
    assert len(parts) == 4


def test_more_behind() -> None:
    parts, told = cut(MODE + b"\0")
    assert told == ["trailing_octets"]
    assert parts[-1].layout is SURPLUS


def test_nobody_pushes_a_list() -> None:
    parts, told = cut(MODE, PUSH)
    assert [part.layout for part in parts] == [OCTETS]
    assert told == []


def test_the_parts_of_an_answer() -> None:
    first = body(IDS_1, 213, 1)
    assert [part.layout for part in first] == [SZL_HEAD, SZL_ID, SZL_ID, SZL_ID]
    for last in (0, 1):
        (later,) = body(IDS_2, 213, last)
        assert later.layout is OCTETS
        assert later.note == "continuation"


def test_a_first_part_may_end_within_a_record() -> None:
    parts = body(struct.pack(">4H", 0x001C, 0, 34, 10) + struct.pack(">H24s8x", 1, b"station") + b"\0\x02ab", 5, 1)
    assert [part.layout for part in parts] == [SZL_HEAD, COMPONENT_RECORDS[1], OCTETS]
    assert parts[2].note == "first bytes of a record"


@pytest.mark.parametrize(
    "middle",
    [
        b"\0",
        bytes.fromhex("0011011100120112") + bytes(100),
        bytes.fromhex("0f1100000012ffff") + bytes(100),
        bytes.fromhex("7011000000120fff") + bytes(100),
        bytes.fromhex("0011000000 1c0002") + bytes(56),
    ],
    ids=["too short", "ids", "head only", "no module class", "all of it is there"],
)
def test_a_middle_part_does_not_begin_a_list(middle: bytes) -> None:
    (part,) = body(middle, 5, 1)
    assert part.note == "continuation"


def test_protection_by_name() -> None:
    (_, record), _ = cut(szl(0x0132, struct.pack(">6H", 4, 1, 0, 1, 3, 1) + bytes(28), index=4))
    assert record.layout is PROTECTION
    assert record.text("parameter_level") == "no password"
    assert record.text("switch") == "STOP"
    assert record.text("startup_switch") == "CRST"


@given(
    st.sampled_from([*range(0x100)]),
    st.integers(0, 0xF),
    st.integers(0, 0x11),
    st.integers(0, 80),
    st.binary(max_size=200),
)
def test_every_list_is_covered_without_gaps(
    partial: int, extract: int, index: int, length: int, records: bytes
) -> None:
    octets = struct.pack(">4H", extract << 8 | partial, index, length, 3) + index.to_bytes(2, "big") + records
    parts, _ = cut(octets)
    assert b"".join(octets[part.offset : part.end] for part in parts) == octets


@given(st.binary(max_size=100), st.integers(0, 3), st.integers(0, 1), st.integers(0, 2))
def test_never_raises(octets: bytes, type_: int, data_unit_ref: int, last: int) -> None:
    parts, _ = cut(octets, type_)
    assert b"".join(octets[part.offset : part.end] for part in parts) == octets
    head = bytes((0, 1, 0x12, 8, 0x12, 0x84, 1, 3, data_unit_ref, last, 0, 0))
    data = b"\xff\x09" + len(octets).to_bytes(2, "big") + octets
    parse_body(parse_pdu(struct.pack(">BBHHHH", 0x32, 7, 0, 1, len(head), len(data)) + head + data))
