"""Reads facts about stations from S7comm transactions: SZL, clock, blocks and modes (reference sections 4.5, 4.6, 4.12).

`dissect.protocols.s7plus.events` reads what CPUs state in S7comm-plus, and collects it in `Identity.told`.
"""

from __future__ import annotations

from datetime import UTC, datetime
from typing import Final

from dissect.engine.stations import facts
from dissect.engine.stations.facts import Fact
from dissect.engine.transactions.connection import Connection
from dissect.engine.transactions.operation import Operation
from dissect.engine.transactions.transaction import ANSWERED, PUSH, Transaction
from dissect.protocols.s7.blocks import BLOCK_COUNT, INFO, LISTED_BLOCK, TYPE_WANTED, header_text
from dissect.protocols.s7.clock import CLOCK as CLOCK_LAYOUT
from dissect.protocols.s7.clock import SETTING
from dissect.protocols.s7.layouts import DATA_HEAD
from dissect.protocols.s7.parameters import HEADER_SIZE, UserdataHead
from dissect.protocols.s7.szl import SZL_HEAD, record_layout
from dissect.protocols.s7.szl_communication import CAPABILITY_RECORDS, PROTECTION
from dissect.protocols.s7.szl_notes import extract
from dissect.protocols.s7.szl_records import (
    BLANK,
    COMPONENT_RECORDS,
    ETHERNET,
    IDENTIFICATION,
    OPERATING_MODE,
    version_text,
)
from dissect.protocols.s7.szl_tables import HEAD_ONLY
from dissect.protocols.s7.tables import (
    GROUP_BLOCKS,
    GROUP_CPU,
    GROUP_MODE,
    GROUP_TIME,
    LIST_OF_TYPE,
    READ_SZL,
    SUCCESS,
    USERDATA,
)
from dissect.protocols.s7.values import date_and_time
from dissect.wire.octets import u16
from dissect.wire.part import Part
from dissect.wire.text import hex_number

#: Userdata groups with facts about a station.
TELLING: Final = frozenset((GROUP_MODE, GROUP_BLOCKS, GROUP_CPU, GROUP_TIME))
#: Names of modules by rack and slot, which are the two numbers in an octet of a TSAP.
_MODULES: Final = [f"rack {place >> 5} slot {place & 0x1F}" for place in range(256)]
#: Partial lists with facts; other lists may be polled by a panel for hours.
_LISTS: Final = frozenset((0x11, 0x1C, 0x24, 0x31, 0x32, 0x37))
#: Number of answers whose facts are remembered, because polling returns the same answer again and again.
MAX_ANSWERS: Final = 512

#: Components of list 0x1C by their number.
_COMPONENTS: Final[dict[int, str]] = {
    0x01: facts.STATION_NAME,
    0x02: facts.MODULE_NAME,
    0x03: facts.PLANT,
    0x05: facts.SERIAL_NUMBER,
    0x07: facts.MODULE_TYPE,
    0x08: facts.CARD_SERIAL,
    0x0B: facts.LOCATION,
}
_COMPONENT_LAYOUTS: Final = frozenset([id(layout) for layout in COMPONENT_RECORDS.values()])
_GENERAL: Final = CAPABILITY_RECORDS[0x01]
#: Layouts of records with facts; other records of a list need not be parsed.
_TELLING_RECORDS: Final = _COMPONENT_LAYOUTS | frozenset(
    [id(layout) for layout in (IDENTIFICATION, OPERATING_MODE, PROTECTION, _GENERAL, ETHERNET)]
)
#: The subject of a record of list 0x11, by its index.
_MODULE: Final = 0x0001
_HARDWARE: Final = 0x0006
_FIRMWARE: Final = 0x0007
#: Offset of the DATE_AND_TIME in a clock; it is the last part of the clock.
_TIME: Final = 2
_NS: Final = 1_000_000_000
_EPOCH: Final = datetime(1970, 1, 1, tzinfo=UTC)

#: Key and value of a fact.
Said = tuple[str, str]


class Evidence:
    """Reads facts from transactions. One object per analysis."""

    def __init__(self) -> None:
        self._answers: dict[tuple[int, int, bytes, bytes], list[Said]] = {}

    def of_transaction(self, transaction: Transaction) -> list[Fact]:
        """Return the facts about the station that answered or pushed; empty if there are none."""
        head = transaction.parameters.userdata
        if head is None or transaction.rosctr != USERDATA:
            return []
        if transaction._outcome == PUSH:
            if head.group != GROUP_MODE or transaction.request_frame:
                return []
            said = [(facts.OPERATING_MODE, head.subfunction_name)]
            return _facts(transaction, said, "mode transition")
        if transaction.has_errors or not transaction.response_frame:
            return []
        if transaction.is_likely and not _tells_by_itself(head):
            return []
        if head.group == GROUP_TIME:
            return _clock(transaction, head)
        if head.group == GROUP_CPU and head.subfunction == READ_SZL:
            return self._szl(transaction)
        if head.group == GROUP_BLOCKS:
            return self._blocks(transaction)
        return []

    def of_operation(self, operation: Operation) -> list[Fact]:
        """Return the facts in an answer in several parts, which is now complete."""
        head = operation.content_head
        if head is None or not operation.content:
            return []
        if operation.likely and not _tells_by_itself(head):
            return []
        wanted = operation.subject if head.group == GROUP_BLOCKS else ""
        if len(operation.content) < operation.announced:
            return []  # records are missing; the later ones would be read at wrong offsets
        source = "block functions"
        if head.group == GROUP_CPU and head.subfunction == READ_SZL:
            szl_id = int.from_bytes(operation.content[:2], "big")
            if szl_id & 0xFF not in _LISTS:
                return []
            source = f"SZL {hex_number(szl_id, 4)}"
        elif head.group != GROUP_BLOCKS:
            return []
        found: list[Fact] = []
        for part in operation.content_parts():
            said = said_by([part], wanted)
            if said:
                frames = operation.frames_of(part.offset, part.end)
                found += made(operation.connection, operation.asked_by, said, source, frames, operation.end_ns)
        return found

    def _szl(self, transaction: Transaction) -> list[Fact]:
        payload = _answered(transaction)
        if len(payload) < SZL_HEAD.size or payload[1] not in _LISTS:
            return []
        szl_id = u16(payload, 0)
        return _facts(transaction, self._said(transaction, b"", payload), f"SZL {hex_number(szl_id, 4)}")

    def _blocks(self, transaction: Transaction) -> list[Fact]:
        asked, payload = asked_payload(transaction), _answered(transaction)
        return _facts(transaction, self._said(transaction, asked, payload), "block functions") if payload else []

    def _said(self, transaction: Transaction, asked: bytes, payload: bytes) -> list[Said]:
        """Return the facts in an answer; an answer that was seen before is not read again."""
        parameters = transaction.response_parameters
        head = parameters.userdata if parameters is not None else None
        if head is None or head.error_code or head.data_unit_ref or head.last_data_unit:
            return []  # refused, or one of several parts
        key = (head.group, head.subfunction, asked, payload)
        said = self._answers.get(key)
        if said is None:
            body = transaction.request_body if asked else None
            part = body.find(TYPE_WANTED) if body is not None else None
            if head.group == GROUP_CPU:
                parts = _records(payload)
            else:
                answer = transaction.response
                parts = answer.body.parts if answer is not None else []
            said = said_by(parts, part.note if part is not None else "")
            if len(self._answers) >= MAX_ANSWERS:
                del self._answers[next(iter(self._answers))]
            self._answers[key] = said
        return said


def _tells_by_itself(head: UserdataHead) -> bool:
    """Return whether an answer itself names its subject, so that its facts are true for any request.

    The list of the blocks of a type does not name that type, and a station that accepts a time does not repeat it.
    """
    if head.group == GROUP_BLOCKS:
        return head.subfunction != LIST_OF_TYPE
    return head.group != GROUP_TIME or head.subfunction not in SETTING


def _records(payload: bytes) -> list[Part]:
    """Parse the records with facts of a complete list; missing records are left out."""
    szl_id, length, count = u16(payload, 0), u16(payload, 4), u16(payload, 6)
    if extract(szl_id) == HEAD_ONLY or not length:
        return []
    parts = []
    for at in range(SZL_HEAD.size, min(len(payload) - length, SZL_HEAD.size + (count - 1) * length) + 1, length):
        layout = record_layout(szl_id, payload, at, at + length)
        if id(layout) not in _TELLING_RECORDS:
            continue
        parts.append(Part(layout, payload, at, at + (length if layout.open else min(length, layout.size))))
    return parts


def _answered(transaction: Transaction) -> bytes:
    """Return the payload of a userdata answer, read in place because panels poll; empty if the answer is not a success."""
    parameters = transaction.response_parameters
    if parameters is None:
        return b""
    size = len(parameters.octets)
    return _payload(transaction._response_buf, transaction._response_offset, transaction.response_size, size)


def asked_payload(transaction: Transaction) -> bytes:
    """Return the payload of a userdata request; empty if it has none."""
    size = len(transaction.parameters.octets)
    return _payload(transaction._request_buf, transaction._request_offset, transaction.request_size, size)


def _payload(buf: bytes, offset: int, size: int, parameters: int) -> bytes:
    at = offset + HEADER_SIZE + parameters
    if size < HEADER_SIZE + parameters + DATA_HEAD.size or buf[at] != SUCCESS:
        return b""
    return buf[at + DATA_HEAD.size : offset + size]


def said_by(parts: list[Part], wanted: str = "") -> list[Said]:
    """Return the facts in the parts of an answer; ``wanted`` is the type of the listed blocks."""
    said: list[Said] = []
    for part in parts:
        layout = part.layout
        if layout is IDENTIFICATION:
            said += _identification(part)
        elif id(layout) in _COMPONENT_LAYOUTS:
            key = _COMPONENTS.get(part.number("index") & 0xFF, "")
            if key:
                said.append((key, part.text("text").strip()))
        elif layout is OPERATING_MODE:
            said.append((facts.OPERATING_MODE, part.text("mode")))
        elif layout is PROTECTION:
            said.append((facts.PROTECTION, _with_number(part, "level")))
            said.append((facts.MODE_SWITCH, part.text("switch")))
        elif layout is _GENERAL:
            said.append((facts.MAX_PDU, str(max(0, part.number("pdu_length")) or "")))
            said.append((facts.MAX_CONNECTIONS, str(max(0, part.number("connections")) or "")))
        elif layout is ETHERNET:
            said.append((facts.INTERFACE, f"{part.text('ip_address')} {part.text('mac_address')}"))
        elif layout is BLOCK_COUNT and part.text("block_type"):
            said.append((f"{facts.BLOCKS} {part.text('block_type')}", str(part.number("block_count"))))
        elif layout is LISTED_BLOCK and wanted:
            said.append((facts.BLOCK, f"{wanted} {part.number('block_number')}"))
        elif layout is INFO:
            said.append((facts.BLOCK, header_text(part)))
    return [(key, value) for key, value in said if value]


def _identification(part: Part) -> list[Said]:
    """Read a record of list 0x11: the order number, and the version of the component given by its index."""
    index, version, release = part.number("index"), part.number("version"), part.number("release")
    said: list[Said] = []
    order = part.text("order_number").strip()
    if index == _MODULE and order:
        said.append((facts.ORDER_NUMBER, order))
    letter = version_text(version) if version > 0 else ""
    if index == _FIRMWARE and letter and release >= 0:
        said.append((facts.FIRMWARE, f"{letter}.{release >> 8}.{release & 0xFF}"))
    elif index == _HARDWARE and not letter and version not in {-1, 0, BLANK}:
        said.append((facts.HARDWARE, str(version)))  # its release is the release of a file of the programming device
    return said


def _with_number(part: Part, name: str) -> str:
    number = part.number(name)
    return f"{number} ({part.text(name)})" if part.text(name) else str(number)


def _clock(transaction: Transaction, head: UserdataHead) -> list[Fact]:
    """Read a clock: the time that a station reports, or accepts as its new time."""
    setting = head.subfunction in SETTING
    if transaction._outcome != ANSWERED:
        return []
    payload = asked_payload(transaction) if setting else _answered(transaction)
    text = date_and_time(payload[_TIME : CLOCK_LAYOUT.size]) if len(payload) >= CLOCK_LAYOUT.size else None
    clock_ns = clock_time(text) if text is not None else None
    if clock_ns is None:
        return []
    at_ns = int(transaction.request_ns if setting else transaction.response_ns)
    said = [(facts.CLOCK_SET if setting else facts.CLOCK, str(clock_ns - at_ns))]
    if not setting:
        return _facts(transaction, said, "read clock")
    frames = [int(transaction.request_frame)]  # the answer only accepts the time
    return made(transaction.connection, int(transaction.asked_by), said, "set clock", frames, at_ns)


def clock_time(text: str) -> int | None:
    """Return a DATE_AND_TIME ("DT#2026-11-21-01:31:15.556") as nanoseconds since 1970; None for any other text.

    It has no time zone and is interpreted as UTC.
    """
    try:
        found = datetime.fromisoformat(f"{text[3:13]} {text[14:]}").replace(tzinfo=UTC)
    except ValueError:
        return None
    since = found - _EPOCH
    return (since.days * 86_400 + since.seconds) * _NS + since.microseconds * 1000


def module_asked(connection: Connection, asked_by: int) -> str:
    """Return rack and slot of the called TSAP; empty if it has none, or if ``asked_by`` is not the client."""
    tsap = connection.tsap_called
    if tsap is None or tsap.rack < 0 or asked_by != connection.client_side:
        return ""
    return _MODULES[32 * tsap.rack + tsap.slot]


def made(
    connection: Connection, asked_by: int, said: list[Said], source: str, frames: list[int], time_ns: int
) -> list[Fact]:
    """Return facts about the side that ``asked_by`` sent its request to."""
    if not said:
        return []
    host = str(connection.tcp.ends[1 - asked_by].host)
    module = module_asked(connection, asked_by)
    number = int(connection.number)
    return [Fact(host, module, key, value, source, number, frames, time_ns) for key, value in said]


def _facts(transaction: Transaction, said: list[Said], source: str) -> list[Fact]:
    frames = transaction.frames
    time_ns = max(int(transaction.request_ns), int(transaction.response_ns))
    return made(transaction.connection, int(transaction.asked_by), said, source, frames, time_ns)
