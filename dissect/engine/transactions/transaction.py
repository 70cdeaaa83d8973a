"""`Transaction`: a request and its answer, either of which may be missing, and their outcome."""

from __future__ import annotations

from typing import TYPE_CHECKING, Final

from mypy_extensions import i64, mypyc_attr

from dissect.engine.transactions.old_names import OldNames
from dissect.engine.transactions.payloads import SCD, ScdMessage, ScdParameters
from dissect.engine.transactions.results import (
    BEHIND,
    DOUBTS,
    EXPECTED,
    GAPS,
    ITEM,
    MESSAGE,
    NO_CODE,
    NO_CODE_TEXTS,
    STILL_OPEN,
    UNCONFIRMED,
    SentAgain,
    Subscription,
    TransactionError,
    alarm_errors,
    data_code,
    has_items,
    item_error,
    refusal,
    userdata_results,
)
from dissect.protocols.s7.body import Body
from dissect.protocols.s7.items import (
    DataItem,
    ItemResult,
    fitting,
    parse_data_items,
    read_results,
    without_fill,
    write_results,
)
from dissect.protocols.s7.message import NOT_REFUSED, Pdu, parse_pdu
from dissect.protocols.s7.parameters import ACK_HEADER_SIZE, HEADER_SIZE, Parameters
from dissect.protocols.s7.tables import (
    ACK_DATA,
    JOB,
    READ_VAR,
    USERDATA,
    WRITE_VAR,
)
from dissect.protocols.s7plus.check import Check, check
from dissect.protocols.s7plus.events import subscription_of
from dissect.protocols.s7plus.hiding import said_half, shown_half
from dissect.protocols.s7plus.items import Half, PlusItem, join_items
from dissect.protocols.s7plus.message import PlusPdu, parse_plus
from dissect.protocols.s7plus.parameters import PLUS, PlusParameters
from dissect.protocols.s7plus.tables import NOTIFICATION, NOTIFIED, PARTIAL_ERROR
from dissect.wire.copies import leaves
from dissect.wire.malformed import Malformed
from dissect.wire.text import printable

if TYPE_CHECKING:
    from collections.abc import Callable

    from dissect.engine.transactions.connection import Connection
    from dissect.engine.transactions.items import TransactionItem

# The outcomes of a transaction.
OPEN: Final = 0
ANSWERED: Final = 1
UNANSWERED: Final = 2
ORPHAN: Final = 3
PUSH: Final = 4
BEHIND_MALFORMED: Final = 5  # behind a malformed header, and in no pair: nothing is missing

#: Names of the outcomes, by the numbers above.
OUTCOMES: Final[list[str]] = ["open", "answered", "unanswered", "orphan_answer", "unsolicited", "behind_malformed"]

#: Why a request remained without an answer.
CONNECTION_CLOSED: Final = "connection_closed"
CAPTURE_ENDED: Final = "capture_ended"
HOLE: Final = "hole"
ONE_SIDED: Final = "one_sided"
REFERENCE_REUSED: Final = "reference_reused"
TABLE_FULL: Final = "table_full"
CONNECTION_EVICTED: Final = "connection_evicted"
#: Not the reason for a missing answer, but the reason why none may be expected; pairs may have it, too.
MALFORMED_HEADER: Final = "malformed_header"
#: One sentence for each reason.
REASON_TEXTS: Final[dict[str, str]] = {
    CONNECTION_CLOSED: "the connection ended before an answer came",
    CAPTURE_ENDED: "the capture ends before an answer came",
    HOLE: "answered, but the answer was not captured",
    ONE_SIDED: "the direction of the answers was not captured",
    REFERENCE_REUSED: "the requesting side reused the reference without waiting for the answer",
    TABLE_FULL: "too many requests were pending at once; this one was dropped",
    CONNECTION_EVICTED: "too many connections were open at once; this one was dropped",
    MALFORMED_HEADER: "behind a malformed TPDU header, which the receiver may have dropped",
}
#: The sentence for `HOLE` if it is only likely: other requests, or a push, may explain the missing octets.
PERHAPS_ANSWERED: Final = "perhaps answered: bytes from the answering side are missing from the capture"

#: How certain a pair of request and answer is, or how certain it is that an uncaptured answer was sent.
SURE: Final = "sure"
LIKELY: Final = "likely"
CERTAINTIES: Final = (SURE, LIKELY)
#: Why a pair is only likely: a code and a sentence for each of the flags `GAPS` and `ALIKE`.
DOUBT_TEXTS: Final[dict[str, str]] = {
    "gaps": "bytes of both directions are missing from the capture between request and answer",
    "alike": "the answer fits several pending requests with the same reference",
}


#: The texts of the outcomes, by their numbers, and the number of errors that `Transaction.__str__` names.
OUTCOME_WORDS: Final = (
    "open",
    "answered",
    "no answer",
    "answer without request",
    "unsolicited",
    "behind a malformed header",
)
_SAID: Final = 3
#: Implements `Transaction.as_dict`; `dissect.files.session` sets it, because only a later room knows how lines are written.
AS_DICT: Final[list[Callable[[Transaction], dict[str, object]]]] = []


@mypyc_attr(
    free_list_len=1
)  # the next object reuses the memory of the last one: most are freed before the next is made
class Transaction(OldNames):
    """A request and its answer.

    Sides are 0 and 1 of ``connection``; ``asked_by`` is the side that sent the request (for an answer without a request and for
    a push: the side that received it). Times are nanoseconds since 1970; frames count from 1, and 0 means that there is none.
    ``reason`` is why a request stayed unanswered. `items` are the same for all protocols.

    The octets of both PDUs are kept and parsed only on demand. `s7_results` are stored at the first access, because rules and
    outputs both need those of a refusal.
    """

    __slots__ = (
        "_carried",
        "_checked",
        "_flags",
        "_known_body",
        "_outcome",
        "_request_ack",
        "_request_buf",
        "_request_offset",
        "_request_seq",
        "_response_buf",
        "_response_offset",
        "_results",
        "again",
        "asked_by",
        "connection",
        "error_code",
        "has_errors",
        "number",
        "parameters",
        "pdu_ref",
        "reason",
        "request_frame",
        "request_ns",
        "request_size",
        "response_frame",
        "response_ns",
        "response_parameters",
        "response_rosctr",
        "response_size",
        "rosctr",
        "subscribed",
    )

    def __init__(
        self, number: i64, connection: Connection, asked_by: i64, rosctr: i64, pdu_ref: i64, parameters: Parameters
    ) -> None:
        self.number: i64 = number
        self.connection: Connection = connection
        self.asked_by: i64 = asked_by
        self.rosctr: i64 = rosctr
        self.pdu_ref: i64 = pdu_ref
        self.parameters: Parameters = parameters  # of the request; of the answer if there is no request
        self._request_ack: i64 = -1  # TCP acknowledgement in the packet of the request, -1 for none
        self._request_seq: i64 = -1  # TCP sequence number where its last segment begins
        self.request_frame: i64 = 0
        self.request_ns: i64 = 0
        self._request_buf: bytes = b""
        self._request_offset: i64 = 0
        self.request_size: i64 = 0
        self.response_frame: i64 = 0
        self.response_ns: i64 = 0
        self._response_buf: bytes = b""
        self._response_offset: i64 = 0
        self.response_size: i64 = 0
        self.response_rosctr: i64 = 0
        self.response_parameters: Parameters | None = None
        self._outcome: i64 = OPEN
        self.reason: str = ""
        self.error_code: i64 = 0  # header class and code, or the userdata error code
        self.has_errors: bool = False
        self._flags: i64 = 0
        self._checked: Check | None = None  # the answer of S7comm-plus, until it is judged
        self.subscribed: Subscription | None = None  # for a push: its subscription, if known
        self._carried: list[ScdMessage] | None = None  # SCD in the items or the block of an S7 transaction
        self.again: SentAgain | None = None  # for a request that TCP retransmitted
        self._results: list[ItemResult] | None = None
        self._known_body: Body | None = None  # the parts of the request, once `request_body` was used

    def __repr__(self) -> str:
        return f"Transaction({self.number}, {self.function_name}, {self.outcome})"

    def __str__(self) -> str:
        """Return its subject and its outcome: ``Read Var DB1.DBB0 x2: answered, Object does not exist``."""
        from dissect.engine.transactions.naming import subject

        said = [str(error.name) for error in self.errors[:_SAID]] or ([self.reason_text] if self.reason_text else [])
        return printable(f"{subject(self)}: {', '.join([OUTCOME_WORDS[self._outcome], *said])}")

    @property
    def items(self) -> list[TransactionItem]:
        """The items that were read, written or pushed, in one form for S7comm, S7comm-plus and SCD, refused items included.

        Empty for functions without items. With tags, a part of an item that has a tag is a separate item.
        """
        from dissect.engine.transactions.items import items_of

        return items_of(self)

    def as_dict(self) -> dict[str, object]:
        """Return the transaction as the JSON line of `s7dissect transactions -T jsonl` has it (docs/json.md)."""
        if not AS_DICT:
            raise RuntimeError("import dissect.files.session first: it knows how JSON lines are made")
        return AS_DICT[0](self)

    def _set_response(
        self, rosctr: i64, parameters: Parameters, buf: bytes, at: i64, size: i64, frame: i64, time_ns: i64
    ) -> None:
        """Store the answer: the PDU ``buf[at:at + size]``, which packet ``frame`` completed."""
        self.response_frame = frame
        self.response_ns = time_ns
        self._response_buf = buf
        self._response_offset = at
        self.response_size = size
        self.response_rosctr = rosctr
        self.response_parameters = parameters

    @property
    def outcome(self) -> str:
        """``answered``, ``unanswered``, ``orphan_answer``, ``unsolicited``, ``behind_malformed``; ``open`` while it waits."""
        return OUTCOMES[self._outcome]

    @property
    def function(self) -> int:
        """Function code of the request, or else of the answer: one octet, in S7comm-plus two; -1 for none."""
        parameters = self.parameters
        if isinstance(parameters, PlusParameters):
            return parameters.code
        return parameters.function

    @property
    def is_plus(self) -> bool:
        """True for S7comm-plus; its request and response are `plus_request` and `plus_response`."""
        return self.rosctr == PLUS

    @property
    def is_scd(self) -> bool:
        """The SCD messages: request and answer of an SCD transaction, or the messages inside an S7 transaction."""
        return self.rosctr == SCD

    @property
    def scd(self) -> list[ScdMessage]:
        """The SCD messages: request and answer of an SCD transaction, or those that an S7 transaction carried."""
        if self._carried is not None:
            return self._carried
        found: list[ScdMessage] = []
        if self.rosctr == SCD:
            asked = self.parameters
            if self.request_size and isinstance(asked, ScdParameters):
                found.append(asked.scd)
            told = self.response_parameters
            if isinstance(told, ScdParameters):
                found.append(told.scd)
        return found

    @property
    def function_name(self) -> str:
        """Name of the function; for userdata the name of the group and subfunction."""
        return self.parameters.function_name

    @property
    def latency_ns(self) -> int | None:
        """Time from the request's last packet to the answer's last packet; None if one is missing or the pair `is_likely`."""
        return self.response_ns - self.request_ns if self._outcome == ANSWERED and not self._flags & DOUBTS else None

    @property
    def certainty(self) -> str:
        """``sure`` or ``likely``: for a pair, and for an answer that was sent but not captured; else empty.

        A push is ``likely`` if its items are those of a request that only likely began its job.
        """
        if self._outcome == ANSWERED or (self._outcome == UNANSWERED and self.reason == HOLE):
            return LIKELY if self._flags & DOUBTS else SURE
        return LIKELY if self.doubt else ""

    @property
    def is_likely(self) -> bool:
        """True for a pair that is only likely: it is excluded from times, values and contradictions, and counted separately."""
        return self._outcome == ANSWERED and self._flags & DOUBTS != 0

    @property
    def doubt(self) -> str:
        """Why a pair, or the assignment of a push to its request, is only likely, as a key of `DOUBT_TEXTS`; else empty."""
        if self._flags & DOUBTS == 0 or (self._outcome != ANSWERED and self._outcome != PUSH):
            return ""
        return "gaps" if self._flags & GAPS else "alike"

    @property
    def is_behind(self) -> bool:
        """True when its request or its answer is behind the malformed header of a TPDU."""
        return self._flags & BEHIND != 0

    @property
    def reason_text(self) -> str:
        """One sentence that says why a request has no answer; empty if it has one, and for an answer without a request."""
        if self._outcome != UNANSWERED and self._outcome != BEHIND_MALFORMED:
            return ""
        if self.reason == HOLE and self._flags & DOUBTS:
            return PERHAPS_ANSWERED
        return REASON_TEXTS.get(self.reason, "")

    @property
    def missed(self) -> bool:
        """True when an answer was due but did not come. This is the only rule for what counts as unanswered.

        An answer that was or may have been sent but not captured (`unseen`) is not missed: only the capture lacks it.
        """
        return self._outcome == UNANSWERED and not self._flags & STILL_OPEN and not self.unseen

    @property
    def unseen(self) -> bool:
        """True when an answer was or may have been sent but not captured: a gap, or only one direction was captured."""
        return self._outcome == UNANSWERED and (self.reason == HOLE or self._flags & EXPECTED != 0)

    @property
    def failed(self) -> bool:
        """True when the answer refuses something, or was `missed`."""
        return self.has_errors or self.missed

    @property
    def request_octets(self) -> bytes:
        """The octets of the request's PDU, empty when there is none."""
        if self._request_offset == 0 and self.request_size == len(self._request_buf):
            return self._request_buf  # no copy
        return self._request_buf[self._request_offset : self._request_offset + self.request_size]

    @property
    def response_octets(self) -> bytes:
        """The octets of the answer's PDU, empty when there is none."""
        if self._response_offset == 0 and self.response_size == len(self._response_buf):
            return self._response_buf  # no copy
        return self._response_buf[self._response_offset : self._response_offset + self.response_size]

    @property
    def request(self) -> Pdu | None:
        """The S7comm request, parsed again at each access; None if there is none."""
        if not self.request_size or self.is_plus or self.is_scd:
            return None
        return parse_pdu(
            self.request_octets, self.request_frame, self.request_ns, self.connection.number, self.asked_by
        )

    @property
    def request_body(self) -> Body | None:
        """The parts of the S7comm request (`Pdu.body`), None if there is none; stored for the next access."""
        if self._known_body is None and (request := self.request) is not None:
            self._known_body = request.body
        return self._known_body

    @property
    def response(self) -> Pdu | None:
        """The S7comm answer, parsed again at each access; None if there is none."""
        if not self.response_size or self.is_plus or self.is_scd:
            return None
        return parse_pdu(
            self.response_octets, self.response_frame, self.response_ns, self.connection.number, 1 - self.asked_by
        )

    @property
    def plus_request(self) -> PlusPdu | None:
        """The S7comm-plus request, parsed again at each access; None if there is none."""
        if not self.request_size or not self.is_plus:
            return None
        return parse_plus(
            self.request_octets, self.request_frame, self.request_ns, self.connection.number, self.asked_by
        )

    @property
    def plus_response(self) -> PlusPdu | None:
        """The S7comm-plus response or notification, parsed again at each access; None if there is none."""
        if not self.response_size or not self.is_plus:
            return None
        return parse_plus(
            self.response_octets, self.response_frame, self.response_ns, self.connection.number, 1 - self.asked_by
        )

    def _plus_halves(self, said: bool = False) -> tuple[Half | None, Half | None]:
        """Read both S7comm-plus PDUs without secrets, None for a missing one; ``said``: only the attributes shown in lines."""
        asked, told, read = self.plus_request, self.plus_response, said_half if said else shown_half
        return (read(asked) if asked is not None else None, read(told) if told is not None else None)

    @property
    def plus_results(self) -> list[PlusItem]:
        """Return every item of an S7comm-plus read, write or notification joined with its answer; empty for other functions.

        The items are parsed again at each call.
        """
        asked, told = self._plus_halves()
        return join_items(asked, told, self.connection.plus)

    @property
    def s7_results(self) -> list[ItemResult]:
        """Return every item joined with its value and return code, in wire order; empty for functions without items.

        Reads, writes, cyclic services and test functions on variables have items; `subscribed` names those of a push. Once the
        transaction is complete each call returns the same list: do not change it.
        """
        if self._results is not None:
            return self._results
        results = self._read_results()
        if self._outcome != OPEN:
            self._results = results
        return results

    def _read_results(self) -> list[ItemResult]:
        function = self.function
        if self.rosctr == JOB:
            items = self.parameters.items if self.request_size else []
            if function == READ_VAR:
                return read_results(items, self._answered_items())
            if function == WRITE_VAR:
                return write_results(items, self._written_items(), self._write_codes())
        elif self.rosctr == USERDATA:
            head = self.parameters.userdata
            if head is not None and has_items(head):
                asked = self.parameters if self.request_size else None
                told = self.response_parameters
                wanted = self.subscribed.items if self.subscribed is not None else None
                return userdata_results(asked, self.request_octets, told, self.response_octets, wanted)
        return []

    def _answered_items(self) -> list[DataItem]:
        """Return the data items of a read answer; their offsets are within the buffer."""
        answer = self.response_parameters
        if answer is None or answer.item_count <= 0 or answer.function != READ_VAR or self.response_rosctr != ACK_DATA:
            return []
        at: i64 = self._response_offset + ACK_HEADER_SIZE + len(answer.octets)
        end: i64 = self._response_offset + self.response_size
        if self.error_code and at >= end:
            return []  # refused as a whole: no items come back
        return parse_data_items(self._response_buf, at, end, answer.item_count, True, [])

    def _written_items(self) -> list[DataItem]:
        """Return the data items of a write request; their offsets are within the buffer.

        If the data block contradicts itself, all data items after the first one that does not match its item are meaningless.
        """
        asked = self.parameters
        if asked.item_count <= 0 or asked.function != WRITE_VAR or self.rosctr != JOB or not self.request_size:
            return []
        at: i64 = self._request_offset + HEADER_SIZE + len(asked.octets)
        end: i64 = self._request_offset + self.request_size
        told: list[Malformed] = []
        found = parse_data_items(self._request_buf, at, end, asked.item_count, False, told)
        if not told:
            return found
        early: i64 = without_fill(asked.items, self._request_buf, at, end)
        return fitting(asked.items, found[:early] if early else found)

    def _write_codes(self) -> list[int]:
        answer = self.response_parameters
        if answer is None or answer.function != WRITE_VAR or self.response_rosctr != ACK_DATA:
            return []
        at: i64 = self._response_offset + ACK_HEADER_SIZE + len(answer.octets)
        return list(self._response_buf[at : self._response_offset + self.response_size])

    @property
    def frames(self) -> list[int]:
        """The packet numbers of request and answer, if captured."""
        if self.request_frame == 0:
            return [self.response_frame] if self.response_frame else []
        if self.response_frame == 0:
            return [self.request_frame]
        return [self.request_frame, self.response_frame]

    @property
    def errors(self) -> list[TransactionError]:
        """Everything that the answer refuses, in wire order: header, parameter, items. Empty if it refuses nothing."""
        if not self.has_errors:
            return []
        if self.is_scd:
            return self._scd_errors()
        whole = refusal(self)
        errors = [whole] if whole is not None else []
        if self.is_plus:
            return errors + self._plus_item_errors()
        if self.rosctr == USERDATA:
            errors += alarm_errors(self)
        results = self.s7_results
        for number in range(1, len(results) + 1):  # not `enumerate`: with a start value mypyc calls it
            result, code = results[number - 1], results[number - 1].return_code
            address = result.item.address if result.item is not None else ""
            if result.refused:
                errors.append(item_error(code, number, address))
            elif code < 0 and self._flags & UNCONFIRMED:
                errors.append(TransactionError(ITEM, NO_CODE, *NO_CODE_TEXTS, number, address))
        return errors

    @property
    def refused(self) -> bool:
        """True when the answer refuses the request as a whole (`results.refusal`); in S7comm-plus perhaps only a part of it."""
        return self.error_code != 0 or (self.has_errors and data_code(self) != NOT_REFUSED)

    def _plus_item_errors(self) -> list[TransactionError]:
        """Return the refusals of single items; empty if the request was refused as a whole."""
        if self.error_code and self.error_code != PARTIAL_ERROR:
            return []
        if self.request_size == 0:
            told = check(self.response_octets)
            if told.sound and told.opcode == NOTIFICATION:
                return [self._notified_error(reference, kind) for reference, kind in told.refusals]
        return [
            TransactionError(
                ITEM,
                item.return_code,
                item.codes.name(item.return_code),
                item.codes.text(item.return_code),
                item.number,
                printable(item.label),
            )
            for item in self.plus_results
            if item.return_code > 0
        ]

    def _notified_error(self, reference: int, kind: int) -> TransactionError:
        """Return the refusal of an item of a subscription, without reading the values that came with it."""
        session = self.connection.plus
        address = session.address_of(subscription_of(self.response_octets), reference) if session is not None else None
        label = session.label(address) if session is not None and address is not None else f"item {reference}"
        return TransactionError(ITEM, kind, NOTIFIED.name(kind), NOTIFIED.text(kind), reference, printable(label))

    def _scd_errors(self) -> list[TransactionError]:
        told = self.response_parameters
        if not isinstance(told, ScdParameters):
            return []
        name = "abort" if told.scd.message.phase == "abort" else "error"
        return [TransactionError(MESSAGE, int(told.err), name, told.scd.dictionary.error_text(int(told.err)))]


def unasked(
    connection: Connection,
    asked_by: i64,
    rosctr: i64,
    pdu_ref: i64,
    parameters: Parameters,
    buf: bytes,
    at: i64,
    size: i64,
    frame: i64,
    time_ns: i64,
) -> Transaction:
    """Return an answer as a transaction without a request, for now; side ``asked_by`` would have sent the request."""
    transaction = Transaction(0, connection, asked_by, rosctr, pdu_ref, parameters)
    transaction._set_response(rosctr, parameters, buf, at, size, frame, time_ns)
    transaction._outcome = ORPHAN
    return transaction


leaves(Transaction, without=("_known_body", "_request_seq"))
