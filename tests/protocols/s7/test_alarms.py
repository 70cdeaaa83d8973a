from __future__ import annotations

import pytest
from hypothesis import given
from hypothesis import strategies as st

from dissect.protocols.s7 import alarm_layouts as layouts
from dissect.protocols.s7 import alarms
from dissect.protocols.s7.tables import ALARM_QUERY, AR_SEND, MESSAGE_SERVICE
from tests.cases import each
from tests.protocols.s7.userdata_pdus import (
    PUSH,
    REQUEST,
    RESPONSE,
    body,
    has_surplus,
    names,
    payload_parts,
    stands_cuts,
    trailing,
    userdata,
)

TIME = "2311142215306213"
NO_TIME = "0000000000000000"
TOLD = "DT#2023-11-14-22:15:30.621"
USER = "5553455231000000"
VALUE = "ff040010002a"
MESSAGE = "120a16 01 000000c2 01 00 00 00"
NOTIFICATION = "120e1c 00 000000c3 05 00 ff fe 02 04 06 00"
ACK = "120819 00 60000001 01 01"
LOCK = "120615 00 60000001"
DATA_SET = "29 0000 04 60000001 00 01 ff fe"

#: (kind, subfunction, payload, parts, notes)
EXAMPLES = [
    (REQUEST, 2, "0100" + USER, ["message service"], ["events: mode transitions"]),
    (REQUEST, 2, "0300" + USER, ["message service"], ["events: mode transitions, system diagnostics"]),
    (
        REQUEST, 2, "8100" + USER + "0900", ["message service", "alarm subscription", "reserved"],
        ["events: mode transitions, alarms", "ALARM_S initiate"],
    ),
    (
        REQUEST, 2, "8000" + USER + "0702 12061300 00000001 12061300 00000002",
        ["message service", "alarm subscription", "archives", "archive", "archive"],
        ["events: alarms", "AR_SEND initiate", "AR_ID 0x00000001", "AR_ID 0x00000002"],
    ),
    (REQUEST, 2, "0000" + USER, ["message service"], ["events: none"]),
    (RESPONSE, 2, "0200", ["message service"], []),
    (RESPONSE, 2, "0200090100", ["message service", "alarm subscription", "reserved"], ["ALARM_S initiate"]),
    (
        RESPONSE, 2, "020007 03 ff ff 0a 00",
        ["message service", "alarm subscription", "archives", "return code", "return code", "return code", "fill"],
        ["AR_SEND initiate", "1 of 3 refused, object 3: Object does not exist"],
    ),
    (
        PUSH, 0x05, TIME + "4001" + MESSAGE + VALUE, ["alarm", "message", "data item", "content"],
        [TOLD, "event 0x000000c2: signal 1 on, with 00 2a"],
    ),
    (
        PUSH, 0x12, TIME + "4001" + MESSAGE + VALUE, ["alarm", "message", "data item", "content"],
        [TOLD, "event 0x000000c2: coming signal 1, with 00 2a"],
    ),
    (
        PUSH, 0x11, TIME + "4001 120a16 00 000000c2 00 00 00 00", ["alarm", "message"],
        [TOLD, "event 0x000000c2: going signal 1"],
    ),
    (
        PUSH, 0x16, TIME + "4001" + NOTIFICATION, ["alarm", "notification"],
        [TOLD, "event 0x000000c3: coming signal 3, going signal 2"],
    ),
    (
        PUSH, 0x06, TIME + "4002" + NOTIFICATION + MESSAGE + VALUE,
        ["alarm", "notification", "message", "data item", "content"],
        [TOLD, "event 0x000000c3: coming signal 3, going signal 2", "event 0x000000c2: signal 1 on, with 00 2a"],
    ),
    (
        PUSH, 0x09, "0001" + TIME + "0002 4001" + MESSAGE + VALUE, ["alarm", "message", "data item", "content"],
        [TOLD, "event 0x000000c2: signal 1 on, with 00 2a"],
    ),
    (
        REQUEST, 0x0B, "0901" + ACK, ["message objects", "acknowledgement"],
        ["event 0x60000001: coming signal 1, going signal 1"],
    ),
    (
        RESPONSE, 0x0B, "0902ff0a", ["message objects", "return code", "return code"],
        ["1 of 2 refused, object 2: Object does not exist"],
    ),
    (
        PUSH, 0x0C, TIME + "0901" + ACK, ["alarm", "acknowledgement"],
        [TOLD, "event 0x60000001: coming signal 1, going signal 1"],
    ),
    (REQUEST, 0x07, "0901" + LOCK, ["message objects", "alarm to lock or unlock"], ["event 0x60000001"]),
    (RESPONSE, 0x08, "0901ff", ["message objects", "return code"], []),
    (RESPONSE, 0x08, "0901ee", ["message objects", "return code"], ["refused: 0xee"]),
    (
        PUSH, 0x12, TIME + "4001 120a16 03 000000c2 01 00 00 00 ff09000654414e4b2031 0a000000 ff090009010203040506070809",
        ["alarm", "message", "data item", "content", "data item", "data item", "content"],
        [
            TOLD,
            "event 0x000000c2: coming signal 1, with 'TANK 1', Object does not exist, 01 02 03 04 05 06 07 08 …",
        ],
    ),
    (PUSH, 0x0D, "0901" + LOCK, ["message objects", "alarm to lock or unlock"], ["event 0x60000001"]),
    (PUSH, 0x0E, "0901" + LOCK, ["message objects", "alarm to lock or unlock"], ["event 0x60000001"]),
    (REQUEST, 0x13, "0001 12081a00 01 34 00000004", ["message objects", "alarm query"], ["ALARM_S"]),
    (REQUEST, 0x13, "0001 12081a00 03 34 60000001", ["message objects", "alarm query"], ["event 0x60000001"]),
    (REQUEST, 0x13, "0001 12081a00 08 34 00000000", ["message objects", "alarm query"], []),
    (RESPONSE, 0x13, "00010a000000", ["alarms"], ["Object does not exist"]),
    (
        RESPONSE, 0x13, "0001ff09000c 09 0000 02 00000007 00 81 ff ff", ["alarms", "pending alarm"],
        ["1 alarm", "ALARM_8 event 0x00000007: signals 1, 8 on"],
    ),
    (
        RESPONSE, 0x13, "0001ff090028" + DATA_SET + TIME + VALUE + NO_TIME + VALUE,
        ["alarms", "pending alarm", "came", "data item", "content", "went", "data item", "content"],
        ["1 alarm", "ALARM_S event 0x60000001: coming signal 1", TOLD, "no time"],
    ),
]  # fmt: skip


@each(("kind", "subfunction", "payload", "parts", "notes"), EXAMPLES)
def test_examples(kind: int, subfunction: int, payload: str, parts: list[str], notes: list[str]) -> None:
    octets = userdata(kind, 4, subfunction, payload)
    found = body(octets)
    assert found.malformed == []
    assert names(found) == parts
    assert found.notes == notes
    stands_cuts(octets)
    more = trailing(octets)
    # An answer of two octets may go on with an alarm type, which is then cut short.
    assert has_surplus(more) or [fault.reason for fault in more.malformed] == ["too_short"]


def test_alarms_until_a_length_of_zero() -> None:
    one = DATA_SET + TIME + VALUE + NO_TIME + VALUE
    found = body(userdata(RESPONSE, 4, 0x13, "0001ff09ffff" + one + one + "00"))
    assert found.malformed == []
    assert names(found)[-1] == "end of alarms"
    assert found.notes[0] == "2 alarms"


def test_alarms_in_several_parts() -> None:
    one = bytes.fromhex(DATA_SET + TIME + VALUE + NO_TIME + VALUE).hex()
    first = body(userdata(RESPONSE, 4, 0x13, "0001ff09ffff" + one + one[:50], 1, 7, 1))
    assert first.malformed == []
    assert first.notes[0] == "1 alarm"
    assert first.notes[-1] == "continues in the next part"
    middle = body(userdata(RESPONSE, 4, 0x13, one[50:] + one, 1, 7, 1))
    assert middle.malformed == []
    assert middle.notes == ["continuation"]
    last = body(userdata(RESPONSE, 4, 0x13, one, 1, 7, 0))
    assert last.notes == ["continuation"]


def test_a_complete_length_that_is_too_large_is_told() -> None:
    found = body(userdata(RESPONSE, 4, 0x13, "0001ff090020 09 0000 02 00000007 00 81 ff ff"))
    assert [fault.reason for fault in found.malformed] == ["length_beyond"]
    short = body(userdata(RESPONSE, 4, 0x13, "0001ff09000c 09 0000 02 00000007 00"))
    assert {fault.reason for fault in short.malformed} == {"length_beyond", "too_short"}


def test_the_user_and_the_events_asked_for() -> None:
    found = body(userdata(REQUEST, 4, 2, "fb00" + USER + "0500"))
    part = found.find(layouts.MESSAGE_REQUEST)
    assert part is not None
    assert part.text("user") == "USER1"
    assert alarms.events_text(part) == "mode transitions, system diagnostics, alarms, unknown 0x78"


def test_an_alarm_tells_its_fields() -> None:
    found = body(userdata(PUSH, 4, 0x16, TIME + "4001" + NOTIFICATION))
    part = payload_parts(found)[1]
    assert [part.number(name) for name in ("event_id", "event_state", "ack_going", "ack_coming", "last_changed")] == [
        0xC3,
        5,
        0xFF,
        0xFE,
        6,
    ]


def test_an_object_of_an_unknown_syntax_is_passed_over() -> None:
    found = body(userdata(PUSH, 4, 5, TIME + "4002 120477 010203" + MESSAGE + VALUE))
    assert names(found) == ["alarm", "item", "octets", "message", "data item", "content"]
    assert found.malformed == []


def test_an_object_goes_by_its_syntax_and_a_wrong_length_is_told() -> None:
    found = body(userdata(PUSH, 4, 5, TIME + "4001 120816 00 000000c2 01 00 00 00"))
    assert [(fault.reason, fault.field) for fault in found.malformed] == [("length_below", "item.length")]
    assert found.notes[-1] == "event 0x000000c2: signal 1 on"
    longer = body(userdata(PUSH, 4, 5, TIME + "4001 120c16 00 000000c2 01 00 00 00"))
    assert [fault.reason for fault in longer.malformed] == ["length_beyond"]


def test_objects_that_are_missing_are_told() -> None:
    assert [fault.reason for fault in body(userdata(PUSH, 4, 0x0D, "0902" + LOCK)).malformed] == ["too_short"]
    assert [fault.reason for fault in body(userdata(RESPONSE, 4, 0x0B, "0903ff")).malformed] == ["count_mismatch"]


def test_archive_data_in_one_part_and_in_several() -> None:
    archive = "12061300 00000005"
    whole = body(userdata(PUSH, 4, 0x10, archive + "0300 616263"))
    assert whole.malformed == []
    assert names(whole) == ["archive", "archive length", "archive data"]
    assert whole.notes == ["AR_ID 0x00000005", "3 bytes"]
    first = body(userdata(PUSH, 4, 0x10, archive + "0a00 616263", 0, 3, 1))
    assert first.malformed == []
    assert first.notes == ["AR_ID 0x00000005", "10 bytes"]
    middle = body(userdata(PUSH, 4, 0x10, archive + "0000 616263", 0, 3, 1))
    assert middle.notes == ["AR_ID 0x00000005", "continuation"]
    last = body(userdata(PUSH, 4, 0x10, archive + "6465", 0, 3, 0))
    assert last.notes == ["AR_ID 0x00000005", "continuation"]
    short = body(userdata(PUSH, 4, 0x10, archive + "0900 616263"))
    assert [fault.reason for fault in short.malformed] == ["length_beyond"]


@pytest.mark.parametrize(("mask", "text"), [(0, "no signal"), (1, "signal 1"), (0x82, "signals 2, 8")])
def test_signals(mask: int, text: str) -> None:
    assert alarms.signals_text(mask) == text


_SUBFUNCTIONS = [MESSAGE_SERVICE, *alarms.ALARMS, AR_SEND, ALARM_QUERY]


@given(st.integers(0, 3), st.sampled_from(_SUBFUNCTIONS), st.binary(max_size=80), st.integers(0, 1), st.integers(0, 1))
def test_never_raises(kind: int, subfunction: int, octets: bytes, unit: int, last: int) -> None:
    body(userdata(kind, 4, subfunction, octets.hex(), 1, unit, last))


@given(st.sampled_from(_SUBFUNCTIONS), st.integers(0, 4), st.binary(max_size=60))
def test_never_raises_on_objects(subfunction: int, count: int, octets: bytes) -> None:
    body(userdata(PUSH, 4, subfunction, f"{TIME}40{count:02x}{octets.hex()}"))
