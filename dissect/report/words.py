"""Small phrases that several faces share: durations, sizes, values, what a transaction says."""

from __future__ import annotations

from dissect.s7.tables import RETURN_CODES, SUCCESS
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
)
from dissect.wire.text import printable

#: Elements of an array, and characters of a text, that are shown on a line.
_SHOWN = 8
_SHOWN_TEXT = 32

_REASONS = {
    CONNECTION_CLOSED: "connection closed",
    CAPTURE_ENDED: "capture ends",
    HOLE: "hole in the capture",
    REFERENCE_REUSED: "reference used again",
    TABLE_FULL: "too many open",
    CONNECTION_EVICTED: "too many connections",
}


def duration(ns: int | None) -> str:
    """Return a duration in the unit that suits it, for example ``412 µs``, ``3.21 ms``, ``1.54 s``; ``-`` for none."""
    if ns is None:
        return "-"
    size = abs(ns)
    if size < 1_000_000:
        return f"{ns / 1e3:.0f} µs"
    if size < 100_000_000:
        return f"{ns / 1e6:.2f} ms"
    if size < 1_000_000_000:
        return f"{ns / 1e6:.0f} ms"
    if size < 600_000_000_000:
        return f"{ns / 1e9:.2f} s"
    minutes, seconds = divmod(ns // 1_000_000_000, 60)
    hours, minutes = divmod(minutes, 60)
    return f"{hours} h {minutes:02d} min {seconds:02d} s"


def size(octets: int) -> str:
    """Return a size for a person: ``512 B``, ``5.4 kB``, ``118.2 MB``."""
    for unit, factor in (("GB", 10**9), ("MB", 10**6), ("kB", 10**3)):
        if octets >= factor:
            return f"{octets / factor:.1f} {unit}"
    return f"{octets} B"


def count(number: int, one: str, many: str = "") -> str:
    """Return a number with its noun: ``1 packet``, ``31 packets``."""
    return f"{number} {one if number == 1 else many or one + 's'}"


def value(shown: Value) -> str:
    """Return a decoded value on one line; long arrays and texts are cut with a note of how much there is."""
    if isinstance(shown, bool):
        return "true" if shown else "false"
    if isinstance(shown, str):
        text = printable(shown)
        return f"'{text[:_SHOWN_TEXT]}'" + (f"… ({len(shown)} characters)" if len(text) > _SHOWN_TEXT else "")
    if isinstance(shown, list):
        body = ", ".join([value(element) for element in shown[:_SHOWN]])
        return f"[{body}]" if len(shown) <= _SHOWN else f"[{body}, … {len(shown)} in all]"
    return "-" if shown is None else str(shown)


def octets(data: bytes) -> str:
    """Return octets as hexadecimal on one line, cut after 16."""
    return data[:16].hex(" ") + (f" … {len(data)} octets" if len(data) > 16 else "")


def address(transaction: Transaction, index: int) -> str:
    """Return the address of an item with its count where that is not one, for example ``DB10.DBW4[3]``."""
    item = transaction.parameters.items[index]
    return f"{item.address}[{item.count}]" if item.count > 1 else item.address


def item(result: ItemResult) -> str:
    """Return one item with what became of it: ``DB10.DBW4 = 1234``, ``DB99.DBW0: Object does not exist``."""
    asked = result.item
    name = "?" if asked is None else (f"{asked.address}[{asked.count}]" if asked.count > 1 else asked.address)
    if result.return_code >= 0 and result.return_code != SUCCESS:
        return f"{name}: {RETURN_CODES.name(result.return_code)}"
    if result.data is None:
        return name
    decoded = result.value
    return f"{name} = {value(decoded) if decoded is not None else octets(result.data)}"


def subject(transaction: Transaction) -> str:
    """Return what a transaction is about: its items, the setup, or nothing."""
    results = transaction.results()
    if results:
        return ", ".join([item(result) for result in results])
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


def outcome(transaction: Transaction) -> str:
    """Return how a transaction ended, empty when all went well."""
    if transaction.outcome == ORPHAN:
        said = "answer without request"
    elif transaction.outcome == PUSH:
        said = "push"
    elif transaction.outcome == ANSWERED:
        said = ""
    else:
        said = f"NO ANSWER ({_REASONS.get(transaction.reason, transaction.reason)})"
    if transaction.error_code:
        error = transaction.errors[0]
        refused = f"REFUSED 0x{error.code:04x} {error.name}"
        said = f"{said}, {refused}" if said else refused
    return said
