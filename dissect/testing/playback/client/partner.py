"""BSENDs of a PLC: those that its program sent in the recording, and the recorded answers."""

from __future__ import annotations

from collections import deque
from collections.abc import Iterable

from dissect.protocols.s7.message import parse_pdu
from dissect.protocols.s7.parameters import HEADER_SIZE, PROTOCOL_ID, REQUEST
from dissect.testing.golden.exchange import S7
from dissect.testing.golden.masking import mask_s7
from dissect.testing.golden.model import Transaction
from dissect.testing.playback.bsend import answered_piece, is_bsend


def sent_by_server(transaction: Transaction) -> bool:
    """Return whether this is a BSEND of the PLC that the client answered in the recording."""
    if transaction.asked_by != "server" or transaction.exchange.kind != S7 or not transaction.response:
        return False
    return is_bsend(parse_pdu(transaction.request), REQUEST)


def may_be_answered(octets: bytes) -> bool:
    """Return whether a message of a PLC is a well-formed BSEND without extra data."""
    if len(octets) < HEADER_SIZE or octets[0] != PROTOCOL_ID:
        return False
    pdu = parse_pdu(octets)
    return is_bsend(pdu, REQUEST) and not pdu.malformed and pdu.data_offset + pdu.data_length == len(octets)


class Sends:
    """The recorded BSENDs that a PLC may send now, each once, equal ones in recorded order."""

    def __init__(self, recorded: Iterable[Transaction]) -> None:
        self._left: dict[bytes, deque[Transaction]] = {}
        self._came: set[int] = set()
        for transaction in recorded:
            self._left.setdefault(mask_s7(transaction.request), deque()).append(transaction)

    def answer(self, request: bytes) -> bytes:
        """Return the recorded answer to a BSEND and remove it; empty if it was not recorded."""
        left = self._left.get(mask_s7(request))
        if not left:
            return b""
        recorded = left.popleft()
        self._came.add(id(recorded))
        return answered_piece(recorded.response, parse_pdu(request))

    def came(self, transaction: Transaction) -> bool:
        """Return whether the PLC has sent this recorded BSEND."""
        return id(transaction) in self._came
