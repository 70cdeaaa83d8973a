"""Masks PDUs: removes what differs from one recording of a session to the next, such as references and sequence numbers.

Masked octets become 0; sizes and positions do not change. Masked in S7comm (reference 3.1, 4.1, 4.3): the PDU reference; the
sequence number of userdata (1 if it marks a piece of a BSEND that another piece follows, reference 4.10); the data unit
reference (1 if there is one, so that "more follows" stays); the id of an upload; the fill octet after an odd item (reference
3.5), where some devices send leftover memory; and passwords (`dissect.protocols.s7.hiding`), because a stored text must not
contain them. Masked in S7comm-plus: sequence numbers, session id, credit tick, integrity ids, digests and secrets
(docs/s7plus.md).
"""

from __future__ import annotations

from typing import Final

from dissect.protocols.s7.hiding import without_secrets
from dissect.protocols.s7.items import DATA_HEAD, parse_data_items
from dissect.protocols.s7.layouts import HEADER, USERDATA_EXTENDED, USERDATA_SHORT
from dissect.protocols.s7.parameters import ACK_HEADER_SIZE, HEADER_SIZE, PROTOCOL_ID
from dissect.protocols.s7.tables import (
    ACK_DATA,
    CPU_SERVICES,
    END_UPLOAD,
    GROUP_PBC,
    JOB,
    PARAMETER_EXTENDED,
    PARAMETER_SHORT,
    READ_VAR,
    START_UPLOAD,
    UPLOAD,
    USERDATA,
    WRITE_VAR,
)
from dissect.protocols.s7.transfer import UPLOAD_HEAD
from dissect.protocols.s7plus.hiding import shown_answer, shown_contents
from dissect.protocols.s7plus.layouts import DIGEST, INTEGRITY_ID
from dissect.protocols.s7plus.layouts import NOTIFICATION as NOTIFICATION_HEAD
from dissect.protocols.s7plus.layouts import REQUEST as REQUEST_HEAD
from dissect.protocols.s7plus.layouts import RESPONSE as RESPONSE_HEAD
from dissect.protocols.s7plus.message import PlusPdu, parse_plus
from dissect.protocols.s7plus.tables import NOTIFICATION, REQUEST, V1
from dissect.testing.golden import usual
from dissect.wire.layout import HOLDS_REFERENCE

# Positions of references: (begin, end), relative to the beginning of each structure.
_HEADER: Final = HEADER.places(HOLDS_REFERENCE)
_UPLOAD: Final = UPLOAD_HEAD.places(HOLDS_REFERENCE)
_PLUS_REQUEST: Final = REQUEST_HEAD.places(HOLDS_REFERENCE)
_PLUS_RESPONSE: Final = RESPONSE_HEAD.places(HOLDS_REFERENCE)
_PLUS_NOTIFICATION: Final = NOTIFICATION_HEAD.places(HOLDS_REFERENCE)
#: The bit of a variable-size number that marks a following octet.
_MORE: Final = 0x80
_PARAM_LENGTH: Final = 6
# Positions in a userdata PDU, header included: function, syntax, type and group, sequence, data unit reference.
_FUNCTION: Final = HEADER_SIZE
_SYNTAX: Final = HEADER_SIZE + 4
_TYPE_AND_GROUP: Final = HEADER_SIZE + 5
SEQUENCE, DATA_UNIT = (HEADER_SIZE + begin for begin, _ in USERDATA_EXTENDED.places(HOLDS_REFERENCE))
#: The two halves of the octet with type and group, and the type of an answer.
_TYPE: Final = 0xC0
_GROUP: Final = 0x3F
_RESPONSE: Final = 0x80
_READ: Final = bytes((READ_VAR,))
_WRITE: Final = bytes((WRITE_VAR,))
_UPLOADS: Final = (bytes((UPLOAD,)), bytes((END_UPLOAD,)))
_STARTS: Final = bytes((START_UPLOAD,))


def _clear(octets: bytearray, places: list[tuple[int, int]], at: int = 0) -> None:
    """Clear the references of a structure that begins ``at``, as far as the PDU reaches."""
    for begin, end in places:
        if at + end <= len(octets):
            octets[at + begin : at + end] = bytes(end - begin)


def mask_s7(octets: bytes) -> bytes:
    """Return an S7 PDU without its references and passwords; one too short for a header is returned unchanged. Never raises."""
    if len(octets) < HEADER_SIZE or octets[0] != PROTOCOL_ID:
        return octets
    made = usual.masked(octets)
    if made is not None:
        return made
    rosctr = octets[1]
    at = ACK_HEADER_SIZE if rosctr == ACK_DATA else HEADER_SIZE
    function = octets[at : at + 1] if len(octets) > at else b""  # compiled, no slice may begin behind the end
    if rosctr == USERDATA or function not in (_READ, _WRITE):
        octets = without_secrets(octets)
    masked = bytearray(octets)
    _clear(masked, _HEADER)
    if rosctr == USERDATA:
        _mask_userdata(masked, octets)
    elif (function == _READ and rosctr == ACK_DATA) or (function == _WRITE and rosctr == JOB):
        _mask_fills(masked, octets)
    elif (rosctr == JOB and function in _UPLOADS) or (rosctr == ACK_DATA and function == _STARTS):
        _clear(masked, _UPLOAD, at)
    return bytes(masked)


def _mask_fills(masked: bytearray, octets: bytes) -> None:
    """Clear the fill octets of a read answer or a write."""
    head = HEADER_SIZE if octets[1] == JOB else ACK_HEADER_SIZE
    count = octets[head + 1] if len(octets) > head + 1 else 0
    if count > 1:
        at = head + int.from_bytes(octets[_PARAM_LENGTH : _PARAM_LENGTH + 2], "big")
        for item in parse_data_items(octets, at, len(octets), count, octets[1] == ACK_DATA, [])[:-1]:
            end = int(item.offset) + DATA_HEAD + len(item.data)
            if len(item.data) & 1 and end < len(masked):
                masked[end] = 0


def _mask_userdata(masked: bytearray, octets: bytes) -> None:
    size = int.from_bytes(octets[_PARAM_LENGTH : _PARAM_LENGTH + 2], "big")
    if size >= USERDATA_SHORT.size and len(octets) > SEQUENCE and octets[_FUNCTION] == CPU_SERVICES:
        syntax = octets[_SYNTAX]
        if syntax in {PARAMETER_SHORT, PARAMETER_EXTENDED}:
            goes_on = octets[_TYPE_AND_GROUP] & _GROUP == GROUP_PBC and octets[SEQUENCE] and not _answers(octets)
            masked[SEQUENCE] = 1 if goes_on else 0
        extended = syntax == PARAMETER_EXTENDED and size >= USERDATA_EXTENDED.size
        if extended and len(octets) > DATA_UNIT and octets[DATA_UNIT]:
            masked[DATA_UNIT] = 1


def _answers(octets: bytes) -> bool:
    return octets[_TYPE_AND_GROUP] & _TYPE == _RESPONSE


def mask_plus_answer(octets: bytes, request: bytes) -> bytes:
    """Return `mask_plus` of an answer; if its request reads an attribute that must not be shown, without the values."""
    masked = bytearray(mask_plus(octets))
    if octets and request:
        for begin, end in shown_answer(parse_plus(octets), parse_plus(request))[1]:
            masked[begin:end] = bytes(end - begin)
    return bytes(masked)


def mask_plus(octets: bytes) -> bytes:
    """Return an S7comm-plus PDU (its frames one after another) without counters and digests. Never raises."""
    pdu = parse_plus(octets)
    masked = bytearray(octets)
    for begin, end in pdu.digest_places:
        masked[begin:end] = bytes(end - begin)
    if pdu.opcode == NOTIFICATION and pdu.version != V1:
        if pdu.credit_tick >= 0:
            _clear_data(masked, pdu, _PLUS_NOTIFICATION)
            begin = end = NOTIFICATION_HEAD.size
            while end < len(pdu.data) and end < begin + 4 and pdu.data[end] & _MORE:
                end += 1
            _clear_data(masked, pdu, [(begin, end + 1)], _MORE)
    elif pdu.sequence >= 0:
        request = pdu.opcode == REQUEST and pdu.session_id >= 0
        _clear_data(masked, pdu, _PLUS_REQUEST if request else _PLUS_RESPONSE)
    contents, secrets = shown_contents(pdu)
    for part in contents.parts:
        if part.layout is INTEGRITY_ID:
            _clear_data(masked, pdu, [(part.offset, part.end)], _MORE)
        elif part.layout is DIGEST:
            _clear_data(masked, pdu, [(part.offset + 1, part.end)])
    for begin, end in secrets:
        masked[begin:end] = bytes(end - begin)
    return bytes(masked)


def _clear_data(masked: bytearray, pdu: PlusPdu, places: list[tuple[int, int]], kept: int = 0) -> None:
    """Clear data of a PDU across its frames, except for the bits ``kept``."""
    for begin, end in places:
        for at in range(begin, min(end, len(pdu.data))):
            masked[pdu.place(at)] &= kept
