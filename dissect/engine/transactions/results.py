"""What is known about an answer: facts, refusals, and the items of userdata functions.

`dissect.engine.transactions.transaction` checks every answer and stores the results as facts: `Transaction._flags`,
`has_errors`. The rules in `dissect.engine.findings` judge these. `userdata_results` joins the items of subscriptions (reference
4.7) and test functions (4.8) with their values; it is called only on demand. It takes parsed parameters and the octets of PDUs,
so the result is the same for a capture and for a session file.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Final

from mypy_extensions import i64

from dissect.engine.transactions.payloads import ScdParameters
from dissect.protocols.s7.errors import errors_of
from dissect.protocols.s7.items import (
    DATA_HEAD,
    DataItem,
    Item,
    ItemResult,
    data_size_within,
    item_fill,
    parse_data_items,
    parse_items,
    read_results,
    write_results,
)
from dissect.protocols.s7.message import (
    NOT_REFUSED,
    alarm_codes,
    alarms_asked,
    answers_by_alarm,
    refusing_code,
    userdata_payload,
)
from dissect.protocols.s7.parameters import HEADER_SIZE, PUSH, REQUEST, Parameters, UserdataHead
from dissect.protocols.s7.tables import (
    ACK,
    ACK_DATA,
    GROUP_CYCLIC,
    GROUP_TEST,
    OBJECT_DOES_NOT_EXIST,
    RETURN_CODES,
    SUCCESS,
    USERDATA,
)
from dissect.protocols.s7.watched_items import ADDRESS_SIZE, parse_test_items
from dissect.protocols.s7plus.check import check
from dissect.protocols.s7plus.check_response import check_response, notifies_refusal
from dissect.protocols.s7plus.parameters import PlusParameters
from dissect.protocols.s7plus.tables import ERRORS, refuses
from dissect.protocols.s7plus.tables import RETURN_CODES as PLUS_CODES
from dissect.wire.codes import coded
from dissect.wire.copies import leaves
from dissect.wire.octets import u16, u32
from dissect.wire.text import duration_text, hex_number, printable

if TYPE_CHECKING:
    from dissect.engine.transactions.transaction import Transaction

# Facts about a transaction (`Transaction._flags`).
FUNCTION_MISMATCH: Final = 1
COUNT_MISMATCH: Final = 2
SIZE_MISMATCH: Final = 4
MISMATCHES: Final = FUNCTION_MISMATCH | COUNT_MISMATCH | SIZE_MISMATCH  # the answer does not fit the request
REORDERED: Final = 8  # the answer was captured before its request
BAD_DATA: Final = 16  # the data block of the answer does not match its items
# the capture explains why a half is missing: it begins mid-stream, has one direction only, or a gap
EXPECTED: Final = 32
BAD_REQUEST: Final = 64  # the data block of a write request does not match its items
WRITE_SIZE: Final = 128  # the data of a write have a different size from their item
NOT_LOADED: Final = 512  # activation of a block that was not loaded on this connection
STRAY_PUSH: Final = 1024  # a push that belongs to no subscription of this connection
ODD_DATA_CODE: Final = 256  # the data of a read have a different transport size from the one that CPUs use
UNCONFIRMED: Final = 2048  # the positive answer to a write has fewer return codes than items
STILL_OPEN: Final = 4096  # the capture ended before the answer was due, so nothing is wrong
GAPS: Final = 8192  # only likely: octets of both directions are missing between request and answer
ALIKE: Final = 16384  # only likely: several requests with one reference were open, and the answer matches each of them
DOUBTS: Final = GAPS | ALIKE
ASKED_JUDGED: Final = 32768  # the fault in the data of a write was reported
BEHIND: Final = 65536  # one half of it is behind the malformed header of a TPDU (dissect.engine.transactions.behind)


def went_wrong(transaction: Transaction) -> bool:
    """Return whether a transaction failed, or has an answer that does not match its request."""
    return transaction.failed or mismatches(transaction) != 0


def mismatches(transaction: Transaction) -> i64:
    """Return how an answer does not match its request (`MISMATCHES`); 0 for a pair that is only likely, so perhaps none."""
    flags: i64 = transaction._flags
    return flags & MISMATCHES if flags & DOUBTS == 0 else 0


def wants_answer(transaction: Transaction) -> bool:
    """Return whether a request needs an answer.

    In S7comm-plus it may not need one; before version 3 it is answered nevertheless.
    """
    request = transaction.plus_request
    return request is None or request.wants_response


def half_captured(transaction: Transaction) -> bool:
    """Return whether the capture explains why a half of a transaction is missing: one direction, mid-stream start, a gap."""
    return transaction._flags & EXPECTED != 0


def check_other_answer(transaction: Transaction) -> None:
    """Find errors in an answer that is not an Ack or Ack_Data: S7comm-plus, SCD, or userdata without error code.

    In S7comm-plus a negative return value or a partial error is an error, in SCD an abort or a negative ``scd_err_t``, in
    userdata the return code of an answer without its payload, or of an alarm.
    """
    told = transaction.response_parameters
    if transaction.response_rosctr == USERDATA:
        transaction.has_errors = data_code(transaction) != NOT_REFUSED or len(alarm_errors(transaction)) > 0
        return
    if isinstance(told, ScdParameters):
        transaction.error_code = told.err
        transaction.has_errors = told.refused
        return
    checked = transaction._checked = check(transaction.response_octets)
    code, refused = check_response(checked)
    if refused:
        transaction.has_errors = True
        if refuses(code):
            transaction.error_code = code


def data_code(transaction: Transaction) -> i64:
    """Return the return code by which a userdata answer refuses the whole request; `NOT_REFUSED` for none."""
    told = transaction.response_parameters
    head = told.userdata if told is not None else None
    if head is None or transaction.response_rosctr != USERDATA:
        return NOT_REFUSED
    return refusing_code(head, transaction._response_buf, transaction._response_offset, transaction.response_size)


def check_notification(transaction: Transaction) -> None:
    """Note whether an S7comm-plus notification refuses items of its subscription."""
    if transaction.is_plus:
        checked = transaction._checked = check(transaction.response_octets)
        if notifies_refusal(checked):
            transaction.has_errors = True


def mismatch(request: Parameters, answer: Parameters) -> bool:
    """Return whether an answer names a different function from its request.

    For userdata that is a different group or subfunction, for SCD a different service or object.
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
    """Check the data block of a write request against its items; return flags.

    A PDU with wrong lengths gets none, because it was already reported.
    """
    data_at: i64 = at + HEADER_SIZE + len(parameters.octets)
    if parameters.malformed or data_at + u16(buf, at + 8) != at + size:
        return 0
    return _check_data(parameters, buf, data_at, at + size)


def _check_data(parameters: Parameters, buf: bytes, at: i64, end: i64) -> i64:
    """Step through the data items of a write as `parse_data_items` does, without making objects of them."""
    flags: i64 = 0
    count: i64 = parameters.item_count
    size: i64 = 0
    for index in range(count):
        room: i64 = end - at - DATA_HEAD
        if room < 0:
            return BAD_REQUEST
        head: i64 = u32(buf, at)
        size = data_size_within(head >> 16 & 0xFF, head & 0xFFFF, room)
        if size > room:
            return BAD_REQUEST
        wanted: i64 = parameters.size_of(index)
        if wanted >= 0 and wanted != size:
            flags = WRITE_SIZE
        at += DATA_HEAD + size + item_fill(size, index + 1 == count)
    if at < end and not (end - at == 1 and size & 1):
        return BAD_REQUEST
    return flags


def error_code(rosctr: i64, octets: bytes, parameters: Parameters) -> i64:
    """Return the error in an answer: header class and code, or the userdata error code; 0 for none."""
    head = parameters.userdata
    if head is not None:
        return head.error_code
    if (rosctr == ACK or rosctr == ACK_DATA) and len(octets) >= 12:
        return u16(octets, 10)
    return 0


#: Subfunctions of the cyclic services with items: cyclic transfer, change driven transfer, and its modification.
CYCLIC_ITEMS: Final = frozenset((0x01, 0x05, 0x07))
VARIABLE_STATUS: Final = 0x02
#: Test functions that write: modify variable and force.
TEST_WRITES: Final = frozenset((0x08, 0x09))
TEST_ITEMS: Final = frozenset((VARIABLE_STATUS, *TEST_WRITES))

#: Return code in a push: the value has not changed since the last one (reference 4.7).
UNCHANGED: Final = 0xFE

#: Octets before the items of a request: reserved, count, time base and factor.
_ASKED_HEAD: Final = 4
#: Octets before the items of a push: reserved and count; in a test function only the count.
_SENT_HEAD: Final = 2
#: Octets before the blocks of a test function: their sizes.
_TEST_SIZES: Final = 4


#: Parts of an answer that may contain a refusal (`TransactionError.part`).
HEADER: Final = "header"
PARAMETER: Final = "parameter"
DATA: Final = "data"  # for userdata: the return code of an answer without payload
RETURN_VALUE: Final = "return value"  # of S7comm-plus
ITEM: Final = "item"
ALARM: Final = "alarm"  # an alarm that the request acknowledges, locks or unlocks
MESSAGE: Final = "message"  # of SCD


#: The code of an error that means: the answer has no return code.
NO_CODE: Final = -1
NO_CODE_TEXTS: Final = (
    "No return code",
    "The answer has no return code for this item: it is unknown whether it was written.",
)
#: The sentence for 0x0a when it refuses an answer's data: its meaning differs from that in other userdata.
_NO_DATA: Final = "The answer has this return code instead of data: the PLC does not have what was requested."
#: Parts with codes of one octet.
SHORT_CODES: Final = frozenset((DATA, ITEM, ALARM))


class TransactionError:
    """One refusal in an answer.

    ``part`` is the part of the answer that contains it: `HEADER`, `PARAMETER`, `DATA`, `RETURN_VALUE`, `ITEM`, `ALARM` or
    `MESSAGE`. ``item`` is the number of the item or alarm, counted from 1; 0 for the other parts. ``code`` is the number on the
    wire, or `NO_CODE` if the answer has none for a written item; ``name`` and ``text`` are its name and sentence. ``address``
    is the item's address, or the event id of the alarm, if there is one.
    """

    __slots__ = ("address", "code", "item", "name", "part", "text")

    def __init__(self, part: str, code: int, name: str, text: str, item: int = 0, address: str = "") -> None:
        self.part = part
        self.item = item
        self.code = code
        self.name = name
        self.text = text
        self.address = address

    @property
    def where(self) -> str:
        """The part as shown to people and in JSON: its name, and the number of an item or alarm (``header``, ``item 2``)."""
        return f"{self.part} {self.item}" if self.item else self.part

    @property
    def coded(self) -> str:
        """The code in hexadecimal and its name; only the name if there is no code."""
        if self.code == NO_CODE:
            return self.name
        return coded(hex_number(self.code, 2 if self.part in SHORT_CODES else 4), self.name)

    def __repr__(self) -> str:
        return f"TransactionError({self.where!r}, 0x{self.code:x}, {self.name!r})"

    def __str__(self) -> str:
        """Return the place and the error: ``item 3 DB2.DBB400 x4: Object does not exist``."""
        where = self.where
        address = f" {self.address}" if self.address and self.address != where else ""
        return printable(f"{where}{address}: {self.name}")

    def as_dict(self) -> dict[str, object]:
        """Return the error as the JSON contract has it."""
        return {
            "where": self.where,
            "code": known_code(self),
            "name": self.name,
            "text": self.text,
        }


def known_code(error: TransactionError) -> int | None:
    """Return the code of an error, None if the answer has none; -1 is an error of SCD as well."""
    return None if error.code == NO_CODE and error.part != MESSAGE else error.code


def item_error(code: int, number: int, address: str) -> TransactionError:
    """Return the error of an item that was refused with ``code``; ``number`` counts from 1."""
    return TransactionError(ITEM, code, RETURN_CODES.name(code), RETURN_CODES.text(code), number, address)


def refusal(transaction: Transaction) -> TransactionError | None:
    """Return the error with which an answer refuses its whole request, None for none; SCD has messages instead."""
    code = int(transaction.error_code)
    if not code:
        code = int(data_code(transaction)) if transaction.has_errors else NOT_REFUSED
        if code == NOT_REFUSED:
            return None
        text = _NO_DATA if code == OBJECT_DOES_NOT_EXIST else RETURN_CODES.text(code)
        return TransactionError(DATA, code, RETURN_CODES.name(code), text)
    part = PARAMETER if transaction.parameters.userdata is not None else HEADER
    codes = errors_of(transaction.function)
    if transaction.is_plus:
        part, codes = RETURN_VALUE, PLUS_CODES
    return TransactionError(part, code, codes.name(code), codes.text(code))


def alarm_errors(transaction: Transaction) -> list[TransactionError]:
    """Return the errors of alarms that an answer refuses to acknowledge, lock or unlock; empty for other functions."""
    told = transaction.response_parameters
    head = told.userdata if told is not None else None
    if head is None or head.error_code or not answers_by_alarm(head):
        return []
    asked = alarms_asked(transaction.request_octets)
    return [
        TransactionError(
            ALARM,
            code,
            RETURN_CODES.name(code),
            RETURN_CODES.text(code),
            number,
            f"event 0x{asked[number - 1]:08x}" if number <= len(asked) else "",
        )
        for number, code in enumerate(alarm_codes(transaction.response_octets), 1)
        if code != SUCCESS
    ]


class SentAgain:
    """How often TCP retransmitted a request; ``frame`` and ``time_ns`` are packet and time of the latest retransmission."""

    __slots__ = ("frame", "time_ns", "times")

    def __init__(self) -> None:
        self.times: i64 = 0
        self.frame: i64 = 0
        self.time_ns: i64 = 0

    def text(self, request_ns: int) -> str:
        """Return it in words, with the time since the request."""
        after = duration_text(int(self.time_ns) - int(request_ns))
        if self.times == 1:
            return f"request sent again after {after}"
        return f"request sent again {self.times} times, last after {after}"


class Subscription:
    """A subscription: the items that a job sends, and the PDU that requested them; ``head`` is the head of its parameters.

    ``doubts`` are the flags among `DOUBTS` of the answer that began the job: a different request may have begun it.
    """

    __slots__ = ("doubts", "head", "items", "request")

    def __init__(self, head: UserdataHead, request: bytes, doubts: i64 = 0) -> None:
        self.head: UserdataHead = head
        self.items: list[Item] = requested_items(head, request)
        self.request: bytes = request
        self.doubts: i64 = doubts

    def __repr__(self) -> str:
        return f"Subscription({self.head.name}: {', '.join([item.address for item in self.items])})"

    @property
    def written(self) -> list[DataItem]:
        """The values to which the request modifies or forces its items, read again at each call; empty for other jobs."""
        return _test_values(self.head, self.request, len(self.items)) if self.head.group == GROUP_TEST else []


def has_items(head: UserdataHead) -> bool:
    """Return whether a userdata PDU has items: it belongs to a cyclic service, or to a test function on variables."""
    if head.group == GROUP_CYCLIC:
        return head.subfunction in CYCLIC_ITEMS
    return head.group == GROUP_TEST and head.subfunction in TEST_ITEMS


def _test_data(payload: bytes) -> bytes:
    """Return the data block of a programmer command, which follows its sizes and its parameter block."""
    if len(payload) < _TEST_SIZES:
        return b""
    at: i64 = _TEST_SIZES + u16(payload, 0)
    return payload[at : at + u16(payload, 2)]


def requested_items(head: UserdataHead, octets: bytes) -> list[Item]:
    """Return the items in a request of a cyclic service or test function; ``octets`` is the PDU."""
    if head.type != REQUEST or head.data_unit_ref or not has_items(head):
        return []
    payload = userdata_payload(octets)
    if head.group == GROUP_CYCLIC:
        if len(payload) < _ASKED_HEAD:
            return []
        return parse_items(payload, _ASKED_HEAD, len(payload), payload[1], [])
    return parse_test_items(_test_data(payload))


def userdata_results(
    asked: Parameters | None, request: bytes, told: Parameters | None, response: bytes, subscribed: list[Item] | None
) -> list[ItemResult]:
    """Join the items of a cyclic service or test function with their values.

    ``request`` and ``response`` are PDUs, empty if missing; ``asked`` and ``told`` are their parameters. A push has no request:
    its items are ``subscribed``; if these are unknown, its values have no addresses.
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
    payload = userdata_payload(response)
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
    """Return the values of a request to modify or force variables, which come after the addresses."""
    if head.subfunction not in TEST_WRITES or not count:
        return []
    data = _test_data(userdata_payload(request))
    return parse_data_items(data, _SENT_HEAD + ADDRESS_SIZE * count, len(data), count, False, [])


def _test_results(head: UserdataHead, items: list[Item], data: bytes) -> list[ItemResult]:
    """Return the results of a push of a test function: values, or the return codes of written items."""
    if head.type != PUSH or len(data) < _SENT_HEAD:
        return read_results(items, [])
    count: i64 = u16(data, 0)
    if head.subfunction == VARIABLE_STATUS:
        return read_results(items, parse_data_items(data, _SENT_HEAD, len(data), count, True, []))
    return write_results(items, [], list(data[_SENT_HEAD : _SENT_HEAD + count]))


leaves(Subscription, TransactionError)
