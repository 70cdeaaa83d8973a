"""SCD in a transaction as lines: requests, answers, and every value by name (docs/scd-traffic.md)."""

from __future__ import annotations

from dissect.engine.transactions.payloads import ScdMessage
from dissect.engine.transactions.transaction import Transaction
from dissect.wire.text import printable


def scd_lines(transaction: Transaction) -> tuple[str, ...]:
    """Return the SCD of a transaction, one line for each message and each value in it; empty if there is none."""
    lines: list[str] = []
    for message in transaction.scd:
        half = "request" if message.side == transaction.asked_by else "answer"
        lines += [f"{half} {line}" for line in _lines(message)]
    return tuple(lines)


def _lines(scd_message: ScdMessage) -> list[str]:
    from dissect.scd.wording import row_text

    message = scd_message.message
    head = f"{printable(scd_message.binding)}: {scd_message.subject}"
    if scd_message.place:
        head += f" in {printable(scd_message.place)}"
    if message.err:
        head += f", err {message.err} {printable(scd_message.dictionary.error_text(message.err))}"
    if message.error is not None:
        head += f", not decoded: {message.error.code} {printable(message.error.detail)}"
    known = {flag for row in scd_message.values for flag in row.flags}
    odd = [flag for flag in message.flags if flag not in known]
    if odd:
        head += f" [{', '.join(odd)}]"
    return [head, *[f"  {row_text(row)}" for row in scd_message.values]]
