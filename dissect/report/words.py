"""Small phrases that several faces share: durations, sizes, values, what a transaction says."""

from __future__ import annotations

from typing import Final

from dissect.iso.tsap import Tsap
from dissect.report.plus import plus_item_texts, plus_subject
from dissect.report.scd import scd_subject
from dissect.s7.items import Item
from dissect.s7.message import Pdu
from dissect.s7.tables import READ_VAR, RETURN_CODES, SETUP_COMMUNICATION, USERDATA, WRITE_VAR
from dissect.s7.values import BYTE, Value
from dissect.transactions.results import ItemResult
from dissect.transactions.transaction import (
    ANSWERED,
    CAPTURE_ENDED,
    CONNECTION_CLOSED,
    CONNECTION_EVICTED,
    HOLE,
    ITEM,
    MESSAGE,
    NO_CODE,
    ORPHAN,
    PUSH,
    REFERENCE_REUSED,
    TABLE_FULL,
    UNCONFIRMED,
    Transaction,
    TransactionError,
)
from dissect.wire.durations import duration_text
from dissect.wire.text import printable, shortened

#: Elements of an array, characters of a text and octets that are shown on a line.
_SHOWN: Final = 8
_SHOWN_TEXT: Final = 32
_SHOWN_OCTETS: Final = 16
#: Fewer characters than these may be a chance.
_LEAST_TEXT: Final = 4
#: Items or notes that a summary names, and characters of a note.
_NAMED: Final = 3
_NOTE: Final = 100
#: Functions that say what they are about by their items, or by what they negotiate.
_TOLD_BY_ITEMS: Final = frozenset((READ_VAR, WRITE_VAR, SETUP_COMMUNICATION))

#: Group and subfunction that lists the blocks of a type.
_LIST_OF_TYPE: Final = (3, 2)

REASONS: Final = {
    CONNECTION_CLOSED: "connection closed",
    CAPTURE_ENDED: "capture ends",
    HOLE: "gap in the capture",
    REFERENCE_REUSED: "reference used again",
    TABLE_FULL: "too many open",
    CONNECTION_EVICTED: "too many connections",
}


def duration(ns: int | None) -> str:
    """Return a duration in the unit that suits it, for example ``412 µs``, ``3.21 ms``, ``1.54 s``; ``-`` for none."""
    if ns is None:
        return "-"
    return duration_text(ns)


def size(octets: int) -> str:
    """Return a size for a person: ``512 B``, ``5.4 kB``, ``118.2 MB``."""
    for unit, factor in (("GB", 10**9), ("MB", 10**6), ("kB", 10**3)):
        if octets >= factor:
            return f"{octets / factor:.1f} {unit}"
    return f"{octets} B"


def count(number: int, one: str, many: str = "") -> str:
    """Return a number with its noun: ``1 packet``, ``31 packets``."""
    return f"{number} {one if number == 1 else many or one + 's'}"


def vlans(key: int) -> list[int]:
    """Return the VLAN ids of a connection, the outer tag first, from the number that holds them in twelve bits each."""
    vids: list[int] = []
    while key:
        key, vid = divmod(key, 4096)
        vids.append(vid)
    vids.reverse()
    return vids


def tsaps(calling: Tsap | None, called: Tsap | None, siemens: bool) -> str:
    """Return the TSAPs of a connection, ``?`` for one not captured; with rack and slot when it is ``siemens`` that speaks."""
    one = "?" if calling is None else printable(calling.describe(False) if siemens else _plain(calling))
    other = "?" if called is None else printable(called.describe() if siemens else _plain(called))
    return f"TSAP {one} → {other}"


def _plain(tsap: Tsap) -> str:
    return tsap.describe() if tsap.connection_type < 0 else str(tsap)


def value(shown: Value) -> str:
    """Return a decoded value on one line; long arrays and texts are cut with a note of how much there is."""
    if isinstance(shown, bool):
        return "true" if shown else "false"
    if isinstance(shown, str):
        if len(shown) > _SHOWN_TEXT:
            return f"'{printable(shown[:_SHOWN_TEXT])}'… ({len(shown)} characters)"
        return f"'{printable(shown)}'"
    if isinstance(shown, list):
        body = ", ".join([value(element) for element in shown[:_SHOWN]])
        return f"[{body}]" if len(shown) <= _SHOWN else f"[{body}, … {len(shown)} in all]"
    return "-" if shown is None else str(shown)


def octets(data: bytes) -> str:
    """Return octets as hexadecimal on one line, cut after 16 with a note of how many there are, and the text in them if any."""
    text = spelled(data)
    said = f" '{text}'" if text else ""
    if len(data) <= _SHOWN_OCTETS:
        return (data.hex(" ") or "(empty)") + said
    return f"{data[:_SHOWN_OCTETS].hex(' ')} … {len(data)} bytes{said}"


def spelled(data: bytes) -> str:
    """Return the text that octets spell, empty where they do not: ASCII that can be printed, NULs or blanks behind it.

    An S7 STRING begins with its greatest and its present length.
    """
    if len(data) >= _LEAST_TEXT + 2 and data[1] <= data[0] and _LEAST_TEXT <= data[1] <= len(data) - 2:
        content = data[2 : 2 + data[1]]
    else:
        content = data.rstrip(b"\0 ")
    if len(content) < _LEAST_TEXT or not all([0x20 <= octet < 0x7F for octet in content]):
        return ""
    text = content.decode("ascii")
    return printable(text if len(text) <= _SHOWN_TEXT else f"{text[:_SHOWN_TEXT]}…")


def address(item: Item) -> str:
    """Return the address of an item with its count where that is not one, for example ``DB10.DBW4 x3``."""
    return shortened(item.label, 100)


def item(result: ItemResult, number: int) -> str:
    """Return one item with what became of it: ``DB10.DBW4 = 1234``, ``DB99.DBW0: Object does not exist``."""
    asked = result.item
    name = f"item {number}" if asked is None else address(asked)
    if result.data is not None:
        name += f" = {_content(result)}"
    if result.unchanged:
        return f"{name}: unchanged"
    return f"{name}: {RETURN_CODES.name(result.return_code)}" if result.refused else name


def _content(result: ItemResult) -> str:
    """Return what was read or written: the value, and octets as such, with the text they spell where they spell one."""
    assert result.data is not None
    decoded = result.value
    if decoded is None or (
        isinstance(decoded, list) and result.item is not None and result.item.transport_size == BYTE
    ):
        return octets(result.data)
    return value(decoded)


def items(transaction: Transaction) -> list[str]:
    """Return every item with what became of it, in wire order; those that a push says are unchanged are counted."""
    if transaction.is_plus:
        return plus_item_texts(transaction)
    results = list(enumerate(transaction.results(), 1))
    unsure = transaction.flags & UNCONFIRMED != 0
    said = [
        f"{item(result, number)}{': no return code' if unsure and result.return_code < 0 else ''}"
        for number, result in results
        if not result.unchanged
    ]
    same = len(results) - len(said)
    return [*said, f"{same} unchanged"] if same else said


def subject(transaction: Transaction) -> str:
    """Return what a transaction is about: all its items, the setup, or what request and answer say."""
    if transaction.is_plus:
        return plus_subject(transaction)
    said = ", ".join(items(transaction)) or _setup(transaction) or notes(transaction)
    if transaction.rosctr == USERDATA and transaction.results():
        said = ": ".join([text for text in (_heads(transaction), said) if text])
    if transaction.carried is not None:
        said = "; ".join([text for text in (said, scd_subject(transaction)) if text])
    return said


def _heads(transaction: Transaction) -> str:
    """Return what request and answer say in front of their items: interval, job number, block."""
    from dissect.s7.cyclic import CYCLIC_REQUEST, CYCLIC_VALUES  # late: see `Pdu.body`
    from dissect.s7.programmer_layouts import TEST_BLOCK, TEST_HEAD

    said = [
        part.note
        for pdu in (transaction.request, transaction.response)
        if pdu is not None
        for part in pdu.body.parts
        if part.note and part.layout in {CYCLIC_REQUEST, CYCLIC_VALUES, TEST_BLOCK, TEST_HEAD}
    ]
    first = said[0] if said else ""
    return ", ".join([shortened(note, _NOTE) for note in dict.fromkeys(said) if not first.startswith(f"{note},")])


def notes(transaction: Transaction) -> str:
    """Return what request and answer say, for functions that have no items: a few notes of each."""
    if transaction.is_plus:
        return plus_subject(transaction)
    if transaction.is_scd:
        return scd_subject(transaction)
    if transaction.function in _TOLD_BY_ITEMS:
        return ""
    asked, told = transaction.request, transaction.response
    said = [body_notes(pdu) for pdu in (asked, told) if pdu is not None]
    head = transaction.parameters.userdata
    listed = (
        head is not None and (head.group, head.subfunction) == _LIST_OF_TYPE
    )  # the answer only goes on: SFC 0 (AWL), …
    return (" " if listed else " → ").join([text for text in said if text])


def subject_whole(transaction: Transaction) -> str:
    """Return what a transaction without items is about, nothing left out."""
    if transaction.is_plus or transaction.is_scd or transaction.function in _TOLD_BY_ITEMS:
        return subject(transaction)
    asked, told = transaction.request, transaction.response
    said = [", ".join([printable(note) for note in pdu.body.notes]) for pdu in (asked, told) if pdu is not None]
    return " → ".join([text for text in said if text])


def body_notes(pdu: Pdu) -> str:
    """Return what the parts of a PDU are about: the first few notes, and how many more there are."""
    return some_notes(pdu.body.notes)


def some_notes(found: list[str]) -> str:
    """Return the first few notes, and how many more there are."""
    more = f" and {len(found) - _NAMED} more" if len(found) > _NAMED else ""
    return ", ".join([shortened(note, _NOTE) for note in found[:_NAMED]]) + more


def gist(transaction: Transaction) -> str:
    """Return what a transaction is about, as a summary: the items that failed, or else what was asked for, but never all."""
    results = transaction.results()
    numbered = list(enumerate(results, 1))
    refused = [(number, result) for number, result in numbered if result.refused]
    if refused:
        some = [item(result, number) for number, result in refused[:_NAMED]]
        total = f"{len(refused)} of {count(len(results), 'item')} refused: " if len(results) > 1 else ""
        return total + ", ".join(some) + (", …" if len(refused) > _NAMED else "")
    names = [address(result.item) if result.item is not None else f"item {number}" for number, result in numbered]
    more = f" and {len(names) - _NAMED} more" if len(names) > _NAMED else ""
    return ", ".join(names[:_NAMED]) + more or _setup(transaction) or notes(transaction)


def _setup(transaction: Transaction) -> str:
    asked = transaction.parameters.setup
    if asked is None:
        return ""
    answer = transaction.response_parameters
    granted = answer.setup if answer is not None else None
    wish = f"PDU {asked.pdu_length}, AmQ {asked.max_amq_calling}/{asked.max_amq_called}"
    if granted is None or transaction.outcome != ANSWERED:
        return f"asks {wish}"
    given = f"PDU {granted.pdu_length}, AmQ {granted.max_amq_calling}/{granted.max_amq_called}"
    return f"granted {given}" if given == wish else f"asks {wish}, granted {given}"


def error_text(error: TransactionError) -> str:
    """Return an error: a code of S7 as it stands on the wire with its name, one of SCD with what it means."""
    if error.part == MESSAGE:
        return f"{error.name} {error.code}: {printable(error.text)}"
    if error.code == NO_CODE:
        return error.name
    code = f"0x{error.code:02x}" if error.part == ITEM else f"0x{error.code:04x}"
    return f"{code} {error.name}"


def outcome(transaction: Transaction) -> str:
    """Return how a transaction ended, empty when all went well."""
    why = f" ({REASONS.get(transaction.reason, transaction.reason)})" if transaction.reason else ""
    if transaction.outcome == ORPHAN:
        said = f"answer without request{why}"
    elif transaction.outcome == PUSH:
        said = "one way" if transaction.request_frame else "push"
    elif transaction.outcome == ANSWERED:
        said = ""
    else:
        said = f"NO ANSWER{why}"
    if transaction.error_code and transaction.has_errors:
        error = transaction.errors[0]
        refused = f"REFUSED {error_text(error)}"
        said = f"{said}, {refused}" if said else refused
    return said
