"""More grounds (`dissect.oracle.grounds`): services of which Wireshark 4.0 reads less than we do, or by other names."""

from __future__ import annotations

from typing import Final

from dissect.iso.cotp import parse_tpdu
from dissect.oracle import facts
from dissect.oracle.body_grounds import RECORD_OCTETS
from dissect.oracle.grounds import Case
from dissect.s7.bodies import parse_body
from dissect.s7.message import parse_pdu
from dissect.s7.szl_records import RECORD
from dissect.s7.tables import AR_SEND, MESSAGE_SERVICE, READ_RECORD

CREDIT: Final = "cotp.credit"
#: The parameter that holds a credit too.
_FLOW_CONTROL: Final = 0x8C
_AREA: Final = "s7comm.param.item.area"
#: The area of data records.
_RECORDS: Final = 1
#: Types of message service about archives: AR_SEND abort, AR_SEND initiate.
_ARCHIVES: Final = frozenset((6, 7))


def credit_of_parameter(case: Case) -> bool:
    """Whether only Wireshark shows a credit, that of a flow control confirmation."""
    if case.ours is not None or case.our_record is None:
        return False
    parameters = parse_tpdu(case.octets[facts.TPKT_SIZE :]).parameters
    values = [int.from_bytes(one.value[-2:], "big") for one in parameters if one.code == _FLOW_CONTROL]
    return case.theirs in values


def data_record(case: Case) -> bool:
    """Whether only we show count, DB number or address of an item whose area says that it is a data record."""
    if case.ours is None or case.theirs is not None:
        return False
    if case.place.part == facts.IN_ITEM:
        return case.beside(_AREA) == _RECORDS
    for part in parse_body(parse_pdu(case.octets)).data:
        if part.offset <= case.place.number < part.end and part.find("area") is not None:
            return part.number("area") == _RECORDS
    return False


def fill_before_length(case: Case) -> bool:
    """Whether only we show the octet between the status and the length of a data record that was read."""
    return case.ours is not None and case.theirs is None and _is_of(case, 2, READ_RECORD)


def archives(case: Case) -> bool:
    """Whether only one side shows a field of a message service about archives."""
    if (case.ours is None) == (case.theirs is None) or not _is_of(case, 4, MESSAGE_SERVICE):
        return False
    return parse_body(parse_pdu(case.octets)).number("alarm_type") in _ARCHIVES


def archive_data(case: Case) -> bool:
    """Whether only one side shows a field of the data of an archive."""
    return (case.ours is None) != (case.theirs is None) and _is_of(case, 4, AR_SEND)


def _is_of(case: Case, group: int, subfunction: int) -> bool:
    head = parse_pdu(case.octets).parameters.userdata if case.octets else None
    return head is not None and (head.group, head.subfunction) == (group, subfunction)


def record_without_names(case: Case) -> bool:
    """Whether Wireshark shows octets, as of a list it does not know, where we show fields that it has no names for."""
    if case.ours is not None or not isinstance(case.theirs, bytes) or case.place.name != RECORD_OCTETS:
        return False
    parts = parse_body(parse_pdu(case.octets)).data if case.octets else []
    own = [part for part in parts if part.offset == case.place.number and part.layout is not RECORD]
    named = [field for part in own for field in part.layout.fields if field.wireshark]
    return bool(own) and not named
