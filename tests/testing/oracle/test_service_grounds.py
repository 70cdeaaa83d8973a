"""The grounds about services: each holds for what it is meant for, and for nothing that only looks like it."""

from __future__ import annotations

import struct
from typing import Final

import pytest

from dissect.testing.oracle import body_grounds
from dissect.testing.oracle.facts import IN_BODY, IN_ITEM, IN_TPDU, TPDU, FieldPlace, Record, Value
from dissect.testing.oracle.ours import pdu_record
from tests.build import pdu, tpdu
from tests.testing.oracle.test_grounds import answer, case

DB: Final = "s7comm.param.item.db"
ITEMS: Final = bytes.fromhex("120a1002006400050100010012 0a10020064000584000100".replace(" ", ""))
RECORDS: Final = "s7comm.param.userdata.szl_part_list"


def userdata(group: int, subfunction: int, payload: bytes) -> Record:
    """A response."""
    head = bytes([0, 1, 0x12, 8, 0x12, 0x80 | group, subfunction, 1, 0, 0, 0, 0])
    return pdu_record(1, pdu(7, 1, head, b"\xff\x09" + struct.pack(">H", len(payload)) + payload))


@pytest.mark.parametrize(
    ("code", "ours", "theirs", "holds"),
    [(0x8C, None, 4, True), (0x8C, None, 5, False), (0x8B, None, 4, False), (0x8C, 4, 4, False)],
)
def test_credit_of_parameter(code: int, ours: Value | None, theirs: Value, holds: bool) -> None:
    parameter = bytes([code, 8]) + bytes.fromhex("0000000100010004")
    octets = tpdu(struct.pack(">BHHB", 0xE0, 0, 1, 0), parameter)
    record = Record(TPDU, 1, octets, {})
    place = FieldPlace(IN_TPDU, 0, body_grounds.CREDIT)
    assert body_grounds.credit_of_parameter(case(place, ours, theirs, record)) == holds


@pytest.mark.parametrize(("number", "holds"), [(1, True), (2, False)])
def test_data_record_in_a_read(number: int, holds: bool) -> None:
    read = pdu_record(1, pdu(1, 7, b"\x04\x02" + ITEMS))
    assert body_grounds.data_record(case(FieldPlace(IN_ITEM, number, DB), 5, None, read)) == holds
    assert not body_grounds.data_record(case(FieldPlace(IN_ITEM, number, DB), 5, 6, read))


@pytest.mark.parametrize(("item", "holds"), [(ITEMS[:12], True), (ITEMS[12:], False)])
def test_data_record_in_userdata(item: bytes, holds: bool) -> None:
    head = bytes([0, 1, 0x12, 4, 0x11, 0x42, 8, 0])
    record = pdu_record(1, pdu(7, 1, head, b"\xff\x09\x00\x0e\x00\x01" + item))
    at = 10 + len(head) + 4 + 2 + 6
    assert body_grounds.data_record(case(FieldPlace(IN_BODY, at, DB), b"\x00\x05", None, record)) == holds
    assert not body_grounds.data_record(case(FieldPlace(IN_BODY, 2, DB), b"\x00\x05", None, record))


def test_what_depends_on_the_service() -> None:
    place = FieldPlace(IN_BODY, 30, "s7comm.param.itemcount")
    initiate, others = b"\x02\x00\x07\x01\xff\x00", b"\x02\x00\x09\x01\x00"
    assert body_grounds.archives(case(place, b"\x01", None, userdata(4, 2, initiate)))
    assert not body_grounds.archives(case(place, b"\x01", None, userdata(4, 2, others)))
    assert not body_grounds.archives(case(place, b"\x01", b"\x02", userdata(4, 2, initiate)))
    assert body_grounds.archive_data(case(place, b"\x01", None, userdata(4, 0x10, b"12")))
    assert not body_grounds.archive_data(case(place, b"\x01", None, userdata(4, 0x11, b"12")))
    assert body_grounds.fill_before_length(case(place, b"\x00", None, userdata(2, 8, b"12")))
    assert not body_grounds.fill_before_length(case(place, b"\x00", None, userdata(2, 1, b"12")))
    assert not body_grounds.fill_before_length(case(place, None, b"\x00", userdata(2, 8, b"12")))
    assert not body_grounds.archives(case(place, b"\x01", None, answer(b"\xff\x09\x00\x02ab")))


@pytest.mark.parametrize(("szl_id", "size", "holds"), [(0x90, 14, True), (0x11, 28, False), (0x16, 14, False)])
def test_record_without_names(szl_id: int, size: int, holds: bool) -> None:
    record = userdata(4, 1, struct.pack(">HHHH", szl_id, 0, size, 1) + bytes(size))
    place = FieldPlace(IN_BODY, 34, RECORDS)
    assert body_grounds.record_without_names(case(place, None, bytes(size), record)) == holds
    assert not body_grounds.record_without_names(case(FieldPlace(IN_BODY, 35, RECORDS), None, bytes(size), record))
    assert not body_grounds.record_without_names(case(place, b"", bytes(size), record))
