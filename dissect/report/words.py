"""Small phrases that several faces share: durations, sizes, values, what a transaction says."""

from __future__ import annotations

from typing import Final

from dissect.iso.tsap import Tsap
from dissect.report.plus import plus_item_texts, plus_subject
from dissect.report.scd import scd_subject
from dissect.s7.items import Item
from dissect.s7.message import Pdu
from dissect.s7.tables import READ_VAR, RETURN_CODES, SETUP_COMMUNICATION, SUCCESS, WRITE_VAR
from dissect.s7.values import Value
from dissect.transactions.transaction import (
    ANSWERED,
    CAPTURE_ENDED,
    CONNECTION_CLOSED,
    CONNECTION_EVICTED,
    HOLE,
    ORPHAN,
    PUSH,
    REFERENCE_REUSED,
    TABLE_FULL,
    ItemResult,
    Transaction,
    TransactionError,
)
from dissect.wire.text import printable, shortened

#: Elements of an array, characters of a text and octets that are shown on a line.
_SHOWN: Final = 8
_SHOWN_TEXT: Final = 32
_SHOWN_OCTETS: Final = 16
#: Items or notes that a summary names, and characters of a note.
_NAMED: Final = 3
_NOTE: Final = 100
#: Functions that say what they are about by their items, or by what they negotiate.
_TOLD_BY_ITEMS: Final = frozenset((READ_VAR, WRITE_VAR, SETUP_COMMUNICATION))

REASONS: Final = {
    CONNECTION_CLOSED: "connection closed",
    CAPTURE_ENDED: "capture ends",
    HOLE: "hole in the capture",
    REFERENCE_REUSED: "reference used again",
    TABLE_FULL: "too many open",
    CONNECTION_EVICTED: "too many connections",
}

_NS_PER_S: Final = 1_000_000_000


def duration(ns: int | None) -> str:
    """Return a duration in the unit that suits it, for example ``412 µs``, ``3.21 ms``, ``1.54 s``; ``-`` for none."""
    if ns is None:
        return "-"
    size = abs(ns)
    if 0 < size < 10_000:
        return f"{ns / 1e3:.1f} µs"
    if size < 999_500:
        return f"{ns / 1e3:.0f} µs"
    if size < 99_995_000:
        return f"{ns / 1e6:.2f} ms"
    if size < 999_500_000:
        return f"{ns / 1e6:.0f} ms"
    if size < 600 * _NS_PER_S:
        return f"{ns / 1e9:.2f} s"
    minutes, seconds = divmod(size // _NS_PER_S, 60)
    hours, minutes = divmod(minutes, 60)
    days, hours = divmod(hours, 24)
    units = [(days, "d"), (hours, "h"), (minutes, "min"), (seconds, "s")]
    first = next(index for index, (number, _) in enumerate(units) if number)
    sign = "-" if ns < 0 else ""
    return sign + " ".join([f"{number} {unit}" for number, unit in units[first:]])


def size(octets: int) -> str:
    """Return a size for a person: ``512 B``, ``5.4 kB``, ``118.2 MB``."""
    for unit, factor in (("GB", 10**9), ("MB", 10**6), ("kB", 10**3)):
        if octets >= factor:
            return f"{octets / factor:.1f} {unit}"
    return f"{octets} B"


def count(number: int, one: str, many: str = "") -> str:
    """Return a number with its noun: ``1 packet``, ``31 packets``."""
    return f"{number} {one if number == 1 else many or one + 's'}"


def moment(iso: str) -> str:
    """Return an ISO 8601 time for a person: a blank between date and time, and microseconds."""
    day, _, time = iso.partition("T")
    return f"{day} {time[:15]}"


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
    """Return octets as hexadecimal on one line, cut after 16 with a note of how many there are."""
    if len(data) <= _SHOWN_OCTETS:
        return data.hex(" ") or "(empty)"
    return f"{data[:_SHOWN_OCTETS].hex(' ')} … {len(data)} octets"


def address(item: Item) -> str:
    """Return the address of an item with its count where that is not one, for example ``DB10.DBW4 x3``."""
    return shortened(item.label, 100)


def item(result: ItemResult, number: int) -> str:
    """Return one item with what became of it: ``DB10.DBW4 = 1234``, ``DB99.DBW0: Object does not exist``."""
    asked = result.item
    name = f"item {number}" if asked is None else address(asked)
    if result.return_code >= 0 and result.return_code != SUCCESS:
        return f"{name}: {RETURN_CODES.name(result.return_code)}"
    if result.data is None:
        return name
    decoded = result.value
    return f"{name} = {value(decoded) if decoded is not None else octets(result.data)}"


def items(transaction: Transaction) -> list[str]:
    """Return every item of a read or write with what became of it, in wire order."""
    if transaction.is_plus:
        return plus_item_texts(transaction)
    return [item(result, number) for number, result in enumerate(transaction.results(), 1)]


def subject(transaction: Transaction) -> str:
    """Return what a transaction is about: all its items, the setup, or what request and answer say."""
    if transaction.is_plus:
        return plus_subject(transaction)
    said = ", ".join(items(transaction)) or _setup(transaction) or notes(transaction)
    if transaction.carried is not None:
        said = "; ".join([text for text in (said, scd_subject(transaction)) if text])
    return said


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
    refused = [(number, result) for number, result in numbered if result.return_code not in {-1, SUCCESS}]
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
    if error.where == "message":
        return f"{error.name} {error.code}: {printable(error.text)}"
    code = f"0x{error.code:02x}" if error.where.startswith("item") else f"0x{error.code:04x}"
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
