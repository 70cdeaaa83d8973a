"""More grounds (`dissect.testing.oracle.grounds`): differences within the parameters and the data of a PDU.

They depend on positions, or on services that Wireshark 4.0 reads less completely than we do or under different names.
"""

from __future__ import annotations

from typing import Final

from dissect.protocols.iso.cotp import parse_tpdu
from dissect.protocols.s7.bodies import parse_body
from dissect.protocols.s7.message import parse_pdu
from dissect.protocols.s7.services import PI_SERVICES
from dissect.protocols.s7.szl_records import RECORD
from dissect.protocols.s7.tables import AR_SEND, MESSAGE_SERVICE, READ_RECORD
from dissect.testing.oracle import facts
from dissect.testing.oracle.facts import FieldPlace
from dissect.testing.oracle.grounds import Case
from dissect.wire.part import OCTETS

#: Octets of a record that Wireshark does not read, and the prefix of the names of record fields.
RECORD_OCTETS: Final = "s7comm.param.userdata.szl_part_list"
_OF_RECORDS: Final = "s7comm.szl."
#: The argument of a PI service, and its name.
ARGUMENT: Final = "s7comm.param.pistart.argument"
_SERVICE: Final = "s7comm.param.pistart.servicename"


def argument_unknown(case: Case) -> bool:
    """Whether Wireshark shows an undocumented PI service without an argument, and we show one."""
    if case.theirs is not None or case.their_record is None or case.octets[10:11] != b"\x28":
        return False
    shown = {place.name: fact.value for place, fact in case.their_record.facts.items()}
    service = shown.get(_SERVICE)
    return isinstance(service, bytes) and ARGUMENT not in shown and service.decode("latin-1") not in PI_SERVICES


def in_parts(case: Case) -> bool:
    """Whether only we show a field of a part of an answer that more parts follow."""
    if case.theirs is not None or case.place.part != facts.IN_BODY:
        return False
    head = parse_pdu(case.octets).parameters.userdata
    return head is not None and head.last_data_unit == 1


def last_alone(case: Case) -> bool:
    """Whether only one side shows a field of the last part of an answer whose other parts Wireshark has not seen."""
    if (case.ours is None) == (case.theirs is None) or case.place.part != facts.IN_BODY or case.their_record is None:
        return False
    head = parse_pdu(case.octets).parameters.userdata
    return head is not None and head.data_unit_ref > 0 and head.last_data_unit == 0 and not case.their_record.joined


def longer_time(case: Case) -> bool:
    """Whether Wireshark's time of a clock begins two octets earlier than ours, at its reserved octet."""
    return _begins_earlier(case, 2)


def longer_count(case: Case) -> bool:
    """Whether Wireshark's count begins one octet earlier than ours, at the reserved octet."""
    return _begins_earlier(case, 1)


def _begins_earlier(case: Case, ahead: int) -> bool:
    if case.our_record is None or case.their_record is None:
        return False
    place = case.place
    if case.ours is None:
        mine, other = case.our_record.facts.get(place._replace(number=place.number + ahead)), case.theirs
        return mine is not None and isinstance(other, bytes) and len(other) > ahead and other[ahead:] == mine.value
    theirs = case.their_record.facts.get(place._replace(number=place.number - ahead))
    return theirs is not None and isinstance(theirs.value, bytes) and theirs.value[ahead:] == case.ours


def fill_of_an_item(case: Case) -> bool:
    """Whether only we show an octet after an item of odd size in the parameters, or after the last item of the data."""
    if case.theirs is not None or case.place.part != facts.IN_BODY:
        return False
    pdu = parse_pdu(case.octets)
    ends = [pdu.header_size + item.offset + len(item.octets) for item in pdu.parameters.items if len(item.octets) & 1]
    return case.place.number in ends or case.place.number == len(case.octets) - 1


def payload_as_octets(case: Case) -> bool:
    """Whether Wireshark has a name for octets that we do not interpret: a part without a structure, from first to last."""
    if case.ours is not None or case.place.part != facts.IN_BODY or not isinstance(case.theirs, bytes):
        return False
    place = (case.place.number, case.place.number + len(case.theirs))
    parts = parse_body(parse_pdu(case.octets)).data if case.octets else []
    return any(part.layout is OCTETS and (part.offset, part.end) == place for part in parts)


def records_as_octets(case: Case) -> bool:
    """Whether Wireshark shows octets where we show the fields of a record of a system status list."""
    if case.our_record is None or case.their_record is None or (case.ours is None) == (case.theirs is None):
        return False
    for place, fact in case.their_record.facts.items():
        if place.part != case.place.part or place.name != RECORD_OCTETS or not isinstance(fact.value, bytes):
            continue
        inside = range(place.number, place.number + len(fact.value))
        if case.ours is not None and case.place.number in inside:
            return True
        if case.place == place:
            ours = [one for one in case.our_record.facts if one.part == place.part and one.number in inside]
            return bool(ours) and all(one.name.startswith(_OF_RECORDS) for one in ours)
    return False


def whole_of_fields(case: Case) -> bool:
    """Whether Wireshark shows as one text several fields of ours that cover it without a gap."""
    if case.ours is not None or not isinstance(case.theirs, bytes) or case.our_record is None:
        return False
    ends: dict[int, int] = {}
    for place, fact in case.our_record.facts.items():
        if place.part == case.place.part and isinstance(fact.value, bytes):
            ends[place.number] = place.number + len(fact.value)
    at = case.place.number
    end = at + len(case.theirs)
    while at < end and at in ends:
        at = ends[at]
    return at == end


def block_header(case: Case) -> bool:
    """Whether Wireshark shows the header of a block and its code as one field; we show only the code."""
    if case.our_record is None or case.their_record is None:
        return False
    contents = [
        [(place, fact.value) for place, fact in record.facts.items() if _same_name(place, case.place)]
        for record in (case.our_record, case.their_record)
    ]
    if len(contents[0]) != 1 or len(contents[1]) != 1:
        return False
    (mine, code), (other, block) = contents[0][0], contents[1][0]
    if not isinstance(code, bytes) or not isinstance(block, bytes):
        return False
    ends_alike = mine.number + len(code) == other.number + len(block) and block.endswith(code)
    return mine.number > other.number and ends_alike and block.startswith(b"pp")


def _same_name(place: FieldPlace, other: FieldPlace) -> bool:
    return place.name == other.name and place.part == other.part


CREDIT: Final = "cotp.credit"
#: The parameter that also contains a credit.
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
    """Whether only we show count, DB number or address of an item whose area is that of data records."""
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
    """Whether Wireshark shows octets, as in an unknown list, where we show fields that it has no names for."""
    if case.ours is not None or not isinstance(case.theirs, bytes) or case.place.name != RECORD_OCTETS:
        return False
    parts = parse_body(parse_pdu(case.octets)).data if case.octets else []
    own = [part for part in parts if part.offset == case.place.number and part.layout is not RECORD]
    named = [field for part in own for field in part.layout.fields if field.wireshark]
    return bool(own) and not named
