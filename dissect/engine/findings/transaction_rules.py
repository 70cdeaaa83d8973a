"""Findings about transactions and about the items they name (reference sections 7.2 and 7.3).

A parameter block is judged when it is first seen (`Parameters.unjudged`): unknown codes, impossible addresses. So polling the
same items for hours costs nothing. The engine calls `judge_transaction` only for transactions in which it found something odd.
"""

from __future__ import annotations

from typing import Final

from mypy_extensions import i64

from dissect.engine.findings.cause_tables import EXPLAINS, OUTRIGHT, VAGUE
from dissect.engine.findings.known_bugs_tables import KNOWN_BUGS
from dissect.engine.findings.reporter import Finding, Reporter
from dissect.engine.transactions.naming import item_subject, subject
from dissect.engine.transactions.refusals import read_codes
from dissect.engine.transactions.results import (
    ALARM,
    ASKED_JUDGED,
    BAD_DATA,
    BAD_REQUEST,
    COUNT_MISMATCH,
    EXPECTED,
    FUNCTION_MISMATCH,
    ITEM,
    NO_CODE,
    ODD_DATA_CODE,
    REORDERED,
    SIZE_MISMATCH,
    STILL_OPEN,
    WRITE_SIZE,
    TransactionError,
    item_error,
)
from dissect.engine.transactions.side import Side
from dissect.engine.transactions.transaction import (
    ANSWERED,
    CAPTURE_ENDED,
    CONNECTION_CLOSED,
    ORPHAN,
    PUSH,
    REASON_TEXTS,
    TABLE_FULL,
    UNANSWERED,
    Transaction,
)
from dissect.protocols.s7.clock import CLOCK
from dissect.protocols.s7.errors import protects
from dissect.protocols.s7.items import Item, odd_data_code, without_fill
from dissect.protocols.s7.layouts import DATA_HEAD
from dissect.protocols.s7.message import Pdu, userdata_payload
from dissect.protocols.s7.parameters import HEADER_SIZE, Parameters
from dissect.protocols.s7.szl import SZL_HEAD, shortage
from dissect.protocols.s7.szl_notes import extract
from dissect.protocols.s7.szl_tables import HEAD_ONLY
from dissect.protocols.s7.tables import (
    ACK_DATA,
    ANSWER_TRANSPORT_SIZE,
    AREAS,
    BIT,
    CPU_SERVICES,
    DB_AREAS,
    DOWNLOAD_ENDED,
    END_UPLOAD,
    FUNCTIONS,
    GROUP_CPU,
    GROUP_PBC,
    GROUP_SECURITY,
    GROUP_TIME,
    INCONSISTENT,
    JOB,
    NUMBERED_AREAS,
    OWN_SIZE_AREAS,
    PI_SERVICE,
    PLC_STOP,
    READ_SZL,
    RECORD_AREA,
    REQUEST_DOWNLOAD,
    S7ANY,
    START_UPLOAD,
    SUCCESS,
    SYNTAX_IDS,
    TRANSPORT_SIZES,
    TYPE_NOT_SUPPORTED,
    USERDATA_GROUPS,
    USERDATA_SUBFUNCTIONS,
    WRITE_VAR,
)
from dissect.protocols.s7plus.tables import PARTIAL_ERROR
from dissect.wire.octets import u16
from dissect.wire.text import count, duration_text, over_limit, some

#: Jobs that are commands, or that begin or end a transfer; the many jobs that carry pieces of blocks are not in it.
_COMMANDS: Final = frozenset((REQUEST_DOWNLOAD, DOWNLOAD_ENDED, START_UPLOAD, END_UPLOAD, PI_SERVICE, PLC_STOP))
#: Two capture queues may swap packets that are this close in time; a larger step means that the clock runs backwards.
DISORDER_NS: Final = 1_000_000
#: A request captured this long after its answer is not out of order: TCP sent it again (in practice after 20 ms or more).
_SENT_AGAIN_NS: Final = 10_000_000
#: Userdata groups whose payloads have the same length on every CPU, or state their length.
_SERVICES: Final = frozenset((GROUP_PBC, GROUP_SECURITY, GROUP_TIME))
#: Maximum of the length field of a data item, in bits.
_MOST_BITS: Final = 0xFFFF
_DATA_BLOCK: Final = "the data block does not fit the item count"
#: Maximum number of faults of a block that a finding names.
_NAMED: Final = 3


def judge_parameters(reporter: Reporter, side: Side, parameters: Parameters, frame: i64, time_ns: i64) -> None:
    """Judge a parameter block when it is seen for the first time."""
    parameters.unjudged = False
    if parameters.malformed:
        return
    unknown = _unknown_codes(parameters)
    odd: list[str] = []
    for item in parameters.items:
        if item.syntax_id == S7ANY and item.transport_size >= 0:
            what = odd_address(item)
            if what:
                odd.append(f"{item.address}: {what}")
    _note_items(reporter, "s7.unknown_code", side, parameters, unknown, frame, time_ns)
    _note_items(reporter, "s7.odd_address", side, parameters, odd, frame, time_ns)


def _note_items(
    reporter: Reporter, slug: str, side: Side, parameters: Parameters, faults: list[str], frame: i64, time_ns: i64
) -> None:
    if faults:
        begun = f"{parameters.function_name}: " if parameters.items else ""
        detail = f"{begun}{some(faults, _NAMED, '; ')}"
        reporter.note(slug, side.connection.number, [frame], time_ns, detail)


def _unknown_codes(parameters: Parameters) -> list[str]:
    """Return a text for each unknown code in a parameter block."""
    found: list[str] = []
    function: i64 = parameters.function
    head = parameters.userdata
    if head is not None:
        if head.group not in USERDATA_GROUPS:
            found.append(f"userdata group 0x{head.group:02x}")
        # PBC has its own PDU type instead of a subfunction
        elif head.group != GROUP_PBC or function != CPU_SERVICES:
            subfunctions = USERDATA_SUBFUNCTIONS.get(head.group)
            if subfunctions is not None and head.subfunction not in subfunctions:
                found.append(f"subfunction 0x{head.subfunction:02x} of {head.group_name}")
        return found
    if function >= 0 and (parameters.rosctr == JOB or parameters.rosctr == ACK_DATA) and function not in FUNCTIONS:
        found.append(f"function 0x{function:02x}")
    for number, item in enumerate(parameters.items, 1):
        if item.syntax_id not in SYNTAX_IDS:
            found.append(f"item {number}: syntax 0x{item.syntax_id:02x}")
        elif item.transport_size >= 0:
            if item.area not in AREAS:
                found.append(f"item {number}: area 0x{item.area:02x}")
            if item.transport_size not in TRANSPORT_SIZES:
                found.append(f"item {number}: transport size 0x{item.transport_size:02x}")
    return found


def odd_address(item: Item) -> str:
    """Return what is odd about the address of an S7ANY item; empty if nothing is (reference 3.5)."""
    area: i64 = item.area
    if area == RECORD_AREA or area not in AREAS:
        return ""  # a record has a logical id instead of an address; the rules of an unknown area are unknown
    if item.db and area not in DB_AREAS:
        return f"DB number {item.db} outside a DB"
    if area in NUMBERED_AREAS:
        own = area in OWN_SIZE_AREAS and item.transport_size != area
        return f"transport size {TRANSPORT_SIZES.name(item.transport_size)}" if own else ""
    if item.start_bit >> 19:
        return "bits above the address are set"
    if item.start_bit & 7 and item.transport_size != BIT:
        return f"bit {item.start_bit & 7} in the address of a {TRANSPORT_SIZES.name(item.transport_size)}"
    return ""


#: A bit of `Connection.told`: a wrong transport size in answers was reported. The bits below belong to other rules.
_DATA_CODES: Final = 256


def judge_transaction(reporter: Reporter, transaction: Transaction, slow_ns: i64) -> None:
    """Report what is odd about a finished transaction. This is slow; call it only for transactions with something odd."""
    if transaction.is_likely:
        pass  # if the answer belongs to a different request, its time and fit mean nothing
    elif transaction._outcome == ANSWERED:
        _judge_flags(reporter, transaction)
        latency: int = transaction.response_ns - transaction.request_ns
        if latency > slow_ns:
            _note(
                reporter,
                "transaction.slow",
                transaction,
                over_limit(latency, int(slow_ns)) + _acknowledged(transaction) + _sent_again(transaction),
            )
        elif -DISORDER_NS <= latency < 0 and not transaction._flags & REORDERED:  # otherwise the clock stepped
            detail = f"by the times of the packets the answer precedes the request by {duration_text(-latency)}"
            _note(reporter, "transaction.reordered", transaction, detail)
    elif transaction._outcome == ORPHAN and not transaction._flags & EXPECTED:
        _note(reporter, "transaction.orphan", transaction, _orphan(transaction))
    because = reporter.because
    code: i64 = transaction.error_code
    if because is not None and (protects(code) or (code and because.slug not in OUTRIGHT and code >> 8 not in VAGUE)):
        reporter.because = None  # the answer itself states why the request was refused
    if transaction.has_errors:
        # a push has no request that could be refused as a whole, but single items of the subscription may be refused
        if transaction._outcome == PUSH:
            _judge_items(reporter, transaction)
        else:
            _judge_errors(reporter, transaction)


def judge_szl(reporter: Reporter, transaction: Transaction) -> None:
    """Report an SZL answer in one PDU that is shorter than the records stated in its head."""
    head = transaction.parameters.userdata
    answer = transaction.response_parameters
    told = answer.userdata if answer is not None else None
    if (
        head is None
        or answer is None
        or told is None
        or head.group != GROUP_CPU
        or head.subfunction != READ_SZL
        or transaction.has_errors
    ):
        return
    if told.last_data_unit != 0 or told.data_unit_ref != 0 or told.error_code or head.data_unit_ref > 0:
        return
    # read in place, because panels poll SZLs
    buf = transaction._response_buf
    at: i64 = transaction._response_offset
    data_at: i64 = at + HEADER_SIZE + len(answer.octets)
    payload_at: i64 = data_at + DATA_HEAD.size
    size: i64 = min(at + transaction.response_size, data_at + u16(buf, at + 8)) - payload_at - SZL_HEAD.size
    if size < 0 or buf[data_at] != SUCCESS:
        return
    szl_id, length, count = u16(buf, payload_at), u16(buf, payload_at + 4), u16(buf, payload_at + 6)
    if extract(szl_id) != HEAD_ONLY and length * count > size:
        detail = shortage(szl_id, length, count, int(size))
        frames = transaction.frames
        reporter.note("s7.malformed", transaction.connection.number, frames, int(transaction.response_ns), detail)


def judge_body(reporter: Reporter, transaction: Transaction) -> None:
    """Report a command or service, or its answer, whose parts are too short or state more than is there.

    Extra octets after the last part are not reported, only shown with the PDU: some servers pad what they send.
    """
    head = transaction.parameters.userdata
    if transaction.parameters.function not in _COMMANDS if head is None else head.group not in _SERVICES:
        return
    if (
        head is not None
        and head.group == GROUP_TIME
        and len(userdata_payload(transaction.response_octets)) == CLOCK.size
    ):
        return  # a clock reading, as panels do it again and again
    response = transaction.response
    for pdu, body in (
        (transaction.request, transaction.request_body),
        (response, response.body if response is not None else None),
    ):
        if pdu is None or body is None or pdu.malformed:
            continue
        faults = [fact for fact in body.malformed if fact.reason != "trailing_octets"]
        if faults:
            who = transaction.connection.tcp.ends[pdu.side]
            detail = f"{pdu.rosctr_name} from {who}, {transaction.function_name}: {faults[0]}"
            if pdu.rosctr == JOB and len(transaction.parameters.octets) == 1:
                detail += KNOWN_BUGS["bare_command"].note
            reporter.note("s7.malformed", transaction.connection.number, [pdu.frame], pdu.time_ns, detail)
            if pdu.side == transaction.asked_by:
                reporter.blame("s7.malformed")


def judge_unanswered(reporter: Reporter, transaction: Transaction, now_ns: i64, slow_ns: i64) -> None:
    """Report an unanswered request, unless the capture has a gap or ends too early for certainty."""
    judge_written(reporter, transaction)
    if transaction._outcome != UNANSWERED:
        return
    if transaction.unseen:
        transaction.connection.not_captured += 1
        return
    if transaction.reason == CAPTURE_ENDED and now_ns - transaction.request_ns <= slow_ns:
        transaction._flags |= STILL_OPEN
        transaction.connection.still_open += 1
        return
    if transaction.reason == TABLE_FULL:
        reporter.note(
            "transaction.table_full", transaction.connection.number, transaction.frames, transaction.request_ns
        )
    why = _why(transaction) + _sent_again(transaction) + reporter.doubt(transaction.request_ns)
    _note(reporter, "transaction.unanswered", transaction, why)


def _stays_encrypted(transaction: Transaction, side: i64) -> bool:
    """Return whether ``side`` stays encrypted although the other side was decrypted: then the key log is incomplete."""
    session = transaction.connection.tls
    return session is not None and session.is_open and not session.directions[side].content


def _orphan(transaction: Transaction) -> str:
    encrypted = "; the request stays encrypted" if _stays_encrypted(transaction, transaction.asked_by) else ""
    return f"reference 0x{transaction.pdu_ref:04x}{encrypted}"


def _why(transaction: Transaction) -> str:
    """Return why there is no answer, and who closed the connection if it was closed."""
    if _stays_encrypted(transaction, 1 - transaction.asked_by):
        return "the answer, if there was one, stays encrypted"
    connection = transaction.connection
    ending = connection.ending
    if transaction.reason == CONNECTION_CLOSED and ending is not None:
        deed = ending.deed_after(connection, transaction.request_frame, transaction.request_ns)
        if deed:
            return deed
    return REASON_TEXTS[transaction.reason]


def _acknowledged(transaction: Transaction) -> str:
    """Return a text if an empty DT acknowledged the request: then the network is fast, and the device itself is slow."""
    early = transaction.connection.early_ack(transaction)
    if early is None:
        return ""
    after = duration_text(int(early.time_ns - transaction.request_ns))
    return f"; acknowledged after {after} by an empty DT (packet {early.frame})"


def _sent_again(transaction: Transaction) -> str:
    """Return a text if TCP sent the request again: then the network may be slow, or the device gone, not only busy."""
    again = transaction.again
    return f"; {again.text(transaction.request_ns)} (packet {again.frame})" if again is not None else ""


def _note(reporter: Reporter, slug: str, transaction: Transaction, what: str) -> None:
    number = transaction.connection.number
    if reporter.wants_of(slug, transaction):
        time_ns = max(transaction.request_ns, transaction.response_ns)
        reporter.detail(slug, number, transaction.frames, time_ns, f"{subject(transaction)}: {what}")


def _judge_flags(reporter: Reporter, transaction: Transaction) -> None:
    flags = transaction._flags
    if not flags:
        return
    judge_written(reporter, transaction)
    answer = transaction.response_parameters
    if flags & FUNCTION_MISMATCH and answer is not None:
        said = answer.subject if transaction.is_scd else answer.function_name
        _note(reporter, "transaction.function_mismatch", transaction, f"the answer names {said}")
    if flags & COUNT_MISMATCH and answer is not None:
        asked = transaction.parameters.item_count
        _note(
            reporter,
            "transaction.count_mismatch",
            transaction,
            f"requested {count(asked, 'item')}, got {answer.item_count}",
        )
    if flags & SIZE_MISMATCH:
        _note(reporter, "transaction.size_mismatch", transaction, _sizes(transaction))
    if flags & ODD_DATA_CODE and not transaction.connection._told & _DATA_CODES:
        transaction.connection._told |= _DATA_CODES
        _note(reporter, "transaction.odd_data_code", transaction, _data_codes(transaction))
    elif flags & ODD_DATA_CODE:
        frame, time_ns = transaction.response_frame, transaction.response_ns
        reporter.again("transaction.odd_data_code", transaction.connection.number, frame, time_ns)
    if flags & BAD_DATA and reporter.wants_of("s7.malformed", transaction):
        _detail_malformed(
            reporter, transaction, transaction.response, transaction.response_frame, transaction.response_ns
        )
    if flags & REORDERED:
        ahead: int = transaction.request_ns - transaction.response_ns
        what = f"the answer precedes the request by {duration_text(ahead)}"
        if ahead > _SENT_AGAIN_NS:
            what += ": the request was sent again, and its first copy was not captured"
        _note(reporter, "transaction.reordered", transaction, what)


def judge_written(reporter: Reporter, transaction: Transaction) -> None:
    """Report what is wrong with the data of a write, unless already reported; it explains a refusal of the write."""
    if transaction._flags & ASKED_JUDGED:
        return
    if transaction._flags & WRITE_SIZE:
        _note(reporter, "transaction.write_size", transaction, _written_sizes(transaction))
        reporter.blame("transaction.write_size")
    if transaction._flags & BAD_REQUEST:
        frame, time_ns = transaction.request_frame, transaction.request_ns
        if reporter.wants("s7.malformed", transaction.connection.number, frame, frame, time_ns):
            _detail_malformed(reporter, transaction, transaction.request, frame, time_ns)
        reporter.blame("s7.malformed")


def _detail_malformed(reporter: Reporter, transaction: Transaction, pdu: Pdu | None, frame: int, time_ns: int) -> None:
    if pdu is None:
        return
    what = _early(transaction, pdu) or str(pdu.malformed[0] if pdu.malformed else _DATA_BLOCK)
    who = transaction.connection.tcp.ends[pdu.side]
    detail = f"{pdu.rosctr_name} from {who}, {subject(transaction)}: {what}"
    reporter.detail("s7.malformed", transaction.connection.number, [frame], time_ns, detail)


def _early(transaction: Transaction, pdu: Pdu) -> str:
    """Return the item of a write that begins early because a fill byte is missing; empty if nothing of this kind is wrong."""
    asked = transaction.parameters
    if pdu.side != transaction.asked_by or not transaction._flags & BAD_REQUEST:
        return ""
    octets = pdu.octets
    early = without_fill(asked.items, octets, HEADER_SIZE + len(asked.octets), len(octets))
    if not early:
        return ""
    said = f"no fill byte after item {early}, whose length is odd: item {early + 1} begins one byte early"
    return said + KNOWN_BUGS["no_fill_byte"].note


def _sizes(transaction: Transaction) -> str:
    for number, result in enumerate(transaction.s7_results, 1):
        item = result.item
        if item is not None and result.data is not None and 0 <= item.size != len(result.data):
            said = f"item {number} ({item.address}) requested {item.size} bytes, got {len(result.data)}"
            counted = item.size * 8 > _MOST_BITS and len(result.data) < item.size
            return said + (KNOWN_BUGS["length_in_bits"].note if counted else "")
    return "an item has a different size"


def _written_sizes(transaction: Transaction) -> str:
    pairs = zip(transaction.parameters.items, transaction._written_items(), strict=False)
    for number, (item, data_item) in enumerate(pairs, 1):
        if 0 <= item.size != len(data_item.data):
            return f"item {number} ({item.address}) needs {item.size} bytes, got {len(data_item.data)}"
    return "the data of an item have a different size"


def _data_codes(transaction: Transaction) -> str:
    pairs = zip(transaction.parameters.items, transaction._answered_items(), strict=False)
    for number, (item, answer) in enumerate(pairs, 1):
        if answer.return_code == SUCCESS and odd_data_code(item, answer):
            asked = TRANSPORT_SIZES.name(item.transport_size)
            expected = ANSWER_TRANSPORT_SIZE[item.transport_size]
            return (
                f"item {number}, a {asked}, was returned as 0x{answer.transport_size:02x} instead of 0x{expected:02x}"
            )
    return "an item has a different transport size"


def _judge_errors(reporter: Reporter, transaction: Transaction) -> None:
    if transaction.is_scd:
        error = transaction.errors[0]
        _note(reporter, "transaction.refused", transaction, f"{error.name} {error.code}: {error.text}")
        return
    if transaction.refused and not _in_part(transaction):
        if reporter.wants_of("transaction.refused", transaction):
            error = transaction.errors[0]
            reporter.detail(
                "transaction.refused",
                transaction.connection.number,
                transaction.frames,
                transaction.response_ns,
                f"{_asked(transaction)}: {error.coded}",
            )
        return
    _judge_items(reporter, transaction)


def _judge_items(reporter: Reporter, transaction: Transaction) -> None:
    slug = "transaction.item_error"
    codes = read_codes(transaction) if reporter.because is None else None
    if codes is not None:
        _judge_codes(reporter, transaction, slug, codes)
        return
    because = reporter.because
    alone: bool = False  # whether an item was refused for no known reason
    for error in transaction.errors:
        reporter.because = _why_refused(reporter, transaction, error, because)
        alone = alone or (error.part == ITEM and reporter.because is None)
        if error.part == ALARM:
            what = f"{error.address or error.where}: {error.coded}"
            _note(reporter, "transaction.alarm_refused", transaction, what)
        # An item without a return code was not refused: the answer is too short, which is a different finding.
        if error.part == ITEM and error.code != NO_CODE and reporter.wants_of(slug, transaction):
            reporter.detail(
                slug,
                transaction.connection.number,
                transaction.frames,
                transaction.response_ns,
                f"{transaction.function_name} {_about(transaction, error)}: {error.coded}",
            )
    if alone:
        reporter.because = None  # the rest is about all items


def _judge_codes(reporter: Reporter, transaction: Transaction, slug: str, codes: list[int]) -> None:
    """Report the refused items of a plain read that have no known cause."""
    for index in range(len(codes)):
        code: i64 = codes[index]
        if code != SUCCESS and reporter.wants_of(slug, transaction):
            items = transaction.parameters.items
            item = items[index] if index < len(items) else None
            error = item_error(int(code), index + 1, item.address if item is not None else "")
            about = (
                item.label if item is not None and transaction.connection.naming is None else _about(transaction, error)
            )
            what = f"{transaction.function_name} {about}: {error.coded}"
            time_ns = transaction.response_ns
            reporter.detail(slug, transaction.connection.number, transaction.frames, time_ns, what)


def _why_refused(
    reporter: Reporter, transaction: Transaction, error: TransactionError, because: Finding | None
) -> Finding | None:
    """Return the cause of the refusal of an item; ``because`` is the fault of the request as a whole.

    Items before the first wrong one in the data of a write are sound; data of a wrong size have their own code.
    """
    if error.part != ITEM:
        return because
    if because is not None and transaction._flags & BAD_REQUEST and because.slug == "s7.malformed":
        return because if error.item > len(transaction._written_items()) else None
    if because is not None and because.slug == "transaction.write_size":
        return because if error.code == INCONSISTENT else None
    if because is None or "transaction.item_error" not in EXPLAINS[because.slug]:
        return _several_bits(reporter, transaction, error)
    return because


def _several_bits(reporter: Reporter, transaction: Transaction, error: TransactionError) -> Finding | None:
    """Report an item that was refused because it has type BIT and a count other than 1; return it as a cause, else None."""
    if error.part != ITEM or error.code != TYPE_NOT_SUPPORTED or transaction.rosctr != JOB:
        return None
    results = transaction.s7_results
    item = results[error.item - 1].item if 0 < error.item <= len(results) else None
    if item is None or item.transport_size != BIT or item.count == 1:
        return None
    what = f"item {error.item} ({item.label}) is of type BIT, which takes the count 1; the address may be right"
    what += KNOWN_BUGS["bit_count"].note
    _note(reporter, "transaction.bit_count", transaction, what)
    return reporter.noted("transaction.bit_count")


def _asked(transaction: Transaction) -> str:
    """Return what was requested; for S7comm-plus with the names of variables and attributes."""
    labels = [item.label for item in transaction.plus_results] if transaction.is_plus else []
    if not labels:
        return subject(transaction)
    return f"{transaction.function_name} {some(labels, _NAMED)}"


def _in_part(transaction: Transaction) -> bool:
    """Return whether an S7comm-plus answer refuses some items only."""
    if not transaction.is_plus or transaction.error_code != PARTIAL_ERROR:
        return False
    return any([error.part == ITEM for error in transaction.errors])


def _about(transaction: Transaction, error: TransactionError) -> str:
    """Return a text for an item: its tags if it has some, else its address and length, or its position."""
    results = transaction.s7_results
    known = results[error.item - 1].item if 0 < error.item <= len(results) else None
    if known is not None and transaction.connection.naming is None and transaction.parameters.function != WRITE_VAR:
        return known.label
    return item_subject(transaction, error.item, error.address) or error.where
