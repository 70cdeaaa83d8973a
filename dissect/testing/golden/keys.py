"""Keys by which transactions of two sessions are matched, from the exact request to only the kind of operation."""

from __future__ import annotations

from typing import Final

from dissect.meaning.report import words
from dissect.protocols.s7.layouts import DATA_HEAD
from dissect.protocols.s7.parameters import REQUEST
from dissect.protocols.s7.tables import (
    GROUP_BLOCKS,
    GROUP_CPU,
    READ_SZL,
    READ_VAR,
    USERDATA,
    WRITE_VAR,
)
from dissect.testing.golden.difference import DiffOptions
from dissect.testing.golden.exchange import PLUS, SCD, Exchange
from dissect.testing.golden.model import Transaction
from dissect.testing.golden.plus import plus_notes, plus_subject
from dissect.testing.golden.plus_objects import Objects
from dissect.testing.golden.writing import FORMS
from dissect.wire.text import printable, shortened, some, titled

#: Maximum number of items that a subject names, and of its characters.
_NAMED: Final = 3
_LONG: Final = 100

#: Length of the id of a partial list, at the beginning of a request for one.
_SZL_ID: Final = 2

Key = tuple[object, ...]


class Keys:
    """Computes the keys of transactions; transactions that share an exchange are evaluated once."""

    def __init__(self, options: DiffOptions) -> None:
        self._options = options
        self.objects = Objects()
        self._exact: dict[Exchange, Key] = {}
        self._loose: dict[Exchange, Key] = {}

    def exact(self, transaction: Transaction) -> Key:
        """Return the exact request without its ignored parts; for an unsolicited message, the message."""
        exchange = self.objects.stable(transaction)
        key = self._exact.get(exchange)
        if key is None:
            key = _loose(exchange) if self._partly_ignored(exchange) else _exact(exchange)
            self._exact[exchange] = key
        return transaction.asked_by, *key

    def loose(self, transaction: Transaction) -> Key:
        """Return the request without the values in it."""
        return transaction.asked_by, *self._loose_key(self.objects.stable(transaction))

    def _loose_key(self, exchange: Exchange) -> Key:
        key = self._loose.get(exchange)
        if key is None:
            key = (*_loose(exchange), _request_target(exchange))
            self._loose[exchange] = key
        return key

    def _partly_ignored(self, exchange: Exchange) -> bool:
        """Return whether a part of the request is ignored, so that it must not affect the matching."""
        options = self._options
        if exchange.function == WRITE_VAR and options.mentions("values", "time"):
            return any(
                [
                    options.ignores(kind, item.address, item.label)
                    for item in exchange.items
                    for kind in ("values", "time")
                ]
            )
        if exchange.function not in FORMS and options.mentions("contents", "time"):
            return options.ignores("contents", exchange.function_name) or (
                options.mentions("time") and "clock" in exchange.function_name
            )
        return False


def _exact(exchange: Exchange) -> Key:
    if exchange.kind == SCD:
        return SCD, tuple([line for line in exchange.scd if line.startswith("request")]) or exchange.scd
    if exchange.request:
        return exchange.kind, exchange.request
    return "told", exchange.kind, exchange.response


def _loose(exchange: Exchange) -> Key:
    if exchange.kind == SCD:
        return SCD, exchange.scd[0].partition(" = ")[0] if exchange.scd else ""
    request = exchange.request_pdu
    if request is not None:
        return exchange.kind, request.rosctr, request.parameters.octets
    if exchange.kind == PLUS and exchange.request:
        return "asked", exchange.kind, exchange.function_name, plus_subject(exchange.request)
    return "told" if not exchange.request else "asked", exchange.kind, exchange.function_name


def _request_target(exchange: Exchange) -> bytes:
    """Return the target of a request if it is in its data: a different list or block is a different request.

    A different index of the same list is the same request with other parameters.
    """
    request = exchange.request_pdu
    head = request.parameters.userdata if request is not None and request.rosctr == USERDATA else None
    if request is None or head is None or head.type != REQUEST:
        return b""
    if head.group == GROUP_CPU and head.subfunction == READ_SZL:
        return bytes(request.data[DATA_HEAD.size : DATA_HEAD.size + _SZL_ID])
    return bytes(request.data) if head.group == GROUP_BLOCKS else b""


def action(transaction: Transaction) -> Key:
    """Return the side and the kind of operation, without its object, unless the object makes it a different request."""
    exchange = transaction.exchange
    return (
        transaction.asked_by,
        bool(exchange.request),
        exchange.kind,
        exchange.function_name,
        _request_target(exchange),
    )


def subject(exchange: Exchange, address: str = "") -> str:
    """Return a transaction's subject: ``READ DB10.DBW4``; for several items only ``address`` if it is given."""
    name = FORMS.get(exchange.function, "") if exchange.request_pdu is not None else ""
    if exchange.function in {READ_VAR, WRITE_VAR} and name:
        labels = [shortened(item.label, _LONG) for item in exchange.items]
        if address:
            return f"{name} {address}"
        return f"{name} {some(labels, _NAMED)}".rstrip()
    if exchange.kind == SCD:
        return shortened(exchange.scd[0].partition(" ")[2], _LONG) if exchange.scd else "SCD"
    if exchange.kind == PLUS and exchange.request:
        return titled(printable(exchange.function_name), words.some_notes(plus_notes(exchange.request)[:_NAMED]))
    note = words.some_notes(exchange.request_notes[:1]) if exchange.request_pdu is not None and not name else ""
    return titled(name or printable(exchange.function_name), note)
