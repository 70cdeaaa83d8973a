"""The sequence number of a BSEND, which its receiver assigns and a golden does not contain (reference 4.10).

The first piece has 0, its answer has a number, and all further pieces and answers have that number.
"""

from __future__ import annotations

from typing import Final

from dissect.protocols.s7.message import Pdu, parse_pdu
from dissect.protocols.s7.parameters import REQUEST, RESPONSE
from dissect.protocols.s7.pbc import goes_on
from dissect.protocols.s7.tables import BSEND, GROUP_PBC, USERDATA
from dissect.testing.golden.masking import SEQUENCE

_FIRST: Final = 1


def is_bsend(pdu: Pdu, type_: int) -> bool:
    """Return whether a PDU is a BSEND (``REQUEST``) or the answer to one (``RESPONSE``)."""
    head = pdu.parameters.userdata
    if pdu.rosctr != USERDATA or head is None or len(pdu.octets) <= SEQUENCE:
        return False
    return (head.type, head.group, head.subfunction) == (type_, GROUP_PBC, BSEND)


def answered_piece(answer: bytes, piece: Pdu) -> bytes:
    """Return the answer to a piece with the number of the BSEND; any other PDU unchanged."""
    head = piece.parameters.userdata
    if head is None or not is_bsend(parse_pdu(answer), RESPONSE):
        return answer
    return _numbered(answer, head.sequence or answer[SEQUENCE] or _FIRST)


def next_piece(piece: bytes, number: int) -> bytes:
    """Return a piece that continues a BSEND with the ``number`` it was given; any other PDU unchanged."""
    pdu = parse_pdu(piece)
    head = pdu.parameters.userdata
    further = is_bsend(pdu, REQUEST) and head is not None and goes_on(head)
    return _numbered(piece, number) if further and number else piece


def _numbered(octets: bytes, number: int) -> bytes:
    return octets[:SEQUENCE] + bytes((number & 0xFF,)) + octets[SEQUENCE + 1 :]
