"""Finds passwords in an S7 PDU, so that displayed or stored texts omit them.

A session password (userdata, security, reference section 4.11) is only encoded, not encrypted; passwords of Sinumerik services
(section 3.10) are plain text. A wrong length must not make a password visible, so no length is trusted: if lengths and octets
do not match, everything that may be a password is hidden.
"""

from __future__ import annotations

from typing import Final

from dissect.protocols.s7.bodies import parse_body
from dissect.protocols.s7.body import Body
from dissect.protocols.s7.control import PI_PASSWORD, PI_STRING
from dissect.protocols.s7.message import Pdu, parse_pdu
from dissect.protocols.s7.parameters import HEADER_SIZE, PROTOCOL_ID
from dissect.protocols.s7.services import PI_SERVICES, SECRET
from dissect.protocols.s7.tables import JOB, PI_SERVICE, SEND_PASSWORD, USERDATA
from dissect.wire.layout import HOLDS_SECRET

#: Offsets in a userdata PDU: type and group, subfunction; and the value of the type and group in a security request.
_GROUP_AT: Final = 15
_SUBFUNCTION_AT: Final = 16
_SECURITY_REQUEST: Final = 0x45
_FUNCTION_AT: Final = 10
_DATA_HEAD: Final = 4
#: The parameter head of a request, which states its own length: 8 octets, or 12 with an error code.
_HEAD_LENGTH_AT: Final = 13
_HEADS: Final = frozenset((8, 12))
_FIRST_HEAD: Final = 8
#: Offset of the first argument of a service.
_ARGUMENTS_AT: Final = 20

_SECRET_SERVICES: Final = [name.encode() for name, service in PI_SERVICES.items() if SECRET in service.arguments]


def secret_spans(octets: bytes) -> list[tuple[int, int]]:
    """Return (offset, end) of each possible password in an S7 PDU, in order. Never raises.

    Everything after the data head of a session password counts, whatever the lengths are.
    """
    size = len(octets)
    if size <= _SUBFUNCTION_AT or octets[0] != PROTOCOL_ID:
        return []
    if octets[1] == USERDATA and octets[_GROUP_AT] == _SECURITY_REQUEST and octets[_SUBFUNCTION_AT] == SEND_PASSWORD:
        head = (octets[6] << 8) + octets[7]
        if head not in _HEADS or octets[_HEAD_LENGTH_AT] != head - 4:
            head = _FIRST_HEAD
        begin = HEADER_SIZE + head + _DATA_HEAD
        return [(begin, size)] if begin < size else []
    if octets[1] == JOB and octets[_FUNCTION_AT] == PI_SERVICE:
        pdu = parse_pdu(octets)
        return _in_service(pdu, parse_body(pdu))
    return []


def _in_service(pdu: Pdu, body: Body) -> list[tuple[int, int]]:
    """Return the password arguments of a service; return all arguments if their number does not match the service."""
    octets = pdu.octets
    arguments = [part for part in body.parts if part.layout is PI_STRING or part.layout is PI_PASSWORD]
    name = b""
    for part in body.parts:
        found = part.find("service")
        if found is not None and found.octets is not None:
            name = found.octets
    service = PI_SERVICES.get(name.decode("latin-1"))
    whole = not pdu.malformed and not body.malformed and service is not None
    if whole and service is not None and (SECRET not in service.arguments or len(arguments) == service.count):
        spans = []
        for part in arguments:
            found = part.holding(HOLDS_SECRET)
            if found is not None and found.end > found.offset:
                spans.append((int(found.offset), int(found.end)))
        return spans
    for secret in _SECRET_SERVICES:
        at = octets.find(secret, _ARGUMENTS_AT)
        if at >= 0:
            return [span for span in ((_ARGUMENTS_AT, at - 1), (at + len(secret), len(octets))) if span[0] < span[1]]
    if any([row.encode() in octets for row in PI_SERVICES]) or (name and not pdu.malformed and not body.malformed):
        return []
    return [(_ARGUMENTS_AT, len(octets))] if len(octets) > _ARGUMENTS_AT else []


def body_to_show(pdu: Pdu) -> Body:
    """Return the parts of a PDU, without the notes of parts that may contain a password."""
    body = parse_body(pdu)
    if pdu.rosctr == JOB and pdu.function == PI_SERVICE and len(pdu.octets) > _SUBFUNCTION_AT:
        spans = _in_service(pdu, body)
        for part in body.parts:
            if part.holding(HOLDS_SECRET) is None and any(
                [begin < part.end and part.offset < end for begin, end in spans]
            ):
                part.note = ""
    return body


def secret_spans_within(octets: bytes) -> list[tuple[int, int]]:
    """Return (offset, end) of each possible password, if an S7 PDU may begin anywhere in ``octets``."""
    at = octets.find(PROTOCOL_ID)
    while at >= 0:
        spans = secret_spans(octets[at:])
        if spans:
            return [(begin + at, end + at) for begin, end in spans]
        at = octets.find(PROTOCOL_ID, at + 1)
    return []


def without_secrets(octets: bytes) -> bytes:
    """Return an S7 PDU with its passwords replaced by zeros."""
    for begin, end in secret_spans(octets):
        octets = b"".join((octets[:begin], bytes(end - begin), octets[end:]))
    return octets
