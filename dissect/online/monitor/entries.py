"""`Entry`: a transaction, operation or SCD message in the rolling list, with the octets that its details need.

A transaction from the pipeline refers to the buffer into which its packets were read, which may be a large piece of a capture.
Entries have copies of only their own octets, and are bounded all together.
"""

from __future__ import annotations

from collections import deque
from typing import Final

from dissect.engine.transactions.connection import Connection
from dissect.engine.transactions.operation import Operation
from dissect.engine.transactions.payloads import ScdMessage
from dissect.engine.transactions.transaction import Transaction
from dissect.protocols.ibh.packet import HEADER, LONG_HEAD, SHORT_HEAD, parse_packet
from dissect.protocols.ibh.tables import IBH_NETLINK
from dissect.protocols.iso.cotp import parse_tpdu

#: Estimated octets of memory of an entry besides those of its PDUs.
_COST: Final = 1000
#: Octets of the TPKT header and the header of a DT.
_TPKT_HEAD: Final = 7
#: Sizes of the headers before the user data of an IBH-NetLink packet: its own, and MPI's with function and number.
_IBH_HEADS: Final = (HEADER + SHORT_HEAD + 2, HEADER + LONG_HEAD + 2)

What = Transaction | Operation | tuple[ScdMessage, Connection]


class Entry:
    """An entry of the rolling list. ``order`` numbers the entries as they come; ``slow``: the answer was slow."""

    __slots__ = ("order", "slow", "time_ns", "what")

    def __init__(self, order: int, time_ns: int, what: What, slow: bool) -> None:
        self.order = order
        self.time_ns = time_ns
        self.what = what
        self.slow = slow

    @property
    def connection(self) -> Connection:
        """The connection it happened on."""
        what = self.what
        return what[1] if isinstance(what, tuple) else what.connection

    @property
    def failed(self) -> bool:
        """True for a transaction that was refused, in part or as a whole, or never answered."""
        return isinstance(self.what, Transaction) and bool(self.what.failed)

    @property
    def octets(self) -> int:
        """Its estimated size in memory."""
        what = self.what
        if isinstance(what, Transaction):
            return _COST + len(what._request_buf) + len(what._response_buf)
        if isinstance(what, Operation):
            return _COST + int(what.octets)
        return _COST + len(what[0].octets)


class Ring:
    """The latest entries: at most ``most`` of them, with at most ``most_octets``."""

    def __init__(self, most: int, most_octets: int) -> None:
        self.entries: deque[Entry] = deque()
        self.octets = 0
        self._most = most
        self._most_octets = most_octets

    def add(self, entry: Entry) -> None:
        """Add an entry; the oldest ones are dropped to make room."""
        self.entries.append(entry)
        self.octets += entry.octets
        while len(self.entries) > self._most or (self.octets > self._most_octets and len(self.entries) > 1):
            self.octets -= self.entries.popleft().octets


def detached(transaction: Transaction) -> Transaction:
    """Return a copy of a transaction with its own octets: for each PDU the packet that carries all of it, else the PDU."""
    copy = Transaction(
        transaction.number,
        transaction.connection,
        transaction.asked_by,
        transaction.rosctr,
        transaction.pdu_ref,
        transaction.parameters,
    )
    copy.request_frame = transaction.request_frame
    copy.request_ns = transaction.request_ns
    copy.response_frame = transaction.response_frame
    copy.response_ns = transaction.response_ns
    copy.response_rosctr = transaction.response_rosctr
    copy.response_parameters = transaction.response_parameters
    copy._outcome = transaction._outcome
    copy.reason = transaction.reason
    copy.error_code = transaction.error_code
    copy.has_errors = transaction.has_errors
    copy._flags = transaction._flags
    copy._carried = transaction._carried
    copy.subscribed = transaction.subscribed
    ibh = transaction.connection.protocol == IBH_NETLINK
    head = _head(transaction._request_buf, int(transaction._request_offset), int(transaction.request_size), ibh)
    start = int(transaction._request_offset)
    copy._request_buf = bytes(transaction._request_buf[start - head : start + int(transaction.request_size)])
    copy._request_offset = head
    copy.request_size = transaction.request_size
    head = _head(transaction._response_buf, int(transaction._response_offset), int(transaction.response_size), ibh)
    start = int(transaction._response_offset)
    copy._response_buf = bytes(transaction._response_buf[start - head : start + int(transaction.response_size)])
    copy._response_offset = head
    copy.response_size = transaction.response_size
    return copy


def _head(buf: bytes, offset: int, size: int, ibh: bool) -> int:
    """Return the size of the packet headers directly before a PDU; 0 if no single packet carries all of it."""
    if not size:
        return 0
    if ibh:
        for head in _IBH_HEADS:
            if (
                offset >= head
                and parse_packet(bytes(buf[offset - head : offset + size])).data == buf[offset : offset + size]
            ):
                return head
        return 0
    at = offset - _TPKT_HEAD
    if at < 0 or buf[at] != 3 or int.from_bytes(buf[at + 2 : at + 4], "big") != size + _TPKT_HEAD:
        return 0
    tpdu = parse_tpdu(bytes(buf[at + 4 : offset + size]))
    return _TPKT_HEAD if len(tpdu.data) == size and not tpdu.malformed else 0
