"""The certainty of a pair of request and answer as text: the mark on a line, and the sentence about omitted pairs.

`Transaction.certainty` and `Transaction.doubt` are the facts (docs/decisions/0004-pairing.md).
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Final

from dissect.engine.transactions.transaction import CONNECTION_EVICTED, DOUBT_TEXTS, Transaction
from dissect.wire.text import count

#: Why a pair is only likely, in a few words for the end of a line.
SHORT: Final[dict[str, str]] = {"gaps": "gaps in both directions", "alike": "fits several requests"}


def mark(transaction: Transaction) -> str:
    """Return the mark of a transaction that is only likely, ``(likely: fits several requests)``; empty for all others."""
    doubt = transaction.doubt
    return doubt_mark(doubt) if doubt else ""


def doubt_mark(doubt: str) -> str:
    """Return the mark for a key of `DOUBT_TEXTS`; empty for none."""
    return f"(likely: {SHORT[doubt]})" if doubt else ""


def add_doubt(doubts: dict[str, int], transaction: Transaction) -> None:
    """Count a transaction that is only likely by its doubt; do nothing for all others."""
    doubt = transaction.doubt
    if doubt:
        doubts[doubt] = doubts.get(doubt, 0) + 1


def not_captured(answers: int, reasons: Mapping[str, int]) -> str:
    """Return, as text, how many answers the capture may lack; ``reasons`` counts why requests have no answer.

    For a connection that was dropped because too many were open, the answer may be in the capture.
    """
    said = count(answers, "answer not captured", "answers not captured")
    return f"{said} or on dropped connections" if reasons.get(CONNECTION_EVICTED) else said


def left_out(doubts: Mapping[str, int]) -> str:
    """Return the sentence, without a full stop, about likely pairs that are left out of answer times; empty for none.

    ``doubts`` are their numbers, by key of `DOUBT_TEXTS`.
    """
    total = sum(doubts.values())
    return (
        f"{count(total, 'pair is', 'pairs are')} only likely and left out of answer times: {why(doubts)}"
        if total
        else ""
    )


def values_left_out(doubts: Mapping[str, int], of: str = "values") -> str:
    """Return the same sentence about transactions, pairs and pushes whose values are left out of something; empty for none."""
    total = sum(doubts.values())
    said = count(total, "transaction is", "transactions are")
    return f"{said} only likely and left out of {of}: {why(doubts)}" if total else ""


def why(doubts: Mapping[str, int]) -> str:
    """Return why transactions are only likely; if there are several reasons, how many transactions have each."""
    said = [(DOUBT_TEXTS[doubt], doubts[doubt]) for doubt in DOUBT_TEXTS if doubts.get(doubt)]
    if len(said) == 1:
        return said[0][0]
    return "; ".join([f"{text} ({number})" for text, number in said])
