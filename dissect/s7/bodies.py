"""What stands in the parameter block and the data block of an S7 PDU, cut into parts without gaps.

Read this file to find which structure stands where: the tables at its end name, for every function and every userdata
subfunction, the parser of its body. Each parser takes parts from a `Cursor` in wire order; what it leaves over is told as
surplus. This is not the hot path: reads and writes are paired by `dissect.s7.items` alone, a body is cut when somebody looks.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Final

from dissect.s7 import clock
from dissect.s7.items import data_size_within
from dissect.s7.layouts import (
    DATA_ITEM,
    ITEM_HEAD,
    MODE_TRANSITION,
    S7ANY_ITEM,
    SETUP,
    USERDATA_EXTENDED,
    USERDATA_SHORT,
    VARIABLES_HEAD,
)
from dissect.s7.message import Pdu
from dissect.s7.parameters import Parameters, UserdataHead
from dissect.s7.tables import (
    ACK,
    ACK_DATA,
    CPU_SERVICES,
    JOB,
    READ_VAR,
    ROSCTR,
    SETUP_COMMUNICATION,
    SUCCESS,
    USERDATA,
    WRITE_VAR,
)
from dissect.wire.layout import Layout
from dissect.wire.malformed import Malformed
from dissect.wire.part import OCTETS, Cursor, Part

#: Cuts the parameter block or the data block of a job (``answer`` false) or of its answer.
JobParser = Callable[[Cursor, bool], None]
#: Cuts the payload of a userdata PDU, which follows the four octets of its data head.
PayloadParser = Callable[[Cursor, UserdataHead], None]

#: The content of a data item.
CONTENT: Final = Layout("content", "reference section 3.5", [OCTETS.fields[0]])
#: A return code of a write answer.
RETURN_CODE: Final = Layout("return code", "reference section 3.5", [DATA_ITEM.fields[0]])
#: A function alone, as most positive answers have it.
FUNCTION: Final = Layout("function", "reference section 3.3", [VARIABLES_HEAD.fields[0]])


class Body:
    """The parts of a PDU behind its header; offsets are within the PDU.

    ``malformed`` tells what the parts have against themselves; the facts of `Pdu.malformed` are not repeated in it.
    """

    __slots__ = ("data", "malformed", "parameters")

    def __init__(self) -> None:
        self.parameters: list[Part] = []
        self.data: list[Part] = []
        self.malformed: list[Malformed] = []

    @property
    def parts(self) -> list[Part]:
        """All parts in wire order."""
        return self.parameters + self.data

    def find(self, layout: Layout) -> Part | None:
        """Return the first part of this layout, None when there is none."""
        for part in self.parts:
            if part.layout is layout:
                return part
        return None

    @property
    def notes(self) -> list[str]:
        """What the parts are about, in wire order; text from the wire, not escaped."""
        return [part.note for part in self.parts if part.note]


def parse_body(pdu: Pdu) -> Body:
    """Cut a PDU behind its header into parts. Never raises."""
    body = Body()
    at = min(pdu.header_size, len(pdu.octets))
    middle = min(pdu.data_offset, len(pdu.octets))
    end = min(middle + pdu.data_length, len(pdu.octets))
    body.parameters = parse_parameter_parts(pdu.octets, at, middle, pdu.parameters, body.malformed)
    body.data = parse_data_parts(pdu.octets, middle, end, pdu.parameters, body.malformed)
    return body


def parse_parameter_parts(
    octets: bytes, at: int, end: int, parameters: Parameters, malformed: list[Malformed]
) -> list[Part]:
    """Cut the parameter block ``octets[at:end]``, which was read as ``parameters``; faults are added to ``malformed``."""
    cursor = Cursor(octets, at, end, "param", malformed)
    rosctr = parameters.rosctr
    function = parameters.function
    if rosctr == USERDATA:
        _userdata_head(cursor, parameters)
    elif function < 0 or rosctr not in ROSCTR:
        cursor.rest()
    elif function in {READ_VAR, WRITE_VAR, SETUP_COMMUNICATION}:
        _known_parameters(cursor, parameters)
    else:
        parse = PARAMETERS.get(function)
        if parse is None:
            cursor.take(FUNCTION)
            cursor.rest()
        else:
            parse(cursor, rosctr != JOB)
            cursor.finish()
    return cursor.parts


def _known_parameters(cursor: Cursor, parameters: Parameters) -> None:
    """Setup, read and write: `parse_parameters` has told their faults already, so none is told here."""
    cursor.malformed = []
    if parameters.function == SETUP_COMMUNICATION:
        cursor.take(SETUP)
        cursor.finish()
        return
    cursor.take(VARIABLES_HEAD)
    start = cursor.at - VARIABLES_HEAD.size
    for item in parameters.items:
        if start + item.offset > cursor.at:
            cursor.take_fill(1)
        size = len(item.octets)
        if item.transport_size >= 0:
            cursor.take(S7ANY_ITEM, note=item.address)
        else:
            cursor.take(ITEM_HEAD, note=item.address)
            cursor.take(OCTETS, size - ITEM_HEAD.size)
    cursor.finish()


def _userdata_head(cursor: Cursor, parameters: Parameters) -> None:
    cursor.malformed = []  # `parse_parameters` has told them
    head = parameters.userdata
    if head is None:
        cursor.rest()
    elif parameters.function != CPU_SERVICES:
        cursor.take(MODE_TRANSITION, note=head.subfunction_name)
    else:
        cursor.take(USERDATA_EXTENDED if head.extended else USERDATA_SHORT)
    cursor.finish()


def parse_data_parts(
    octets: bytes, at: int, end: int, parameters: Parameters, malformed: list[Malformed]
) -> list[Part]:
    """Cut the data block ``octets[at:end]`` of a PDU with these parameters; faults are added to ``malformed``."""
    cursor = Cursor(octets, at, end, "data", malformed)
    if cursor.left <= 0:
        return cursor.parts
    rosctr = parameters.rosctr
    function = parameters.function
    if rosctr == USERDATA:
        _payload(cursor, parameters)
    elif function == READ_VAR or function == WRITE_VAR:
        _known_data(cursor, parameters)
    else:
        parse = DATA.get(function) if rosctr in ROSCTR else None
        if parse is None:
            cursor.rest()
        else:
            parse(cursor, rosctr != JOB)
            cursor.finish()
    return cursor.parts


def _known_data(cursor: Cursor, parameters: Parameters) -> None:
    """The data of a read or write: `parse_pdu` has told its faults already, so none is told here."""
    cursor.malformed = []
    count = parameters.item_count
    if parameters.function == WRITE_VAR and parameters.rosctr in {ACK, ACK_DATA}:
        for _ in range(min(count, cursor.left)):
            cursor.take(RETURN_CODE)
    elif (parameters.function == WRITE_VAR) == (parameters.rosctr == JOB):
        take_data_items(cursor, count, parameters.rosctr == ACK_DATA, parameters)
    cursor.finish()


def take_data_items(cursor: Cursor, count: int, response: bool, parameters: Parameters | None = None) -> None:
    """Cut up to ``count`` data items with their contents and fill octets (reference 3.5).

    In a ``response`` an item whose return code is not success is its four head octets. ``parameters`` name what they are.
    """
    for number in range(count):
        items = parameters.items if parameters is not None else []
        head = cursor.take(DATA_ITEM, note=items[number].address if number < len(items) else "")
        if head is None:
            return
        size = 0
        if not response or head.number("return_code") == SUCCESS:
            size = data_size_within(head.number("transport_size"), head.number("length"), cursor.left)
        if size:
            cursor.take(CONTENT, size)
        if number + 1 < count or cursor.left == 1:
            cursor.take_fill(size)


def _payload(cursor: Cursor, parameters: Parameters) -> None:
    head = parameters.userdata
    if head is None or parameters.function != CPU_SERVICES:
        cursor.rest()
        return
    data_head = cursor.take(DATA_ITEM)
    if data_head is None:
        return
    size = data_head.number("length")
    if size > cursor.left:
        cursor.tell("length_beyond", "data.length", size, cursor.left)
    payload = Cursor(cursor.octets, cursor.at, min(cursor.at + size, cursor.end), "item", cursor.malformed)
    if payload.left > 0:
        parse = PAYLOADS.get((head.group, head.subfunction))
        if parse is None:
            payload.rest()
        else:
            parse(payload, head)
            payload.finish()
    cursor.parts.extend(payload.parts)
    cursor.at = payload.at
    cursor.finish()


#: Parsers of parameter blocks by function.
PARAMETERS: Final[dict[int, JobParser]] = {}

#: Parsers of data blocks by function.
DATA: Final[dict[int, JobParser]] = {}

#: Parsers of userdata payloads by group and subfunction.
PAYLOADS: Final[dict[tuple[int, int], PayloadParser]] = {
    (7, clock.READ_CLOCK): clock.parse_clock,
    (7, clock.SET_CLOCK): clock.parse_clock,
    (7, clock.READ_CLOCK_FOLLOWING): clock.parse_clock,
    (7, clock.SET_CLOCK_SECOND): clock.parse_clock,
}
