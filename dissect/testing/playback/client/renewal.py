"""Adapts requests to the current connection: references, sequence numbers and upload ids are replaced."""

from __future__ import annotations

from typing import Final

from dissect.protocols.s7.layouts import PDU_REF, USERDATA_EXTENDED
from dissect.protocols.s7.message import Pdu, parse_pdu
from dissect.protocols.s7.parameters import ACK_HEADER_SIZE, HEADER_SIZE, REQUEST
from dissect.protocols.s7.tables import END_UPLOAD, JOB, START_UPLOAD, UPLOAD, USERDATA
from dissect.protocols.s7.transfer import UPLOAD_HEAD
from dissect.testing.golden.masking import DATA_UNIT, SEQUENCE
from dissect.testing.golden.model import Transaction
from dissect.wire.layout import HOLDS_REFERENCE

(_ID_BEGINS, _ID_ENDS) = UPLOAD_HEAD.places(HOLDS_REFERENCE)[0]
#: Position of the upload id in a job and in the answer that assigns it, header included.
_ASKED_ID: Final = slice(HEADER_SIZE + _ID_BEGINS, HEADER_SIZE + _ID_ENDS)
_TOLD_ID: Final = slice(ACK_HEADER_SIZE + _ID_BEGINS, ACK_HEADER_SIZE + _ID_ENDS)
_EXTENDED_END: Final = HEADER_SIZE + USERDATA_EXTENDED.size

NO_UPLOAD: Final = "there is no upload to continue"
NO_MORE: Final = "the answer before it was complete already"


class Renewal:
    """The state of one connection for adapting requests. ``pdu_length`` is negotiated, 0 before that."""

    def __init__(self) -> None:
        self.pdu_length = 0
        self._reference = 0
        self._upload_id = b""
        self._live: dict[tuple[int, int], Pdu] = {}  # the latest answer of each userdata function
        self._recorded_more: dict[tuple[int, int], bool] = {}  # for each: whether the recorded answer has more parts …
        self._sending: dict[tuple[int, int], bool] = {}  # … and whether the request has

    def reference(self) -> int:
        """Return a new reference: each number once, never 0, then from the beginning."""
        self._reference = self._reference % 0xFFFF + 1
        return self._reference

    def refusal(self, transaction: Transaction) -> str:
        """Return why a request cannot be sent now, empty if it can."""
        request = transaction.request
        if self.pdu_length and len(request) > self.pdu_length:
            return f"its {len(request)} bytes do not fit the PDU length of {self.pdu_length} that was granted"
        pdu = parse_pdu(request)
        if pdu.rosctr == JOB and pdu.function in {UPLOAD, END_UPLOAD} and not self._upload_id:
            return NO_UPLOAD
        key = _follows(pdu)
        if key is not None and self._recorded_more.get(key):
            head = self._live[key].parameters.userdata if key in self._live else None
            if head is None or not head.more:
                return NO_MORE
        return ""

    def renewed(self, request: bytes) -> tuple[int, bytes]:
        """Return the new reference of a request, and the adapted request."""
        number = self.reference()
        octets = bytearray(request)
        octets[PDU_REF] = number.to_bytes(2, "big")
        pdu = parse_pdu(request)
        if pdu.rosctr == JOB and pdu.function in {UPLOAD, END_UPLOAD} and len(octets) >= _ASKED_ID.stop:
            octets[_ASKED_ID] = self._upload_id or octets[_ASKED_ID]
        key = _follows(pdu)
        if key is not None and len(octets) >= _EXTENDED_END:
            self._continue(octets, key, number)
        return number, bytes(octets)

    def _continue(self, octets: bytearray, key: tuple[int, int], number: int) -> None:
        """Set the sequence number of a userdata request that continues another one, and the data unit reference of its parts.

        The server assigns the data unit reference of an answer in parts, the client that of a request in parts (reference 4.3,
        4.10).
        """
        head = self._live[key].parameters.userdata if key in self._live else None
        fetches = self._recorded_more.get(key, False)
        if head is not None and (fetches or self._sending.get(key, False)):
            octets[SEQUENCE] = head.sequence & 0xFF
        if octets[DATA_UNIT]:
            counted = head.data_unit_ref if fetches and head is not None else number
            octets[DATA_UNIT] = counted & 0xFF or 1

    def answered(self, transaction: Transaction, answer: bytes) -> None:
        """Take the answer to the request that was sent for a recorded transaction."""
        recorded_request, response = parse_pdu(transaction.request), parse_pdu(answer)
        if response.parameters.setup is not None and recorded_request.parameters.setup is not None:
            self.pdu_length = response.parameters.setup.pdu_length
        if recorded_request.rosctr == JOB and recorded_request.function == START_UPLOAD:
            good = response.function == START_UPLOAD and not response.error_class and len(answer) >= _TOLD_ID.stop
            self._upload_id = answer[_TOLD_ID] if good else b""
        head = recorded_request.parameters.userdata
        if recorded_request.rosctr == USERDATA and head is not None:
            key = (head.group, head.subfunction)
            self._live[key] = response
            recorded = transaction.exchange.response_pdu
            was = recorded.parameters.userdata if recorded is not None else None
            self._recorded_more[key] = was is not None and was.more
            self._sending[key] = head.more


def _follows(pdu: Pdu) -> tuple[int, int] | None:
    """Return group and subfunction of a userdata request that continues after an answer, None for any other request."""
    head = pdu.parameters.userdata
    if pdu.rosctr != USERDATA or head is None or head.type != REQUEST or not head.extended:
        return None
    return head.group, head.subfunction
