"""The grounds of what differs within a body: each holds for what it is meant for, and for nothing that only looks like it."""

from __future__ import annotations

import struct
from typing import Final

import pytest

from dissect.testing.oracle import body_grounds
from dissect.testing.oracle.facts import IN_BODY, IN_JOINED, IN_PARAMETERS, PDU, FieldPlace, LocatedValue, Record, Value
from dissect.testing.oracle.ours import pdu_record
from tests.build import pdu
from tests.testing.oracle.test_grounds import TYPE, answer, case

RECORD: Final = "s7comm.param.userdata.szl_part_list"
CLOCK: Final = b"\x00\x19" + bytes.fromhex("1602081451379162")


def clock(unit: int = 0, last: int = 0, payload: bytes = CLOCK) -> Record:
    """The answer to reading a clock, or a part of one."""
    parameters = b"\x00\x01\x12\x08\x12\x87\x01\x02" + bytes([unit, last, 0, 0])
    return pdu_record(1, pdu(7, 1, parameters, b"\xff\x09" + struct.pack(">H", len(payload)) + payload))


@pytest.mark.parametrize(
    ("last", "place", "theirs", "holds"),
    [
        (1, FieldPlace(IN_BODY, 26, "s7comm.data.ts_reserved"), None, True),
        (0, FieldPlace(IN_BODY, 26, "s7comm.data.ts_reserved"), None, False),
        (1, FieldPlace(IN_BODY, 26, "s7comm.data.ts_reserved"), b"\x01", False),
        (1, FieldPlace(IN_JOINED, 26, "s7comm.data.ts_reserved"), None, False),
        (1, FieldPlace(IN_PARAMETERS, 0, "s7comm.param.userdata.seq_num"), None, False),
    ],
)
def test_in_parts(last: int, place: FieldPlace, theirs: Value | None, holds: bool) -> None:
    assert body_grounds.in_parts(case(place, b"\x00", theirs, clock(5, last))) == holds


def test_in_parts_needs_a_head_that_says_so() -> None:
    place = FieldPlace(IN_BODY, 26, "s7comm.data.ts_reserved")
    assert not body_grounds.in_parts(case(place, b"\x00", None, answer(b"\xff\x09\x00\x02ab")))


@pytest.mark.parametrize(
    ("unit", "last", "joined", "ours", "theirs", "holds"),
    [
        (5, 0, b"", None, b"\x00", True),
        (5, 0, b"", b"\x00", None, True),
        (5, 0, b"", b"\x00", b"\x01", False),
        (5, 0, CLOCK, None, b"\x00", False),
        (0, 0, b"", None, b"\x00", False),
        (5, 1, b"", None, b"\x00", False),
    ],
)
def test_last_alone(unit: int, last: int, joined: bytes, ours: Value | None, theirs: Value | None, holds: bool) -> None:
    shown = Record(PDU, 1, b"", {})
    shown.joined = joined
    place = FieldPlace(IN_BODY, 26, "s7comm.data.ts_reserved")
    assert body_grounds.last_alone(case(place, ours, theirs, clock(unit, last), shown)) == holds
    assert not body_grounds.last_alone(case(TYPE, ours, theirs, clock(unit, last), shown))
    assert not body_grounds.last_alone(case(place, ours, theirs, clock(unit, last), None))


@pytest.mark.parametrize(
    ("function", "shown", "theirs", "holds"),
    [
        (b"\x28", {"servicename": b"_XYZW"}, None, True),
        (b"\x28", {"servicename": b"_MODU"}, None, False),
        (b"\x28", {"servicename": b"_XYZW"}, b"EP", False),
        (b"\x28", {"servicename": b"_XYZW", "argument": b"E"}, None, False),
        (b"\x28", {}, None, False),
        (b"\x29", {"servicename": b"_XYZW"}, None, False),
    ],
)
def test_argument_unknown(function: bytes, shown: dict[str, bytes], theirs: Value | None, holds: bool) -> None:
    place = FieldPlace(IN_BODY, 20, body_grounds.ARGUMENT)
    facts = {
        FieldPlace(IN_BODY, 40, f"s7comm.param.pistart.{name}"): LocatedValue(value, 40)
        for name, value in shown.items()
    }
    ours = Record(PDU, 1, pdu(1, 7, function + bytes(7)), {})
    there = case(place, b"EP", theirs, ours, Record(PDU, 1, b"", facts))
    assert body_grounds.argument_unknown(there) == holds
    assert not body_grounds.argument_unknown(case(place, b"EP", theirs, ours, None))


ODD: Final = pdu(1, 7, b"\x04\x02\x12\x03\x55ab\x00\x12\x0a\x10\x02\x00\x01\x00\x01\x84\x00\x00\x00")


@pytest.mark.parametrize(
    ("at", "theirs", "holds"), [(17, None, True), (29, None, True), (17, b"\x00", False), (16, None, False)]
)
def test_fill_of_an_item(at: int, theirs: Value | None, holds: bool) -> None:
    there = case(FieldPlace(IN_BODY, at, "s7comm.data.fillbyte"), b"\x00", theirs, pdu_record(1, ODD))
    assert body_grounds.fill_of_an_item(there) == holds


UNKNOWN: Final = pdu(7, 1, b"\x00\x01\x12\x04\x11\x45\x60\x00", b"\xff\x09\x00\x04some")


@pytest.mark.parametrize(
    ("octets", "at", "shown", "holds"),
    [
        (UNKNOWN, 22, b"some", True),
        (UNKNOWN, 22, b"som", False),
        (UNKNOWN, 23, b"ome", False),
        (UNKNOWN.replace(b"\x45\x60", b"\x44\x01"), 22, b"some", False),
    ],
)
def test_payload_as_octets(octets: bytes, at: int, shown: bytes, holds: bool) -> None:
    place = FieldPlace(IN_BODY, at, "s7comm.data.userdata")
    assert body_grounds.payload_as_octets(case(place, None, shown, pdu_record(1, octets))) == holds
    assert not body_grounds.payload_as_octets(case(place, shown, None, pdu_record(1, octets)))


def name_of(*pieces: tuple[int, bytes]) -> Record:
    facts = {FieldPlace(IN_BODY, at, f"s7comm.piece.{at}"): LocatedValue(value, at) for at, value in pieces}
    return Record(PDU, 1, b"", facts)


@pytest.mark.parametrize(
    ("pieces", "ours", "holds"),
    [
        (((19, b"_"), (20, b"0A"), (22, b"00001")), None, True),
        (((19, b"_"), (22, b"00001")), None, False),
        (((19, b"_"), (20, b"0A"), (22, b"000011")), None, False),
        (((19, b"_"), (20, b"0A")), None, False),
        (((19, b"_"), (20, b"0A"), (22, b"00001")), b"_", False),
    ],
)
def test_whole_of_fields(pieces: tuple[tuple[int, bytes], ...], ours: Value | None, holds: bool) -> None:
    place = FieldPlace(IN_BODY, 19, "s7comm.param.blockcontrol.filename")
    assert body_grounds.whole_of_fields(case(place, ours, b"_0A00001", name_of(*pieces))) == holds


@pytest.mark.parametrize(
    ("code", "at", "block", "holds"),
    [
        (b"code", 22, b"pp\x01\x01code", True),
        (b"code", 23, b"pp\x01\x01code", False),
        (b"cod!", 22, b"pp\x01\x01code", False),
        (b"code", 22, b"px\x01\x01code", False),
        (b"pp\x01\x01code", 18, b"pp\x01\x01code", False),  # then there is no difference
    ],
)
def test_block_header(code: bytes, at: int, block: bytes, holds: bool) -> None:
    mine, other = FieldPlace(IN_BODY, at, "s7comm.resp.data"), FieldPlace(IN_BODY, 18, "s7comm.resp.data")
    ours, theirs = (
        Record(PDU, 1, b"", {mine: LocatedValue(code, at)}),
        Record(PDU, 1, b"", {other: LocatedValue(block, 18)}),
    )
    assert body_grounds.block_header(case(mine, code, None, ours, theirs)) == holds
    assert body_grounds.block_header(case(other, None, block, ours, theirs)) == holds
    theirs.facts[other._replace(number=90)] = LocatedValue(b"", 90)
    assert not body_grounds.block_header(case(mine, code, None, ours, theirs)), "not the only content"
    assert not body_grounds.block_header(case(mine, code, None, ours, None))


@pytest.mark.parametrize(
    ("shown", "at", "holds"),
    [
        (CLOCK, 26, True),
        (CLOCK[2:], 28, False),  # then there is no difference
        (CLOCK[:-1] + b"\x00", 26, False),
        (CLOCK, 27, False),
        (CLOCK[1:], 26, False),
    ],
)
def test_longer_time(shown: bytes, at: int, holds: bool) -> None:
    place = FieldPlace(IN_BODY, 28, "s7comm.data.ts")
    ours = clock()
    assert ours.facts[place].value == CLOCK[2:]
    theirs_place = place._replace(number=at)
    theirs = Record(PDU, 1, ours.octets, {theirs_place: LocatedValue(shown, at)})
    mine = case(place, CLOCK[2:], None, ours, theirs)
    other = case(theirs_place, None, shown, ours, theirs)
    assert (body_grounds.longer_time(mine), body_grounds.longer_time(other)) == (holds, holds)
    assert not body_grounds.longer_time(case(place, CLOCK[2:], None, ours, None))


@pytest.mark.parametrize(("shown", "at", "holds"), [(b"\0\1", 26, True), (b"\0\2", 26, False), (b"\1", 26, False)])
def test_longer_count(shown: bytes, at: int, holds: bool) -> None:
    head = b"\x00\x01\x12\x08\x12\x82\x01\x04\x00\x00\x00\x00"
    ours = pdu_record(1, pdu(7, 1, head, b"\xff\x09\x00\x08\x00\x01\xff\x04\x00\x10\x00\xaa"))
    place = FieldPlace(IN_BODY, 27, "s7comm.param.itemcount")
    assert ours.facts[place].value == b"\1"
    theirs = Record(PDU, 1, ours.octets, {place._replace(number=at): LocatedValue(shown, at)})
    mine = case(place, b"\1", None, ours, theirs)
    other = case(place._replace(number=at), None, shown, ours, theirs)
    assert (body_grounds.longer_count(mine), body_grounds.longer_count(other)) == (holds, holds)


@pytest.mark.parametrize(
    ("shown", "at", "name", "holds"),
    [
        (bytes(4), 34, RECORD, True),
        (bytes(2), 36, RECORD, True),
        (bytes(4), 38, RECORD, False),
        (bytes(4), 34, "s7comm.data.userdata", False),
    ],
)
def test_records_as_octets(shown: bytes, at: int, name: str, holds: bool) -> None:
    mine = FieldPlace(IN_BODY, 36, "s7comm.szl.0132.0004.key")
    other = FieldPlace(IN_BODY, at, name)
    ours = Record(PDU, 1, b"", {mine: LocatedValue(bytes(2), 36)})
    theirs = Record(PDU, 1, b"", {other: LocatedValue(shown, at)})
    assert body_grounds.records_as_octets(case(mine, bytes(2), None, ours, theirs)) == holds
    assert body_grounds.records_as_octets(case(other, None, shown, ours, theirs)) == holds
    assert not body_grounds.records_as_octets(case(mine, bytes(2), b"ab", ours, theirs)), "both have the field"
    assert not body_grounds.records_as_octets(case(mine, bytes(2), None, ours, None))


def test_octets_in_the_place_of_something_else_are_no_record() -> None:
    mine = FieldPlace(IN_BODY, 36, "s7comm.data.userdata.szl_id")
    other = FieldPlace(IN_BODY, 34, RECORD)
    ours = Record(PDU, 1, b"", {mine: LocatedValue(bytes(2), 36)})
    theirs = Record(PDU, 1, b"", {other: LocatedValue(bytes(4), 34)})
    assert not body_grounds.records_as_octets(case(other, None, bytes(4), ours, theirs))
