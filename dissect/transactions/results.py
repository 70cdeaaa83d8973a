"""What became of a request: first whether anything is wrong with its response, then item by item.

`check_answer` looks at every response. It only steps over the data items in place, because this is done for every answer,
and leaves what it saw as facts: `Transaction.flags`, `has_errors` (reference 5.1 and 7.3). What they are worth is judged in
`dissect.findings`. `read_results` and the others below join each requested item with its own answer, and are only called when
somebody looks: reads, writes (reference 3.5), subscriptions (4.7), test functions (4.8). They work on parsed parameters and
the octets of PDUs, so that a transaction and a session read from a file say the same.
"""

from __future__ import annotations

import struct
from typing import TYPE_CHECKING, Final

from mypy_extensions import i64

from dissect.s7.items import DATA_HEAD, DataItem, Item, data_size_within, parse_data_items, parse_items, walk_areas
from dissect.s7.parameters import HEADER_SIZE, PUSH, REQUEST, Parameters, UserdataHead
from dissect.s7.tables import (
    ACK,
    ACK_DATA,
    ANSWER_TRANSPORT_SIZE,
    GROUP_CYCLIC,
    GROUP_TEST,
    READ_VAR,
    RECORD_AREA,
    S7ANY,
    SETUP_COMMUNICATION,
    SUCCESS,
    USERDATA,
    WRITE_VAR,
)
from dissect.s7.values import Value, decode_value
from dissect.s7.watched_items import ADDRESS_SIZE, parse_test_items
from dissect.s7plus.parameters import PlusParameters
from dissect.s7plus.refusals import answered, notifies_refusal
from dissect.s7plus.tables import ERRORS, refuses
from dissect.transactions.payloads import ScdParameters
from dissect.wire.build import COMPILED
from dissect.wire.malformed import Malformed
from dissect.wire.octets import u16

if TYPE_CHECKING:
    from dissect.transactions.transaction import Transaction

# Facts about a transaction (`Transaction.flags`).
FUNCTION_MISMATCH: Final = 1
COUNT_MISMATCH: Final = 2
SIZE_MISMATCH: Final = 4
REORDERED: Final = 8
BAD_DATA: Final = 16
EXPECTED: Final = 32  # a half is missing, and no wonder: mid-stream start, one direction only, or a hole
BAD_REQUEST: Final = 64
WRITE_SIZE: Final = 128  # data of a write have another size than their item
NOT_LOADED: Final = 512  # a block is activated that was not loaded on this connection
STRAY_PUSH: Final = 1024  # a push that belongs to no subscription of this connection
ODD_DATA_CODE: Final = 256  # data of a read came with a different transport size from what CPUs answer with
UNCONFIRMED: Final = 2048  # the good answer to a write lacks return codes
STILL_OPEN: Final = 4096  # the capture ended before the answer was due, so that nothing is wrong

_HEAD: Final = struct.Struct(">BBH")


def check_answer(transaction: Transaction, parameters: Parameters, data_at: i64) -> None:
    """Look for errors and contradictions in an answer; ``data_at`` is where its data block begins."""
    buf = transaction.response_buf
    at: i64 = transaction.response_offset
    end: i64 = at + transaction.response_size
    if transaction.response_rosctr >= USERDATA:
        head = parameters.userdata
        if head is not None and head.error_code:
            transaction.error_code = head.error_code
            transaction.has_errors = True
        elif transaction.response_rosctr > USERDATA:
            check_other_answer(transaction)
        return
    code: i64 = u16(buf, at + 10)
    if code:
        transaction.error_code = code
        transaction.has_errors = True
    function: i64 = transaction.parameters.function
    if parameters.function != function or transaction.response_rosctr != ACK_DATA:
        return  # an Ack, or an answer to something else
    if function == READ_VAR:
        if parameters.item_count >= 0 and not (code and data_at == end):
            _check_read(transaction, parameters.item_count, buf, data_at, end)
    elif function == WRITE_VAR:
        if parameters.item_count >= 0 and not (code and data_at == end):
            _check_write(transaction, parameters.item_count, buf, data_at, end)
    elif function == SETUP_COMMUNICATION:
        setup = parameters.setup
        if setup is not None and code == 0:
            transaction.connection.grant(setup, transaction.asked_by)


def check_other_answer(transaction: Transaction) -> None:
    """Look at the return value of an S7comm-plus answer, or what an SCD message says of itself.

    In S7comm-plus a negative value, or a partial error, is an error; in SCD an abort or a negative ``scd_err_t``.
    """
    told = transaction.response_parameters
    if isinstance(told, ScdParameters):
        transaction.error_code = told.err
        transaction.has_errors = told.refused
        return
    code, refused = answered(transaction.response_octets)
    if refused:
        transaction.has_errors = True
        if refuses(code):
            transaction.error_code = code


def check_notification(transaction: Transaction) -> None:
    """Look whether an S7comm-plus notification refuses items of its subscription."""
    if transaction.is_plus and notifies_refusal(transaction.response_octets):
        transaction.has_errors = True


def _check_read(transaction: Transaction, count: i64, buf: bytes, at: i64, end: i64) -> None:
    """Step through the data items of a read answer: return codes, sizes against the request, octets against the block."""
    items = transaction.parameters.items
    asked: i64 = transaction.parameters.item_count
    if count != asked and not transaction.parameters.malformed:  # what a broken request asks for nobody can say
        transaction.flags |= COUNT_MISMATCH
    known: i64 = len(items)
    index: i64 = 0
    size: i64 = 0
    while index < count:
        if at + 4 > end:
            transaction.flags |= BAD_DATA
            return
        return_code: i64
        transport_size: i64
        length: i64
        if COMPILED:
            return_code = buf[at]
            transport_size = buf[at + 1]
            length = u16(buf, at + 2)
        else:
            return_code, transport_size, length = _HEAD.unpack_from(buf, at)
        at += 4
        if return_code == SUCCESS:
            size = data_size_within(transport_size, length, end - at)
            if index < known:
                wanted: i64 = items[index].size
                if wanted != size and wanted >= 0:
                    transaction.flags |= SIZE_MISMATCH
                elif wanted < 0:
                    _check_areas(transaction, items[index], buf, at, min(at + size, end))
        else:
            size = 0
            transaction.has_errors = True
        index += 1
        at += size
        if size & 1 and index < count:
            at += 1
    if at != end and not (at + 1 == end and size & 1):
        transaction.flags |= BAD_DATA


def _check_areas(transaction: Transaction, item: Item, buf: bytes, at: i64, end: i64) -> None:
    """Look at the return codes of the areas in the answer to a DBREAD item."""
    areas = item.areas
    if areas is None or not areas:
        return
    told = walk_areas(areas, buf[at:end])
    if not told:
        transaction.flags |= SIZE_MISMATCH
    for area in told:
        if area.return_code != SUCCESS:
            transaction.has_errors = True


def _check_write(transaction: Transaction, count: i64, buf: bytes, at: i64, end: i64) -> None:
    """Look at the return codes of a write answer: one octet for each item."""
    if end - at < transaction.parameters.item_count and transaction.error_code == 0:
        transaction.flags |= UNCONFIRMED
        transaction.has_errors = True
    if count != transaction.parameters.item_count and not transaction.parameters.malformed:
        transaction.flags |= COUNT_MISMATCH
    if end - at != count:
        transaction.flags |= BAD_DATA
    while at < end:
        if buf[at] != SUCCESS:
            transaction.has_errors = True
        at += 1


def mismatch(request: Parameters, answer: Parameters) -> bool:
    """Return whether an answer names something else than its request: the function, for userdata group and subfunction.

    For SCD it is the service and the object it is about.
    """
    if answer.function < 0:
        return False  # an Ack without parameters
    asked = request.userdata
    told = answer.userdata
    if isinstance(answer, ScdParameters):
        return request.function != answer.function or not (
            isinstance(request, ScdParameters) and request.index == answer.index and request.sub == answer.sub
        )
    if isinstance(answer, PlusParameters):
        return request.function != answer.function and answer.code not in ERRORS
    if asked is not None and told is not None:
        return asked.group != told.group or asked.subfunction != told.subfunction
    return request.function != answer.function


def check_written(parameters: Parameters, buf: bytes, at: i64, size: i64) -> i64:
    """Check the data block of a write request against its items; return flags. Errors in its lengths were reported already."""
    data_at: i64 = at + HEADER_SIZE + len(parameters.octets)
    if parameters.malformed or data_at + u16(buf, at + 8) != at + size:
        return 0
    told: list[Malformed] = []
    written = parse_data_items(buf, data_at, at + size, parameters.item_count, False, told)
    if told:
        return BAD_REQUEST
    items = parameters.items
    for index in range(len(written)):
        wanted: i64 = items[index].size
        if wanted >= 0 and wanted != len(written[index].data):
            return WRITE_SIZE
    return 0


def check_data_codes(transaction: Transaction) -> None:
    """Compare the transport sizes of a read answer with those CPUs answer with, for each distinct request once.

    A request of which every item was refused is looked at again with its next answer.
    """
    if transaction.response_rosctr != ACK_DATA or transaction.flags & (COUNT_MISMATCH | BAD_DATA | FUNCTION_MISMATCH):
        return
    for result in transaction.results():
        item = result.item
        answer = result.answer
        if item is not None and answer is not None and answer.return_code == SUCCESS:
            transaction.parameters.answer_unjudged = False
            if odd_data_code(item, answer):
                transaction.flags |= ODD_DATA_CODE


def odd_data_code(item: Item, answer: DataItem) -> bool:
    """Return whether a good data item has another transport size than CPUs answer its request item with (reference 3.5)."""
    if item.syntax_id != S7ANY or item.area == RECORD_AREA:
        return False
    expected: int = ANSWER_TRANSPORT_SIZE.get(item.transport_size, -1)
    return expected >= 0 and expected != answer.transport_size


def error_code(rosctr: i64, octets: bytes, parameters: Parameters) -> i64:
    """Return the error an answer carries: header class and code, or the userdata error code; 0 for none."""
    head = parameters.userdata
    if head is not None:
        return head.error_code
    if (rosctr == ACK or rosctr == ACK_DATA) and len(octets) >= 12:
        return u16(octets, 10)
    return 0


#: Subfunctions of the cyclic services that have items: cyclic transfer, change driven transfer, its modification.
CYCLIC_ITEMS: Final = frozenset((0x01, 0x05, 0x07))
VARIABLE_STATUS: Final = 0x02
#: Test functions that write: modify variable and force.
TEST_WRITES: Final = frozenset((0x08, 0x09))
TEST_ITEMS: Final = frozenset((VARIABLE_STATUS, *TEST_WRITES))

#: Return code in a push: the value has not changed since the last one (reference 4.7).
UNCHANGED: Final = 0xFE

#: Octets before the items: reserved, count, time base and factor in a request, reserved and count in what is sent.
_ASKED_HEAD: Final = 4
_SENT_HEAD: Final = 2
_TEST_SIZES: Final = 4


class ItemResult:
    """An item of the request joined with its own answer (either may be missing).

    ``return_code`` is -1 when there is no answer; ``data`` the octets read or written, None when there are none.
    ``decodable``: ``data`` has the size that the item asked for, so that ``value`` can be decoded.
    ``unchanged``: a push says that the value is the one it sent before.
    """

    __slots__ = ("answer", "data", "item", "return_code", "unchanged")

    def __init__(self, item: Item | None, return_code: i64, data: bytes | None, answer: DataItem | None) -> None:
        self.item: Item | None = item
        self.return_code: i64 = return_code
        self.data: bytes | None = data
        self.answer: DataItem | None = answer
        self.unchanged: bool = False

    def __repr__(self) -> str:
        return f"ItemResult({self.item!r}, {self.return_code}, {self.data!r})"

    @property
    def refused(self) -> bool:
        """True when there is an answer and it is not success."""
        return self.return_code != -1 and self.return_code != SUCCESS and not self.unchanged

    @property
    def decodable(self) -> bool:
        """True when there are octets of the size the item asked for (see `Item.fits`)."""
        item = self.item
        data = self.data
        return item is not None and data is not None and item.fits(len(data))

    @property
    def value(self) -> Value:
        """The decoded value, None when there is none (see `decode_value`)."""
        item = self.item
        data = self.data
        if item is None or data is None or not self.decodable:
            return None
        return decode_value(item.transport_size, data)


class Subscription:
    """What a job was asked to send: its items, and the PDU that named them; ``head`` is that of its parameters."""

    __slots__ = ("head", "items", "request")

    def __init__(self, head: UserdataHead, request: bytes) -> None:
        self.head: UserdataHead = head
        self.items: list[Item] = requested_items(head, request)
        self.request: bytes = request

    @property
    def written(self) -> list[DataItem]:
        """The values that the items were modified or forced to, read from the request at each call; none for other jobs."""
        return _test_values(self.head, self.request, len(self.items)) if self.head.group == GROUP_TEST else []


def read_results(items: list[Item], answers: list[DataItem]) -> list[ItemResult]:
    """Join the items of a read with the data items of its answer; a DBREAD item is one result for each of its areas."""
    results: list[ItemResult] = []
    for index in range(max(len(items), len(answers))):
        item = items[index] if index < len(items) else None
        answer = answers[index] if index < len(answers) else None
        if item is not None and item.areas is not None:
            results.extend(area_results(item, answer))
        elif answer is None:
            results.append(ItemResult(item, -1, None, None))
        else:
            results.append(_result(item, answer))
    return results


def _result(item: Item | None, answer: DataItem) -> ItemResult:
    return ItemResult(item, answer.return_code, answer.data if answer.return_code == SUCCESS else None, answer)


def area_results(item: Item, answer: DataItem | None) -> list[ItemResult]:
    """Return a DBREAD item area by area, each with its own return code; as one where it was refused or does not fit."""
    areas = item.areas
    if areas is None:
        return [_result(item, answer)] if answer is not None else [ItemResult(item, -1, None, None)]
    if answer is None:
        return [ItemResult(area, -1, None, None) for area in areas]
    told = walk_areas(areas, answer.data) if answer.return_code == SUCCESS else []
    if not told:
        return [_result(item, answer)]
    return [_result(area, told[index]) for index, area in enumerate(areas)]


def write_results(items: list[Item], written: list[DataItem], codes: list[int]) -> list[ItemResult]:
    """Join the items of a write with the values it carried and the return codes of its answer."""
    results: list[ItemResult] = []
    for index in range(max(len(items), len(codes))):
        item = items[index] if index < len(items) else None
        data_item = written[index] if index < len(written) else None
        code = codes[index] if index < len(codes) else -1
        results.append(ItemResult(item, code, data_item.data if data_item is not None else None, data_item))
    return results


def has_items(head: UserdataHead) -> bool:
    """Return whether a userdata PDU is about items: of a cyclic service or of a test function on variables."""
    if head.group == GROUP_CYCLIC:
        return head.subfunction in CYCLIC_ITEMS
    return head.group == GROUP_TEST and head.subfunction in TEST_ITEMS


def _payload(octets: bytes) -> bytes:
    """Return the payload of a userdata PDU, behind the head of its data block; empty when there is none."""
    if len(octets) < HEADER_SIZE:
        return b""
    at: i64 = HEADER_SIZE + u16(octets, 6)
    if at + DATA_HEAD > len(octets):
        return b""
    return octets[at + DATA_HEAD : at + DATA_HEAD + u16(octets, at + 2)]


def _test_data(payload: bytes) -> bytes:
    """Return the data block of a programmer command, behind its sizes and parameter block."""
    if len(payload) < _TEST_SIZES:
        return b""
    at: i64 = _TEST_SIZES + u16(payload, 0)
    return payload[at : at + u16(payload, 2)]


def requested_items(head: UserdataHead, octets: bytes) -> list[Item]:
    """Return the items that a request of a cyclic service or test function names; ``octets`` is the PDU."""
    if head.type != REQUEST or head.data_unit_ref or not has_items(head):
        return []
    payload = _payload(octets)
    if head.group == GROUP_CYCLIC:
        if len(payload) < _ASKED_HEAD:
            return []
        return parse_items(payload, _ASKED_HEAD, len(payload), payload[1], [])
    return parse_test_items(_test_data(payload))


def userdata_results(
    asked: Parameters | None, request: bytes, told: Parameters | None, response: bytes, subscribed: list[Item] | None
) -> list[ItemResult]:
    """Join the items of a cyclic service or test function with their values.

    ``request`` and ``response`` are PDUs, empty where there is none, with their parameters. A push has no request: its items
    are those that were ``subscribed``; where these are not known its values stand without addresses.
    """
    asks = asked.userdata if asked is not None and request else None
    tells = told.userdata if told is not None and response else None
    items = subscribed if subscribed is not None else []
    if asks is not None:
        items = requested_items(asks, request)
    if asks is not None and asks.group == GROUP_TEST:
        return write_results(items, _test_values(asks, request, len(items)), [])
    if tells is None or tells.type == REQUEST or not has_items(tells) or tells.more or tells.continues:
        return read_results(items, [])
    payload = _payload(response)
    if tells.group == GROUP_CYCLIC:
        if len(payload) < _SENT_HEAD:
            return read_results(items, [])
        results = read_results(items, parse_data_items(payload, _SENT_HEAD, len(payload), payload[1], True, []))
    else:
        results = _test_results(tells, items, _test_data(payload))
    for result in results:
        result.unchanged = result.return_code == UNCHANGED
    return results


def _test_values(head: UserdataHead, request: bytes, count: int) -> list[DataItem]:
    """Return the values that a request to modify or force variables carries behind their addresses."""
    if head.subfunction not in TEST_WRITES or not count:
        return []
    data = _test_data(_payload(request))
    return parse_data_items(data, _SENT_HEAD + ADDRESS_SIZE * count, len(data), count, False, [])


def _test_results(head: UserdataHead, items: list[Item], data: bytes) -> list[ItemResult]:
    """Return what a push of a test function says: values, or the return codes of what was written."""
    if head.type != PUSH or len(data) < _SENT_HEAD:
        return read_results(items, [])
    count: i64 = u16(data, 0)
    if head.subfunction == VARIABLE_STATUS:
        return read_results(items, parse_data_items(data, _SENT_HEAD, len(data), count, True, []))
    return write_results(items, [], list(data[_SENT_HEAD : _SENT_HEAD + count]))
