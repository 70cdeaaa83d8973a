"""Userdata PDUs from their payloads, and the conditions for every parser of a payload (reference sections 4.1 and 4.2)."""

from __future__ import annotations

from dissect.protocols.s7.bodies import parse_body
from dissect.protocols.s7.body import Body
from dissect.protocols.s7.message import parse_pdu
from dissect.protocols.s7.parameters import PUSH, REQUEST, RESPONSE
from dissect.wire.malformed import LIMITS, REASONS
from dissect.wire.part import SURPLUS, Part
from tests.build import USERDATA, data_item, pdu, userdata_head

#: Octets of header and extended parameters, and of the data head before the payload.
AHEAD = 10 + 12 + 4


def userdata(
    kind: int, group: int, subfunction: int, payload: str, sequence: int = 0, unit: int = 0, last: int = 0
) -> bytes:
    """Return a userdata PDU with this payload (hexadecimal digits, blanks are ignored) and an extended head."""
    octets = bytes.fromhex(payload)
    return pdu(USERDATA, 1, userdata_head(kind, group, subfunction, sequence, unit, last), data_item(0xFF, 9, octets))


def body(octets: bytes) -> Body:
    """Return the body of a PDU, after checking that its parts cover it without gaps."""
    pdu = parse_pdu(octets)
    found = parse_body(pdu)
    at = min(pdu.header_size, len(octets))
    for part in found.parts:
        assert part.offset == at
        assert part.end > at
        for before, after in zip(part.values, part.values[1:], strict=False):
            assert after.offset in {before.end, before.offset}
        at = part.end
    assert at == min(pdu.data_offset + max(pdu.data_length, 0), len(octets)) or at == len(octets)
    for fault in found.malformed:
        assert fault.reason in REASONS
        assert fault.limit in LIMITS
    return found


def payload_parts(found: Body) -> list[Part]:
    """Return the parts of the payload, without the data head."""
    return found.data[1:]


def names(found: Body) -> list[str]:
    """Return the names of the payload's parts."""
    return [part.layout.name for part in payload_parts(found)]


def stands_cuts(octets: bytes) -> None:
    """Check that a PDU is parsed correctly when it ends after each octet, and when its payload does."""
    for size in range(len(octets)):
        body(octets[:size])
    kind, group, subfunction = octets[15] >> 6, octets[15] & 0x3F, octets[16]
    payload = octets[AHEAD:]
    for size in range(len(payload)):
        body(userdata(kind, group, subfunction, payload[:size].hex(), octets[17], octets[18], octets[19]))


def trailing(octets: bytes) -> Body:
    """Return the body of a PDU with two octets more in its payload."""
    kind, group, subfunction = octets[15] >> 6, octets[15] & 0x3F, octets[16]
    return body(userdata(kind, group, subfunction, octets[AHEAD:].hex() + "beef", octets[17], octets[18], octets[19]))


def has_surplus(found: Body) -> bool:
    """Return whether octets were left over, which must be reported."""
    surplus = [part for part in found.parts if part.layout is SURPLUS]
    assert not surplus or any(fault.reason == "trailing_octets" for fault in found.malformed)
    return bool(surplus)


__all__ = [
    "PUSH",
    "REQUEST",
    "RESPONSE",
    "body",
    "has_surplus",
    "names",
    "payload_parts",
    "stands_cuts",
    "trailing",
    "userdata",
]
