"""Messages and alarms (userdata group 4, reference section 4.9): subscriptions, alarms, acknowledgements, alarm queries."""

from __future__ import annotations

from typing import Final

from dissect.protocols.s7.alarm_layouts import (
    ALARM_HEAD,
    ALARM_QUERY_ANSWER,
    ALARM_S_COMING,
    ALARM_S_GOING,
    ALARM_STATE,
    ALARM_SUBSCRIPTION,
    ARCHIVE_COUNT,
    ARCHIVE_DATA,
    ARCHIVE_ITEM,
    ARCHIVE_LENGTH,
    END_OF_ALARMS,
    MESSAGE_ANSWER,
    MESSAGE_REQUEST,
    MESSAGE_RESERVED,
    MESSAGE_RESERVED_ANSWER,
    OBJECTS_HEAD,
    QUERIES,
    QUERY_OTHER,
    QUERY_TYPE_AT,
    SCAN_HEAD,
    SYNTAXES,
)
from dissect.protocols.s7.data_parts import CONTENT, RETURN_CODE, take_data_items
from dissect.protocols.s7.layouts import DATA_ITEM, ITEM_HEAD
from dissect.protocols.s7.parameters import PUSH, REQUEST, RESPONSE, UserdataHead
from dissect.protocols.s7.tables import (
    ACKNOWLEDGE,
    ACKNOWLEDGED,
    ALARM_8,
    ALARM_8_LOCK,
    ALARM_8_UNLOCK,
    ALARM_QUERY_ITEM,
    ALARM_S,
    ALARM_SQ,
    ALARM_TYPES,
    LOCKED,
    NOTIFY,
    NOTIFY_8,
    OCTET_STRING,
    SCAN,
    SUCCESS,
    UNLOCKED,
)
from dissect.protocols.s7.values import spelled
from dissect.wire.malformed import Malformed
from dissect.wire.octets import u16
from dissect.wire.part import OCTETS, Cursor, Part
from dissect.wire.text import hex_number

#: Subfunctions that consist of message objects.
ALARMS: Final = (
    ALARM_8, NOTIFY, ALARM_8_LOCK, ALARM_8_UNLOCK, SCAN, ACKNOWLEDGE, ACKNOWLEDGED, LOCKED, UNLOCKED, ALARM_SQ, ALARM_S,
    NOTIFY_8,
)  # fmt: skip
#: Pushes that begin with the time of the event.
_TIMED: Final = frozenset((ALARM_8, NOTIFY, ACKNOWLEDGED, ALARM_SQ, ALARM_S, NOTIFY_8))
#: Alarms with a single signal, which is coming or going.
_SINGLE: Final = frozenset((ALARM_SQ, ALARM_S))
#: Maximum number of octets of an associated value in a line.
_SHOWN_OCTETS: Final = 8
#: Alarm subscriptions about archives.
_ARCHIVES: Final = frozenset((6, 7))
_TYPE_ALARM_S: Final = 4
#: The complete length for "until a data set of length 0".
_OPEN_LENGTH: Final = 0xFFFF

#: The result of `events_text` for an empty mask, which ends a subscription.
NO_EVENTS: Final = "none"
_EVENTS: Final = (
    ("mode_transitions", "mode transitions"),
    ("system_diagnostics", "system diagnostics"),
    ("user_diagnostics", "user diagnostics"),
    ("alarms", "alarms"),
)


def parse_message_service(cursor: Cursor, head: UserdataHead) -> None:
    """Parse a subscription to events, or its answer."""
    if head.type == REQUEST:
        part = cursor.take(MESSAGE_REQUEST)
        if part is None:
            return
        part.note = f"events: {events_text(part)}"
        if part.number("alarms") and cursor.left > 0:
            _subscription(cursor, True)
    elif head.type == RESPONSE:
        cursor.take(MESSAGE_ANSWER)
        if cursor.left > 0:
            _subscription(cursor, False)
    else:
        cursor.rest()  # a push of it is not known


def events_text(part: Part) -> str:
    """Return the events named by the mask of a message service, as text."""
    named = [text for name, text in _EVENTS if part.number(name) > 0]
    if part.number("unknown") > 0:
        named.append(f"unknown 0x{part.number('unknown') << 3:02x}")
    return ", ".join(named) or NO_EVENTS


def _subscription(cursor: Cursor, request: bool) -> None:
    part = cursor.take(ALARM_SUBSCRIPTION)
    if part is None:
        return
    part.note = part.text("alarm_type")
    if part.number("alarm_type") not in _ARCHIVES:
        cursor.take(MESSAGE_RESERVED if request else MESSAGE_RESERVED_ANSWER)
        return
    count = cursor.take(ARCHIVE_COUNT)
    if count is None:
        return
    if request:
        for _ in range(count.number("item_count")):
            item = cursor.take(ARCHIVE_ITEM)
            if item is None:
                return
            item.note = _archive(item)
    else:
        count.note = _codes(cursor, count.number("item_count"))
        cursor.take_fill(count.number("item_count"))


def _archive(part: Part) -> str:
    return f"AR_ID 0x{part.number('ar_id'):08x}"


def _codes(cursor: Cursor, count: int) -> str:
    """Parse one return code for each object; return the codes other than success as text."""
    taken = min(count, cursor.left)
    refused: list[str] = []
    for number in range(taken):
        code = cursor.take(RETURN_CODE)
        if code is not None and code.number("return_code") != SUCCESS:
            refused.append(f"{number + 1}: {_code_text(code)}")
    if taken < count:
        cursor.tell("count_mismatch", "objects", count, taken)
    if not refused:
        return ""
    return (
        f"{len(refused)} of {count} refused, object {', '.join(refused)}" if count > 1 else f"refused: {refused[0][3:]}"
    )


def _code_text(part: Part) -> str:
    """Return the name of a part's return code, or its number."""
    return part.text("return_code") or hex_number(part.number("return_code"), 2)


def parse_alarm(cursor: Cursor, head: UserdataHead) -> None:
    """Parse alarms, notifications, acknowledgements, locks and the request of an alarm query."""
    if head.continues:
        cursor.rest("continuation")
        return
    if head.subfunction == SCAN and head.type == PUSH:
        part = cursor.take(SCAN_HEAD)
    elif head.subfunction in _TIMED:
        part = cursor.take(ALARM_HEAD)
    else:
        part = cursor.take(OBJECTS_HEAD)
    if part is None:
        return
    part.note = part.text("time")
    count = part.number("objects")
    if head.type == RESPONSE:
        part.note = _codes(cursor, count)
        return
    for _ in range(count):
        if not _object(cursor, head.subfunction):
            return


def _object(cursor: Cursor, subfunction: int) -> bool:
    """Parse one message object with its associated values; return False if it does not fit."""
    if cursor.left < ITEM_HEAD.size:
        return cursor.take(ITEM_HEAD) is not None
    size = cursor.octets[cursor.at + 1]
    syntax = cursor.octets[cursor.at + 2]
    layout = SYNTAXES.get(syntax)
    if syntax == ALARM_QUERY_ITEM and cursor.left > QUERY_TYPE_AT:
        kind = cursor.octets[cursor.at + QUERY_TYPE_AT]
        layout = QUERIES.get(kind, QUERY_OTHER)
    if layout is None:
        cursor.take(ITEM_HEAD)
        if size > 1:
            cursor.take(OCTETS, size - 1)
        return cursor.left > 0
    if layout.size != size + 2:
        # Reported, but ignored: Wireshark uses the length of the syntax, and the meaning of another length is unknown.
        reason = "length_below" if size + 2 < layout.size else "length_beyond"
        at = cursor.at + 1
        cursor.malformed.append(Malformed("s7", reason, "item.length", at, layout.size - 2, size, cursor.limit))
    part = cursor.take(layout)
    if part is None:
        return False
    part.note = _object_note(part, subfunction)
    if part.find("event_state") is not None:
        first = len(cursor.parts)
        take_data_items(cursor, part.number("values"), True)
        part.note += _values(cursor.parts[first:])
    return True


def _values(parts: list[Part]) -> str:
    """Return the associated values of a message as text: octets, with the text that they contain, if any."""
    said = []
    for part in parts:
        if part.layout is CONTENT:
            octets = part.octets("data")
            text = spelled(octets)
            more = " …" if len(octets) > _SHOWN_OCTETS else ""
            said.append(f"'{text}'" if text else octets[:_SHOWN_OCTETS].hex(" ") + more)
        elif part.layout is DATA_ITEM and part.number("return_code") != SUCCESS:
            said.append(_code_text(part))
    return f", with {', '.join(said)}" if said else ""


def _object_note(part: Part, subfunction: int) -> str:
    if part.find("query_type") is not None:
        if part.find("event_id") is not None:
            return f"event 0x{part.number('event_id'):08x}"
        return part.text("alarm_type")
    event = f"event 0x{part.number('event_id'):08x}"
    if part.find("event_coming") is not None:
        return _with_changes(part, event, ("event_coming", "event_going"))
    if part.find("event_state") is not None:
        state = part.number("event_state")
        if subfunction in _SINGLE:
            return f"{event}: {'coming' if state & 1 else 'going'} signal 1"
        return f"{event}: {signals_text(state)} on" if state else f"{event}: no signal on"
    return _with_changes(part, event, ("ack_coming", "ack_going"))


def _with_changes(part: Part, event: str, masks: tuple[str, str]) -> str:
    """Return the text of an event with the signals that come and go."""
    changes = [
        f"{word} {signals_text(part.number(name))}"
        for word, name in zip(("coming", "going"), masks, strict=True)
        if part.number(name) > 0
    ]
    return f"{event}: {', '.join(changes)}" if changes else event


def signals_text(mask: int) -> str:
    """Return the signals of a mask with one bit for each of 1 to 8, for example ``signal 1`` or ``signals 2, 8``."""
    signals = [str(bit + 1) for bit in range(8) if mask >> bit & 1]
    return f"signal{'s' if len(signals) > 1 else ''} {', '.join(signals)}" if signals else "no signal"


def parse_alarm_query(cursor: Cursor, head: UserdataHead) -> None:
    """Parse an alarm query, or the first part of its answer, which has a data set for each pending alarm."""
    if head.type != RESPONSE:
        parse_alarm(cursor, head)
        return
    if head.continues or (head.more and not _begins(cursor)):
        cursor.rest("continuation")
        return
    answer = cursor.take(ALARM_QUERY_ANSWER)
    if answer is None:
        return
    if answer.number("return_code") != SUCCESS:
        answer.note = answer.text("return_code")
        return
    complete = answer.number("complete_length")
    end = cursor.end if complete == _OPEN_LENGTH else min(cursor.at + complete, cursor.end)
    if complete != _OPEN_LENGTH and complete > cursor.left and not head.more:
        cursor.tell("length_beyond", "complete length", complete, cursor.left)
    alarms = 0
    while cursor.at < end:
        if complete == _OPEN_LENGTH and cursor.octets[cursor.at] == 0:
            cursor.take(END_OF_ALARMS)
            cursor.rest()  # no capture proves that nothing follows, but nothing is known to follow
            break
        data_set = Cursor(cursor.octets, cursor.at, end, "item", [] if head.more else cursor.malformed)
        told = len(data_set.malformed)
        _alarm_state(data_set)
        if head.more and len(data_set.malformed) > told:
            cursor.rest("continues in the next part")
            break
        cursor.parts.extend(data_set.parts)
        cursor.at = data_set.at
        alarms += 1
    answer.note = f"{alarms} alarm{'s' if alarms != 1 else ''}"


def _begins(cursor: Cursor) -> bool:
    """Return whether this can be the first part of an answer to an alarm query that continues in another PDU."""
    at = cursor.at
    if cursor.left < ALARM_QUERY_ANSWER.size or cursor.octets[at + 2] != SUCCESS:
        return False
    complete = u16(cursor.octets, at + 4)
    return cursor.octets[at + 3] == OCTET_STRING and complete >= cursor.left - ALARM_QUERY_ANSWER.size


def _alarm_state(cursor: Cursor) -> None:
    """Parse one data set; for ALARM_S it has the times when the alarm came and went, each with a value."""
    part = cursor.take(ALARM_STATE)
    if part is None:
        return
    kind = part.number("alarm_type")
    state = part.number("event_state")
    if kind != _TYPE_ALARM_S:
        part.note = f"{ALARM_TYPES.name(kind)} event 0x{part.number('event_id'):08x}: {signals_text(state)} on"
        return
    part.note = f"ALARM_S event 0x{part.number('event_id'):08x}: {'coming' if state & 1 else 'going'} signal 1"
    for layout in (ALARM_S_COMING, ALARM_S_GOING):
        time = cursor.take(layout)
        if time is None:
            return
        time.note = time.text("time") or "no time"
        take_data_items(cursor, 1, True)


def parse_archive(cursor: Cursor, head: UserdataHead) -> None:
    """Parse archive data sent by AR_SEND; every part of a long archive has its id, the first part also has its length."""
    item = cursor.take(ARCHIVE_ITEM)
    if item is None:
        return
    item.note = _archive(item)
    if head.continues:
        cursor.rest("continuation")
        return
    if head.more and (cursor.left < ARCHIVE_LENGTH.size or _little(cursor) <= cursor.left - ARCHIVE_LENGTH.size):
        cursor.rest("continuation")
        return
    size = _little(cursor)
    length = cursor.take(ARCHIVE_LENGTH)
    if length is None:
        return
    length.note = f"{size} bytes"
    if size > cursor.left and not head.more:
        cursor.tell("length_beyond", "archive length", size, cursor.left)
    if cursor.left > 0 and size:
        cursor.take(ARCHIVE_DATA, min(size, cursor.left))


def _little(cursor: Cursor) -> int:
    """Return the little-endian number in the two octets at the cursor."""
    return int.from_bytes(cursor.octets[cursor.at : min(cursor.at + 2, cursor.end)], "little")
