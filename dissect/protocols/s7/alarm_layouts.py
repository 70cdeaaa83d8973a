"""The parts of messages and alarms (userdata group 4) as layouts (reference section 4.9)."""

from __future__ import annotations

from typing import Final

from dissect.protocols.s7.layouts import DATA_ITEM, ITEM_HEAD
from dissect.protocols.s7.tables import ALARM_QUERIES, ALARM_SUBSCRIPTIONS, ALARM_TYPES
from dissect.protocols.s7.values import date_and_time
from dissect.wire.layout import (
    COUNTS_REST,
    HOLDS_BLOCK_TEXT,
    HOLDS_NUMBER,
    HOLDS_TIME,
    HOLDS_VALUE,
    REST,
    Field,
    Layout,
    latin,
)

_SOURCE: Final = "reference section 4.9"

_MASK: Final = "s7comm.cpu.msg.events"
MESSAGE_REQUEST: Final = Layout(
    "message service",
    _SOURCE,
    [
        Field("alarms", 1, "Alarms; which ones follows.", f"{_MASK}.alarms", bits=(0x80, 7)),
        Field("unknown", 1, "0.", bits=(0x78, 3), shares=True),
        Field("user_diagnostics", 1, "Entries of users.", f"{_MASK}.userdefined", bits=(0x04, 2), shares=True),
        Field("system_diagnostics", 1, "System diagnostics.", f"{_MASK}.system", bits=(0x02, 1), shares=True),
        Field("mode_transitions", 1, "Mode transitions.", f"{_MASK}.modetrans", bits=(0x01, 0), shares=True),
        Field("reserved", 1, "0.", "s7comm.cpu.msg.req_reserved1"),
        Field("user", 8, "Name of the requester.", "s7comm.cpu.msg.username", means=latin, holds=HOLDS_BLOCK_TEXT),
    ],
)
MESSAGE_ANSWER: Final = Layout(
    "message service",
    _SOURCE,
    [
        Field("result", 1, "2 in captures.", "s7comm.cpu.msg.res_result"),
        Field("reserved", 1, "0.", "s7comm.cpu.msg.res_reserved1"),
    ],
)
#: The subscribed alarms; follows the mask in a request whose alarm bit is set, and in its answer.
ALARM_SUBSCRIPTION: Final = Layout(
    "alarm subscription",
    _SOURCE,
    [Field("alarm_type", 1, "Which alarms, begun or ended.", "s7comm.cpu.msg.almtype", ALARM_SUBSCRIPTIONS)],
)
MESSAGE_RESERVED: Final = Layout("reserved", _SOURCE, [Field("reserved", 1, "0.", "s7comm.cpu.msg.req_reserved2")])
MESSAGE_RESERVED_ANSWER: Final = Layout(
    "reserved",
    _SOURCE,
    [
        Field("reserved_2", 1, "1 in captures.", "s7comm.cpu.msg.res_reserved2"),
        Field("reserved_3", 1, "0 in captures.", "s7comm.cpu.msg.res_reserved3"),
    ],
)


def little(octets: bytes) -> str | None:
    """Return a little-endian number as text."""
    return str(int.from_bytes(octets, "little"))


ARCHIVE_ITEM: Final = Layout(
    "archive",
    _SOURCE,
    [
        *ITEM_HEAD.fields,
        Field("unknown", 1, "Unknown."),
        Field("ar_id", 4, "AR_ID of the block AR_SEND."),
    ],
)
ARCHIVE_COUNT: Final = Layout(
    "archives", _SOURCE, [Field("item_count", 1, "Archives that follow.", "s7comm.param.itemcount")]
)
#: Octets of an archive, in its first part. It is little-endian, unlike all other fields.
ARCHIVE_LENGTH: Final = Layout(
    "archive length",
    _SOURCE,
    [Field("archive_length", 2, "Bytes of all parts, low byte first.", means=little, holds=HOLDS_NUMBER)],
)
ARCHIVE_DATA: Final = Layout(
    "archive data",
    _SOURCE,
    [Field("archive_data", REST, "As the program sent them.", "s7comm.data.userdata", holds=HOLDS_VALUE)],
)

_TIME: Final = Field("time", 8, "DATE_AND_TIME in BCD.", "s7comm.data.ts", means=date_and_time, holds=HOLDS_TIME)
_OBJECTS: Final = [
    Field("function", 1, "Function identifier.", "s7comm.alarm.function"),
    Field("objects", 1, "Message objects that follow.", "s7comm.alarm.nr_objects", decimal=True),
]
ALARM_HEAD: Final = Layout("alarm", _SOURCE, [_TIME, *_OBJECTS])
SCAN_HEAD: Final = Layout(
    "alarm",
    _SOURCE,
    [
        Field("scan_1", 2, "Unknown.", "s7comm.alarm.scan.unknown1"),
        _TIME,
        Field("scan_2", 2, "Unknown.", "s7comm.alarm.scan.unknown2"),
        *_OBJECTS,
    ],
)
#: Head of messages without a time: locks, acknowledgements, queries.
OBJECTS_HEAD: Final = Layout("message objects", _SOURCE, [*_OBJECTS])

_ITEM_HEAD: Final = [
    ITEM_HEAD.fields[0],
    Field("length", 1, "Bytes up to the last fixed field.", "s7comm.param.item.varspec_length", counts=COUNTS_REST),
    ITEM_HEAD.fields[2],
]
_VALUES: Final = Field(
    "values", 1, "Associated values that follow.", "s7comm.alarm.nr_add_values", counts=DATA_ITEM.name
)
_EVENT: Final = Field("event_id", 4, "Number of the message.", "s7comm.alarm.event_id")
_STATE: Final = Field("event_state", 1, "Signals 1 to 8 that are on, one bit each.", "s7comm.alarm.eventstate")
_ACK: Final = [
    Field("ack_going", 1, "Signals whose going is acknowledged.", "s7comm.alarm.ack_state.going"),
    Field("ack_coming", 1, "Signals whose coming is acknowledged.", "s7comm.alarm.ack_state.coming"),
]
_INDICATION: Final = [*_ITEM_HEAD, _VALUES, _EVENT, _STATE, Field("state", 1, "Unknown.", "s7comm.alarm.state"), *_ACK]

#: Message objects by syntax id; an alarm query has three forms with the same syntax id, see below.
SYNTAXES: Final[dict[int, Layout]] = {
    0x15: Layout("alarm to lock or unlock", _SOURCE, [*_ITEM_HEAD, _VALUES, _EVENT]),
    0x16: Layout("message", _SOURCE, [*_INDICATION]),
    0x19: Layout("acknowledgement", _SOURCE, [*_ITEM_HEAD, _VALUES, _EVENT, *_ACK]),
    0x1C: Layout(
        "notification",
        _SOURCE,
        [
            *_INDICATION,
            Field("event_going", 1, "Signals that went.", "s7comm.alarm.event.going"),
            Field("event_coming", 1, "Signals that came.", "s7comm.alarm.event.coming"),
            Field("last_changed", 1, "Signals that changed last.", "s7comm.alarm.event.lastchanged"),
            Field("reserved", 1, "Unknown.", "s7comm.alarm.event.reserved"),
        ],
    ),
}

_BY_TYPE: Final = 1
_BY_EVENT: Final = 3
_QUERY: Final = [
    *_ITEM_HEAD,
    Field("unknown_1", 1, "Unknown.", "s7comm.alarm.query.unknown1"),
    Field("query_type", 1, "What the last field is.", "s7comm.alarm.query.querytype", ALARM_QUERIES),
    Field("unknown_2", 1, "Unknown.", "s7comm.alarm.query.unknown2"),
]
QUERY_BY_TYPE: Final = Layout(
    "alarm query",
    _SOURCE,
    [*_QUERY, Field("alarm_type", 4, "Which alarms.", "s7comm.alarm.query.alarmtype", ALARM_TYPES)],
)
QUERY_BY_EVENT: Final = Layout("alarm query", _SOURCE, [*_QUERY, _EVENT])
QUERY_OTHER: Final = Layout("alarm query", _SOURCE, [*_QUERY, Field("value", 4, "Unknown.")])
#: Layouts of an item of an alarm query, by the kind of the query. In each of them it is the octet at `QUERY_TYPE_AT`.
QUERIES: Final = {_BY_TYPE: QUERY_BY_TYPE, _BY_EVENT: QUERY_BY_EVENT}
QUERY_TYPE_AT: Final = 4

ALARM_QUERY_ANSWER: Final = Layout(
    "alarms",
    _SOURCE,
    [
        *_OBJECTS,
        *DATA_ITEM.fields[:2],
        Field(
            "complete_length",
            2,
            "Bytes of all alarms; 0xffff: until a length of 0.",
            "s7comm.alarm.query.complete_length",
        ),
    ],
)
#: A pending alarm. For ALARM_S the two parts below follow, each followed by a data item.
ALARM_STATE: Final = Layout(
    "pending alarm",
    _SOURCE,
    [
        Field("length", 1, "Bytes from the alarm type on.", "s7comm.alarm.query.dataset_length"),
        Field("unknown_1", 2, "Unknown.", "s7comm.alarm.query.resunknown1"),
        Field("alarm_type", 1, "Kind of alarm.", "s7comm.alarm.query.alarmtype", ALARM_TYPES),
        _EVENT,
        Field("unknown_2", 1, "Unknown.", "s7comm.alarm.query.resunknown1"),
        _STATE,
        *_ACK,
    ],
)
ALARM_S_COMING: Final = Layout("came", _SOURCE, [_TIME])
ALARM_S_GOING: Final = Layout(
    "went",
    _SOURCE,
    [
        Field(
            "time",
            8,
            "DATE_AND_TIME in BCD; 0 while the alarm is on.",
            "s7comm.data.ts",
            means=date_and_time,
            holds=HOLDS_TIME,
        )
    ],
)
END_OF_ALARMS: Final = Layout("end of alarms", _SOURCE, [Field("length", 1, "0.")])
