"""Small phrases of a comparison: what an item held, how a transaction went, which element changed."""

from __future__ import annotations

from typing import Final, NamedTuple

from dissect.engine.transactions.transaction import (
    BEHIND_MALFORMED,
    HOLE,
    LIKELY,
    MALFORMED_HEADER,
    OUTCOMES,
    PERHAPS_ANSWERED,
    REASON_TEXTS,
)
from dissect.meaning.report import words
from dissect.protocols.s7.message import NOT_REFUSED
from dissect.protocols.s7.tables import BYTE, RETURN_CODES
from dissect.testing.golden.exchange import ItemRecord
from dissect.testing.golden.model import Transaction
from dissect.wire.text import printable, shortened

#: Maximum number of array elements that are named, and of octets shown around a change.
_ELEMENTS: Final = 3
_AROUND: Final = 8


#: Maximum number of array values that are shown.
Elements = list[bool | int | float | str | None]


class Change(NamedTuple):
    """A change within a pair of transactions, before it gets numbers: kind, text, and the names that patterns may match."""

    kind: str
    text: str
    was: str = ""
    is_: str = ""
    item: str = ""
    address: str = ""
    targets: tuple[str, ...] = ()
    subject: str = ""


def code_text(code: int, name: str, digits: int = 2) -> str:
    """Return an error for people: ``Object does not exist (0x0a)``."""
    number = f"0x{code:0{digits}x}"
    return number if name == number else f"{name} ({number})"


def item_state(item: ItemRecord) -> str:
    """Return the result of an item: its value, why it was refused, or that there was no answer."""
    if item.refused:
        return f"refused: {code_text(item.return_code, item.error)}"
    if item.result.unchanged:
        return "unchanged"
    if item.data is None:
        return "unanswered" if item.return_code < 0 else "good"
    return content(item) if item.return_code >= 0 else f"{content(item)} without return code"


def content(item: ItemRecord) -> str:
    """Return the value of an item, or its octets."""
    value = item.value
    if value is not None and not _is_bytes(item):
        return words.value(value)
    return words.octets(item.data or b"")


def _is_bytes(item: ItemRecord) -> bool:
    """Return whether an item is plain bytes, which are shown in hexadecimal."""
    return item.transport_size == BYTE and len(item.data or b"") > 1


def outcome(transaction: Transaction) -> str:
    """Return the outcome of a transaction in few words."""
    exchange = transaction.exchange
    if transaction.outcome == "unanswered":
        if transaction.certainty:  # the answer was not captured
            return PERHAPS_ANSWERED if transaction.certainty == LIKELY else REASON_TEXTS[HOLE]
        return f"unanswered: {REASON_TEXTS.get(transaction.reason, transaction.reason)}"
    if transaction.outcome == OUTCOMES[BEHIND_MALFORMED]:
        return REASON_TEXTS[MALFORMED_HEADER]
    if exchange.error_code:
        return f"refused: {code_text(exchange.error_code, exchange.error, 4)}"
    if exchange.refusing_code != NOT_REFUSED:
        return f"refused: {code_text(exchange.refusing_code, RETURN_CODES.name(exchange.refusing_code))}"
    if transaction.outcome == "orphan_answer":
        return "an answer without a request"
    if transaction.outcome == "unsolicited":
        return "a message that expects no answer"
    items = exchange.items
    if len(items) == 1:
        return item_state(items[0])
    refused = len([item for item in items if item.refused])
    return f"answered, {refused} of {len(items)} items refused" if refused else "answered"


def value_change(was: ItemRecord, is_: ItemRecord) -> tuple[str, str, str]:
    """Return the description of a changed value, and both values; for arrays only the elements that differ."""
    old, new = was.value, is_.value
    hexadecimal = _is_bytes(was) or _is_bytes(is_)
    if isinstance(old, list) and isinstance(new, list) and len(old) == len(new):
        return _bytes(was.data or b"", is_.data or b"") if hexadecimal else _elements(old, new)
    if hexadecimal or old is None or new is None or words.value(old) == words.value(new):
        first, second = octets_change(was.data or b"", is_.data or b"")
    else:
        first, second = words.value(old), words.value(new)
    return f"was {first}, is {second}", first, second


def _elements(old: Elements, new: Elements) -> tuple[str, str, str]:
    changed = [at for at in range(len(new)) if repr(old[at]) != repr(new[at])]
    changes = [f"element {at} was {words.value(old[at])}, is {words.value(new[at])}" for at in changed[:_ELEMENTS]]
    more = f" and {len(changed) - _ELEMENTS} more of {len(new)}" if len(changed) > _ELEMENTS else ""
    was, is_ = words.value(old), words.value(new)
    if was == is_:  # they differ after the part of an array that is shown
        was, is_ = (
            ", ".join([f"element {at} = {words.value(each[at])}" for at in changed[:_ELEMENTS]]) for each in (old, new)
        )
    return "; ".join(changes) + more, was, is_


def _bytes(old: bytes, new: bytes) -> tuple[str, str, str]:
    """Return the same for arrays of bytes of equal length, in hexadecimal as everywhere."""
    changed = [at for at in range(min(len(old), len(new))) if old[at] != new[at]]
    changes = [f"byte {at} was {old[at]:02x}, is {new[at]:02x}" for at in changed[:_ELEMENTS]]
    more = f" and {len(changed) - _ELEMENTS} more of {len(new)}" if len(changed) > _ELEMENTS else ""
    was, is_ = octets_change(old, new)
    return "; ".join(changes) + more, was, is_


def octets_change(was: bytes, is_: bytes) -> tuple[str, str]:
    """Return both in hexadecimal; long ones from where they begin to differ."""
    if max(len(was), len(is_)) <= 2 * _AROUND:
        return words.octets(was), words.octets(is_)
    shorter = min(len(was), len(is_))
    at = next((index for index in range(shorter) if was[index] != is_[index]), shorter)
    start = max(0, at - _AROUND // 2)
    excerpts = [
        f"{octets[start : start + _AROUND].hex(' ') or 'nothing'} at byte {start} of {len(octets)}"
        for octets in (was, is_)
    ]
    return excerpts[0], excerpts[1]


def short(text: str) -> str:
    """Return a text from the wire, escaped and shortened."""
    return shortened(printable(text), 120)
