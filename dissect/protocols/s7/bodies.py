"""Splits the parameter block and the data block of an S7 PDU into parts without gaps.

Read this file to find the structure of each message: the tables at its end name the parser for each function and each userdata
subfunction. A parser takes parts from a `Cursor` in wire order; octets that it leaves are reported as surplus. This is not the
hot path: for pairing reads and writes `dissect.protocols.s7.items` is sufficient; a body is parsed only when its parts are
needed.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Final

from dissect.protocols.s7 import (
    alarms,
    blocks,
    clock,
    control,
    cyclic,
    diagnostics,
    nc,
    pbc,
    programmer,
    security,
    szl,
    transfer,
)
from dissect.protocols.s7.body import Body
from dissect.protocols.s7.data_parts import RETURN_CODE, take_data_items, take_items
from dissect.protocols.s7.layouts import (
    DATA_HEAD,
    FUNCTION,
    MODE_TRANSITION,
    SETUP,
    USERDATA_EXTENDED,
    USERDATA_SHORT,
    VARIABLES_HEAD,
)
from dissect.protocols.s7.message import Pdu
from dissect.protocols.s7.parameters import Parameters, UserdataHead
from dissect.protocols.s7.tables import (
    ACK,
    ACK_DATA,
    ALARM_QUERY,
    AR_SEND,
    BLOCK_INFO,
    BSEND,
    CHANGE_DRIVEN,
    CHANGE_DRIVEN_MODIFY,
    CPU_SERVICES,
    CYCLIC_TRANSFER,
    DIAGNOSTIC_MESSAGE,
    DOWNLOAD_BLOCK,
    END_UPLOAD,
    GROUP_BLOCKS,
    GROUP_CPU,
    GROUP_CYCLIC,
    GROUP_NC,
    GROUP_PBC,
    GROUP_ROUTING,
    GROUP_SECURITY,
    GROUP_TEST,
    GROUP_TIME,
    JOB,
    LIST_BLOCKS,
    LIST_OF_TYPE,
    MESSAGE_SERVICE,
    PI_SERVICE,
    PLC_STOP,
    READ_CLOCK,
    READ_CLOCK_FOLLOWING,
    READ_RECORD,
    READ_SZL,
    READ_VAR,
    REQUEST_DOWNLOAD,
    ROSCTR,
    SEND_PASSWORD,
    SET_CLOCK,
    SET_CLOCK_SECOND,
    SETUP_COMMUNICATION,
    UNSUBSCRIBE,
    UPLOAD,
    USERDATA,
    USERDATA_SUBFUNCTIONS,
    WRITE_VAR,
)
from dissect.wire.malformed import Malformed
from dissect.wire.part import Cursor, Part

#: Parses the parameter block or the data block of a job (``answer`` is False) or of its answer.
JobParser = Callable[[Cursor, bool], None]
#: Parses the payload of a userdata PDU, which follows the four octets of its data head.
PayloadParser = Callable[[Cursor, UserdataHead], None]


def parse_body(pdu: Pdu) -> Body:
    """Divide the octets after the header of a PDU into parts. Never raises."""
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
    """Parse the parameter block ``octets[at:end]``, which was read as ``parameters``; add faults to ``malformed``."""
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
    """Parse the parameters of setup, read and write; no faults are noted here, because `parse_parameters` has noted them."""
    cursor.malformed = []
    if parameters.function == SETUP_COMMUNICATION:
        cursor.take(SETUP)
        cursor.finish()
        return
    cursor.take(VARIABLES_HEAD)
    take_items(cursor, parameters.items, cursor.at - VARIABLES_HEAD.size)
    cursor.finish()


def _userdata_head(cursor: Cursor, parameters: Parameters) -> None:
    cursor.malformed = []  # `parse_parameters` has noted the faults
    head = parameters.userdata
    if head is None:
        cursor.rest()
    elif parameters.function != CPU_SERVICES:
        cursor.take(MODE_TRANSITION)  # the mode is in the name of the function
    elif head.usend:
        pbc.take_usend(cursor)
    else:
        cursor.take(USERDATA_EXTENDED if head.extended else USERDATA_SHORT)
    cursor.finish()


def parse_data_parts(
    octets: bytes, at: int, end: int, parameters: Parameters, malformed: list[Malformed]
) -> list[Part]:
    """Parse the data block ``octets[at:end]`` of a PDU with these parameters; add faults to ``malformed``."""
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
    """Parse the data of a read or write; no faults are noted here, because `parse_pdu` has noted them."""
    cursor.malformed = []
    count = parameters.item_count
    if parameters.function == WRITE_VAR and parameters.rosctr in {ACK, ACK_DATA}:
        for _ in range(min(count, cursor.left)):
            cursor.take(RETURN_CODE)
    elif (parameters.function == WRITE_VAR) == (parameters.rosctr == JOB):
        take_data_items(cursor, count, parameters.rosctr == ACK_DATA, [item.label for item in parameters.items])
    cursor.finish()


def _payload(cursor: Cursor, parameters: Parameters) -> None:
    head = parameters.userdata
    if head is None or parameters.function != CPU_SERVICES:
        cursor.rest()
        return
    if head.usend:
        pbc.take_usend_data(cursor)
        cursor.finish()
        return
    data_head = cursor.take(DATA_HEAD)
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


def parse_joined(
    group: int, subfunction: int, type_: int, octets: bytes, malformed: list[Malformed] | None = None
) -> list[Part]:
    """Parse the payload of a userdata message that came in several parts, like one that came whole.

    ``octets`` are the joined payloads without their data heads; offsets are within them. Faults are added to ``malformed``.
    """
    told: list[Malformed] = malformed if malformed is not None else []
    cursor = Cursor(octets, 0, len(octets), "item", told)
    if octets:
        parse = PAYLOADS.get((group, subfunction))
        if parse is None:
            cursor.rest()
        else:
            parse(cursor, UserdataHead(type_, group, subfunction, 0))
            cursor.finish()
    return cursor.parts


#: Parsers of parameter blocks by function.
PARAMETERS: Final[dict[int, JobParser]] = {
    CPU_SERVICES: control.parse_cpu_services,
    **dict.fromkeys(range(REQUEST_DOWNLOAD, END_UPLOAD + 1), transfer.parse_parameters),
    PI_SERVICE: control.parse_service,
    PLC_STOP: control.parse_stop,
}

#: Parsers of data blocks by function.
DATA: Final[dict[int, JobParser]] = {
    DOWNLOAD_BLOCK: transfer.parse_data,
    UPLOAD: transfer.parse_data,
}

#: Parsers of userdata payloads by group and subfunction.
PAYLOADS: Final[dict[tuple[int, int], PayloadParser]] = {
    **{(GROUP_TEST, code.number): programmer.parse_programmer for code in USERDATA_SUBFUNCTIONS[GROUP_TEST]},
    (GROUP_CYCLIC, CYCLIC_TRANSFER): cyclic.parse_transfer,
    (GROUP_CYCLIC, UNSUBSCRIBE): cyclic.parse_unsubscribe,
    (GROUP_CYCLIC, CHANGE_DRIVEN): cyclic.parse_transfer,
    (GROUP_CYCLIC, CHANGE_DRIVEN_MODIFY): cyclic.parse_transfer,
    (GROUP_CYCLIC, READ_RECORD): cyclic.parse_record,
    (GROUP_CPU, READ_SZL): szl.parse_szl,
    (GROUP_BLOCKS, LIST_BLOCKS): blocks.parse_list,
    (GROUP_BLOCKS, LIST_OF_TYPE): blocks.parse_list_of_type,
    (GROUP_BLOCKS, BLOCK_INFO): blocks.parse_info,
    (GROUP_CPU, MESSAGE_SERVICE): alarms.parse_message_service,
    (GROUP_CPU, DIAGNOSTIC_MESSAGE): diagnostics.parse_diagnostic_message,
    **dict.fromkeys([(GROUP_CPU, subfunction) for subfunction in alarms.ALARMS], alarms.parse_alarm),
    (GROUP_CPU, AR_SEND): alarms.parse_archive,
    (GROUP_CPU, ALARM_QUERY): alarms.parse_alarm_query,
    (GROUP_SECURITY, SEND_PASSWORD): security.parse_password,
    (GROUP_PBC, BSEND): pbc.parse_bsend,
    (GROUP_TIME, READ_CLOCK): clock.parse_clock,
    (GROUP_TIME, SET_CLOCK): clock.parse_clock,
    (GROUP_TIME, READ_CLOCK_FOLLOWING): clock.parse_clock,
    (GROUP_TIME, SET_CLOCK_SECOND): clock.parse_clock,
    **dict.fromkeys([(GROUP_ROUTING, subfunction) for subfunction in nc.ROUTING], nc.parse_routing),
    **dict.fromkeys([(GROUP_NC, code.number) for code in USERDATA_SUBFUNCTIONS[GROUP_NC]], nc.parse_nc),
}
