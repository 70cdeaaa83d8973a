"""PDUs without what differs from one recording of the same session to the next: reference and sequence numbers.

What is masked is 0 afterwards; nothing changes its size or place. Of S7comm (reference 3.1, 4.1, 4.3): the PDU reference, the
sequence number of userdata (1 where it says that a piece of a BSEND goes on with another, reference 4.10), the data unit
reference (1 where there is one, so that "more follows" stays), the id of an upload; the fill octet behind an odd item
(reference 3.5), where some devices leave what was in memory; and passwords (`dissect.s7.hiding`), which a text that is kept
must not hold. Of S7comm-plus: sequence numbers, session id, credit tick, integrity ids, digests and secrets
(docs/s7plus.md).
"""

from __future__ import annotations

from typing import Final

from dissect.s7.hiding import without_secrets
from dissect.s7.items import DATA_HEAD, parse_data_items
from dissect.s7.parameters import ACK_HEADER_SIZE, GROUP_PBC, HEADER_SIZE, PROTOCOL_ID
from dissect.s7.tables import (
    ACK_DATA,
    CPU_SERVICES,
    END_UPLOAD,
    JOB,
    READ_VAR,
    START_UPLOAD,
    UPLOAD,
    USERDATA,
    WRITE_VAR,
)
from dissect.s7plus.hiding import shown_contents
from dissect.s7plus.layouts import DIGEST, INTEGRITY_ID
from dissect.s7plus.message import DIGEST_SIZE, parse_plus
from dissect.s7plus.tables import NOTIFICATION, REQUEST, V1, V3

_REFERENCE: Final = slice(4, 6)
_NONE: Final = bytes(2)
_PARAM_LENGTH: Final = slice(6, 8)
# Of a userdata PDU, header included: function, syntax, sequence, data unit reference.
_FUNCTION: Final = 10
_SYNTAX: Final = 14
_TYPE_AND_GROUP: Final = 15
_SEQUENCE: Final = 17
_DATA_UNIT: Final = 18
#: Bits of the octet with both, and an answer in those of the type.
_TYPE: Final = 0xC0
_GROUP: Final = 0x3F
_RESPONSE: Final = 0x80
_SHORT: Final = 0x11
_EXTENDED: Final = 0x12
_ACK_FUNCTION: Final = 12
#: Octets from the function to the id of an upload, and its size.
_UPLOAD_ID_AT: Final = 4
_UPLOAD_ID: Final = 4
_PLUS_HEADER: Final = 4
_READ: Final = bytes((READ_VAR,))
_WRITE: Final = bytes((WRITE_VAR,))


def mask_s7(octets: bytes) -> bytes:
    """Return an S7 PDU without its references and passwords; what is too short for a header stays as it is. Never raises."""
    if len(octets) < HEADER_SIZE or octets[0] != PROTOCOL_ID:
        return octets
    rosctr = octets[1]
    octets = without_secrets(octets)
    if rosctr == USERDATA:
        return _mask_userdata(octets)
    at = -1
    function = octets[_ACK_FUNCTION : _ACK_FUNCTION + 1] if rosctr == ACK_DATA else octets[_FUNCTION : _FUNCTION + 1]
    if (function == _READ and rosctr == ACK_DATA) or (function == _WRITE and rosctr == JOB):
        return _mask_fills(octets)
    if rosctr == JOB and len(octets) > _FUNCTION and octets[_FUNCTION] in {UPLOAD, END_UPLOAD}:
        at = _FUNCTION + _UPLOAD_ID_AT
    elif rosctr == ACK_DATA and len(octets) > _ACK_FUNCTION and octets[_ACK_FUNCTION] == START_UPLOAD:
        at = _ACK_FUNCTION + _UPLOAD_ID_AT
    if at >= 0 and len(octets) >= at + _UPLOAD_ID:
        return b"".join((octets[:4], _NONE, octets[6:at], bytes(_UPLOAD_ID), octets[at + _UPLOAD_ID :]))
    return b"".join((octets[:4], _NONE, octets[6:]))


def _mask_fills(octets: bytes) -> bytes:
    """Return a read answer or a write without reference and fill octets."""
    masked = bytearray(octets)
    masked[_REFERENCE] = _NONE
    head = HEADER_SIZE if octets[1] == JOB else ACK_HEADER_SIZE
    count = octets[head + 1] if len(octets) > head + 1 else 0
    if count > 1:
        at = head + int.from_bytes(octets[_PARAM_LENGTH], "big")
        for item in parse_data_items(octets, at, len(octets), count, octets[1] == ACK_DATA, [])[:-1]:
            end = int(item.offset) + DATA_HEAD + len(item.data)
            if len(item.data) & 1 and end < len(masked):
                masked[end] = 0
    return bytes(masked)


def _mask_userdata(octets: bytes) -> bytes:
    masked = bytearray(octets)
    masked[_REFERENCE] = _NONE
    size = int.from_bytes(octets[_PARAM_LENGTH], "big")
    if size >= 8 and len(octets) > _SEQUENCE and octets[_FUNCTION] == CPU_SERVICES:
        syntax = octets[_SYNTAX]
        if syntax in {_SHORT, _EXTENDED}:
            goes_on = octets[_TYPE_AND_GROUP] & _GROUP == GROUP_PBC and octets[_SEQUENCE] and not _answers(octets)
            masked[_SEQUENCE] = 1 if goes_on else 0
        if syntax == _EXTENDED and size >= 12 and len(octets) > _DATA_UNIT and octets[_DATA_UNIT]:
            masked[_DATA_UNIT] = 1
    return bytes(masked)


def _answers(octets: bytes) -> bool:
    return octets[_TYPE_AND_GROUP] & _TYPE == _RESPONSE


def mask_plus(octets: bytes) -> bytes:
    """Return an S7comm-plus PDU (its frames one behind the other) without numbers that count and digests. Never raises."""
    pdu = parse_plus(octets)
    masked = bytearray(octets)
    at = pdu.data_offset
    if pdu.version == V3:
        _mask_digests(masked)
    if pdu.opcode == NOTIFICATION and pdu.version != V1:
        if pdu.credit_tick >= 0:
            masked[at + 11] = 0
            end = at + 12
            while end < len(masked) and end < at + 17:
                more = masked[end] & 0x80
                masked[end] = more
                end += 1
                if not more:
                    break
    elif pdu.sequence >= 0:
        masked[at + 7 : at + 9] = _NONE
        if pdu.opcode == REQUEST and pdu.session_id >= 0:
            masked[at + 9 : at + 13] = bytes(4)
    found, secrets = shown_contents(pdu)
    for part in found.parts:
        if part.layout is INTEGRITY_ID or part.layout is DIGEST:
            start = pdu.place(part.offset) + (1 if part.layout is DIGEST else 0)
            end = pdu.place(part.end - 1)
            for place in range(start, end + 1):
                masked[place] &= 0x80 if part.layout is INTEGRITY_ID else 0
    for begin, end in secrets:
        masked[begin:end] = bytes(end - begin)
    return bytes(masked)


def _mask_digests(octets: bytearray) -> None:
    at = 0
    while at + _PLUS_HEADER < len(octets):
        length = int.from_bytes(octets[at + 2 : at + 4], "big")
        start = at + _PLUS_HEADER
        if length > DIGEST_SIZE and octets[start] == DIGEST_SIZE and start + DIGEST_SIZE < len(octets):
            octets[start + 1 : start + 1 + DIGEST_SIZE] = bytes(DIGEST_SIZE)
        at = start + length
