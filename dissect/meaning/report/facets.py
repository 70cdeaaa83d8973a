"""A transaction as text: its items with their values or errors, its subject, its outcome.

`FACETS` has the protocols that reports know, by `Transaction.rosctr`. To describe another protocol in its own terms, write a
subclass of `Facet` and add one row. S7comm is the default; its JSON, the bulk of all output, is in
`dissect.meaning.report.writers.jsonl`.
"""

from __future__ import annotations

from typing import Final

from mypy_extensions import i64

from dissect.engine.transactions.good_items import good_octets
from dissect.engine.transactions.naming import NamedValue, Naming
from dissect.engine.transactions.payloads import SCD, is_scd_key
from dissect.engine.transactions.results import (
    COUNT_MISMATCH,
    FUNCTION_MISMATCH,
    MESSAGE,
    SIZE_MISMATCH,
    UNCONFIRMED,
    TransactionError,
    mismatches,
)
from dissect.engine.transactions.transaction import (
    ANSWERED,
    CAPTURE_ENDED,
    CONNECTION_CLOSED,
    CONNECTION_EVICTED,
    HOLE,
    MALFORMED_HEADER,
    ONE_SIDED,
    ORPHAN,
    PUSH,
    REFERENCE_REUSED,
    TABLE_FULL,
    Transaction,
)
from dissect.meaning.report import words
from dissect.meaning.report.facet import Facet
from dissect.meaning.report.plus import PlusFacet
from dissect.meaning.report.scd import ScdFacet, scd_subject
from dissect.protocols.s7.blocks import BLOCK_COUNT
from dissect.protocols.s7.body import Body
from dissect.protocols.s7.items import Item, ItemResult, data_size_within
from dissect.protocols.s7.message import Pdu
from dissect.protocols.s7.tables import (
    BIT,
    BYTE,
    ELEMENT_OCTETS,
    READ_VAR,
    RETURN_CODES,
    SETUP_COMMUNICATION,
    USERDATA,
    WRITE_VAR,
)
from dissect.protocols.s7.values import decode_value, number_texts
from dissect.protocols.s7plus.parameters import PLUS, is_plus_key
from dissect.protocols.s7plus.tables import PARTIAL_ERROR
from dissect.wire.text import printable, shortened, some

#: Functions that are described by their items, or by the negotiated values; notes on them would add nothing.
_TOLD_BY_ITEMS: Final = frozenset((READ_VAR, WRITE_VAR, SETUP_COMMUNICATION))

#: Group and subfunction of the request that lists the blocks of a type.
_LIST_OF_TYPE: Final = (3, 2)

#: Maximum number of tags of one item that a line names.
_SHOWN_TAGS: Final = 16
#: Maximum number of types of blocks that are shown with their numbers; there are fewer types, so all are shown.
_BLOCK_TYPES: Final = 16
#: Why a request remained without an answer.
REASONS: Final = {
    CONNECTION_CLOSED: "connection closed",
    CAPTURE_ENDED: "capture ends",
    HOLE: "gap in the capture",
    ONE_SIDED: "direction not captured",
    REFERENCE_REUSED: "reference used again",
    TABLE_FULL: "too many open",
    CONNECTION_EVICTED: "too many connections",
    MALFORMED_HEADER: "behind a malformed TPDU header",
}


def address(item: Item) -> str:
    """Return the address of an item, and its count if that is not 1, for example ``DB10.DBW4 x3``."""
    if not item.shown:
        item.shown = shortened(item.label, 100)
    return item.shown


def item(result: ItemResult, number: int, naming: Naming | None = None) -> str:
    """Return one item with its value or error: ``DB10.DBW4 = 1234``, ``DB99.DBW0: Object does not exist``.

    With ``naming``, the tags in the item replace its value: ``DB10.DBB0 x6 {Tank.Level = 3.5 m, …}``.
    """
    asked = result.item
    name = f"item {number}" if asked is None else address(asked)
    known = naming.named(result) if naming is not None else []
    if known:
        name = _with_names(name, known)
    elif result.data is not None:
        name += f" = {content(asked, result.data) if asked is not None else words.octets(result.data)}"
    name += _other_size(result)
    if result.unchanged:
        return f"{name}: unchanged"
    return f"{name}: {RETURN_CODES.name(result.return_code)}" if result.refused else name


def _other_size(result: ItemResult) -> str:
    """Return a remark on an item that has fewer or more octets than requested; empty if the number is right."""
    asked, data, stands_in = result.item, result.data, result.answer
    if asked is None or data is None or not 0 <= asked.size != len(data):
        return ""
    if stands_in is not None:
        stated = data_size_within(stands_in.transport_size, stands_in.length, asked.size)
        if stated > len(data):
            return f" ({len(data)} of {stated} bytes captured)"
    return f" ({words.count(len(data), 'byte')} instead of {asked.size})"


def _with_names(place: str, known: list[NamedValue]) -> str:
    """Return an item with its tags: a single tag is placed before the address, several are placed after it."""
    if len(known) == 1:
        only = named_value(known[0])
        name, equals, content = only.partition(" = ")
        return f"{name} ({place}){equals}{content}"
    shown = [named_value(value) for value in known[:_SHOWN_TAGS]]
    more = f", … {len(known)} in all" if len(known) > _SHOWN_TAGS else ""
    return f"{place} {{{', '.join(shown)}{more}}}"


def named_value(known: NamedValue) -> str:
    """Return a value with its name and unit: ``Tank.Level = 3.5 m``; octets without a tag with their address."""
    size = len(known.data)
    if not known.name:
        place = f"{known.address} x{size}" if size > 1 else known.address
        return f"{place}{f' ({known.remark})' if known.remark else ''} = {words.octets(known.data)}"
    name = shortened(known.name, 100)
    if known.value is None:
        why = f" ({printable(known.remark)})" if known.remark else ""
        return f"{name}{why} = {words.octets(known.data)}" if size else name
    unit = f" {shortened(known.unit, 20)}" if known.unit else ""
    return f"{name} = {words.value(known.value, known.data)}{unit}"


def content(asked: Item, data: bytes) -> str:
    """Return the value that was read or written; several bytes in hexadecimal, with the text if they spell one."""
    size: i64 = len(data)
    kind: i64 = asked.transport_size
    if (kind == BYTE and size != 1) or (asked.size != size and not asked.fits(size)):
        return words.octets(data)
    if kind == BIT and size == 1:
        return "true" if data[0] & 1 else "false"
    texts = number_texts(kind, data, words.SHOWN)
    if not texts:
        decoded = decode_value(kind, data)
        return words.octets(data) if decoded is None else words.value(decoded, data)
    if len(texts) == 1:
        return texts[0]
    body = ", ".join(texts)
    count: i64 = size // ELEMENT_OCTETS[kind]
    return f"[{body}]" if count <= words.SHOWN else f"[{body}, … {count} in all]"


def body_notes(pdu: Pdu) -> str:
    """Return `notes_of` the body of a PDU."""
    return notes_of(pdu.body)


def notes_of(body: Body) -> str:
    """Return the first few notes on the parts of a body, and the number of the others.

    From a list of the numbers of blocks that a CPU has, types without blocks are left out.
    """
    counts = [part for part in body.parts if part.layout is BLOCK_COUNT]
    if not counts:
        return words.some_notes(body.notes)
    return words.some_notes([part.note for part in counts if part.number("block_count")], _BLOCK_TYPES) or "no blocks"


def items_in_short(results: list[ItemResult], naming: Naming | None = None) -> str:
    """Return the first few refused items, or if none was refused the first few of all, without values; empty for none."""
    numbered = list(enumerate(results, 1))
    refused = [(number, result) for number, result in numbered if result.refused]
    if refused:
        first = [item(result, number, naming) for number, result in refused[: words.NAMED]]
        total = f"{len(refused)} of {words.count(len(results), 'item')} refused: " if len(results) > 1 else ""
        return total + ", ".join(first) + (", …" if len(refused) > words.NAMED else "")
    names = [_short_name(result, number, naming) for number, result in numbered]
    return some(names, words.NAMED)


def _unconfirmed(transaction: Transaction) -> str:
    """Return the items for which the answer has no return code; empty if there are none, or if it refuses other items."""
    results = transaction.s7_results if transaction._flags & UNCONFIRMED else []
    unsure = [result for result in results if result.return_code < 0]
    if not unsure or any([result.refused for result in results]):
        return ""
    total = f"{len(unsure)} of {words.count(len(results), 'item')} without a return code: "
    return total + items_in_short(unsure, transaction.connection.naming)


def _short_name(result: ItemResult, number: int, naming: Naming | None) -> str:
    """Return the address of an item with its tag, ``Tank.Level (DB1.DBD0)``, or the number: ``DB1.DBB0 x10 (3 tags)``."""
    if result.item is None:
        return f"item {number}"
    known = [value.name for value in naming.named(result) if value.name] if naming is not None else []
    if not known:
        return address(result.item)
    place = address(result.item)
    return f"{shortened(known[0], 100)} ({place})" if len(known) == 1 else f"{place} ({len(known)} tags)"


def error_text(error: TransactionError) -> str:
    """Return an error: an S7 code as on the wire with its name, an SCD code with its meaning."""
    if error.part == MESSAGE:
        return f"{error.name} {error.code}: {printable(error.text)}"
    return error.coded


def outcome(transaction: Transaction) -> str:
    """Return how a transaction ended; empty for an answer without errors."""
    why = f" ({REASONS.get(transaction.reason, transaction.reason)})" if transaction.reason else ""
    if transaction._outcome == ORPHAN:
        said = f"answer without request{why}"
    elif transaction._outcome == PUSH:
        said = "one way" if transaction.request_frame else "push"
    elif transaction.is_behind:
        said = REASONS[MALFORMED_HEADER]
    elif transaction._outcome == ANSWERED:
        said = ""
    elif transaction.reason == HOLE:
        said = transaction.reason_text
    else:
        said = _without_answer(transaction, why)
    if transaction.again is not None:
        again = transaction.again.text(transaction.request_ns)
        said = f"{said}, {again}" if said else again
    if mismatches(transaction):
        said = ", ".join([text for text in (said, f"MISMATCH ({_mismatch(transaction)})") if text])
    if transaction.has_errors and transaction.refused:
        error = transaction.errors[0]
        word = "PARTLY REFUSED" if transaction.is_plus and error.code == PARTIAL_ERROR else "REFUSED"
        refused = f"{word} {error_text(error)}"
        said = f"{said}, {refused}" if said else refused
    return said


def _without_answer(transaction: Transaction, why: str) -> str:
    """Return the outcome of a request whose answer is unknown; ``why`` is the reason in brackets."""
    if not transaction.unseen:
        return f"NO ANSWER{why}"
    if transaction.reason == CONNECTION_EVICTED:  # the answer may well be in the capture
        return f"answer not followed{why}"
    return "answer not captured"


def _mismatch(transaction: Transaction) -> str:
    """Return how an answer does not match its request."""
    answer = transaction.response_parameters
    said = []
    if answer is not None and transaction._flags & FUNCTION_MISMATCH:
        said.append(f"the answer names {'a different object' if transaction.is_scd else answer.function_name}")
    if answer is not None and transaction._flags & COUNT_MISMATCH:
        said.append(f"requested {words.count(transaction.parameters.item_count, 'item')}, got {answer.item_count}")
    if transaction._flags & SIZE_MISMATCH:
        said.append("item size")
    return ", ".join(said)


class S7Facet(Facet):
    """S7comm."""

    def items(self, transaction: Transaction) -> list[str]:
        """Return each item with its value or error, then the number of items that a push states as unchanged."""
        good = good_octets(transaction)
        if good is not None:  # nearly always: then no `ItemResult` is needed
            asked = transaction.parameters.items
            return [f"{address(asked[index])} = {content(asked[index], good[index])}" for index in range(len(good))]
        results = list(enumerate(transaction.s7_results, 1))
        unsure = transaction._flags & UNCONFIRMED != 0
        naming = transaction.connection.naming
        said = [
            f"{item(result, number, naming)}{': no return code' if unsure and result.return_code < 0 else ''}"
            for number, result in results
            if not result.unchanged
        ]
        same = len(results) - len(said)
        return [*said, f"{same} unchanged"] if same else said

    def subject(self, transaction: Transaction) -> str:
        """Return all items, or the setup, or notes on request and answer."""
        said = ", ".join(self.items(transaction)) or self.setup(transaction) or self.notes(transaction)
        if transaction.rosctr == USERDATA and transaction.s7_results:
            said = ": ".join([text for text in (_heads(transaction), said) if text])
        if transaction._carried is not None:
            said = "; ".join([text for text in (said, scd_subject(transaction)) if text])
        return said

    def subject_whole(self, transaction: Transaction) -> str:
        """Return the subject of a transaction without items, not shortened."""
        if transaction.function in _TOLD_BY_ITEMS:
            return self.subject(transaction)
        asked, told = transaction.request, transaction.response
        said = [", ".join([printable(note) for note in pdu.body.notes]) for pdu in (asked, told) if pdu is not None]
        return _asked_and_told(said)

    def notes(self, transaction: Transaction) -> str:
        """Return a few notes on request and answer, for functions that have no items."""
        if transaction.function in _TOLD_BY_ITEMS:
            return ""
        asked, told = transaction.request, transaction.response
        said = [body_notes(pdu) for pdu in (asked, told) if pdu is not None]
        head = transaction.parameters.userdata
        # In a list of blocks the answer continues the text of the request: SFC 0 (AWL), …
        listed = head is not None and (int(head.group), int(head.subfunction)) == _LIST_OF_TYPE
        return " ".join([text for text in said if text]) if listed else _asked_and_told(said)

    def setup(self, transaction: Transaction) -> str:
        """Return the values that a setup requested, and those that were granted."""
        asked = transaction.parameters.setup
        if asked is None:
            return ""
        answer = transaction.response_parameters
        granted = answer.setup if answer is not None else None
        wish = str(asked)
        if granted is None or transaction._outcome != ANSWERED:
            return f"asks {wish}"
        given = str(granted)
        return f"granted {given}" if given == wish else f"asks {wish}, granted {given}"

    def statistics(self, code: int) -> dict[str, object]:
        """Return the function code, and for userdata group and subfunction."""
        if code < 0x10000:
            return {"code": f"0x{code & 0xFF:02x}" if code >= 0 else None}
        group = (code >> 8) & 0xFF
        # Userdata has function code 0x00, except the mode transition: code 0x01, and group 0.
        return {"code": "0x00" if group else "0x01", "group": group, "subfunction": code & 0xFF}


def _asked_and_told(said: list[str]) -> str:
    """Join the notes on a request and on its answer; parts of the answer that repeat the request are left out."""
    if len(said) < 2:
        return "".join(said)
    asked, told = said
    if told == asked or told.startswith(f"{asked}, "):
        said = [asked, told[len(asked) + 2 :]]
    return " → ".join([text for text in said if text])


def _heads(transaction: Transaction) -> str:
    """Return notes on the parts before the items of request and answer: interval, job number, block."""
    from dissect.protocols.s7.cyclic import CYCLIC_REQUEST, CYCLIC_VALUES  # imported late: see `Pdu.body`
    from dissect.protocols.s7.programmer_layouts import TEST_BLOCK, TEST_HEAD

    said = [
        part.note
        for pdu in (transaction.request, transaction.response)
        if pdu is not None
        for part in pdu.body.parts
        if part.note and part.layout in {CYCLIC_REQUEST, CYCLIC_VALUES, TEST_BLOCK, TEST_HEAD}
    ]
    first = said[0] if said else ""
    return ", ".join([shortened(note, words.NOTE) for note in dict.fromkeys(said) if not first.startswith(f"{note},")])


S7: Final = S7Facet()
_PLUS: Final = PlusFacet()
_SCD: Final = ScdFacet()

#: By `Transaction.rosctr`: the protocols without a ROSCTR, which have a number of their own there. All others are S7comm.
FACETS: Final[dict[int, Facet]] = {PLUS: _PLUS, SCD: _SCD}


def facet_of(transaction: Transaction) -> Facet:
    """Return the facet of a transaction's protocol."""
    return FACETS.get(transaction.rosctr, S7)


def facet_of_row(code: int) -> Facet:
    """Return the facet of a row of statistics; ``code`` is its key in `Analysis.functions`."""
    if is_scd_key(code):
        return _SCD
    return _PLUS if is_plus_key(code) else S7


def items(transaction: Transaction) -> list[str]:
    """Return each item with its value or error, in wire order."""
    return facet_of(transaction).items(transaction)


def subject(transaction: Transaction) -> str:
    """Return the subject of a transaction: all its items, or the setup, or notes on request and answer."""
    return facet_of(transaction).subject(transaction)


def gist(transaction: Transaction) -> str:
    """Return the short subject of a transaction: a few refused items, else a few items, the setup, or a few notes."""
    facet = facet_of(transaction)
    return (
        _unconfirmed(transaction)
        or items_in_short(transaction.s7_results, transaction.connection.naming)
        or facet.setup(transaction)
        or facet.notes(transaction)
    )
