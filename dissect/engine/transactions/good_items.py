"""Finds the values of a read without errors, as most reads are, directly in its answer, without creating results."""

from __future__ import annotations

from librt.strings import read_i32_be
from mypy_extensions import i64

from dissect.engine.transactions.results import DOUBTS
from dissect.engine.transactions.transaction import ANSWERED, Transaction
from dissect.protocols.s7.items import DATA_HEAD, Item, data_size_within, item_fill
from dissect.protocols.s7.parameters import ACK_HEADER_SIZE
from dissect.protocols.s7.tables import ACK_DATA, JOB, READ_VAR, SUCCESS


def good_octets(transaction: Transaction) -> list[bytes] | None:
    """Return the octets of each item of a read without errors; None for any other transaction."""
    if transaction.has_errors or transaction.parameters.function != READ_VAR:
        return None
    good = GoodItems()
    found: list[bytes] = []
    if good.begin(transaction):
        while good.step():
            found.append(good.buf[good.at : good.at + good.size])
    return found if good.whole else None


class GoodItems:
    """Steps over the items of a read without errors, without making an object of any item.

    Item ``index`` is ``buf[at:at + size]``. ``whole`` is True once all items were good. Not for reads with tags, items with
    several areas, and pairs that are only likely.
    """

    __slots__ = ("_end", "_items", "_judged", "_next", "at", "buf", "index", "size", "whole")

    def __init__(self) -> None:
        self.buf: bytes = b""
        self.at: i64 = 0
        self.size: i64 = 0
        self.index: i64 = -1
        self.whole: bool = False
        self._items: list[Item] = []
        self._judged: bool = False  # `check_answer` found each item good and of the requested size
        self._next: i64 = 0
        self._end: i64 = 0

    def begin(self, transaction: Transaction) -> bool:
        """Move before the first item of a transaction; return False if it cannot be a read without errors."""
        self.whole = False
        answer = transaction.response_parameters
        asked = transaction.parameters
        if (
            answer is None
            or transaction.has_errors
            or transaction._outcome != ANSWERED
            or asked.function != READ_VAR
            or answer.function != READ_VAR
            or transaction.response_rosctr != ACK_DATA
            or transaction.rosctr != JOB
            or not transaction.request_size
            or transaction.connection.naming is not None
            or answer.item_count != len(asked.items)
        ):
            return False
        flags: i64 = transaction._flags
        if flags & DOUBTS:
            return False  # every output marks or omits a pair that is only likely
        self.buf = transaction._response_buf
        self.index = -1
        self._items = asked.items
        self._judged = flags == 0
        self._next = transaction._response_offset + ACK_HEADER_SIZE + len(answer.octets)
        self._end = transaction._response_offset + transaction.response_size
        return True

    def step(self) -> bool:
        """Move to the next item; return False after the last one, and if something is wrong."""
        index: i64 = self.index + 1
        count: i64 = len(self._items)
        if index == count:
            self.whole = True
            return False
        buf = self.buf
        at: i64 = self._next
        end: i64 = self._end
        if at + DATA_HEAD > end:
            return False
        item = self._items[index]
        if item.areas is not None:
            return False
        body: i64 = at + DATA_HEAD
        size: i64 = item.size
        if size < 0 or not self._judged:
            head: i64 = i64(read_i32_be(buf, at))
            if head >> 24 & 0xFF != SUCCESS:
                return False
            size = data_size_within(head >> 16 & 0xFF, head & 0xFFFF, end - body)
            if 0 <= item.size != size:
                return False
        if body + size > end:
            return False
        self.index = index
        self.at = body
        self.size = size
        self._next = body + size + item_fill(size, index + 1 == count)
        return True
