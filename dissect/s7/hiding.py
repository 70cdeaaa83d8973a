"""Where passwords stand in an S7 PDU, so that what is shown or kept as text leaves them out.

A session password (userdata, security, reference section 4.11) is encoded in a way that hides nothing, and those of Sinumerik
services (section 3.10) are plain text.
"""

from __future__ import annotations

from typing import Final

from dissect.s7.bodies import parse_body
from dissect.s7.message import HEADER_SIZE, PROTOCOL_ID, parse_pdu
from dissect.s7.security import PASSWORD
from dissect.s7.tables import JOB, PI_SERVICE, USERDATA

#: Of a userdata PDU: the octets with type and group, and with the subfunction; and what they hold in a request.
_GROUP_AT: Final = 15
_SUBFUNCTION_AT: Final = 16
_SECURITY_REQUEST: Final = 0x45
_FUNCTION_AT: Final = 10
_DATA_HEAD: Final = 4


def secret_spans(octets: bytes) -> list[tuple[int, int]]:
    """Return (offset, end) of each password in an S7 PDU, in their order. Never raises.

    Of a session password that is everything behind the data head, whatever the lengths say.
    """
    if len(octets) <= _SUBFUNCTION_AT or octets[0] != PROTOCOL_ID:
        return []
    if octets[1] == USERDATA and octets[_GROUP_AT] == _SECURITY_REQUEST and octets[_SUBFUNCTION_AT] == PASSWORD:
        begin = HEADER_SIZE + (octets[6] << 8) + octets[7] + _DATA_HEAD
        return [(begin, len(octets))] if begin < len(octets) else []
    if octets[1] == JOB and octets[_FUNCTION_AT] == PI_SERVICE:
        spans: list[tuple[int, int]] = []
        for part in parse_body(parse_pdu(octets)).parts:
            found = part.find("password")
            if found is not None and found.end > found.offset:
                spans.append((int(found.offset), int(found.end)))
        return spans
    return []


def without_secrets(octets: bytes) -> bytes:
    """Return an S7 PDU with zeros for passwords."""
    for begin, end in secret_spans(octets):
        octets = b"".join((octets[:begin], bytes(end - begin), octets[end:]))
    return octets
