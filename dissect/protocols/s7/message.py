"""One S7 PDU as an object (reference section 3.1).

The engine does not use it; the engine reads only `dissect.protocols.s7.parameters`.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Final

from mypy_extensions import i64

from dissect.protocols.s7.alarm_layouts import OBJECTS_HEAD, SYNTAXES
from dissect.protocols.s7.body import Body
from dissect.protocols.s7.items import DATA_HEAD, DataItem, parse_data_items
from dissect.protocols.s7.layouts import ITEM_HEAD
from dissect.protocols.s7.parameters import (
    ACK_HEADER_SIZE,
    HEADER_SIZE,
    RESPONSE,
    Parameters,
    UserdataHead,
    header_size,
    parse_parameters,
    read_header,
)
from dissect.protocols.s7.tables import (
    ACK_DATA,
    ACKNOWLEDGE,
    ALARM_8_LOCK,
    ALARM_8_UNLOCK,
    DATA,
    FUNCTIONS,
    GROUP_CPU,
    JOB,
    OBJECT_DOES_NOT_EXIST,
    READ_VAR,
    ROSCTR,
    SUCCESS,
    USERDATA,
    USERDATA_SUBFUNCTIONS,
    WRITE_VAR,
)
from dissect.wire.copies import leaves
from dissect.wire.malformed import Malformed
from dissect.wire.octets import u16

#: Contains `dissect.protocols.s7.hiding.body_to_show` once that is imported; repeating the import statement takes as long as
#: parsing many bodies.
_CUT: Final[list[Callable[[Pdu], Body]]] = []

#: Message services that name several alarms in one request; the answer has a return code for each.
_BY_ALARM: Final = frozenset((ALARM_8_LOCK, ALARM_8_UNLOCK, ACKNOWLEDGE))

#: Return codes of an answer without payload that are no error: nothing to return, and a code without a meaning.
_NOTHING_TO_RETURN: Final = frozenset((OBJECT_DOES_NOT_EXIST, 0x00))
#: The result of `refusing_code` if nothing is refused.
NOT_REFUSED: Final = -1


def refusing_code(head: UserdataHead, buf: bytes, at: i64, size: i64) -> i64:
    """Return the return code by which a userdata answer without error code refuses its request, `NOT_REFUSED` for none.

    The answer is ``buf[at:at + size]``. An answer refuses if it has no payload and its return code is not success. An exception
    are functions that may be answered without payload (`dissect.protocols.s7.tables.DATA`), if the code says only that
    (reference 4.2).
    """
    if head.type != RESPONSE or head.error_code or size < HEADER_SIZE or u16(buf, at + 8) != DATA_HEAD:
        return NOT_REFUSED
    data_at: i64 = HEADER_SIZE + u16(buf, at + 6)
    if data_at >= size:
        return NOT_REFUSED  # the capture lacks it
    code: i64 = buf[at + data_at]
    if code == SUCCESS:
        return NOT_REFUSED
    table = USERDATA_SUBFUNCTIONS.get(head.group)
    if code in _NOTHING_TO_RETURN and (table is None or table.returns(head.subfunction) != DATA):
        return NOT_REFUSED
    return code


def userdata_payload(octets: bytes) -> bytes:
    """Return the payload of a userdata PDU, which follows the head of its data block; empty if there is none."""
    if len(octets) < HEADER_SIZE:
        return b""
    at = HEADER_SIZE + u16(octets, 6)
    if at + DATA_HEAD > len(octets):
        return b""
    return octets[at + DATA_HEAD : at + DATA_HEAD + u16(octets, at + 2)]


def answers_by_alarm(head: UserdataHead) -> bool:
    """Return whether this is the answer to an acknowledgement, lock or unlock of alarms (reference 4.9)."""
    return head.type == RESPONSE and head.group == GROUP_CPU and head.subfunction in _BY_ALARM


def alarm_codes(octets: bytes) -> bytes:
    """Return the return codes, one for each alarm, of a PDU for which `answers_by_alarm` is true."""
    payload = userdata_payload(octets)
    count = OBJECTS_HEAD.number("objects", payload, 0, len(payload))
    return payload[OBJECTS_HEAD.size : OBJECTS_HEAD.size + max(count, 0)]


def alarms_asked(octets: bytes) -> list[int]:
    """Return the event ids that the request of such an answer names, in wire order, as far as they are present."""
    payload = userdata_payload(octets)
    found: list[int] = []
    at = OBJECTS_HEAD.size
    for _ in range(OBJECTS_HEAD.number("objects", payload, 0, len(payload))):
        layout = SYNTAXES.get(payload[at + 2]) if at + ITEM_HEAD.size <= len(payload) else None
        event_id = layout.number("event_id", payload, at, len(payload)) if layout is not None else -1
        if event_id < 0:
            break
        found.append(event_id)
        at += 2 + payload[at + 1]
    return found


class Pdu:
    """One S7 PDU and the packet that completed it.

    ``octets`` is the whole TSDU. ``parameters`` is never None. ``malformed`` lists the faults of header, parameters and data
    block, with offsets within the PDU. ``cut`` is True if the capture cut the PDU.
    """

    __slots__ = (
        "connection",
        "cut",
        "data_length",
        "error_class",
        "error_code",
        "frame",
        "malformed",
        "octets",
        "param_length",
        "parameters",
        "pdu_ref",
        "redundancy_id",
        "rosctr",
        "side",
        "time_ns",
    )

    def __init__(self, octets: bytes, frame: int, time_ns: int, connection: int, side: int) -> None:
        self.octets = octets
        self.frame = frame
        self.time_ns = time_ns
        self.connection = connection
        self.side = side
        self.cut = False
        self.rosctr = -1
        self.redundancy_id = 0
        self.pdu_ref = -1
        self.param_length = 0
        self.data_length = 0
        self.error_class = -1
        self.error_code = -1
        self.parameters = Parameters(b"", 0)
        self.malformed: list[Malformed] = []

    def __repr__(self) -> str:
        return f"Pdu({self.rosctr_name}, {self.function_name or '-'}, ref {self.pdu_ref}, packet {self.frame})"

    @property
    def header_size(self) -> int:
        """Octets of the header, 10 or 12."""
        return header_size(self.rosctr)

    @property
    def function(self) -> int:
        """The function octet, -1 if there are no parameters."""
        return self.parameters.function

    @property
    def rosctr_name(self) -> str:
        """``Job``, ``Ack``, ``Ack_Data``, ``Userdata``, or the number."""
        return ROSCTR.name(self.rosctr)

    @property
    def function_name(self) -> str:
        """Name of the function; for userdata, the names of group and subfunction."""
        if self.function >= 0:
            return self.parameters.function_name
        return FUNCTIONS.name(0) if self.rosctr == USERDATA else ""

    @property
    def data_offset(self) -> int:
        """Where the data block begins within ``octets`` (in a damaged PDU perhaps after their end)."""
        return self.header_size + self.param_length

    @property
    def data(self) -> bytes:
        """The data block, as far as it was captured."""
        return self.octets[self.data_offset : self.data_offset + self.data_length]

    @property
    def body(self) -> Body:
        """The parts after the header, without passwords; parsed again at each access. Never raises.

        See `dissect.protocols.s7.bodies`.
        """
        if not _CUT:
            # imported late: it needs the tables of all structures, which few runs use
            from dissect.protocols.s7.hiding import body_to_show

            _CUT.append(body_to_show)
        return _CUT[0](self)

    def data_items(self, malformed: list[Malformed] | None = None) -> list[DataItem]:
        """Return the data items of a read answer or write request, with offsets within the PDU; empty for other PDUs."""
        told: list[Malformed] = [] if malformed is None else malformed
        end = min(len(self.octets), self.data_offset + self.data_length)
        count = self.parameters.item_count
        if count >= 0 and (
            (self.rosctr == ACK_DATA and self.function == READ_VAR)
            or (self.rosctr == JOB and self.function == WRITE_VAR)
        ):
            if count and not self.data_length and self.rosctr == ACK_DATA and (self.error_class or self.error_code):
                return []  # the whole request was refused, without any items
            return parse_data_items(self.octets, self.data_offset, end, count, self.rosctr == ACK_DATA, told)
        return []

    def return_codes(self) -> list[int]:
        """Return the item return codes of a read or write answer, in wire order; empty for other PDUs."""
        if self.rosctr != ACK_DATA:
            return []
        if self.function == WRITE_VAR:
            return list(self.data)
        return [item.return_code for item in self.data_items()]

    @property
    def error(self) -> int:
        """Error class and code of the header as one number, or the error code of userdata; 0 for none."""
        if self.error_class > 0 or self.error_code > 0:
            return self.error_class << 8 | self.error_code
        head = self.parameters.userdata
        return head.error_code if head is not None else 0

    @property
    def refusing_code(self) -> int:
        """The return code by which userdata without error code refuses its request (`refusing_code`), else `NOT_REFUSED`."""
        head = self.parameters.userdata
        return int(refusing_code(head, self.octets, 0, len(self.octets))) if head is not None else NOT_REFUSED

    @property
    def refused(self) -> bool:
        """True if the PDU has an error code, userdata with a refusing return code, or a refused item or alarm."""
        if self.error or self.refusing_code != NOT_REFUSED:
            return True
        head = self.parameters.userdata
        codes = self.return_codes()
        if head is not None and answers_by_alarm(head):
            codes = list(alarm_codes(self.octets))
        return any(code != SUCCESS for code in codes)


def parse_pdu(
    octets: bytes, frame: int = 0, time_ns: int = 0, connection: int = 0, side: int = 0, cut: bool = False
) -> Pdu:
    """Read one S7 PDU (a whole TSDU that begins with 0x32). Never raises. ``cut``: the capture cut it short."""
    pdu = Pdu(octets, frame, time_ns, connection, side)
    pdu.cut = cut
    limit = "snaplen" if cut else "tsdu"
    size = len(octets)
    if size >= 2:
        pdu.rosctr = octets[1]
    if size < HEADER_SIZE:
        pdu.malformed.append(Malformed("s7", "too_short", "header", 0, HEADER_SIZE, size, limit))
        return pdu
    if pdu.rosctr not in ROSCTR:
        pdu.malformed.append(Malformed("s7", "unknown_type", "rosctr", 1, 0, pdu.rosctr, limit))
    pdu.redundancy_id = u16(octets, 2)
    _, pdu.pdu_ref, pdu.param_length, pdu.data_length = read_header(octets, 0)
    head = header_size(pdu.rosctr)
    if size < head:
        pdu.malformed.append(Malformed("s7", "too_short", "header", 0, head, size, limit))
        return pdu
    if head == ACK_HEADER_SIZE:
        pdu.error_class = octets[10]
        pdu.error_code = octets[11]
    total = head + pdu.param_length + pdu.data_length
    if total > size:
        field = "param_length" if head + pdu.param_length > size else "data_length"
        pdu.malformed.append(
            Malformed("s7", "length_beyond", field, 6 if field == "param_length" else 8, total, size, limit)
        )
    elif total < size:
        pdu.malformed.append(Malformed("s7", "trailing_octets", "pdu", total, total, size, limit))
    block = octets[head : head + pdu.param_length]
    if pdu.rosctr not in ROSCTR:
        pdu.parameters = Parameters(block, pdu.rosctr)  # not parsed: it is unknown whether it is a request or an answer
        return pdu
    pdu.parameters = parse_parameters(block, pdu.rosctr)
    if head + pdu.param_length <= size:  # otherwise the faults of the block only repeat the fault above
        for told in pdu.parameters.malformed:
            pdu.malformed.append(
                Malformed(
                    told.layer, told.reason, told.field, told.offset + head, told.needed, told.available, told.limit
                )
            )
        if total <= size:
            pdu.data_items(pdu.malformed)
            _check_return_codes(pdu)
    return pdu


def _check_return_codes(pdu: Pdu) -> None:
    """Check that a write answer has exactly one octet for each item; if the whole request was refused, it may have none."""
    if pdu.rosctr != ACK_DATA or pdu.function != WRITE_VAR or pdu.parameters.item_count < 0:
        return
    count, there = pdu.parameters.item_count, pdu.data_length
    if there != count and (there or not (pdu.error_class or pdu.error_code)):
        pdu.malformed.append(Malformed("s7", "count_mismatch", "return codes", pdu.data_offset, count, there, "data"))


leaves(Pdu)
