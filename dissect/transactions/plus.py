"""The contents of S7comm-plus transactions: both halves, the items joined, what was refused. Read anew at each call."""

from __future__ import annotations

from dissect.s7plus.hiding import shown_half
from dissect.s7plus.items import Half, PlusItem, join_items
from dissect.s7plus.tables import PARTIAL_ERROR, RETURN_CODES
from dissect.transactions.transaction import Transaction, TransactionError
from dissect.wire.text import printable


def plus_halves(transaction: Transaction) -> tuple[Half | None, Half | None]:
    """Read request and response with their contents, without secrets; None for a half that is not there."""
    asked, told = transaction.plus_request, transaction.plus_response
    return (shown_half(asked) if asked is not None else None, shown_half(told) if told is not None else None)


def plus_items(transaction: Transaction) -> list[PlusItem]:
    """Return every item of a read, write or notification joined with its answer; empty for other functions."""
    asked, told = plus_halves(transaction)
    return join_items(asked, told, transaction.connection.plus)


def item_errors(transaction: Transaction) -> list[TransactionError]:
    """Return the refusals of single items, where not everything was refused at once."""
    if transaction.error_code and transaction.error_code != PARTIAL_ERROR:
        return []
    return [
        TransactionError(
            f"item {item.number}",
            item.return_code,
            RETURN_CODES.name(item.return_code),
            RETURN_CODES.text(item.return_code),
            printable(item.label),
        )
        for item in plus_items(transaction)
        if item.return_code > 0
    ]
